"""Measures the figures that the project promises, and prints them as markdown tables beside their targets.

Each group is measured in one run and makes tables of its own:

- `curves`: Plateau's problem over curves and rims whose minimal surface is known,
- `any_loop`: loops of every kind, smooth, rough, narrow, winding and with corners,
- `random`: a hundred random closed curves,
- `solutions`: loops that bound several minimal disks,
- `rims`: annuli between two rims,
- `speed`: seconds and memory of a solve,
- `paper`: the paper's curves, network and training,
- `everyday`: rims cut along triangles, real meshes and noisy rims, beside MeshLib (`pip install '.[peers]'`),
- `meshes`: every hole of every mesh file in a folder,
- `profile`: the functions that one fill spends its time in; only where it is asked for by name.

`python benchmarks/figures.py --help` lists the options. Progress goes to standard error.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from figure_curves import curves
from figure_everyday import everyday
from figure_loops import any_loop, random_loops
from figure_meshes import SHIPPED, meshes, profile
from figure_paper import Training, paper
from figure_rims import rims
from figure_solutions import solutions
from figure_speed import speed
from figure_tables import BENCH_BEGIN, BENCH_END, CUT_OUTS_BEGIN, CUT_OUTS_END, replaced_section
from PIL import Image

from spinor_geom.bench.claims import claims
from spinor_geom.bench.cut_out_pictures import pictures
from spinor_geom.bench.cut_out_tables import cut_out_tables
from spinor_geom.bench.machine import machine, told
from spinor_geom.bench.page import JSON, TABLES, table_of
from spinor_geom.bench.runner import PICTURED, VIEWS
from spinor_geom.bench.tables import Table, claim_table
from spinor_geom.files import atomic_path

README = Path(__file__).parent / "README.md"
CUT_OUTS, PICTURE = README.with_name("cut-outs.csv"), README.parents[1] / "docs" / "cut-outs.png"
COLOURS = 128
CUT_OUT_FIELDS = (
    *("suite", "case", "kind", "method", "status", "reason", "seconds", "open_rim_edges", "new_open_edges"),
    *("old_faces_kept", "crossings", "mesh_crossings", "nonmanifold_edges", "triangles", "min_angle", "max_angle"),
    *("diameter", "distance", "vertex_distance", "surface_distance", "bend", "removed_bend"),
)
USUAL_GROUPS = ("curves", "any_loop", "random", "solutions", "rims", "speed", "paper", "everyday", "meshes")


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures the groups that were asked for; returns the exit status, 0 also where a target is missed."""
    options = parsed(arguments)
    if options.bench is not None:
        write_whole(README, with_bench(README.read_text(encoding="utf-8"), options.bench))
        return 0
    if options.cut_outs is not None:
        show_cut_outs(options.cut_outs)
        return 0
    groups: dict[str, Callable[[], list[Table]]] = {
        "curves": lambda: curves(options.only),
        "any_loop": lambda: any_loop(options.only),
        "random": lambda: random_loops(options.only),
        "solutions": lambda: solutions(options.only),
        "rims": lambda: rims(options.only, options.data),
        "speed": lambda: speed(options.only),
        "paper": lambda: paper(options.only, Training(epochs=options.epochs, checkpoint=options.checkpoint)),
        "everyday": lambda: everyday(options.only, options.data),
        "meshes": lambda: meshes(options.only, options.data),
        "profile": lambda: profile(options.profile_mesh),
    }
    parts = [told(machine())]
    for name in dict.fromkeys(options.groups or USUAL_GROUPS):
        parts += [str(table) for table in groups[name]() if table.rows]
    section = "\n\n".join(parts) + "\n"
    if options.write:
        write_whole(README, replaced_section(README.read_text(encoding="utf-8"), section))
    elif options.output is not None:
        write_whole(options.output, section)
    else:
        sys.stdout.write(section)
    return 0


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line's options."""
    parser = argparse.ArgumentParser(description="Measures the project's figures and prints them as markdown tables.")
    parser.add_argument(
        "groups", nargs="*", metavar="GROUP", help=f"{', '.join(USUAL_GROUPS)} (the default: all of these), profile"
    )
    parser.add_argument(
        "--data", type=Path, default=SHIPPED, metavar="DIR", help="folder of mesh files (default: data/)"
    )
    parser.add_argument("--only", default="", metavar="TEXT", help="only cases and mesh files with this in their names")
    parser.add_argument(
        "--profile-mesh",
        type=Path,
        default=SHIPPED / "demosthenes_low_res.obj",
        metavar="FILE",
        help="mesh that the group profile fills",
    )
    parser.add_argument(
        "--epochs", type=int, default=20, metavar="N", help="epochs of the paper's training; its 800 take over an hour"
    )
    parser.add_argument(
        "--checkpoint", type=Path, metavar="FILE", help="state of that training, from which it goes on if it is there"
    )
    parser.add_argument(
        "--bench",
        type=Path,
        metavar="RUN",
        help="measure nothing; put the tables of a run of spinor-geom bench, a folder, into benchmarks/README.md",
    )
    parser.add_argument(
        "--cut-outs",
        type=Path,
        metavar="RUN",
        help="measure nothing; put what a run of spinor-geom bench --cases cut-outs, a folder, measured into "
        "benchmarks/README.md, benchmarks/cut-outs.csv and docs/cut-outs.png",
    )
    output = parser.add_mutually_exclusive_group()
    output.add_argument("-o", "--output", type=Path, metavar="FILE", help="write there instead of standard output")
    output.add_argument("--write", action="store_true", help="replace the tables in benchmarks/README.md")
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.groups) - {*USUAL_GROUPS, "profile"})
    if unknown:
        parser.error(f"unknown group {', '.join(unknown)}; choose from {', '.join(USUAL_GROUPS)}, profile")
    if not options.data.is_dir():
        parser.error(f"{options.data} is not a folder")
    if options.write:
        # before minutes of measuring, not after
        replaced_section(README.read_text(encoding="utf-8"), "")
    return options


def with_bench(text: str, run: Path) -> str:
    """The page with the tables of a run, but for the longest, in the place of those that were there."""
    parts = (run / TABLES).read_text(encoding="utf-8").split("\n### ")
    section = "\n### ".join(part for part in parts if not part.startswith("Odd rims, in full"))
    return replaced_section(text, section, begin=BENCH_BEGIN, end=BENCH_END)


def show_cut_outs(run: Path) -> None:
    """Writes the tables of a run of cut-outs into the page, a line a measurement as CSV, and the picture."""
    left = json.loads((run / JSON).read_text(encoding="utf-8"))
    records = left["records"]
    promises = claim_table([claim for claim in claims(records) if claim.kind == "accuracy"])
    section = "\n\n".join([told(left["machine"]), *map(str, [promises, *cut_out_tables(records)])])
    page = README.read_text(encoding="utf-8")
    write_whole(README, replaced_section(page, section, begin=CUT_OUTS_BEGIN, end=CUT_OUTS_END))
    write_whole(CUT_OUTS, table_of([{name: short(r[name]) for name in CUT_OUT_FIELDS if name in r} for r in records]))
    figure = pictures([run / VIEWS / case for case in PICTURED])
    with atomic_path(PICTURE) as temporary:
        figure.savefig(temporary, dpi=80)
        Image.open(temporary).convert("RGB").quantize(COLOURS).save(temporary, optimize=True)


def short(value: object) -> object:
    """Numbers to four digits."""
    return float(f"{value:.4g}") if isinstance(value, float) else value


def write_whole(path: Path, text: str) -> None:
    """Writes a text file so that it is either whole or as it was."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
