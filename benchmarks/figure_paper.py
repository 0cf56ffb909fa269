"""The paper's curves, network and training: how exact and how fast, beside what is promised."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from figure_tables import Figure, figure_table, note
from jaxtyping import Float

from spinor_geom import PlateauSolution, gallery, solve_plateau
from spinor_geom.bench.tables import Table
from spinor_geom.experiments.catenoid import CatenoidSettings
from spinor_geom.experiments.catenoid import measure as measure_catenoid
from spinor_geom.experiments.mean_curvature import ORDERS, MeanCurvatureSettings
from spinor_geom.experiments.mean_curvature import measure as measure_mean_curvature
from spinor_geom.experiments.moebius import fit_moebius
from spinor_geom.experiments.paper_surfaces import boundary_of, random_networks, solved_by_network
from spinor_geom.experiments.timing import boundary_distance
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.surface import SpinorSurface
from spinor_geom.training import LevenbergMarquardt, RMSprop, Trained, train_by_rmsprop

RUNS = 5
EXACT, AREA_ERROR, EXACT_SECONDS = 1e-13, 1e-13, 0.1
# targets in diagonals of Γ, and seconds
SMALL, SMALL_SECONDS = 1e-5, 5.0
SMALLER = 1e-7
DEEP, DEEP_SECONDS = 1e-4, 30.0
RECOVERED, ALIKE = 1e-6, 1e-5
# the networks by Levenberg-Marquardt: the first for most curves, the wide one for what it leaves
NARROW = LevenbergMarquardt(tolerance=SMALL)
FINER = LevenbergMarquardt(tolerance=SMALLER)
WIDE = LevenbergMarquardt(tolerance=SMALLER, width=40, nodes=256, distillation_steps=400)
PAPER = LevenbergMarquardt(tolerance=DEEP, depth=10, width=20)
# the paper's 200 × 200 points take hours on one core
SLOPES = MeanCurvatureSettings(grid=24, steps=(20, 40, 80), network=PAPER)
# epochs of the paper's training
EPOCHS = 800
# parts of a training whose mean losses are compared
PARTS = 10


@dataclass(frozen=True, kw_only=True)
class Training:
    """How much of the paper's training is measured.

    Attributes:
        epochs: of its 800.
        checkpoint: file of its state, from which it goes on.
    """

    epochs: int
    checkpoint: Path | None = None


def paper(only: str, training: Training) -> list[Table]:
    """Measures the cases with `only` in their names."""
    figures: list[Figure] = []
    for name, measure in cases(training):
        if only in name:
            note(name)
            figures += measure(name)
    return [figure_table("The paper's curves and network", figures)]


def cases(training: Training) -> list[tuple[str, Callable[[str], list[Figure]]]]:
    """Names of all cases, and functions that measure them."""
    circle, tame, seam = gallery.twisted_circle(), gallery.tennis_seam(0.8), gallery.tennis_seam(0.75)
    symmetric, stable = seam.disks[-1].area, seam.disks[0].area
    return [
        (f"Douglas-Newton, {circle.name}", partial(exact_figures, circle, circle.disks[0].area, keep=True)),
        (f"Douglas-Newton, {tame.name}", partial(exact_figures, tame, tame.disks[0].area, keep=True)),
        (f"Douglas-Newton, {seam.name}, symmetric disk", partial(exact_figures, seam, symmetric, keep=True)),
        (f"Douglas-Newton, {seam.name}, stable disk", partial(exact_figures, seam, stable, keep=False)),
        *(
            (f"Levenberg-Marquardt, {curve.name}", partial(network_figures, curve, finer))
            for curve, finer in ((circle, FINER), (tame, FINER), (seam, WIDE))
        ),
        *((f"10 × 20 network, {curve.name}", partial(deep_figures, curve)) for curve in (circle, tame, seam)),
        ("slopes of |H|, four surfaces", slope_figures),
        ("slopes of the quadrature error, catenoid", catenoid_figures),
        ("random network pair, 10 × 20", recovery_figures),
        (f"RMSprop, {circle.name}", partial(rmsprop_figures, circle, training)),
    ]


def exact_figures(curve: gallery.KnownCurve, area: float, case: str, *, keep: bool) -> list[Figure]:
    """Solves by power series; the first solve is not timed."""
    solve = partial(solve_plateau, curve, model="series", unstable="keep" if keep else "leave")
    solution = solve()
    seconds = statistics.median(timed(solve)[1] for _ in range(RUNS))
    # leaving an unstable disk is a second solve, of twice as many nodes
    limit = EXACT_SECONDS if keep else None
    taken = f"seconds, median of {RUNS}"
    return [
        Figure.at_most(case, "largest distance from Γ / diagonal", measured_distance(solution), EXACT),
        Figure.at_most(case, "null error, largest |φ·φ| / largest |φ|²", null_error(solution), EXACT),
        Figure.at_most(case, "area, relative error", abs(solution.area / area - 1), AREA_ERROR),
        Figure(case=case, name=taken, measured=f"{seconds:.3g}")
        if limit is None
        else Figure.at_most(case, taken, seconds, limit),
    ]


def network_figures(curve: gallery.KnownCurve, finer: LevenbergMarquardt, case: str) -> list[Figure]:
    """Solves by a network of 3 layers of 20 units, then to a finer tolerance."""
    solution, seconds = by_network(curve, NARROW)
    closer, more = by_network(curve, finer)
    told = f"{finer.width} units, {finer.nodes} nodes, {more:.2g} s"
    return [
        Figure.at_most(case, "largest distance from Γ / diagonal", measured_distance(solution), SMALL),
        Figure.at_most(case, "seconds, solve and training", seconds, SMALL_SECONDS),
        Figure.at_most(case, f"the same distance, {told}", measured_distance(closer), SMALLER),
    ]


def deep_figures(curve: gallery.KnownCurve, case: str) -> list[Figure]:
    """Solves by the paper's network."""
    solution, seconds = by_network(curve, PAPER)
    return [
        Figure.at_most(case, "largest distance from Γ / diagonal", measured_distance(solution), DEEP),
        Figure.at_most(case, "seconds, solve and training", seconds, DEEP_SECONDS),
    ]


