"""The command line's entry: parses arguments and runs one command. Imports nothing heavy, so that --help is quick."""

from __future__ import annotations

import argparse
import gc
import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from spinor_geom.batching.options import FORMAT, WHAT
from spinor_geom.errors import SpinorGeomError
from spinor_geom.experiments import NAMES as EXPERIMENTS
from spinor_geom.fill.continuity import CONTINUITY

EPILOG = """exit status: 0 all was done as asked, 1 it was done, but some of it deserves a look and is named on standard
error, 2 the arguments or the input cannot be used, or a file not be written, 130 interrupted; what 0 and 1 mean for a
command stands in its own help"""
FILL_EPILOG = """exit status: 0 every requested loop was closed and no patch crosses itself, the mesh or another patch,
1 some were not or do, or with --strict some are discrete or not within the tolerance (all of these are named on
standard error), 2 the arguments or the input cannot be used, or a file not be written"""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line.

    Args:
        argv: the arguments without the program's name; those of the process by default.

    Returns:
        The exit status.
    """
    arguments = build_parser().parse_args(argv)
    # what the modules make stays until the end: looking through it for garbage, as they are imported and once more when
    # the process ends, takes half a second
    gc.disable()
    # only now: the commands import torch, scipy and libigl
    command = importlib.import_module(f"spinor_geom.cli.{arguments.command}")
    console = importlib.import_module("spinor_geom.cli.console")
    gc.freeze()
    gc.enable()
    try:
        status = int(command.run(arguments))
        console.flush()
        return status
    except BrokenPipeError:
        # the reader of our output has seen enough
        console.close_output()
        return int(console.ExitStatus.DONE)
    except (SpinorGeomError, OSError) as error:
        console.complain(console.sentence(error))
        console.close_output()
        return int(console.ExitStatus.BAD_INPUT)
    except KeyboardInterrupt:
        console.complain("interrupted")
        return int(console.ExitStatus.INTERRUPTED)


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="spinor-geom", description="Fills holes of meshes with exact minimal surfaces.", epilog=EPILOG
    )
    parser.add_argument(
        "--version", action=_Version, nargs=0, default=argparse.SUPPRESS, help="print the version and exit"
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    _add_fill(commands)
    _add_loops(commands)
    _add_reproduce(commands)
    _add_bench(commands)
    _add_batch(commands)
    _add_morph(commands)
    _add_view(commands)
    _add_render(commands)
    return parser


class _Version(argparse.Action):
    """Prints the version; looks it up only when asked."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from spinor_geom.version import program_version

        sys.stdout.write(f"spinor-geom {program_version()}\n")
        parser.exit()


