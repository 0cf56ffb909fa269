"""Distance from Γ against wall-clock time: the paper's training beside our solvers, on one curve in one run."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import torch

from spinor_geom.experiments.experiment import Experiment, Outcome, kept_as
from spinor_geom.gallery import KnownCurve, tennis_seam, twisted_circle
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.render.plots import log_log
from spinor_geom.surface import SpinorSurface
from spinor_geom.training import LevenbergMarquardt, RMSprop, train_by_rmsprop

# points of ∂Ω whose distance from Γ is measured
_POINTS = 1024
PAPER, OURS, CAUCHY, DOUGLAS = "RMSprop", "Levenberg-Marquardt", "Cauchy network", "Douglas-Newton"
CURVES: dict[str, Callable[[], KnownCurve]] = {"twisted circle": twisted_circle, "tennis seam": tennis_seam}


@dataclass(frozen=True, kw_only=True)
class TimingSettings:
    """How long each is run.

    Attributes:
        curves: names of the curves.
        rmsprop: the paper's training.
        tolerances: largest distances, in diagonals, that the network by Levenberg-Marquardt and the Cauchy network are
            asked for; each is a run of its own.
        depth: hidden layers of the network by Levenberg-Marquardt.
    """

    curves: tuple[str, ...]
    rmsprop: RMSprop
    tolerances: tuple[float, ...]
    depth: int


def measure(settings: TimingSettings) -> Outcome:
    """Runs every method on every curve."""
    rows: list[dict[str, Any]] = []
    arrays, pictures, ratios = {}, {}, []
    # what the first solve of a process imports and compiles is nobody's time
    solve_plateau(twisted_circle(), model="series")
    for name in settings.curves:
        lines = on_curve(CURVES[name](), settings)
        for method, (seconds, errors) in lines.items():
            rows += [
                {"curve": name, "method": method, "seconds": s, "distance/diagonal": e}
                for s, e in ([(seconds[-1], errors[-1])] if method == PAPER else zip(seconds, errors, strict=True))
            ]
            arrays[f"{name}/{method}"] = np.array([seconds, errors])
        ratios.append(_compared(name, lines))
        pictures[f"timing-{name.replace(' ', '-')}"] = log_log(
            lines, x="seconds", y="largest distance from Γ / diagonal"
        )
    return Outcome(
        rows=rows,
        holds=all(nearer for nearer, _ in ratios),
        verdict=" ".join(sentence for _, sentence in ratios),
        arrays=arrays,
        pictures=pictures,
    )


def on_curve(curve: KnownCurve, settings: TimingSettings) -> dict[str, tuple[list[float], list[float]]]:
    """Seconds and distances of every method."""
    gamma = BoundaryCurve.from_formula(curve)
    diagonal = float(np.linalg.norm(np.ptp(gamma.coefficients[-1], axis=0)))

    def timed(solve: Callable[[], SpinorSurface]) -> tuple[float, float]:
        begin = time.perf_counter()
        surface = solve()
        seconds = time.perf_counter() - begin
        return seconds, boundary_distance(surface, gamma) / diagonal

    def by_network(tolerance: float) -> SpinorSurface:
        optimizer = LevenbergMarquardt(depth=settings.depth, tolerance=tolerance)
        return solve_plateau(curve, model="mlp", optimizer=optimizer).surface

    def by_cauchy(tolerance: float) -> SpinorSurface:
        edges = diagonal / float(np.linalg.norm(np.diff(gamma.coefficients[-1], axis=0), axis=1).mean())
        return solve_plateau(curve, model="cauchy", tolerance=tolerance * edges).surface

    trained = train_by_rmsprop(curve, options=kept_as(curve.name, settings.rmsprop))
    steps = [(step.seconds, (step.boundary_error or np.nan) / diagonal) for step in trained.history]
    points = {
        PAPER: steps,
        OURS: [timed(partial(by_network, t)) for t in settings.tolerances],
        CAUCHY: [timed(partial(by_cauchy, t)) for t in settings.tolerances],
        DOUGLAS: [timed(lambda: solve_plateau(curve, model="series").surface)],
    }
    return {method: ([s for s, _ in at], [e for _, e in at]) for method, at in points.items()}


def boundary_distance(surface: SpinorSurface, curve: BoundaryCurve) -> float:
    """Largest distance of the boundary from the nearest points of Γ, and of what of Γ it passes over from it."""
    r = surface.position(surface.domain.boundary.point(np.arange(_POINTS) / _POINTS))
    slide = np.unwrap(curve.nearest(r), period=1.0)
    return Misfit.of(torch.from_numpy(r), torch.from_numpy(slide), CurveTensors.of(curve, torch.device("cpu"))).max


def _compared(name: str, lines: dict[str, tuple[list[float], list[float]]]) -> tuple[bool, str]:
    """Whether ours come nearer in less time than the paper's training, and how much."""
    (paper_seconds, *_), paper_error = lines[PAPER][0][::-1], lines[PAPER][1][-1]
    told, nearer = [], True
    for method in (OURS, CAUCHY, DOUGLAS):
        seconds, errors = lines[method]
        best = int(np.argmin(errors))
        nearer &= errors[best] < paper_error and seconds[best] < paper_seconds
        told.append(
            f"{method} {errors[best]:.1e} in {seconds[best]:.2f} s ({paper_error / errors[best]:.0e} times nearer, "
            f"{paper_seconds / seconds[best]:.3g} times faster)"
        )
    return nearer, (
        f"{name}: after {len(lines[PAPER][0])} epochs and {paper_seconds:.1f} s RMSprop is {paper_error:.1e} of the "
        f"diagonal from the curve; {'; '.join(told)}."
    )


_FULL = TimingSettings(
    curves=("twisted circle", "tennis seam"),
    rmsprop=RMSprop(),
    tolerances=(1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7),
    depth=3,
)
EXPERIMENT = Experiment(
    title="boundary error against wall-clock time",
    paper="RMSprop (Algorithm 1), networks of 10 layers of 20 units, 800 epochs; the paper tells no times.",
    here="The paper's training with its own settings; a network of 3 layers of 20 units by Levenberg-Marquardt, a "
    "Cauchy network, and Douglas-Newton on the disk, each on one thread; the same curve in the same run, every point "
    "of ours a solve from nothing. Seen means that each of ours comes nearer in less time.",
    measure=measure,
    full=_FULL,
    quick=replace(
        _FULL, curves=("twisted circle",), rmsprop=RMSprop(epochs=20, order=25), tolerances=(1e-2, 1e-4, 1e-6)
    ),
)