def slope_figures(case: str) -> list[Figure]:
    """Fits slopes of max |H| against steps, of the paper's network on its four surfaces."""
    outcome = measure_mean_curvature(SLOPES)
    return [
        slope_figure(f"{case}: {row['surface']}", row["rule"], row["slope"], f"{SLOPES.grid} × {SLOPES.grid} points")
        for row in outcome.rows
    ]


def catenoid_figures(case: str) -> list[Figure]:
    """Fits slopes of the largest distance from the catenoid."""
    outcome = measure_catenoid(CatenoidSettings())
    return [
        slope_figure(case, row["rule"], row["max error"], "120 × 30 points")
        for row in outcome.rows
        if row["N"] == "slope"
    ]


def slope_figure(case: str, rule: str, slope: float, points: str) -> Figure:
    """A fitted slope next to the rule's order."""
    order, allowed = next(expected for name, expected in ORDERS.items() if name == rule)
    return Figure(
        case=case,
        name=f"slope, {rule}, {points}",
        measured=f"{slope:.2f}",
        target=f"{order} ± {allowed:g}",
        met=bool(abs(slope - order) <= allowed),
    )


def recovery_figures(case: str) -> list[Figure]:
    """Recovers the surface of random networks from its boundary, by power series and by a network of the same size."""
    truth = random_networks(10)
    curve = boundary_of(truth, case)
    series, seconds = timed(partial(solve_plateau, curve, model="series"))
    options = LevenbergMarquardt(tolerance=1e-8, nodes=256, depth=10)
    network, more = timed(partial(solved_by_network, curve, options))
    figures = []
    for surface, method, took in (
        (series.surface, "Douglas-Newton", seconds),
        (network.surface, "Levenberg-Marquardt", more),
    ):
        assert isinstance(surface, SpinorSurface)
        fit = fit_moebius(surface, truth)
        figures += [
            Figure.at_most(case, f"{method}, {took:.2g} s: position / diagonal", fit.position_residual, RECOVERED),
            Figure.at_most(case, f"{method}: p and q up to a Möbius map and sign", fit.spinor_residual, ALIKE),
        ]
    return figures


