"""`spinor-geom compare`: compares exact minimal surfaces over a mesh's loops with discrete ones or a given mesh."""

import argparse
import json
from typing import Any

from spinor_geom.cli.console import ExitStatus, complain, progress, show_lines
from spinor_geom.cli.source import read_surface, require_writable
from spinor_geom.comparison import Comparison, compare
from spinor_geom.errors import OptionError, SpinorGeomError
from spinor_geom.files import write_text
from spinor_geom.fill.loop_choice import boundary_loops, chosen_indices
from spinor_geom.render.page import require_html


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Compares the surfaces over each chosen loop. Reports the error of a loop that cannot be compared."""
    if arguments.output is not None:
        kept = [path for path in (arguments.input, arguments.baseline) if path is not None]
        require_html(arguments.output)
        require_writable(arguments.output, *kept)
    mesh = read_surface(arguments.input, merge=arguments.merge)
    baseline = None if arguments.baseline is None else read_surface(arguments.baseline, merge=arguments.merge)
    loops = boundary_loops(mesh)
    indices = chosen_indices("all" if arguments.loop is None else arguments.loop, loops)
    if not indices:
        raise OptionError(f"{arguments.input} has no boundary loops: the mesh is closed")
    if baseline is not None and len(indices) > 1:
        raise OptionError("the mesh to compare with (--with) has one loop; choose that loop of the input with --loop")
    options: dict[str, Any] = {"target_edge_length": arguments.edge_length or "auto"}
    found: dict[str, Comparison] = {}
    with progress("comparing") as bar:
        for done, index in enumerate(indices, 1):
            try:
                found[f"loop {index}"] = compare(mesh, baseline, loop=index, **options)
            except SpinorGeomError as error:
                if len(indices) == 1:
                    raise
                complain(f"loop {index}: {error}")
            bar(done, len(indices))
    if arguments.output is not None and found:
        from spinor_geom.render.comparison_page import comparison_page

        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        write_text(arguments.output, comparison_page(found, title=f"Minimal surfaces over {arguments.input.name}"))
    if arguments.json:
        show_lines(json.dumps({name: one.to_dict() for name, one in found.items()}, indent=2), piped=True)
    else:
        show_lines("\n\n".join(f"{name}\n{one}" for name, one in found.items()), piped=True)
    return ExitStatus.DONE if len(found) == len(indices) else ExitStatus.IMPERFECT
