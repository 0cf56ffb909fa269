"""Annuli between two rims: catenoids and rings whose area is known, rims of every kind, and MeshLib's stitch beside."""

from __future__ import annotations

import importlib.util
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from figure_tables import Figure, Table, figure_table, note
from jaxtyping import Float

from spinor_geom import (
    BoundaryLoop,
    ClosedCurve,
    NoConnectedSurface,
    PlateauSolution,
    boundary_loops,
    fill_hole,
    solve_plateau,
)
from spinor_geom.adapters import read_mesh, to_mesh
from spinor_geom.fill.bridge import find_islands

RUNS = 3
VERTICES = 64
# Half heights of unit circles, and how near to the exact area each has to come.
HEIGHTS, TOO_FAR = (0.25, 0.5, 0.6, 0.66), (0.7, 1.0)
SAMPLED, EXACT, PLANE, RESIDUAL, SECONDS, NEARER = 1e-6, 1e-12, 1e-10, 1e-3, 0.1, 1e3
SAME = 1e-6  # of areas that are one, relative
SPOT = Path(__file__).parents[1] / "data" / "spot_cut.obj"
VEIN = "vein.stl"  # not among the meshes that are shipped
Pair = tuple[BoundaryLoop | ClosedCurve, BoundaryLoop | ClosedCurve]


def rims(only: str, folder: Path) -> list[Table]:
    """Measures the annuli of the pairs of rims with `only` in their names; some are of mesh files in a folder."""
    groups: dict[str, Callable[[], list[Figure]]] = {
        **{f"catenoid h = {h}": partial(catenoid_figures, h) for h in HEIGHTS},
        **{f"circles h = {h}": partial(far_figures, h) for h in TOO_FAR},
        "plane rings": plane_figures,
        "tilted, wavy, noisy rims": rough_figures,
        "the same rims": invariance_figures,
        "island of spot_cut.obj": island_figures,
        "facing ends of vein.stl": lambda: end_figures(folder / VEIN),
        "MeshLib's stitch": stitch_figures,
    }
    figures: list[Figure] = []
    for name, measure in groups.items():
        if only in name:
            note(name)
            figures += measure()
    return [figure_table("Annuli between two rims", figures)]