def rmsprop_figures(curve: gallery.KnownCurve, training: Training, case: str) -> list[Figure]:
    """Trains as the paper does, and compares with a network of the same size by Levenberg-Marquardt."""
    options = RMSprop(epochs=training.epochs, checkpoint=training.checkpoint)
    trained = train_by_rmsprop(curve, options=options)
    solution, seconds = by_network(curve, PAPER)
    whole = len(trained.history) >= EPOCHS
    done = f"after {len(trained.history)} of {EPOCHS} epochs"
    per_epoch = statistics.median(np.diff([0.0, *(step.seconds for step in trained.history)]).tolist())
    ours = measured_distance(solution)
    return [
        Figure(
            case=case,
            name="runs to the end without NaN",
            measured=f"{trained.status} {done}",
            target=f"finished after {EPOCHS}",
            # a part of the training says nothing of the rest, unless it went wrong
            met=trained.status == "finished" if whole or trained.status != "finished" else None,
        ),
        falling_figure(case, trained),
        Figure(
            case=case, name=f"largest distance from Γ / diagonal, {done}", measured=f"{trained.max_per_diagonal:.1e}"
        ),
        Figure(case=case, name=f"RMS distance from Γ / diagonal, {done}", measured=f"{trained.rms_per_diagonal:.1e}"),
        Figure(
            case=case,
            name="seconds",
            measured=f"{trained.history[-1].seconds:.0f}, median of an epoch {per_epoch:.2f}",
        ),
        Figure(
            case=case,
            name="the same network by Levenberg-Marquardt",
            measured=f"{ours:.1e} in {seconds:.2g} s: {trained.max_per_diagonal / ours:.2g} times nearer",
        ),
    ]


def falling_figure(case: str, trained: Trained) -> Figure:
    """Whether the mean losses of equal parts of a training fall one after the other."""
    losses = np.array([step.loss for step in trained.history])
    means = np.array([part.mean() for part in np.array_split(losses, min(PARTS, len(losses)))])
    return Figure(
        case=case,
        name=f"loss falls on average, {len(means)} parts",
        measured=f"{means[0]:.1e} to {means[-1]:.1e}, {int((np.diff(means) > 0).sum())} rises",
        target="0 rises",
        met=bool((np.diff(means) < 0).all()),
    )


def by_network(curve: gallery.KnownCurve, options: LevenbergMarquardt) -> tuple[PlateauSolution, float]:
    """A solution by a network, and the seconds it took from the curve alone."""
    return timed(lambda: solve_plateau(curve, model="mlp", optimizer=options))


def timed(solve: Callable[[], PlateauSolution]) -> tuple[PlateauSolution, float]:
    """What a solve returns and its seconds."""
    start = time.perf_counter()
    found = solve()
    return found, time.perf_counter() - start


def measured_distance(solution: PlateauSolution) -> float:
    """Largest distance between boundary and Γ in diagonals, from the surface and the curve alone."""
    curve: BoundaryCurve = solution.curve
    return boundary_distance(solution.surface, curve) / solution.loop.diagonal


def null_error(solution: PlateauSolution) -> float:
    """Largest |φ·φ| on the circle by the largest |φ|², φ that of the harmonic map with the solution's boundary values.

    It comes from the slide along Γ alone; p and q of the solution make a null φ whatever they are.
    """
    x: Float[np.ndarray, "n 3"] = solution.curve.point(solution.matching[:, 1] % 1)
    n = len(x)
    k = np.arange(n // 2)[:, None]
    # φ z = 2 Σ k c_k zᵏ
    phi = np.fft.ifft(np.concatenate([2 * k * np.fft.fft(x, axis=0)[: n // 2], np.zeros((n - n // 2, 3))]), axis=0)
    return float(np.abs((phi * phi).sum(1)).max() / (np.abs(phi) ** 2).sum(1).max())
