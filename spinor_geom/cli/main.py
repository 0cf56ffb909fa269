"""The command line's entry: parses arguments and runs one command. Imports nothing heavy, so that --help is quick."""

import argparse
import gc
import importlib
import io
import math
import os
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from spinor_geom.batching.settings import FORMAT, WHAT
from spinor_geom.errors import SpinorGeomError
from spinor_geom.experiments import NAMES as EXPERIMENTS
from spinor_geom.files import MESH_SUFFIXES
from spinor_geom.fill.options import CONTINUITY, ISLANDS, TIME_LIMIT

_TOGETHER = {  # commands of one module
    **dict.fromkeys(("view", "render", "morph"), "pictures"),
    **dict.fromkeys(("batch", "bench", "reproduce"), "runs"),
}
EPILOG = """exit status: 0 all was done as asked, 1 it was done, but some of it deserves a look and is named on standard
error, 2 the arguments or the input cannot be used, or a file not be written, 130 interrupted; what 0 and 1 mean for a
command stands in its own help"""
FILL_EPILOG = """exit status: 0 every requested loop was closed and no patch crosses itself, the mesh or another patch,
1 some were not or do, or with --strict some are discrete or not within the tolerance (all of these are named on
standard error), 2 the arguments or the input cannot be used, or a file not be written"""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line (`argv` without the program's name; the process's by default); gives the exit status."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # closed by the shell: a file that is opened later would get its number
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - open until the end
    if isinstance(sys.stdout, io.TextIOWrapper):  # ? for what the terminal's alphabet lacks
        sys.stdout.reconfigure(errors="replace")
    try:
        try:
            arguments = build_parser().parse_args(argv)
        finally:  # of help and version
            sys.stdout.flush()
        # what the modules make stays until the end: looking through it for garbage, as they are imported and once more
        # when the process ends, takes half a second
        gc.disable()
        # only now: the commands import torch, scipy and libigl
        command = importlib.import_module(f"spinor_geom.cli.{_TOGETHER.get(arguments.command, arguments.command)}")
        gc.freeze()
        gc.enable()
        return int(command.run(arguments))
    except (SpinorGeomError, OSError, MemoryError, KeyboardInterrupt) as error:
        return int(importlib.import_module("spinor_geom.cli.console").ended_by(error))


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = _Parser(
        prog="spinor-geom", description="Fills holes of meshes with exact minimal surfaces.", epilog=EPILOG
    )
    parser.add_argument(
        "--version", action=_Version, nargs=0, default=argparse.SUPPRESS, help="print the version and exit"
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for add in (
        _add_fill,
        _add_loops,
        _add_compare,
        _add_reproduce,
        _add_bench,
        _add_batch,
        _add_morph,
        _add_view_and_render,
    ):
        add(commands)
    return parser


class _Parser(argparse.ArgumentParser):
    """Suggests the nearest option or choice for a mistyped one; `--merge` takes numbers only."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Refuses unknown options where the options of their command are known."""
        texts = list(sys.argv[1:] if args is None else args)
        if _MERGE in self._option_strings():
            texts = _with_merge_values(texts)
        found, rest = super().parse_known_args(texts, namespace)
        if unknown := [text.partition("=")[0] for text in rest if text.startswith("-")]:
            self.error(f"unrecognized arguments: {' '.join(unknown)}{_suggestion(unknown[0], self._option_strings())}")
        return found, rest

    def _option_strings(self) -> list[str]:
        return [name for action in self._actions for name in action.option_strings]

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            error.message += _suggestion(str(value), [str(choice) for choice in action.choices or ()])
            raise


def _with_merge_values(texts: Sequence[str]) -> list[str]:
    """Arguments with `--merge=rounding` for each `--merge` that no number follows.

    argparse would take a file name that follows for the option's value.
    """
    end = texts.index("--") if "--" in texts else len(texts)
    following = [*texts[1:], ""]
    return [
        f"{text}={_ROUNDING}"
        if len(text) > 2 and _MERGE.startswith(text) and place < end and not _is_number(following[place])
        else text
        for place, text in enumerate(texts)
    ]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _suggestion(text: str, known: Sequence[str]) -> str:
    """The nearest of the known names as a question; empty where none is near."""
    import difflib  # only for a mistyped name

    near = difflib.get_close_matches(text, known, 1)
    return f"; did you mean {near[0]}?" if near else ""


class _Version(argparse.Action):
    """Prints the version; looks it up only when asked."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from spinor_geom.version import program_version

        sys.stdout.write(f"spinor-geom {program_version()}\n")
        parser.exit()


def _checked(parse: Callable[[str], Any], what: str, fits: Callable[[Any], bool]) -> Callable[[str], Any]:
    """Parses a text and refuses what is not of a kind."""

    def read(text: str) -> Any:
        try:
            value = parse(text)
            if fits(value):
                return value
        except ValueError:
            pass
        raise argparse.ArgumentTypeError(f"{text!r} is not {what}")

    return read


def _bytes(text: str) -> float:
    ((number, unit),) = re.findall(r"^([\d.]+)([kmgt]?)i?b?$", text.lower())
    return float(number) * 2.0 ** (10 * " kmgt".index(unit or " "))


def _path(metavar: str) -> dict[str, Any]:
    return {"metavar": metavar, "type": Path}


_Commands: TypeAlias = "argparse._SubParsersAction[_Parser]"
_positive = _checked(float, "a positive number", lambda x: 0 < x < math.inf)
_from_zero = _checked(float, "a number from 0 on", lambda x: 0 <= x < math.inf)
_MERGE, _ROUNDING = "--merge", "rounding"  # the option, and its value where no number is given
_FORMATS = ", ".join(suffix[1:] for suffix in MESH_SUFFIXES)
_FLAG: dict[str, Any] = {"action": "store_true"}
_LENGTH: dict[str, Any] = {"metavar": "LENGTH", "type": _positive}
_SECONDS: dict[str, Any] = {"metavar": "S", "type": _positive}
_COUNT: dict[str, Any] = {"metavar": "N", "type": _checked(int, "a number from 1 on", lambda n: n > 0)}
_NAMES: dict[str, Any] = {"metavar": "NAME[,NAME…]", "type": lambda text: tuple(filter(None, text.split(",")))}
_merge_distance = _checked(
    lambda text: text == _ROUNDING or float(text), "a number from 0 on", lambda within: 0 <= within < math.inf
)
_loops = _checked(
    lambda text: [int(part) for part in text.split(",")],
    "a list of numbers such as 0,2,5; loops are numbered from 0",
    lambda places: min(places) >= 0,
)
_size = _checked(
    lambda text: tuple(map(int, text.split("x"))),
    "a size such as 1200x960",
    lambda s: len(s) == 2 and 0 < min(s) <= max(s) <= 16384,
)
_direction = _checked(
    lambda text: tuple(map(float, text.split(","))),
    "a direction such as 1,-2,1.3",
    lambda d: len(d) == 3 and 0 < math.hypot(*d) < math.inf,
)


def _add_fill(commands: _Commands) -> None:
    fill = commands.add_parser("fill", help="fill the holes of a mesh file", epilog=FILL_EPILOG)
    add = fill.add_argument
    _add_input(add)
    add("-o", "--output", **_path("OUT"), required=True, help="filled mesh, format by its suffix")
    _add_filling(fill)
    add("--report", **_path("JSON"), help="write a report")
    add("--html", **_path("HTML"), help="write a page that shows the fill, for any browser")
    add("--quiet", **_FLAG, help="without a terminal: no line for loops that were filled as asked")
    add("--picture", **_path("PNG"), help="draw the open mesh beside the filled one, its largest patch face on")


def _add_filling(parser: argparse.ArgumentParser) -> None:
    """What `fill` and `batch` have in common: which loops are filled, and how."""
    add, which = parser.add_argument, parser.add_mutually_exclusive_group()
    only = "only these holes, as numbered by 'spinor-geom loops', borders of sheets too; may be repeated"
    which.add_argument("--loop", metavar="N[,N…]", type=_loops, action="extend", help=f"{only} (default: all holes)")
    together = "join these loops by one surface, and fill no other"
    which.add_argument("--bridge", metavar="I,J[,K…]", type=_loops, help=together)
    loose = "a loose piece in a hole: join it to the hole's rim, or fill both by themselves (default)"
    add("--islands", choices=ISLANDS, default="ignore", help=loose)
    films = "C0: minimal surfaces, which meet the mesh at the rim (default)"
    smooth = "C1: patches that go on with its tangents and curvature"
    add("--continuity", choices=CONTINUITY, default="C0", help=f"{films}; {smooth}")
    residual = "RMS boundary residual per mean edge of the loop (default: %(default)s)"
    add("--tolerance", metavar="T", type=_positive, default=1e-3, help=residual)
    add("--keep-largest", **_FLAG, help="leave the longest loop open")
    add("--max-perimeter", **_LENGTH, help="leave longer loops open")
    add("--edge-length", **_LENGTH, help="edge length of the patches (default: each loop's mean edge)")
    late = "seconds for the exact surface of each loop, after which it is closed by a discrete one"
    add("--time-limit", **_SECONDS, default=TIME_LIMIT, help=f"{late} (default: %(default)g)")
    strict = "exit with 1 too where a loop is closed by a discrete surface or not within the tolerance"
    add("--strict", **_FLAG, help=strict)
    add("--compare", **_FLAG, help="compare each fill with a discrete minimal surface")


def _add_input(add: Callable[..., Any]) -> None:
    add("input", **_path("IN"), help=f"mesh file: {_FORMATS}")
    _add_merge(add)


def _add_merge(add: Callable[..., Any]) -> None:
    near = "first merge vertices at most TOL apart, in mesh units; without TOL those of equal position up to rounding"
    add(_MERGE, metavar="TOL", nargs="?", default=False, type=_merge_distance, help=f"{near} (STL: always)")


def _add_loops(commands: _Commands) -> None:
    add = commands.add_parser("loops", help="list the boundary loops of a mesh file").add_argument
    _add_input(add)
    add("--json", **_FLAG, help="print JSON")
    add("--picture", **_path("PNG"), help="draw the mesh, before and behind, its loops numbered")


def _add_compare(commands: _Commands) -> None:
    add = commands.add_parser(
        "compare",
        help="measure exact minimal surfaces beside discrete ones, or beside a mesh of yours",
        epilog="exit status: 0 every chosen loop was compared, 1 some were not (they are named on standard error), 2 "
        "the arguments or the input cannot be used, or a file not be written",
    ).add_argument
    _add_input(add)
    only = "only these loops, as numbered by 'spinor-geom loops'; may be repeated (default: all)"
    add("--loop", metavar="N[,N…]", type=_loops, action="extend", help=only)
    mine = "mesh over one loop to compare with: the patch alone (default: a discrete minimal surface)"
    add("--with", dest="baseline", **_path("MY_MESH"), help=mine)
    add("--edge-length", **_LENGTH, help="edge length of the meshes made here (default: each loop's mean edge)")
    add("--json", **_FLAG, help="print JSON")
    add("-o", "--output", **_path("HTML"), help="write a page with the figures and both meshes, for any browser")


def _add_reproduce(commands: _Commands) -> None:
    add = commands.add_parser(
        "reproduce",
        help="run the experiments of the paper",
        epilog="exit status: 0 what the paper says was seen, 1 in some experiment it was not (the report says why), "
        "2 the arguments cannot be used. A run that was stopped goes on where it was when the same command is given "
        "again; what it has finished is measured anew where its folder is removed.",
    ).add_argument
    add("names", metavar="NAME", nargs="*", help=f"experiments: {', '.join(EXPERIMENTS)} (default: all)")
    add("--quick", **_FLAG, help="with fewer epochs and coarser grids; the report says what is shortened")
    add("-o", "--output", **_path("DIR"), required=True, help="folder of report, data and pictures")


def _add_bench(commands: _Commands) -> None:
    add = commands.add_parser(
        "bench",
        help="measure exact minimal surfaces beside discrete ones and beside hole fillers",
        epilog="exit status: 0 every promise of accuracy is kept, 1 some are not (they are named on standard error; "
        "missed times are named too, but do not count), 2 the arguments cannot be used. A run that was killed goes on "
        "where it was when the same command is given again.",
    ).add_argument
    add("-o", "--output", **_path("DIR"), required=True, help="folder of the run")
    add("--quick", **_FLAG, help="a few cases of each suite, every tool once: less than three minutes")
    beside, alone = "disks, fills, odd, cut-outs, meshes, ragged, reports", "curves, rims, speed, paper, batch"
    suites = f"{beside}: ours beside others; {alone}: ours alone (default: all)"
    add("--suite", dest="suites", **_NAMES, help=suites)
    which = "which of their cases, also by patterns as of files, for instance 'icosphere-*' (default: all)"
    add("--cases", **_NAMES, help=which)
    add("--methods", **_NAMES, help="methods and tools (default: all)")
    add("--repeat", **_COUNT, help="counted calls of each (default: 3)")
    add("--time-limit", **_SECONDS, help="seconds for one measurement (default: 180, quick: 60)")
    add("--data", **_path("DIR"), help="folder of mesh files (default: data, if it is there)")


def _add_batch(commands: _Commands) -> None:
    batch = commands.add_parser(
        "batch",
        help="fill the holes of many mesh files, and span curves",
        epilog="exit status: 0 'spinor-geom fill' would exit with 0 for every file, 1 for some it would not "
        "(OUT/failures.log names them), 2 there are no mesh files, or the batch could not start or go on",
    )
    add = batch.add_argument
    lists = "manifest (.csv with a column path, .jsonl) or archive (.zip, .tar, .tar.gz, ...)"
    add(
        "inputs",
        metavar="INPUT",
        nargs="+",
        help=f"mesh file ({_FORMATS}), folder (with all below it), pattern, {lists}",
    )
    add("-o", "--output", **_path("OUT"), required=True, help="folder of results")
    what = "fill: triangulations and filled meshes; surface: triangulations and spinor surfaces; loops: the loops alone"
    add("--what", choices=WHAT, default="fill", help=f"{what} (default: %(default)s)")
    add("--format", choices=FORMAT, help="of the meshes (default: that of each input)")
    _add_merge(add)
    _add_filling(batch)
    add("--workers", **_COUNT, help="processes that solve (default: one a core)")
    add("--scheduler", metavar="ADDRESS", help="use a running Dask cluster instead, as tcp://host:8786")
    near = "curves whose ends are at most so many mean edges apart are closed (default: %(default)s)"
    add("--closing", metavar="T", type=_from_zero, default=1e-3, help=near)
    add("--device", default="cpu", help="of the batched linear algebra (default: %(default)s)")
    add("--resume", **_FLAG, help="go on with the run in OUT: do what is not complete")
    size = _checked(lambda text: int(_bytes(text)), "a size such as 512M or 4G", lambda n: n > 0)
    memory = "of a process that solves, as 512M or 4G (default: 4G)"
    add("--memory-limit", metavar="SIZE", type=size, default=4 << 30, help=memory)
    after = "tries of a file after its process died (default: %(default)s)"
    add("--retries", metavar="K", type=int, default=2, help=after)


def _add_morph(commands: _Commands) -> None:
    add = commands.add_parser(
        "morph",
        help="turn a surface through its associate family, as the catenoid into the helicoid",
        epilog="exit status: 0 the file was written, 2 the surface has no associate family or cannot be read, or the "
        "output's format is unknown",
    ).add_argument
    named = "a name in the gallery, such as catenoid or enneper; for a name that does not exist all are listed"
    add("surface", metavar="SURFACE", help=f"a saved surface (.safetensors), or {named}")
    add("-o", "--output", **_path("OUT"), required=True, help="animation (.gif, .mp4), or page with a slider (.html)")
    add("--frames", **_COUNT, default=72, help="of an animation (default: %(default)s)")


def _add_shown(add: Callable[..., Any]) -> None:
    add("input", **_path("IN"), help=f"mesh file ({_FORMATS}) or saved surface (.safetensors)")
    _add_merge(add)
    add("--curvature", **_FLAG, help="colours tell the curvature: Gauss curvature of a surface, |H| of a mesh")


def _add_view_and_render(commands: _Commands) -> None:
    epilog = "exit status: 0 the window was closed, 2 the file cannot be read or there is no display"
    _add_shown(commands.add_parser("view", help="open a window with a mesh or a surface", epilog=epilog).add_argument)
    add = commands.add_parser(
        "render",
        help="draw a mesh or a surface as a PNG, without a display",
        epilog="exit status: 0 the picture was written, 2 the file cannot be read or the picture not be drawn",
    ).add_argument
    _add_shown(add)
    add("-o", "--output", **_path("PNG"), required=True, help="the picture")
    add("--size", metavar="WxH", type=_size, default=(1200, 960), help="in pixels (default: 1200x960)")
    towards = "direction to the eye: right, backwards, up (default: 1,-2,1.3); write --eye=-1,... for a negative X"
    add("--eye", metavar="X,Y,Z", type=_direction, default=(1.0, -2.0, 1.3), help=towards)
    add("--up", choices=("y", "z"), help="axis that points upwards (default: y for mesh files, z for saved surfaces)")


if __name__ == "__main__":
    sys.exit(main())
