"""Solves with other values of a tuned constant: `python benchmarks/constants.py plateau.steps:STALLED 0.5 0.9`.

Comments beside constants say what changes with another value. This prints it for loops of six kinds: how many
converge, the largest distance of a surface from its loop in mean edges, the largest relative change of an area, and the
CPU time. Without values, numbers are halved and doubled. A pattern such as 'plateau.harmonic*' names all constants that
match.
"""

import argparse
import ast
import importlib
import math
import pkgutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from spinor_geom import gallery
from spinor_geom.bench.cases import KNOWN, SAMPLED, known_case
from spinor_geom.bench.ragged import CUT, NOISY, ragged_hole
from spinor_geom.errors import SpinorGeomError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.solve import solve_plateau

Outcome: TypeAlias = tuple[bool, float, float]  # whether it converged, residual, area


def rim(name: str) -> BoundaryLoop:
    """The rim of a case of the suite "ragged"."""
    hole = ragged_hole(name)
    return hole.loops[hole.rim_indices[0]]


GROUPS: Mapping[str, Callable[[], list[BoundaryLoop]]] = {
    "smooth": lambda: [known_case(name).loop(64) for name in (*KNOWN, *SAMPLED) if known_case(name).kind == "smooth"],
    "corners": lambda: [known_case(name).loop(32) for name in KNOWN if known_case(name).kind != "smooth"],
    "random": lambda: [gallery.random_curve(seed).sample(64) for seed in range(60)],
    "narrow": lambda: [
        gallery.noisy_loop(gallery.ellipse(a, 0.2).sample(96), share, seed=0)
        for a in (4, 8, 16)
        for share in (0.0, 0.05)
    ],
    "cut": lambda: [rim(name) for name in CUT],
    "noisy": lambda: [rim(name) for name, (_, points) in NOISY.items() if points <= 600],
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a row for each value and group."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", metavar="MODULE:CONSTANT", help="below spinor_geom, or a pattern")
    parser.add_argument("values", nargs="*", type=ast.literal_eval, metavar="VALUE", help="Python literals")
    parser.add_argument("--groups", nargs="*", choices=GROUPS, default=tuple(GROUPS), help="kinds of loops")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only every Nth loop of a kind")
    options = parser.parse_args(arguments)
    loops = {group: GROUPS[group]()[:: options.every] for group in options.groups}
    print("| constant | value | loops | converge | largest distance | largest change of an area | CPU seconds |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    before = {group: solved(group, loops[group], None, None) for group in loops}
    for group, (outcomes, seconds) in before.items():
        print(row("as they are", "", group, outcomes, outcomes, seconds), flush=True)
    for name, value in constants(options.name):
        for other in options.values or varied(value):
            for group in loops:
                outcomes, seconds = solved(group, loops[group], name, other)
                print(row(name, repr(other), group, before[group][0], outcomes, seconds), flush=True)


def constants(pattern: str) -> Iterator[tuple[str, Any]]:
    """The constants of modules that match a pattern and are numbers, or tuples of numbers, with their values."""
    for package in ("plateau", "discrete", "meshing"):
        top = importlib.import_module(f"spinor_geom.{package}")
        for found in pkgutil.walk_packages(top.__path__, f"{top.__name__}."):
            module = importlib.import_module(found.name)
            for assignment in ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8")).body:
                for node in ast.walk(assignment) if isinstance(assignment, ast.Assign) else ():
                    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and hasattr(module, node.id):
                        name = f"{found.name.removeprefix('spinor_geom.')}:{node.id}"
                        if fnmatchcase(name, pattern):
                            yield name, getattr(module, node.id)


def varied(value: Any) -> list[Any]:
    """A number, or each of several, halved and doubled, and nothing for other values."""
    if isinstance(value, tuple) and all(isinstance(v, int | float) for v in value):
        return [(*value[:k], other, *value[k + 1 :]) for k, v in enumerate(value) for other in varied(v)]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return []
    return [max(1, value // 2), 2 * value] if isinstance(value, int) else [value / 2, 2 * value]


def solved(group: str, loops: Sequence[BoundaryLoop], name: str | None, value: Any) -> tuple[list[Outcome], float]:
    """The outcomes of a group of loops and their CPU seconds, in a process of its own, so that nothing is cached."""
    with get_context("fork").Pool(1) as pool:
        return pool.apply(_solved, (loops, name, value))


def _solved(loops: Sequence[BoundaryLoop], name: str | None, value: Any) -> tuple[list[Outcome], float]:
    if name is not None:
        module, constant = name.split(":")
        original = getattr(importlib.import_module(f"spinor_geom.{module}"), constant)
        for other in [m for m in sys.modules.values() if getattr(m, "__name__", "").startswith("spinor_geom")]:
            if vars(other).get(constant) is original:
                setattr(other, constant, value)
    start = time.process_time()
    return [_outcome(loop) for loop in loops], time.process_time() - start


def _outcome(loop: BoundaryLoop) -> Outcome:
    try:
        solution = solve_plateau(loop, time_limit=60.0)
    except SpinorGeomError:
        return False, math.inf, math.nan
    return solution.converged, solution.boundary_residual.rms_per_edge, solution.area


def row(name: str, value: str, group: str, before: Sequence[Outcome], after: Sequence[Outcome], seconds: float) -> str:
    """A row of the table."""
    changes = [abs(a[2] / b[2] - 1) for a, b in zip(after, before, strict=True)]
    kept = f"{sum(converged for converged, _, _ in after)} of {len(after)}"
    largest = max(distance for _, distance, _ in after if distance < math.inf)
    figures = f"{largest:.1e} | {np.nanmax(changes):.1e} | {seconds:.1f}"
    return f"| {name} | {value} | {group} | {kept} | {figures} |"


if __name__ == "__main__":
    main()
