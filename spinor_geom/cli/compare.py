"""`spinor-geom compare`: compares exact minimal surfaces over a mesh's loops with discrete ones or a given mesh."""

import argparse
import json
from typing import Any

from spinor_geom.cli.console import ExitStatus, complain, progress, show_lines
from spinor_geom.cli.source import read_surface, require_writable
from spinor_geom.comparison import Comparison, compare
from spinor_geom.errors import OptionError, SpinorGeomError
from spinor_geom.fill.loop_choice import boundary_loops, chosen_indices


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Compares the surfaces over each chosen loop; reports the error of a loop that cannot be compared."""
    if arguments.output is not None:
        kept = [path for path in (arguments.input, arguments.baseline) if path is not None]
        require_writable(arguments.output, *kept)
    mesh = read_surface(arguments.input, merge=arguments.merge)
    baseline = None if arguments.baseline is None else read_surface(arguments.baseline, merge=arguments.merge)
    loops = boundary_loops(mesh)
    places = chosen_indices("all" if arguments.loop is None else arguments.loop, loops)
    if not places:
        raise OptionError(f"{arguments.input} has no boundary loops: the mesh is closed")
    if baseline is not None and len(places) > 1:
        raise OptionError("the mesh to compare with (--with) has one loop; choose that loop of the input with --loop")
    options: dict[str, Any] = {"target_edge_length": arguments.edge_length or "auto"}
    found: dict[str, Comparison] = {}
    with progress("comparing") as bar:
        for done, place in enumerate(places, 1):
            try:
                found[f"loop {place}"] = compare(mesh, baseline, loop=place, **options)
            except SpinorGeomError as error:
                if len(places) == 1:
                    raise
                complain(f"loop {place}: {error}")
            bar(done, len(places))
    if arguments.output is not None and found:
        from spinor_geom.render.comparison_page import comparison_page

        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        comparison_page(found, arguments.output, title=f"Minimal surfaces over {arguments.input.name}")
    if arguments.json:
        show_lines(json.dumps({name: one.to_dict() for name, one in found.items()}, indent=2), piped=True)
    else:
        show_lines("\n\n".join(f"{name}\n{one}" for name, one in found.items()), piped=True)
    return ExitStatus.DONE if len(found) == len(places) else ExitStatus.IMPERFECT
