"""Loops of every kind that meshes and mathematicians have, and a hundred random ones: how nearly each is met."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial

import numpy as np
from figure_curves import Case, convergence, curve_figures, measured_rms_per_edge, timed_solve
from figure_tables import Figure, figure_table, note, short_reason
from scipy.spatial.distance import pdist

from spinor_geom import BoundaryLoop, SpinorGeomError, gallery, mesh_patch
from spinor_geom.bench.tables import Table

SMOOTH, CORNERED, POLYGONAL, USUAL = 1e-8, 1e-4, 1e-8, 1e-3  # RMS distance per mean edge that loops are solved to
SPLINE_ORDER = 3.5  # of the areas in the number of samples, at least: 4 is the cubic spline's
ORDER_SAMPLES = (48, 96)
DIAMETER_SHARE = 1e-5  # RMS distance per diameter, along straight sides
NOISE = 0.2  # of a mean edge

RANDOM_LOOPS, RANDOM_VERTICES, RANDOM_NOISE = 100, 120, 0.15
RANDOM_TOLERANCE, RANDOM_NOISY_TOLERANCE = 1e-6, 1e-3
RANDOM_NEAR, RANDOM_NEAR_COUNT, RANDOM_MEDIAN, RANDOM_NOISY_MEDIAN = 1e-2, 98, 1e-6, 2e-3
OVERSTATED = 2.0  # so many times the distance that is reported, a distance contradicts it
AREA_GAP = 0.05  # relative, between the certified area and that of a mesh, whose edges are chords


def any_loop(only: str) -> list[Table]:
    """Measures the loops of every kind with `only` in their names."""
    figures: list[Figure] = []
    for name, measure in cases():
        if only not in name:
            continue
        note(name)
        start = time.perf_counter()
        try:
            figures += measure(name)
        except SpinorGeomError as error:
            told = f"none, {time.perf_counter() - start:.2f} s: {short_reason(str(error))}"
            figures.append(Figure(case=name, name="solution", measured=told, target="one", met=False))
    return [figure_table("Loops of every kind", figures)]


def cases() -> list[Case]:
    """Names of all loops, and functions that solve and measure them."""
    seams = (gallery.twisted_circle(), gallery.tennis_seam(0.8), gallery.tennis_seam(0.75))
    ellipses = [(gallery.ellipse(a, 0.3), n) for a, n in ((2.0, 100), (4.0, 100), (8.0, 100), (16.0, 200), (32.0, 400))]
    ragged = [(gallery.ellipse(a, 0.3), n) for a, n in ((2.0, 100), (4.0, 100), (8.0, 200))]
    strips = [(gallery.slit(), 102), (gallery.slit(bend=np.pi / 2), 102), (gallery.horseshoe(), 160)]
    strips += [(gallery.helical_ramp(turns), 160) for turns in (1.3, 2.0, 3.0)]
    polygons = (
        (gallery.schwarz_d_quadrilateral(), 96, 1e-9),
        (gallery.schwarz_d_hexagon(), 144, 1e-8),
        (gallery.schwarz_p_hexagon(), 144, 1e-8),
    )
    rims = ((gallery.l_shape(), 64), (gallery.l_shape(rise=0.25), 64), (gallery.zigzag_rim(20), 100))
    return [
        *(
            (f"{curve.name}, {n} vertices", partial(curve_figures, curve, n, tolerance=SMOOTH))
            for curve, n in [*((curve, 128) for curve in seams), *ellipses]
        ),
        *((curve.name, partial(order_figures, curve)) for curve in seams[:2]),
        *((f"{curve.name}, {n} vertices, {NOISE:.0%} noise", partial(ragged_figures, curve, n)) for curve, n in ragged),
        *((f"{curve.name}, {n} vertices", partial(strip_figures, curve, n)) for curve, n in strips),
        *((f"{curve.name}, {n} vertices", partial(polygon_figures, curve, n, error)) for curve, n, error in polygons),
        *((f"{curve.name}, {n} vertices", partial(rim_figures, curve, n)) for curve, n in rims),
    ]


def order_figures(curve: gallery.KnownCurve, case: str) -> list[Figure]:
    """Measures at which power of the number of samples the area of a smooth curve's spline tends to the curve's."""
    few, many = ORDER_SAMPLES
    errors = []
    for n in ORDER_SAMPLES:
        # short and long steps in turn: points at equal steps would be taken for the analytic curve they are on
        s = (np.arange(n) + 0.2 * (-1.0) ** np.arange(n)) / n
        solution, _ = timed_solve(BoundaryLoop.from_points(curve.point(s)), SMOOTH)
        errors.append(abs(solution.area / curve.disks[0].area - 1))
    order = float(np.log(errors[0] / errors[1]) / np.log(many / few))
    name = f"order of the area from {few} to {many} vertices"
    return [Figure.at_least(case, name, order, SPLINE_ORDER)]


def ragged_figures(curve: gallery.KnownCurve, vertices: int, case: str) -> list[Figure]:
    """Solves an even sample of a curve with vertex noise, and measures the boundary."""
    return boundary_figures(gallery.noisy_loop(gallery.evenly_sampled(curve, vertices), NOISE, seed=0), USUAL, case)


def strip_figures(curve: gallery.KnownCurve, vertices: int, case: str) -> list[Figure]:
    """Solves the outline of a strip, and measures boundary and area."""
    return boundary_figures(curve.sample(vertices), USUAL, case, curve.disks)


def boundary_figures(
    loop: BoundaryLoop, tolerance: float, case: str, disks: tuple[gallery.KnownDisk, ...] = ()
) -> list[Figure]:
    """Solves a loop, and measures its boundary and, where it is known, its area, of which nothing is promised."""
    solution, seconds = timed_solve(loop, tolerance)
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
    if disks:
        error = abs(solution.area / disks[0].area - 1)
        figures.append(Figure(case=case, name="area, relative error", measured=f"{error:.1e}"))
    return figures


def polygon_figures(curve: gallery.KnownCurve, vertices: int, area_error: float, case: str) -> list[Figure]:
    """Solves a polygon with a known area, and measures that."""
    solution, seconds = timed_solve(curve.sample(vertices), POLYGONAL)
    rms = measured_rms_per_edge(solution)
    told = f"{rms:.1e}; converged to {POLYGONAL:g}: {convergence(solution, seconds)}"
    return [
        Figure(case=case, name="RMS distance from Γ / mean edge", measured=told),
        Figure.at_most(case, "area, relative error", abs(solution.area / curve.disks[0].area - 1), area_error),
    ]


def rim_figures(curve: gallery.KnownCurve, vertices: int, case: str) -> list[Figure]:
    """Solves a rim with straight sides, and measures its boundary by its diameter."""
    loop = curve.sample(vertices)
    solution, seconds = timed_solve(loop, CORNERED)
    share = measured_rms_per_edge(solution) * loop.mean_edge_length / float(pdist(loop.points).max())
    told = convergence(solution, seconds)
    figures = [
        Figure.at_most(case, "RMS distance from Γ / diameter", share, DIAMETER_SHARE),
        Figure(case=case, name=f"converged to {CORNERED:g}", measured=told, target="yes", met=solution.converged),
    ]
    if curve.disks:
        error = abs(solution.area / curve.disks[0].area - 1)
        figures.append(Figure(case=case, name="area, relative error", measured=f"{error:.1e}"))
    return figures


@dataclass(frozen=True, kw_only=True)
class RandomRecord:
    """What the solve of a random loop gave.

    Attributes:
        name: The curve's.
        noisy: Whether its points were moved.
        rms: RMS distance from Γ per mean edge, measured here; infinite where there is no solution.
        silent: What is wrong with the solution that it does not say; empty where nothing is.
        told: What it says itself, or why there is none.
        seconds: Of the solve.
    """

    name: str
    noisy: bool
    rms: float
    silent: str
    told: str
    seconds: float


def random_loops(only: str) -> list[Table]:
    """Solves random closed curves, every second one with vertex noise, and counts how nearly they are met."""
    records = []
    for seed in range(RANDOM_LOOPS):
        noisy = seed % 2 == 1
        name = gallery.random_curve(seed).name + (f", {RANDOM_NOISE:.0%} noise" if noisy else "")
        if only in name:
            record = random_record(seed, name, noisy=noisy)
            note(f"{name}: {record.rms:.1e}, {record.seconds:.1f} s; {record.silent or record.told}")
            records.append(record)
    if not records:
        return []
    return [figure_table("Random closed curves", random_figures(records)), far_table(records)]


def random_record(seed: int, name: str, *, noisy: bool) -> RandomRecord:
    """Solves one random curve and checks what the solution says about itself."""
    loop = gallery.evenly_sampled(gallery.random_curve(seed), RANDOM_VERTICES)
    if noisy:
        loop = gallery.noisy_loop(loop, RANDOM_NOISE, seed=seed)
    start = time.perf_counter()
    try:
        solution, seconds = timed_solve(loop, RANDOM_NOISY_TOLERANCE if noisy else RANDOM_TOLERANCE)
    except SpinorGeomError as error:
        return RandomRecord(
            name=name, noisy=noisy, rms=np.inf, silent="", told=str(error), seconds=time.perf_counter() - start
        )
    rms, reported = measured_rms_per_edge(solution), solution.boundary_residual.rms_per_edge
    silent = ""
    if not rms <= OVERSTATED * max(reported, solution.tolerance):
        silent = f"its distance from Γ is {rms:.1e} of an edge, not {reported:.1e}"
    elif solution.converged:
        try:
            gap = abs(mesh_patch(solution).area / solution.area - 1)
        except SpinorGeomError as error:
            silent = f"its patch cannot be meshed: {short_reason(str(error))}"
        else:
            silent = f"its area and its mesh's are {gap:.0%} apart" if gap > AREA_GAP else ""
    return RandomRecord(name=name, noisy=noisy, rms=rms, silent=silent, told=solution.reason, seconds=seconds)


def random_figures(records: list[RandomRecord]) -> list[Figure]:
    """The counts and medians of the random loops beside their targets."""
    case = f"{len(records)} loops of {RANDOM_VERTICES} vertices"
    near = sum(record.rms <= RANDOM_NEAR for record in records)
    wanted = int(np.ceil(RANDOM_NEAR_COUNT / RANDOM_LOOPS * len(records)))
    figures = [
        Figure(
            case=case,
            name=f"loops within {RANDOM_NEAR:g} of an edge",
            measured=str(near),
            target=f"≥ {wanted}",
            met=near >= wanted,
        )
    ]
    for noisy, limit in ((False, RANDOM_MEDIAN), (True, RANDOM_NOISY_MEDIAN)):
        rms = [record.rms for record in records if record.noisy == noisy]
        if rms:
            name = f"median RMS distance / mean edge, {f'{RANDOM_NOISE:.0%} noise' if noisy else 'no noise'}"
            figures.append(Figure.at_most(case, name, float(np.median(rms)), limit))
    silent = sum(bool(record.silent) for record in records)
    seconds = [record.seconds for record in records]
    told = f"{np.median(seconds):.2f}; {max(seconds):.2f}"
    return [
        *figures,
        Figure(case=case, name="wrong without saying so", measured=str(silent), target="0", met=silent == 0),
        Figure(case=case, name="seconds of a solve, median; largest", measured=told),
    ]


def far_table(records: list[RandomRecord]) -> Table:
    """The random loops that are far from their curves, or of which the solution says something wrong."""
    rows = tuple(
        (record.name, f"{record.rms:.1e}", short_reason(record.silent or record.told))
        for record in records
        if record.rms > RANDOM_NEAR or record.silent
    )
    return Table(title="Random curves that are not met", columns=("curve", "RMS / mean edge", "why"), rows=rows)
