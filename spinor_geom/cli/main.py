"""The command line's entry: parses arguments and runs one command. Imports nothing heavy, so that --help is quick."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from spinor_geom.experiments import NAMES as EXPERIMENTS

EPILOG = """exit status: 0 every requested loop was filled within the tolerance and no patch crosses itself, the mesh or
another patch, 1 some were not or do (they are named on standard error), 2 the arguments or the input cannot be used"""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line.

    Args:
        argv: the arguments without the program's name; those of the process by default.

    Returns:
        The exit status.
    """
    arguments = build_parser().parse_args(argv)
    # only now: the commands import torch, scipy and libigl
    command = importlib.import_module(f"spinor_geom.cli.{arguments.command}")
    console = importlib.import_module("spinor_geom.cli.console")
    try:
        status = int(command.run(arguments))
        sys.stdout.flush()
        return status
    except console.BAD_INPUT as error:
        console.complain(console.sentence(error))
        return int(console.ExitStatus.BAD_INPUT)
    except BrokenPipeError:
        # the reader of our output has seen enough; without this the interpreter complains once more as it closes it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return int(console.ExitStatus.DONE)
    except KeyboardInterrupt:
        console.complain("interrupted")
        return int(console.ExitStatus.INTERRUPTED)


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="spinor-geom", description="Fills holes of meshes with exact minimal surfaces.", epilog=EPILOG
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    _add_fill(commands)
    _add_loops(commands)
    _add_reproduce(commands)
    return parser


class _Version(argparse.Action):
    """Prints the version; looks it up only when asked."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import version

        sys.stdout.write(f"spinor-geom {version('spinor-geom')}\n")
        parser.exit()


def _add_fill(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    fill = commands.add_parser("fill", help="fill the holes of a mesh file", epilog=EPILOG)
    fill.add_argument("input", metavar="IN", type=Path, help="mesh file: obj, ply, stl, off, glb")
    fill.add_argument(
        "-o", "--output", metavar="OUT", type=Path, required=True, help="filled mesh, format by its suffix"
    )
    fill.add_argument(
        "--loop",
        metavar="N[,N…]",
        type=_places,
        action="extend",
        help="only these holes, as numbered by 'spinor-geom loops'; may be repeated (default: all)",
    )
    fill.add_argument(
        "--bridge",
        metavar="I,J",
        type=_places,
        help="join these two loops by a surface, and fill no other",
    )
    fill.add_argument(
        "--islands",
        choices=("join", "ignore"),
        default="ignore",
        help="a loose piece in a hole: join it to the hole's rim, or fill both by themselves (default)",
    )
    fill.add_argument("--keep-largest", action="store_true", help="leave the longest loop open")
    fill.add_argument("--max-perimeter", metavar="LENGTH", type=_positive, help="leave longer loops open")
    fill.add_argument(
        "--edge-length",
        metavar="LENGTH",
        type=_positive,
        help="edge length of the patches (default: each loop's mean edge)",
    )
    fill.add_argument(
        "--tolerance",
        metavar="T",
        type=_positive,
        default=1e-3,
        help="RMS boundary residual per mean edge of the loop (default: %(default)s)",
    )
    fill.add_argument("--merge", action="store_true", help="first merge vertices of equal position (STL files need it)")
    fill.add_argument("--report", metavar="JSON", type=Path, help="write a report")
    fill.add_argument("--compare", action="store_true", help="compare each fill with a discrete minimal surface")
    fill.add_argument("--picture", metavar="PNG", type=Path, help="draw the open mesh beside the filled one")


def _add_loops(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    loops = commands.add_parser("loops", help="list the boundary loops of a mesh file")
    loops.add_argument("input", metavar="IN", type=Path, help="mesh file: obj, ply, stl, off, glb")
    loops.add_argument(
        "--merge", action="store_true", help="first merge vertices of equal position (STL files need it)"
    )
    loops.add_argument("--json", action="store_true", help="print JSON")


def _add_reproduce(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    reproduce = commands.add_parser(
        "reproduce",
        help="run the experiments of the paper",
        epilog="exit status: 0 what the paper says was seen, 1 in some experiment it was not (the report says why), "
        "2 the arguments cannot be used",
    )
    reproduce.add_argument(
        "names", metavar="NAME", nargs="*", help=f"experiments: {', '.join(EXPERIMENTS)} (default: all)"
    )
    reproduce.add_argument(
        "--quick", action="store_true", help="with fewer epochs and coarser grids; the report says what is shortened"
    )
    reproduce.add_argument(
        "-o", "--output", metavar="DIR", type=Path, required=True, help="folder of report, data and pictures"
    )


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