def ring(
    radius: float, height: float, *, centre: tuple[float, float] = (0.0, 0.0), stretch: float = 1.0
) -> ClosedCurve:
    """An ellipse in a horizontal plane."""
    turn = 2 * np.pi

    def around(order: int, offset: Float[np.ndarray, "3"]) -> Callable[..., Float[np.ndarray, "*pts 3"]]:
        def function(s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
            angle = turn * np.asarray(s) + order * np.pi / 2
            flat = turn**order * radius * np.stack([stretch * np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
            return np.asarray(flat + offset)

        return function

    place = np.array([*centre, height])
    return ClosedCurve(point=around(0, place), derivative=around(1, 0 * place), second_derivative=around(2, 0 * place))


def sampled(curve: ClosedCurve, count: int, *, noise: float = 0.0, seed: int = 0) -> BoundaryLoop:
    """Points at equal steps, moved at random by a share of their distance."""
    points = curve.point(np.arange(count) / count)
    edge = np.linalg.norm(points[1] - points[0])
    return BoundaryLoop.from_points(
        points + noise * edge * np.random.default_rng(seed).normal(size=points.shape), corners=()
    )


def catenoid_area(h: float) -> float:
    """Area of the stable catenoid between unit circles at ±h, by Newton's method for its neck."""
    c = 0.99
    for _ in range(100):
        c -= (c * np.cosh(h / c) - 1) / (np.cosh(h / c) - h / c * np.sinh(h / c))
    return float(2 * np.pi * (h * c + c * c * np.sinh(h / c) * np.cosh(h / c)))


def timed(pair: Pair) -> tuple[PlateauSolution | NoConnectedSurface, float]:
    """An answer, and the median seconds of some after one that is not counted."""
    answer = solve_plateau(pair)
    seconds = []
    for _ in range(RUNS):
        start = time.perf_counter()
        answer = solve_plateau(pair)
        seconds.append(time.perf_counter() - start)
    return answer, statistics.median(seconds)


def catenoid_figures(h: float) -> list[Figure]:
    """Area and time between samples and between formulas."""
    first, second, area = ring(1.0, h), ring(1.0, -h), catenoid_area(h)
    figures = []
    for name, pair, limit in (
        (f"{VERTICES} vertices a rim", (sampled(first, VERTICES), sampled(second, VERTICES)), SAMPLED),
        ("formulas", (first, second), EXACT),
    ):
        answer, seconds = timed(pair)
        error = abs(answer.area / area - 1) if isinstance(answer, PlateauSolution) else float("inf")
        case = f"catenoid h = {h}, {name}"
        figures.append(Figure.at_most(case, "error of the area", error, limit))
        figures.append(Figure.at_most(case, "seconds", seconds, SECONDS))
    return figures


def far_figures(h: float) -> list[Figure]:
    """The answer that there is none."""
    answer, seconds = timed((ring(1.0, h), ring(1.0, -h)))
    none = isinstance(answer, NoConnectedSurface)
    error = abs(answer.area / (2 * np.pi) - 1) if answer.area is not None else float("inf")
    told = "no annulus" if none else "an annulus"
    return [
        Figure(case=f"circles h = {h}", name="answer", measured=told, target="no annulus", met=none),
        Figure.at_most(f"circles h = {h}", "error of the two disks' area", error, EXACT),
        Figure(case=f"circles h = {h}", name="seconds", measured=f"{seconds:.2f}"),
    ]


def plane_figures() -> list[Figure]:
    """Rings in a plane."""
    figures = []
    for name, pair, area in (
        ("plane ring, eccentric hole", (ring(1.0, 0.0), ring(0.2, 0.0, centre=(0.5, 0.1))), 0.96 * np.pi),
        (
            "plane ellipse 4:1, hole near an end",
            (ring(1.0, 0, stretch=4.0), ring(0.2, 0, centre=(2.5, 0.1))),
            3.96 * np.pi,
        ),
    ):
        answer, seconds = timed(pair)
        error = abs(answer.area / area - 1) if isinstance(answer, PlateauSolution) else float("inf")
        figures += [
            Figure.at_most(name, "error of the area", error, PLANE),
            Figure(case=name, name="seconds", measured=f"{seconds:.2f}"),
        ]
    return figures


def rough_figures() -> list[Figure]:
    """Rims that crowd on a round annulus, and rims off each other's axis, with and without noise."""
    figures = []
    slender = {
        "small hole near the end of an ellipse 4:1, lifted": (
            sampled(ring(1.0, 0.0, stretch=4.0), 120),
            sampled(ring(0.2, 0.1, centre=(2.5, 0.1)), 40),
        ),
        "ellipse 8:1 in another": (
            sampled(ring(1.0, 0.0, stretch=8.0), 200),
            sampled(ring(0.7, 0.2, centre=(0.1, 0.05), stretch=7.6 / 0.7), 180),
        ),
    }
    for case, pair in slender.items():
        start = time.perf_counter()
        answer = solve_plateau(pair)
        seconds = time.perf_counter() - start
        residual = answer.boundary_residual.rms_per_edge if isinstance(answer, PlateauSolution) else float("inf")
        figures += [
            Figure.at_most(case, "RMS residual per mean edge", residual, RESIDUAL),
            Figure(case=case, name="seconds", measured=f"{seconds:.1f}"),
        ]
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(0.4), -np.sin(0.4)], [0.0, np.sin(0.4), np.cos(0.4)]])
    first, second = ring(1.0, 0.35, stretch=1.3), ring(0.8, -0.35, centre=(0.2, 0.1))
    for noise in (0.0, 0.1, 0.2):
        upper = BoundaryLoop.from_points(sampled(first, 80, noise=noise).points @ tilt.T, corners=())
        case = f"tilted rims, noise {noise:.0%} of an edge"
        answer, seconds = timed((upper, sampled(second, 60, noise=noise, seed=1)))
        residual = answer.boundary_residual.rms_per_edge if isinstance(answer, PlateauSolution) else float("inf")
        figures += [
            Figure.at_most(case, "RMS residual per mean edge", residual, RESIDUAL),
            Figure(case=case, name="seconds", measured=f"{seconds:.2f}"),
        ]
    return figures


def invariance_figures() -> list[Figure]:
    """Areas between the same two rims given in other ways."""
    first, second = sampled(ring(1.0, 0.35, stretch=1.3), 80), sampled(ring(0.8, -0.35, centre=(0.2, 0.1)), 60)
    usual = solve_plateau((first, second)).area
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    moved = [BoundaryLoop.from_points(30 * loop.points @ turn.T + 100, corners=()) for loop in (first, second)]
    shifted = BoundaryLoop.from_points(np.roll(second.points, 23, axis=0), corners=())
    pairs: dict[str, tuple[Pair, float]] = {
        "shifted in their numbering": ((first, shifted), 1.0),
        "swapped": ((second, first), 1.0),
        "reversed": ((first, second.reversed()), 1.0),
        "moved and scaled": ((moved[0], moved[1]), 900.0),
    }
    figures = []
    for name, (pair, scale) in pairs.items():
        change = abs((solve_plateau(pair).area or 0.0) / scale / (usual or 1.0) - 1)
        figures.append(Figure.at_most("the same rims", f"change of the area, {name}", change, SAME))
    return figures