def _add_fill(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    fill = commands.add_parser("fill", help="fill the holes of a mesh file", epilog=FILL_EPILOG)
    add = fill.add_argument
    _add_input(add)
    add("-o", "--output", metavar="OUT", type=Path, required=True, help="filled mesh, format by its suffix")
    which = fill.add_mutually_exclusive_group()
    which.add_argument(
        "--loop",
        metavar="N[,N…]",
        type=_places,
        action="extend",
        help="only these holes, as numbered by 'spinor-geom loops', borders of sheets too; may be repeated (default: "
        "all holes)",
    )
    which.add_argument(
        "--bridge", metavar="I,J[,K…]", type=_places, help="join these loops by one surface, and fill no other"
    )
    add(
        "--islands",
        choices=("join", "ignore"),
        default="ignore",
        help="a loose piece in a hole: join it to the hole's rim, or fill both by themselves (default)",
    )
    _add_quality(add)
    add("--keep-largest", action="store_true", help="leave the longest loop open")
    add("--max-perimeter", metavar="LENGTH", type=_positive, help="leave longer loops open")
    add(
        "--edge-length",
        metavar="LENGTH",
        type=_positive,
        help="edge length of the patches (default: each loop's mean edge)",
    )
    add(
        "--time-limit",
        metavar="S",
        type=_positive,
        default=20.0,
        help="seconds for the exact surface of each loop, after which it is closed by a discrete one (default: "
        "%(default)g)",
    )
    add(
        "--strict",
        action="store_true",
        help="exit with 1 too where a loop is closed by a discrete surface or not within the tolerance",
    )
    add("--report", metavar="JSON", type=Path, help="write a report")
    add("--html", metavar="HTML", type=Path, help="write a page that shows the fill, for any browser")
    add("--compare", action="store_true", help="compare each fill with a discrete minimal surface")
    add(
        "--picture",
        metavar="PNG",
        type=Path,
        help="draw the open mesh beside the filled one, its largest patch face on",
    )


def _add_quality(add: Callable[..., Any]) -> None:
    add(
        "--continuity",
        choices=CONTINUITY,
        default="C0",
        help="C0: minimal surfaces, which meet the mesh at the rim (default); C1: patches that go on with its tangents "
        "and curvature",
    )
    add(
        "--tolerance",
        metavar="T",
        type=_positive,
        default=1e-3,
        help="RMS boundary residual per mean edge of the loop (default: %(default)s)",
    )


def _add_input(add: Callable[..., Any]) -> None:
    add("input", metavar="IN", type=Path, help="mesh file: obj, ply, stl, off, glb, vtp, vtk, 3mf")
    add("--merge", action="store_true", help="first merge vertices of equal position (those of STL files always are)")


def _add_loops(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    add = commands.add_parser("loops", help="list the boundary loops of a mesh file").add_argument
    _add_input(add)
    add("--json", action="store_true", help="print JSON")
    add("--picture", metavar="PNG", type=Path, help="draw the mesh, before and behind, its loops numbered")


def _add_reproduce(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    add = commands.add_parser(
        "reproduce",
        help="run the experiments of the paper",
        epilog="exit status: 0 what the paper says was seen, 1 in some experiment it was not (the report says why), "
        "2 the arguments cannot be used. A run that was stopped goes on where it was when the same command is given "
        "again; what it has finished is measured anew where its folder is removed.",
    ).add_argument
    add("names", metavar="NAME", nargs="*", help=f"experiments: {', '.join(EXPERIMENTS)} (default: all)")
    add("--quick", action="store_true", help="with fewer epochs and coarser grids; the report says what is shortened")
    add("-o", "--output", metavar="DIR", type=Path, required=True, help="folder of report, data and pictures")


def _add_bench(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    add = commands.add_parser(
        "bench",
        help="measure exact minimal surfaces beside discrete ones and beside hole fillers",
        epilog="exit status: 0 every promise of accuracy is kept, 1 some are not (they are named on standard error; "
        "missed times are named too, but do not count), 2 the arguments cannot be used. A run that was killed goes on "
        "where it was when the same command is given again.",
    ).add_argument
    add("-o", "--output", metavar="DIR", type=Path, required=True, help="folder of the run")
    add("--quick", action="store_true", help="a few cases of each suite, every tool once: less than three minutes")
    add(
        "--suite",
        dest="suites",
        metavar="NAME[,NAME…]",
        type=_names,
        help="disks, fills, odd, cut-outs, meshes, ragged: ours beside others; curves, rims, speed, paper, batch: "
        "ours alone (default: all)",
    )
    add(
        "--cases",
        metavar="NAME[,NAME…]",
        type=_names,
        help="which of their cases, also by patterns as of files, for instance 'icosphere-*' (default: all)",
    )
    add("--methods", metavar="NAME[,NAME…]", type=_names, help="methods and tools (default: all)")
    add("--repeat", metavar="N", type=_count, help="counted calls of each (default: 3)")
    add("--time-limit", metavar="S", type=_positive, help="seconds for one measurement (default: 180, quick: 60)")
    add("--data", metavar="DIR", type=Path, help="folder of mesh files (default: data, if it is there)")


def _names(text: str) -> list[str]:
    return [name for name in text.split(",") if name]


def _add_batch(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    add = commands.add_parser(
        "batch",
        help="solve the boundary loops of many OBJ files",
        epilog="exit status: 0 every loop of every file was done within the tolerance and crosses nothing, 1 some were "
        "not (OUT/failures.log names them), 2 the batch could not start or go on",
    ).add_argument
    add(
        "inputs",
        metavar="INPUT",
        nargs="+",
        help="OBJ file, folder (with all below it), pattern, manifest (.csv with a column path, .jsonl) or archive "
        "(.zip, .tar, .tar.gz, ...)",
    )
    add("-o", "--output", metavar="OUT", type=Path, required=True, help="folder of results")
    add(
        "--what",
        choices=WHAT,
        default="fill",
        help="fill: triangulations and filled meshes; surface: triangulations and spinor surfaces; loops: the loops "
        "alone (default: %(default)s)",
    )
    add("--format", choices=FORMAT, default="obj", help="of the meshes (default: %(default)s)")
    add("--workers", metavar="N", type=_count, help="processes that solve (default: one a core)")
    add("--scheduler", metavar="ADDRESS", help="use a running Dask cluster instead, as tcp://host:8786")
    add(
        "--edge-length",
        metavar="LENGTH",
        type=_positive,
        help="edge length of the triangulations (default: each loop's mean edge)",
    )
    _add_quality(add)
    add(
        "--closing",
        metavar="T",
        type=_from_zero,
        default=1e-3,
        help="curves whose ends are at most so many mean edges apart are closed (default: %(default)s)",
    )
    add("--compare", action="store_true", help="compare each surface with a discrete minimal surface")
    add("--device", default="cpu", help="of the batched linear algebra (default: %(default)s)")
    add("--resume", action="store_true", help="go on with the run in OUT: do what is not complete")
    add(
        "--time-limit",
        metavar="SECONDS",
        type=_positive,
        default=300.0,
        help="for reading a file and for each of its loops (default: %(default)s)",
    )
    add(
        "--memory-limit",
        metavar="SIZE",
        type=_bytes,
        default=4 << 30,
        help="of a process that solves, as 512M or 4G (default: 4G)",
    )
    add(
        "--retries",
        metavar="K",
        type=int,
        default=2,
        help="tries of a file after its process died (default: %(default)s)",
    )


def _add_morph(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    add = commands.add_parser(
        "morph",
        help="turn a surface through its associate family, as the catenoid into the helicoid",
        epilog="exit status: 0 the file was written, 2 the surface has no associate family or cannot be read, or the "
        "output's format is unknown",
    ).add_argument
    add(
        "surface",
        metavar="SURFACE",
        help="a saved surface (.safetensors), or a name in the gallery, such as catenoid or enneper; for a name that "
        "does not exist all are listed",
    )
    add(
        "-o",
        "--output",
        metavar="OUT",
        type=Path,
        required=True,
        help="animation (.gif, .mp4), or page with a slider (.html)",
    )
    add("--frames", metavar="N", type=_count, default=72, help="of an animation (default: %(default)s)")


_SHOWN = "mesh file (obj, ply, stl, off, glb, vtp, vtk, 3mf) or saved surface (.safetensors)"
_CURVATURE = "colours tell the curvature: Gauss curvature of a surface, |H| of a mesh"


def _add_view(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    add = commands.add_parser(
        "view",
        help="open a window with a mesh or a surface",
        epilog="exit status: 0 the window was closed, 2 the file cannot be read or there is no display",
    ).add_argument
    add("input", metavar="IN", type=Path, help=_SHOWN)
    add("--curvature", action="store_true", help=_CURVATURE)


def _add_render(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    add = commands.add_parser(
        "render",
        help="draw a mesh or a surface as a PNG, without a display",
        epilog="exit status: 0 the picture was written, 2 the file cannot be read or the picture not be drawn",
    ).add_argument
    add("input", metavar="IN", type=Path, help=_SHOWN)
    add("-o", "--output", metavar="PNG", type=Path, required=True, help="the picture")
    add("--curvature", action="store_true", help=_CURVATURE)
    add("--size", metavar="WxH", type=_size, default=(1200, 960), help="in pixels (default: 1200x960)")
    add(
        "--eye",
        metavar="X,Y,Z",
        type=_direction,
        default=(1.0, -2.0, 1.3),
        help="direction to the eye: right, backwards, up (default: 1,-2,1.3); write --eye=-1,... for a negative X",
    )
    add("--up", choices=("y", "z"), help="axis that points upwards (default: y for mesh files, z for saved surfaces)")


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return _count(width), _count(height)


def _direction(text: str) -> tuple[float, ...]:
    try:
        direction = tuple(float(part) for part in text.split(","))
    except ValueError:
        direction = ()
    if len(direction) != 3 or not 0 < sum(x * x for x in direction) < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a direction such as 1,-2,1.3")
    return direction


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1 on")
    return int(text)


def _bytes(text: str) -> int:
    units = {"": 0, "k": 10, "m": 20, "g": 30, "t": 40}
    size = text.lower().removesuffix("b").removesuffix("i")
    number = size.rstrip("kmgt")
    try:
        return int(_positive(number) * 2 ** units[size[len(number) :]])
    except (KeyError, argparse.ArgumentTypeError):
        raise argparse.ArgumentTypeError(f"{text!r} is not a size such as 512M or 4G") from None


def _from_zero(text: str) -> float:
    return 0.0 if text.strip("0.") == "" and text else _positive(text)


def _places(text: str) -> list[int]:
    try:
        places = [int(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a list of numbers such as 0,2,5") from None
    if min(places) < 0:
        raise argparse.ArgumentTypeError(f"{text!r} has a negative number; loops are numbered from 0")
    return places


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return value


if __name__ == "__main__":
    sys.exit(main())
