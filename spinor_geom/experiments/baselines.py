"""One curve by the paper's training, in spinors and in the Weierstrass-Enneper form, with our solvers beside it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from numpy.typing import NDArray

from spinor_geom.errors import ZeroOnContourError
from spinor_geom.experiments.drawing import Drawn, surfaces
from spinor_geom.experiments.experiment import kept_as
from spinor_geom.experiments.paper_surfaces import solved_by_network
from spinor_geom.experiments.timing import boundary_distance
from spinor_geom.gallery import KnownCurve
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau import solve_plateau
from spinor_geom.render.plots import log_log
from spinor_geom.surface import BranchPoint, SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface
from spinor_geom.training import LevenbergMarquardt, RMSprop, Trained, train_by_rmsprop

SPINOR, ENNEPER = "RMSprop, spinor", "RMSprop, Weierstrass-Enneper"
NETWORK, SERIES = "Levenberg-Marquardt, spinor", "Douglas-Newton"
# the baseline has failed where it stays so many times farther from the curve than the spinors
_FAILED = 2.0


@dataclass(frozen=True, kw_only=True)
class Trainings:
    """How the networks are trained.

    Attributes:
        rmsprop: the paper's training, of both forms.
        network: ours.
    """

    rmsprop: RMSprop
    network: LevenbergMarquardt


FULL = Trainings(rmsprop=RMSprop(), network=LevenbergMarquardt(depth=10, tolerance=1e-5))
QUICK = Trainings(rmsprop=RMSprop(epochs=12, order=25), network=LevenbergMarquardt(tolerance=1e-5))


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Every method on one curve.

    Attributes:
        rows: a row for each.
        paper: the paper's two trainings.
        areas: of the spinor surfaces.
        failed: whether the Weierstrass-Enneper form stays much farther from the curve.
        verdict: in words.
        arrays: errors by epoch.
        pictures: surfaces and errors.
    """

    rows: list[dict[str, Any]]
    paper: Mapping[str, Trained]
    areas: Mapping[str, float]
    failed: bool
    verdict: str
    arrays: Mapping[str, NDArray[Any]]
    pictures: Mapping[str, Figure]


def compare(curve: KnownCurve, trainings: Trainings, *, name: str) -> Comparison:
    """Trains and solves.

    Args:
        curve: Γ.
        trainings: how.
        name: of the pictures' files.
    """
    gamma = BoundaryCurve.from_formula(curve)
    forms = {SPINOR: trainings.rmsprop, ENNEPER: replace(trainings.rmsprop, representation="weierstrass-enneper")}
    paper = {
        method: train_by_rmsprop(curve, options=kept_as(f"{name}-{options.representation}", options))
        for method, options in forms.items()
    }
    network, network_seconds = _timed(lambda: solved_by_network(curve, trainings.network))
    exact, seconds = _timed(lambda: solve_plateau(curve, model="series", unstable="keep"))
    diagonal = paper[SPINOR].diagonal
    found: dict[str, SpinorSurface | WeierstrassSurface] = {
        **{method: trained.surface for method, trained in paper.items()},
        NETWORK: network.surface,
        SERIES: exact.surface,
    }
    areas = {method: surface.area() for method, surface in found.items() if isinstance(surface, SpinorSurface)}
    branched = {method: branch_points(surface) for method, surface in found.items()}
    told = {
        **{method: (t.misfit.max / diagonal, t.seconds, len(t.history), t.status) for method, t in paper.items()},
        NETWORK: (network.misfit.max / diagonal, network_seconds, len(network.history), network.status),
        SERIES: (boundary_distance(exact.surface, gamma) / diagonal, seconds, len(exact.history), "converged"),
    }
    rows = [
        {
            "curve": curve.name,
            "method": method,
            "steps": steps,
            "seconds": took,
            "distance/diagonal": error,
            "area": areas.get(method),
            "branch points": counted(branched[method]),
            "status": status,
        }
        for method, (error, took, steps, status) in told.items()
    ]
    ratio = told[ENNEPER][0] / told[SPINOR][0]
    lines = {
        method: ([s.index for s in t.history], [(s.boundary_error or np.nan) / diagonal for s in t.history])
        for method, t in paper.items()
    }
    return Comparison(
        rows=rows,
        paper=paper,
        areas=areas,
        failed=ratio >= _FAILED,
        verdict=f"{curve.name}: after {told[SPINOR][2]} epochs the spinors ({told[SPINOR][3]}) are "
        f"{told[SPINOR][0]:.1e} of the diagonal from the curve, and the Weierstrass-Enneper form ({told[ENNEPER][3]}) "
        f"{told[ENNEPER][0]:.1e}, {ratio:.2g} times as far; {poles_of_g(exact.surface)} Branch points of the spinors: "
        f"{counted(branched[SPINOR])}, of the Weierstrass-Enneper form: {counted(branched[ENNEPER])}. Ours: "
        f"{told[NETWORK][0]:.1e} in {network_seconds:.1f} s by a network, {told[SERIES][0]:.1e} in {seconds:.2f} s by "
        "power series.",
        arrays={f"{name}/{method}": np.array(line) for method, line in lines.items()},
        pictures={
            f"{name}-surfaces": surfaces(
                {
                    method: replace(Drawn.of(surface), marks=positions(surface, branched[method] or ()))
                    for method, surface in found.items()
                },
                curves=dict.fromkeys(found, curve.point),
            ),
            f"{name}-errors": log_log(lines, x="epoch", y="largest distance from Γ / diagonal", linear_x=True),
        },
    )


def branch_points(surface: SpinorSurface | WeierstrassSurface) -> tuple[BranchPoint, ...] | None:
    """The branch points in Ω; None where one is so near to ∂Ω that they cannot be counted."""
    try:
        return surface.branch_points()
    except ZeroOnContourError:
        return None


def counted(points: tuple[BranchPoint, ...] | None) -> str:
    """How many there are, and how many of them no small change removes."""
    if points is None:
        return "one on the boundary"
    lasting = sum(not point.removable for point in points)
    return f"{len(points)}, {lasting} not removable" if points else "none"


def positions(surface: SpinorSurface | WeierstrassSurface, points: Sequence[BranchPoint]) -> Float[np.ndarray, "k 3"]:
    """Where branch points lie in space."""
    return surface.position(np.array([point.z for point in points], dtype=np.complex128))


def poles_of_g(surface: SpinorSurface) -> str:
    """How many poles g has in Ω, counted by their orders, where the normal is e₃, as a sentence."""
    count = sum(zero.order for zero in surface.spinor_zeros()[1])
    if not count:
        return "the normal of the disk that is sought is nowhere e₃, so g has no pole."
    return f"the normal of the disk that is sought is e₃ where g has {count} {'pole' if count == 1 else 'poles'}."


def _timed(solve: Callable[[], Any]) -> tuple[Any, float]:
    begin = time.perf_counter()
    return solve(), time.perf_counter() - begin
