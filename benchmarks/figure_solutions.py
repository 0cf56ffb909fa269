"""Loops that bound several minimal disks: whether each is found, and told apart by its verdict."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from figure_tables import Figure, figure_table, note, short_reason

from spinor_geom import BoundaryLoop, PlateauSolution, SpinorGeomError, gallery, solve_plateau
from spinor_geom.bench.tables import Table

TOLERANCE = 1e-6  # RMS distance per mean edge that loops are solved to
AREA_ERROR = 2e-6  # relative, of a disk whose area is known better: the spline through the samples


@dataclass(frozen=True, kw_only=True)
class SolutionCase:
    """A loop and the minimal disks that it is known to bound.

    Attributes:
        name: What it is.
        loop: The loop.
        disks: Known disks, smallest area first; the stable one may be missing where its area is not known.
    """

    name: str
    loop: BoundaryLoop
    disks: tuple[gallery.KnownDisk, ...]


def solutions(only: str) -> list[Table]:
    """Measures verdicts and disks of the loops with `only` in their names."""
    figures: list[Figure] = []
    rows: list[tuple[str, ...]] = []
    for case in cases():
        if only not in case.name:
            continue
        note(case.name)
        start = time.perf_counter()
        try:
            usual = solve_plateau(case.loop, tolerance=TOLERANCE)
            kept = solve_plateau(case.loop, tolerance=TOLERANCE, unstable="keep")
            found = solve_plateau(case.loop, tolerance=TOLERANCE, all_solutions=True)
        except SpinorGeomError as error:
            told = f"none: {short_reason(str(error))}"
            figures.append(Figure(case=case.name, name="solution", measured=told, target="one", met=False))
            continue
        seconds = time.perf_counter() - start
        figures += case_figures(case, usual, kept, found)
        rows += [(case.name, f"{seconds:.1f}", f"{disk.area:.9g}", told_verdict(disk)) for disk in found]
    columns = ("loop", "seconds of the three solves", "area", "verdict")
    return [
        figure_table("Loops that bound several minimal disks", figures),
        Table(title="Disks that were found", columns=columns, rows=tuple(rows)),
    ]


def cases() -> list[SolutionCase]:
    """The loops on both sides of each loss of stability."""
    seams = [gallery.tennis_seam(a) for a in (0.8, 0.75, 0.6)]
    surfaces = [
        *((gallery.enneper(radius), radius < 1, 128) for radius in (0.9, 1.1)),
        # a full turn on both sides of the axis is stable up to R/c = √3
        *((gallery.helicoid(radius, both_sides=True), bool(radius < np.sqrt(3)), 160) for radius in (1.6, 1.9)),
    ]
    return [
        *(
            SolutionCase(name=f"{curve.name}, 192 vertices", loop=curve.sample(192), disks=curve.disks)
            for curve in seams
        ),
        *(
            SolutionCase(
                name=f"{known.name}{', both sides' if known.name.startswith('helicoid') else ''}, {n} vertices",
                loop=known.rim(n),
                disks=(gallery.KnownDisk(area=known.area, stable=stable),),
            )
            for known, stable, n in surfaces
        ),
    ]


def case_figures(
    case: SolutionCase, usual: PlateauSolution, kept: PlateauSolution, found: tuple[PlateauSolution, ...]
) -> list[Figure]:
    """What is promised of one loop: a stable disk, right verdicts, every known disk among all solutions."""
    lowest = case.disks[0]
    figures = [
        Figure(
            case=case.name,
            name="verdict of the solution",
            measured=told_verdict(usual),
            target="stable, index 0",
            met=told_verdict(usual) == "stable, index 0",
        ),
        kept_figure(case, kept),
    ]
    if lowest.stable:
        error = abs(usual.area / lowest.area - 1)
        figures.append(Figure.at_most(case.name, "its area, relative error", error, allowed(lowest)))
    else:
        gain = 1 - usual.area / lowest.area
        figures.append(
            Figure(
                case=case.name,
                name="its area, below that of the unstable disk by",
                measured=f"{gain:.1e}",
                target="> 0",
                met=gain > allowed(lowest),
            )
        )
    for disk in case.disks:
        same = [one for one in found if abs(one.area / disk.area - 1) <= allowed(disk)]
        figures.append(
            Figure(
                case=case.name,
                name=f"all solutions: the disk of area {disk.area:.9g}",
                measured=", ".join(map(told_verdict, same)) or "not found",
                target=known_verdict(disk),
                met=any(told_verdict(one) == known_verdict(disk) for one in same),
            )
        )
    return figures


def kept_figure(case: SolutionCase, kept: PlateauSolution) -> Figure:
    """Whether the disk that is found first, and kept as it is, gets the verdict that is known of it."""
    nearest = min(case.disks, key=lambda disk: abs(disk.area - kept.area))
    known = abs(kept.area / nearest.area - 1) <= allowed(nearest)
    # what lies below an unstable disk and was not left is stable
    target = known_verdict(nearest) if known else "stable, index 0"
    told = told_verdict(kept)
    return Figure(
        case=case.name,
        name=f"verdict of the first disk, area {kept.area:.9g}",
        measured=told,
        target=target,
        met=told == target,
    )


def allowed(disk: gallery.KnownDisk) -> float:
    """Relative distance from a known area within which another one is that disk's."""
    return max(AREA_ERROR, disk.relative_error)


def told_verdict(solution: PlateauSolution) -> str:
    """What a solution says of its stability."""
    return f"{solution.stability.verdict}, index {solution.stability.index}"


def known_verdict(disk: gallery.KnownDisk) -> str:
    """What it should say: the unstable disks that are known here have Morse index 1."""
    return "stable, index 0" if disk.stable else "unstable, index 1"
