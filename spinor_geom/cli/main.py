"""Entry point of the command line. Slow imports come after parsing, so that --help is fast."""

import argparse
import gc
import importlib
import io
import math
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeAlias

from spinor_geom.batching.settings import FORMAT, WHAT
from spinor_geom.errors import HiddenTextureWarning, ImperfectFillWarning, SpinorGeomError, UncertainGradientWarning
from spinor_geom.experiments import NAMES as EXPERIMENTS
from spinor_geom.files import MESH_SUFFIXES
from spinor_geom.fill.fill_options import CLOSING, CONTINUITIES, ISLANDS, TIME_LIMIT

_MODULES = {  # of the commands that have no module of the same name
    **dict.fromkeys(("view", "render", "morph"), "pictures"),
    **dict.fromkeys(("batch", "bench", "reproduce"), "runs"),
}
_UNUSABLE = "2: invalid arguments or input, or a file cannot be written"


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line (`argv` without the program's name, by default `sys.argv`) and returns the exit status."""
    if argv is None:  # a process of its own, which removes its temporary files when it is asked to end, too
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # closed by the shell. The next opened file would get its descriptor
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - open until the end
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # ? for characters that the terminal cannot show
    try:
        try:
            arguments = build_parser().parse_args(argv)
        finally:
            sys.stdout.flush()  # after --help and --version
        # imported modules are never garbage. Collections would take half a second, now and at exit
        gc.disable()
        command = importlib.import_module(f"spinor_geom.cli.{_MODULES.get(arguments.command, arguments.command)}")
        gc.freeze()
        gc.enable()
        with warnings.catch_warnings():
            # warnings of libraries are no sentences for users. -W and PYTHONWARNINGS show them
            for category in (HiddenTextureWarning, ImperfectFillWarning, UncertainGradientWarning):
                warnings.simplefilter("default", category, append=True)
            warnings.simplefilter("ignore", append=True)
            console = importlib.import_module("spinor_geom.cli.console")
            warnings.showwarning = lambda message, *_, **__: console.complain(str(message))
            return int(command.run(arguments))
    except (SpinorGeomError, OSError, MemoryError, KeyboardInterrupt) as error:
        return int(importlib.import_module("spinor_geom.cli.console").report_error(error))


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = _Parser(
        prog="spinor-geom",
        description="Fills holes of meshes with exact minimal surfaces.",
        epilog="exit status: 0: success; 1: finished, but some results need a check, see standard error; "
        f"{_UNUSABLE}; 130: interrupted. The help of each command defines its statuses 0 and 1.",
    )
    version = "print the version and exit"
    parser.add_argument("--version", action=_Version, nargs=0, default=argparse.SUPPRESS, help=version)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    surfaces = (_add_fill, _add_edit, _add_solve, _add_membrane, _add_loops, _add_compare)
    for add in (*surfaces, _add_reproduce, _add_bench, _add_batch, _add_morph, _add_pictures):
        add(commands)
    return parser


class _Parser(argparse.ArgumentParser):
    """Suggests the nearest option or choice for a mistyped one. The value of `--merge` is optional."""

    def error(self, message: str) -> NoReturn:
        """Ends with one sentence. The usage of a command would hide it."""
        self.exit(2, f"{self.prog}: error: {message}; {self.prog} --help lists the arguments\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parses the arguments. An unknown option is an error that suggests the nearest option of the command."""
        texts = list(sys.argv[1:] if args is None else args)
        if _MERGE in self._option_strings():
            texts = _with_merge_values(texts)
        texts = _with_joined_numbers(texts)
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
    """Replaces each `--merge` without a number by `--merge=rounding`. Argparse would use a file name as its value."""
    end = texts.index("--") if "--" in texts else len(texts)
    following = [*texts[1:], ""]
    return [
        f"{text}={_ROUNDING}"
        if len(text) > 2 and _MERGE.startswith(text) and place < end and not _DECIMAL.fullmatch(following[place])
        else text
        for place, text in enumerate(texts)
    ]


def _with_joined_numbers(texts: Sequence[str]) -> list[str]:
    """Joins the numbers after an option of loops: `--loop 0 2` becomes `--loop 0,2`."""
    found, is_value = [""], False
    for text in texts:
        is_numbers = _NUMBERS.fullmatch(text) is not None
        if is_value and is_numbers:
            found[-1] += f",{text}"
            continue
        is_value = is_numbers and found[-1] in _OF_LOOPS
        found.append(text)
    return found[1:]


def _suggestion(text: str, known: Sequence[str]) -> str:
    import difflib  # only for a mistyped name

    near = difflib.get_close_matches(text, known, 1)
    return f"; did you mean {near[0]}?" if near else ""


class _Version(argparse.Action):
    """Prints the version, which is computed only on demand."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from spinor_geom.version import program_version

        sys.stdout.write(f"spinor-geom {program_version()}\n")
        parser.exit()


def _checked(parse: Callable[[str], Any], what: str, is_valid: Callable[[Any], bool]) -> Callable[[str], Any]:
    """An argparse type that parses and checks a text."""

    def read(text: str) -> Any:
        try:
            value = parse(text)
            if is_valid(value):
                return value
        except ValueError:
            pass
        raise argparse.ArgumentTypeError(f"{text!r} is not {what}")

    return read


def _bytes(text: str) -> int:
    ((number, unit),) = re.findall(r"^([\d.]+)([kmgt]?)i?b?$", text.lower())
    return int(float(number) * 2.0 ** (10 * " kmgt".index(unit or " ")))


def _range(text: str) -> range:
    """The numbers of "3" or "2-9"."""
    first, _, last = text.partition("-")
    numbers = range(int(first), int(last or first) + 1)
    if not 0 < len(numbers) <= _MOST_LOOPS:
        raise ValueError
    return numbers


def _path(metavar: str) -> dict[str, Any]:
    return {"metavar": metavar, "type": Path}


_Commands: TypeAlias = "argparse._SubParsersAction[_Parser]"
_positive = _checked(float, "a positive number", lambda x: 0 < x < math.inf)
_from_zero = _checked(float, "a number of at least 0", lambda x: 0 <= x < math.inf)
_MOST_LOOPS = 1_000_000  # in a range
_OF_LOOPS, _NUMBERS = ("--loop", "--film", "--smooth", "--bridge"), re.compile(r"\d[\d,-]*")  # options, their values
_MERGE, _ROUNDING = "--merge", "rounding"  # the option, and its value if no number is given
_DECIMAL = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?|nan|-?inf", re.IGNORECASE)
_FORMATS = ", ".join(suffix[1:] for suffix in MESH_SUFFIXES)
_FLAG: dict[str, Any] = {"action": "store_true"}
_LENGTH: dict[str, Any] = {"metavar": "LENGTH", "type": _positive}
_CLOSING: dict[str, Any] = {"metavar": "T", "type": _from_zero, "default": CLOSING} | {
    "help": "close curves with a gap of at most T mean edge lengths (default: %(default)s)"
}
_SECONDS: dict[str, Any] = {"metavar": "S", "type": _positive}
_COUNT: dict[str, Any] = {"metavar": "N", "type": _checked(int, "a whole number of at least 1", lambda n: n > 0)}
_NAMES: dict[str, Any] = {"metavar": "NAME[,NAME…]", "type": lambda text: tuple(filter(None, text.split(",")))}
_SIZE: dict[str, Any] = {"metavar": "SIZE", "type": _checked(_bytes, "a size such as 512M or 4G", lambda n: n > 0)}
_merge_distance = _checked(
    lambda text: text == _ROUNDING or float(text), "a number of at least 0", lambda within: 0 <= within < math.inf
)
_MERGING: dict[str, Any] = {"metavar": "TOL", "nargs": "?", "default": False, "type": _merge_distance} | {
    "help": "first merge vertices at most TOL apart (mesh units); without TOL, those equal up to rounding (STL: always)"
}
_loops = _checked(
    lambda text: [number for part in text.split(",") for number in _range(part)],
    "a list of numbers such as 0,2,5-8 or 0 2; loops are numbered from 0",
    lambda numbers: True,
)
_LOOP: dict[str, Any] = {"metavar": "N[,N…]", "type": _loops, "action": "extend"}
_pixels = _checked(
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
    fill = commands.add_parser(
        "fill",
        help="fill the holes of a mesh file",
        epilog="exit status: 0: every requested loop was closed, and no patch intersects itself, the mesh or another "
        "patch; 1: a requested loop is still open, a patch has intersections, or with --strict a patch is discrete or "
        f"exceeds the tolerance, see standard error; {_UNUSABLE}",
    )
    add = fill.add_argument
    _add_input(add)
    add("-o", "--output", **_path("OUT"), required=True, help="filled mesh; the suffix selects the format")
    _add_filling(fill)
    fill.set_defaults(continuity=None)  # unlike "c0" it does not name all loops
    named = "fill these loops, and of the others only those of --loop or, with --continuity, all"
    add("--film", **_LOOP, help=f"continuity C0 for these loops; {named}")
    add("--smooth", **_LOOP, help="continuity C1 for these loops; otherwise as --film")
    add("--report", **_path("JSON"), help="write a JSON report")
    add("--html", **_path("HTML"), help="write an HTML page that shows the filled mesh")
    add("--quiet", **_FLAG, help="no counts and filled loops on standard error when standard output is not a terminal")
    add("--picture", **_path("PNG"), help="draw the mesh before and after filling, facing the largest patch")


def _add_edit(commands: _Commands) -> None:
    add = commands.add_parser(
        "edit",
        help="point at the holes of a mesh file in a window, see their patches, and save",
        epilog="exit status: 0: nothing was saved, or every chosen loop was closed without intersections; 1: a chosen "
        f"loop is still open, or a patch has intersections; {_UNUSABLE}, or there is no display",
    ).add_argument
    _add_input(add)
    add("-o", "--output", **_path("OUT"), help="filled mesh (default: IN with _filled added to its name)")


def _add_filling(parser: argparse.ArgumentParser) -> None:
    """The options of `fill` and `batch`: which loops are filled, and how."""
    add = parser.add_argument
    only = "fill only these loops (indices from 'spinor-geom loops'), also borders of sheets; may be repeated"
    add("--loop", **_LOOP, help=f"{only} (default: all holes)")
    together = "connect these loops by one surface, and fill only those others that are named; may be repeated"
    add("--bridge", metavar="I,J[,K…]", type=_loops, action="append", help=together)
    loose = "loose pieces in a hole: connect them to its rim (join), or fill each loop separately (ignore, default)"
    add("--islands", choices=ISLANDS, default="ignore", help=loose)
    minimal = "C0 or film: minimal surfaces, which meet the mesh at an angle (default)"
    smooth = "C1 or smooth: patches that continue the tangents and curvature of the mesh"
    better = "auto: smooth, except where the film meets the mesh at more than 65 degrees"
    add("--continuity", type=str.lower, choices=CONTINUITIES, default="c0", help=f"{minimal}; {smooth}; {better}")
    residual = "largest RMS boundary residual, relative to the mean edge length of the loop (default: %(default)s)"
    add("--tolerance", metavar="T", type=_positive, default=1e-3, help=residual)
    add("--keep-largest", **_FLAG, help="leave the longest loop open")
    add("--max-perimeter", **_LENGTH, help="leave loops of a larger perimeter open")
    add("--edge-length", **_LENGTH, help="target edge length of the patches (default: mean edge length of each loop)")
    late = "seconds for each loop, half of them for its exact surface; see docs/limits.md (default: %(default)g)"
    add("--time-limit", **_SECONDS, default=TIME_LIMIT, help=late)
    add("--strict", **_FLAG, help="exit with 1 also if a patch is discrete or exceeds the tolerance")
    add("--compare", **_FLAG, help="compare each exact patch with a discrete minimal surface")


def _add_input(add: Callable[..., Any]) -> None:
    add("input", **_path("IN"), help=f"mesh file: {_FORMATS}")
    add(_MERGE, **_MERGING)


def _add_solve(commands: _Commands) -> None:
    add = commands.add_parser(
        "solve",
        help="write the minimal surface over closed curves as CAD data (NURBS) or a mesh",
        epilog="exit status: 0: the surface follows the curves and the patches follow the surface; 1: one of them "
        f"exceeds its tolerance, see standard error; {_UNUSABLE}, or no connected surface spans the curves",
    ).add_argument
    edges = "CAD file (edges that belong to no face, or else the free boundary of the faces)"
    add("input", **_path("CURVE"), help=f"{edges}, OBJ file of closed curves, or a mesh whose rims are spanned")
    only = "only these boundary loops of a mesh (indices from 'spinor-geom loops') or curves (CAD files: longest first)"
    add("--loop", **_LOOP, help=f"{only}; several bound one surface (default: all curves, or the only loop of a mesh)")
    add("--closing", **_CLOSING)
    _add_film(add, "mean edges (default: 1e-3, CAD edges: 1e-6)", TIME_LIMIT)


def _add_film(add: Callable[..., Any], unit: str, seconds: float) -> None:
    formats = f"CAD file: .step, .stp, .igs, .iges or .brep; mesh file: {_FORMATS}"
    add("-o", "--output", **_path("OUT"), required=True, help=formats)
    thick = "write a watertight mesh, the surface thickened by half of T to both sides (mesh units)"
    add("--thickness", **_LENGTH | {"metavar": "T"}, help=thick)
    add("--edge", choices=("rounded", "straight"), default="rounded", help="edge of the solid (default: %(default)s)")
    add("--edge-length", **_LENGTH, help="target edge length of a mesh (default: mean edge length of the curves)")
    near = f"largest RMS distance of the surface from the curves, in {unit}"
    add("--tolerance", metavar="T", type=_positive, help=near)
    patches = "largest distance of the patches from the surface, in diagonals of the curves (default: %(default)s)"
    add("--deviation", metavar="D", type=_positive, default=1e-6, help=patches)
    late = "seconds for the surface, and as many for its patches, the best of which are written (default: %(default)g)"
    add("--time-limit", **_SECONDS, default=seconds, help=late)
    unit_of = "unit of curves and meshes (default: mm); CAD files contain theirs"
    add("--unit", choices=("mm", "cm", "m", "in"), help=unit_of)


def _add_membrane(commands: _Commands) -> None:
    add = commands.add_parser(
        "membrane",
        help="write the film inside a frame of cables, fixed edges and planes of symmetry",
        epilog="exit status: 0: the film was written and its forces balance; 1: the file or the balance exceeds its "
        f"tolerance, see standard error; {_UNUSABLE}, or there is no equilibrium. Prints cables and forces as JSON.",
    ).add_argument
    add("input", **_path("FRAME"), help="JSON or STEP file of the edges, see docs/membranes.md and docs/cad.md")
    _add_film(add, "mean edges (default: 1e-4)", 60.0)
    add("--html", **_path("HTML"), help="write a page with the film to turn, its cables and the forces of the supports")


def _add_loops(commands: _Commands) -> None:
    add = commands.add_parser("loops", help="list the boundary loops of a mesh file").add_argument
    _add_input(add)
    add("--json", **_FLAG, help="print JSON")
    add("--picture", **_path("PNG"), help="draw the mesh from two sides, with numbered loops")
    add("--html", **_path("HTML"), help="write a page with the mesh to turn, its numbered loops and the table")


def _add_compare(commands: _Commands) -> None:
    add = commands.add_parser(
        "compare",
        help="compare exact minimal surfaces with discrete ones or with a given mesh",
        epilog=f"exit status: 0: every chosen loop was compared; 1: some were not, see standard error; {_UNUSABLE}",
    ).add_argument
    _add_input(add)
    only = "only these loops (indices from 'spinor-geom loops'); may be repeated (default: all)"
    add("--loop", **_LOOP, help=only)
    own = "filled mesh or patch to compare with (default: a discrete minimal surface)"
    add("--with", dest="baseline", **_path("MY_MESH"), help=own)
    add("--edge-length", **_LENGTH, help="edge length of computed meshes (default: mean edge length of each loop)")
    add("--json", **_FLAG, help="print JSON")
    add("-o", "--output", **_path("HTML"), help="write an HTML page with the results and both meshes")


def _add_reproduce(commands: _Commands) -> None:
    add = commands.add_parser(
        "reproduce",
        help="run the experiments of the paper",
        epilog="exit status: 0: all experiments agree with the paper; 1: some do not, see the report; "
        f"{_UNUSABLE}. Repeat the command to continue an interrupted run; remove the folder to start again.",
    ).add_argument
    add("names", metavar="NAME", nargs="*", help=f"experiments: {', '.join(EXPERIMENTS)} (default: all)")
    add("--quick", **_FLAG, help="fewer epochs and coarser grids; the report lists what was shortened")
    add("-o", "--output", **_path("DIR"), required=True, help="folder for the report, data and pictures")


def _add_bench(commands: _Commands) -> None:
    add = commands.add_parser(
        "bench",
        help="compare exact minimal surfaces with discrete ones and with other hole fillers",
        epilog="exit status: 0: every promise is met; 1: some are missed, see standard error; "
        f"{_UNUSABLE}. Repeat the command to continue an interrupted run.",
    ).add_argument
    add("-o", "--output", **_path("DIR"), required=True, help="folder of the run")
    add("--quick", **_FLAG, help="a few cases of each suite, one run of each tool; takes less than three minutes")
    suites = "disks, fills, odd, cut-outs, meshes, reports, cad"
    add("--suite", dest="suites", **_NAMES, help=f"suites: {suites} (default: all)")
    add("--cases", **_NAMES, help="names of cases, or patterns such as 'icosphere-*' (default: all)")
    add("--methods", **_NAMES, help="names of methods and tools (default: all)")
    add("--repeat", **_COUNT, help="timed runs per case (default: 3)")
    add("--time-limit", **_SECONDS, help="seconds for one measurement (default: 180, quick: 60)")
    add("--data", **_path("DIR"), help="folder of mesh files (default: data, if it exists)")


def _add_batch(commands: _Commands) -> None:
    batch = commands.add_parser(
        "batch",
        help="fill the holes of many mesh files, and solve for the surfaces over curves of OBJ files",
        epilog="exit status: 0: 'spinor-geom fill' would exit with 0 for every file; 1: it would not "
        "for the files in OUT/failures.log; 2: no mesh files were found, or the batch cannot start or continue",
    )
    add = batch.add_argument
    lists = "manifest (.csv with a column 'path', .jsonl) or archive (.zip, .tar, .tar.gz, ...)"
    inputs = f"mesh file ({_FORMATS}), folder (with its subfolders), glob pattern, {lists}"
    add("inputs", metavar="INPUT", nargs="+", help=inputs)
    add("-o", "--output", **_path("OUT"), required=True, help="folder of the results")
    what = "fill: patches and filled meshes; surface: patches and spinor surfaces; loops: boundary loops only"
    add("--what", choices=WHAT, default="fill", help=f"{what} (default: %(default)s)")
    add("--format", choices=FORMAT, help="format of the meshes (default: that of each input)")
    add(_MERGE, **_MERGING)
    _add_filling(batch)
    add("--pictures", **_FLAG, help="draw each filled mesh, and write a page with a scene to turn (extra 'render')")
    add("--workers", **_COUNT, help="number of worker processes (default: one per core)")
    add("--scheduler", metavar="ADDRESS", help="Dask scheduler to use instead, such as tcp://host:8786")
    add("--closing", **_CLOSING)
    add("--device", help="torch device of the batched linear algebra, such as cuda (default: the CPU, without torch)")
    add("--resume", **_FLAG, help="continue the run in OUT with the files that are not complete")
    add("--memory-limit", **_SIZE, default=4 << 30, help="memory of each worker process, such as 512M (default: 4G)")
    again = "how often a file is retried after its process crashed (default: %(default)s)"
    add("--retries", metavar="K", type=int, default=2, help=again)


def _add_morph(commands: _Commands) -> None:
    add = commands.add_parser(
        "morph",
        help="animate the associate family of a surface, such as from the catenoid to the helicoid",
        epilog=f"exit status: 0: the file was written; {_UNUSABLE}, or the surface has no associate family",
    ).add_argument
    named = "a name in the gallery, such as catenoid or enneper; an unknown name prints the list"
    add("surface", metavar="SURFACE", help=f"a saved surface (.safetensors), or {named}")
    add("-o", "--output", **_path("OUT"), required=True, help="animation (.gif, .mp4) or page with a slider (.html)")
    add("--frames", **_COUNT, default=72, help="number of frames of an animation (default: %(default)s)")


def _add_pictures(commands: _Commands) -> None:
    view = commands.add_parser(
        "view",
        help="show a mesh or a saved surface in a window",
        epilog="exit status: 0: the window was closed; 2: the file cannot be read, or there is no display",
    )
    render = commands.add_parser(
        "render",
        help="draw a mesh or a saved surface as a PNG; needs no display",
        epilog=f"exit status: 0: the picture was written; {_UNUSABLE}",
    )
    for parser in (view, render):
        add = parser.add_argument
        add("input", **_path("IN"), help=f"mesh file ({_FORMATS}), CAD file, or saved surface (.safetensors)")
        add(_MERGE, **_MERGING)
        add("--curvature", **_FLAG, help="colour by Gauss curvature (surface) or absolute mean curvature (mesh)")
        upwards = "vertical axis (default: z for STL, 3MF, CAD files and saved surfaces, y for other mesh files)"
        add("--up", choices=("y", "z"), help=upwards)
    add("-o", "--output", **_path("PNG"), required=True, help="the picture")
    add("--size", metavar="WxH", type=_pixels, default=(1200, 960), help="in pixels (default: 1200x960)")
    eye = "direction to the viewer: right, back, up (default: 1,-2,1.3); write --eye=-1,... for a negative X"
    add("--eye", metavar="X,Y,Z", type=_direction, default=(1.0, -2.0, 1.3), help=eye)


if __name__ == "__main__":
    sys.exit(main())