def island_figures() -> list[Figure]:
    """The loose piece in a hole of a mesh, and the whole mesh closed with it."""
    case, mesh = "island of spot_cut.obj", to_mesh(read_mesh(SPOT))
    ((hole, (piece,)),) = find_islands(mesh, boundary_loops(SPOT)).items()
    start = time.perf_counter()
    _, report = fill_hole(SPOT, bridge=(hole, piece), return_report=True)
    seconds = time.perf_counter() - start
    solution = report.loops[hole].solution
    residual = float("inf") if solution is None else solution.boundary_residual.rms_per_edge
    _, whole = fill_hole(SPOT, islands="join", return_report=True)
    return [
        Figure.at_most(case, "RMS residual per mean edge", residual, RESIDUAL),
        Figure(case=case, name="seconds of the bridge", measured=f"{seconds:.1f}"),
        Figure(
            case=case,
            name="the mesh with all its holes filled",
            measured="watertight" if whole.watertight else "open",
            target="watertight",
            met=whole.watertight,
        ),
    ]


def end_figures(path: Path) -> list[Figure]:
    """The two ends of a tube, far apart: the answer that no annulus joins them, and the disks that close it instead."""
    if not path.exists():
        return []
    case, mesh = f"facing ends of {path.name}", read_mesh(path).merged()
    first, second = boundary_loops(mesh)
    answer, seconds = timed((first, second))
    none = isinstance(answer, NoConnectedSurface)
    told = answer.reason if isinstance(answer, NoConnectedSurface) else "an annulus"
    _, report = fill_hole(mesh, return_report=True)
    residuals = [outcome.solution.boundary_residual.rms_per_edge for outcome in report.loops if outcome.solution]
    return [
        Figure(case=case, name="answer", measured=told, target="no annulus", met=none),
        Figure(case=case, name="seconds", measured=f"{seconds:.2f}"),
        Figure.at_most(case, "RMS residual per mean edge of the disks instead", max(residuals), RESIDUAL),
        Figure(
            case=case,
            name="the mesh with both ends filled",
            measured="watertight" if report.watertight else "open",
            target="watertight",
            met=report.watertight,
        ),
    ]


def stitch_figures() -> list[Figure]:
    """How much nearer the area is than that of MeshLib's stitch between the same rims."""
    if importlib.util.find_spec("meshlib") is None:
        return []
    figures = []
    for h in HEIGHTS:
        first, second = sampled(ring(1.0, h), VERTICES), sampled(ring(1.0, -h), VERTICES)
        answer, area = solve_plateau((first, second)), catenoid_area(h)
        ours = abs(answer.area / area - 1) if isinstance(answer, PlateauSolution) else float("inf")
        theirs = abs(stitched_area(first, second) / area - 1)
        nearer = theirs / max(ours, np.finfo(np.float64).eps)
        case = f"catenoid h = {h} beside MeshLib's stitch, which is off by {theirs:.2g}"
        figures.append(
            Figure(
                case=case, name="times nearer", measured=f"{nearer:.0e}", target="≥ 1000", met=bool(nearer >= NEARER)
            )
        )
    return figures


def stitched_area(first: BoundaryLoop, second: BoundaryLoop) -> float:
    """Area of the faces with which MeshLib's stitchHolesNicely joins two flanges one triangle wide."""
    from meshlib import mrmeshnumpy, mrmeshpy

    m = len(first)
    pieces = []
    for number, loop in enumerate((first, second)):
        outwards = loop.points + (loop.points - loop.centroid) * 2 * np.pi / m
        a = np.arange(m)
        b = (a + 1) % m
        faces = np.concatenate([np.column_stack([a, a + m, b]), np.column_stack([b, a + m, b + m])])
        pieces.append((np.concatenate([loop.points, outwards]), faces if number == 0 else faces[:, ::-1]))
    vertices = np.concatenate([points for points, _ in pieces])
    faces = np.concatenate([pieces[0][1], pieces[1][1] + 2 * m]).astype(np.int32)
    mesh = mrmeshnumpy.meshFromFacesVerts(faces, vertices)
    edges = [e for e in mesh.topology.findHoleRepresentiveEdges() if mesh.topology.org(e).get() % (2 * m) < m]
    patch = mrmeshpy.stitchHolesNicely(mesh, edges[0], edges[1], mrmeshpy.StitchHolesNicelySettings())
    return float(mesh.area(patch))
