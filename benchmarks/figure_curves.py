"""Plateau's problem over loops whose minimal surface is known: how exact."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from figure_tables import Figure, figure_table, note, short_reason
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from spinor_geom import (
    BoundaryCurve,
    BoundaryLoop,
    PlateauSolution,
    SpinorGeomError,
    gallery,
    mesh_patch,
    solve_plateau,
)
from spinor_geom.bench.tables import Table

TOLERANCE, PLANE_TOLERANCE = 1e-6, 1e-10  # RMS distance per mean edge that loops are solved to
AREA_ERROR, PLANE_AREA_ERROR = 1e-6, 1e-10  # relative
CURVATURE = 1e-10  # |H| times the loop's diagonal: round-off of second derivatives close to poles
SURFACE_DISTANCE = 1e-6  # per diameter
TURN = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()

Case = tuple[str, Callable[[str], list[Figure]]]


def curves(only: str) -> list[Table]:
    """Measures the loops with `only` in their names."""
    figures: list[Figure] = []
    for name, measure in cases():
        if only not in name:
            continue
        note(name)
        try:
            figures += measure(name)
        except SpinorGeomError as error:
            reason = short_reason(str(error))
            figures.append(Figure(case=name, name="solution", measured=f"none: {reason}", target="one", met=False))
    return [figure_table("Curves and rims with a known answer", figures)]


def cases() -> list[Case]:
    """Names of all loops, and functions that solve and measure them."""
    known = (gallery.twisted_circle(), gallery.tennis_seam(0.8), gallery.tennis_seam(0.75))
    saddles = ((2.0, 100), (8.0, 100), (16.0, 200))
    return [
        *((f"{curve.name}, 128 vertices", partial(curve_figures, curve, 128)) for curve in known),
        *(
            (f"ellipse {a:g}:1 height 0.3, {n} vertices", partial(curve_figures, gallery.ellipse(a, 0.3), n))
            for a, n in saddles
        ),
        *((f"{name}, {len(loop)} vertices", partial(plane_figures, loop)) for name, loop in plane_loops().items()),
        ("Enneper R=0.8, 128 vertices", lambda name: surface_figures(gallery.enneper(0.8), name)),
        (
            "catenoid h=0.5, half a turn, 128 vertices",
            lambda name: surface_figures(gallery.catenoid(0.5, turn=np.pi), name),
        ),
        (
            "helicoid R=1 c=1, half a turn, 128 vertices",
            lambda name: surface_figures(gallery.helicoid(turn=np.pi), name),
        ),
    ]


def plane_loops() -> dict[str, BoundaryLoop]:
    """Plane loops, convex and not, each as it is and turned out of the coordinate planes."""
    star = np.exp(2j * np.pi * np.arange(10) / 10) * np.where(np.arange(10) % 2, 0.45, 1.0)
    polygons = {
        "plane square": (64, [(0, 0), (1, 0), (1, 1), (0, 1)]),
        "plane L": (64, [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]),
        "plane star": (80, [(z.real, z.imag) for z in star.tolist()]),
    }
    loops = {
        name: gallery.polygon([(x, y, 0.0) for x, y in points]).sample(n) for name, (n, points) in polygons.items()
    }
    loops["plane ellipse 2:1"] = gallery.ellipse(2.0).sample(100)
    both: dict[str, BoundaryLoop] = {}
    for name, loop in loops.items():
        corners = np.flatnonzero(loop.corners).tolist()
        both[name] = loop
        both[f"{name}, turned"] = BoundaryLoop.from_points(loop.points @ TURN.T, corners=corners)
    return both


def curve_figures(curve: gallery.KnownCurve, vertices: int, case: str, *, tolerance: float = TOLERANCE) -> list[Figure]:
    """Solves a smooth closed curve sampled at equal parameters, and measures boundary, area and verdict."""
    solution, seconds = timed_solve(curve.sample(vertices), tolerance)
    figures = [
        Figure.at_most(case, "RMS distance from Γ / mean edge", measured_rms_per_edge(solution), tolerance),
        Figure(
            case=case,
            name=f"converged to {tolerance:g}",
            measured=convergence(solution, seconds),
            target="yes",
            met=solution.converged,
        ),
    ]
    if not curve.disks:
        return figures
    disk = min(curve.disks, key=lambda disk: abs(disk.area - solution.area))
    figures.append(Figure.at_most(case, "area, relative error", abs(solution.area / disk.area - 1), AREA_ERROR))
    if disk.stable is not None:
        # the unstable disks of the gallery's curves have Morse index 1
        expected = "stable, index 0" if disk.stable else "unstable, index 1"
        found = f"{solution.stability.verdict}, index {solution.stability.index}"
        figures.append(Figure(case=case, name="stability", measured=found, target=expected, met=found == expected))
    return figures


def plane_figures(loop: BoundaryLoop, case: str) -> list[Figure]:
    """Solves a plane loop, and measures area and mean curvature."""
    solution, seconds = timed_solve(loop, PLANE_TOLERANCE)
    patch = mesh_patch(solution)
    curvature = np.abs(solution.surface.mean_curvature(patch.points[patch.boundary_size :])).max(initial=0.0)
    error = abs(solution.area / enclosed_area(solution.curve) - 1)
    return [
        boundary_figure(case, solution, seconds),
        Figure.at_most(case, "area, relative error", error, PLANE_AREA_ERROR),
        Figure.at_most(case, "largest |H| · diagonal", float(curvature) * loop.diagonal, CURVATURE),
    ]


def surface_figures(known: gallery.KnownSurface, case: str) -> list[Figure]:
    """Solves the rim of a known minimal surface, and measures how far the patch inside is from that surface."""
    loop = known.rim(128)
    solution, seconds = timed_solve(loop, TOLERANCE)
    patch = mesh_patch(solution)
    farthest = known.chart.distances(patch.vertices[patch.boundary_size :]).max(initial=0.0)
    distance = float(farthest / pdist(loop.points).max())
    return [
        boundary_figure(case, solution, seconds),
        Figure(case=case, name="area, relative error", measured=f"{abs(solution.area / known.area - 1):.1e}"),
        Figure.at_most(case, "largest distance from the surface / diameter", distance, SURFACE_DISTANCE),
    ]


def timed_solve(loop: BoundaryLoop, tolerance: float) -> tuple[PlateauSolution, float]:
    """A solution and the seconds it took."""
    start = time.perf_counter()
    solution = solve_plateau(loop, tolerance=tolerance)
    return solution, time.perf_counter() - start


def boundary_figure(case: str, solution: PlateauSolution, seconds: float) -> Figure:
    """How well the boundary was met, where nothing is promised about it."""
    rms = measured_rms_per_edge(solution)
    told = f"{rms:.1e}; converged to {solution.tolerance:g}: {convergence(solution, seconds)}"
    return Figure(case=case, name="RMS distance from Γ / mean edge", measured=told)


def convergence(solution: PlateauSolution, seconds: float) -> str:
    """Whether the solver says that it converged, and after how much."""
    return f"{'yes' if solution.converged else 'no'}, {len(solution.history)} steps, {seconds:.2f} s"


def measured_rms_per_edge(solution: PlateauSolution, samples_per_edge: int = 8) -> float:
    """Root mean square distance, by arc length, of the surface's boundary from the nearest points of Γ, in mean edges.

    Evaluated from the surface's public methods at equal parameters of ∂Ω; the solver's own figure is not used.
    """
    boundary, count = solution.domain.boundary, samples_per_edge * len(solution.loop)
    t = (np.arange(count) + 0.5) / count
    z = boundary.point(t)
    points = np.asarray(solution.surface.position(z))
    distance = np.linalg.norm(points - solution.curve.point(solution.curve.nearest(points)), axis=1)
    length = np.asarray(solution.surface.conformal_factor(z)) * np.abs(boundary.derivative(t))
    return float(np.sqrt(length @ distance**2 / length.sum())) / solution.loop.mean_edge_length


def enclosed_area(curve: BoundaryCurve) -> float:
    """Area |½ ∮ Γ × dΓ| inside a plane cubic spline; three Gauss nodes a piece are exact."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    width = np.diff(curve.breaks)[:, None]
    s = curve.breaks[:-1, None] + width * (nodes + 1) / 2
    products = np.cross(curve.point(s) - curve.point(np.array(0.0)), curve.derivative(s))
    return float(np.linalg.norm(((width * weights / 2)[..., None] * products).sum(axis=(0, 1))) / 2)
