"""One curve by the paper's training, in spinors and in the Weierstrass-Enneper form, with our solvers beside it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from spinor_geom.errors import ZeroOnContourError
from spinor_geom.experiments.drawing import Drawn, surfaces
from spinor_geom.experiments.experiment import Outcome, kept_as
from spinor_geom.experiments.paper_surfaces import solved_by_network
from spinor_geom.experiments.timing import boundary_distance
from spinor_geom.gallery import KnownCurve
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau import solve_plateau
from spinor_geom.render.plots import log_log
from spinor_geom.surface import BranchPoint, SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface
from spinor_geom.training import LevenbergMarquardt, RMSprop, train_by_rmsprop

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


def compare(curve: KnownCurve, trainings: Trainings, *, name: str) -> Outcome:
    """Trains and solves; it holds where the Weierstrass-Enneper form stays much farther from the curve.

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
    begin = time.perf_counter()
    network = solved_by_network(curve, trainings.network)
    between = time.perf_counter()
    exact = solve_plateau(curve, model="series", unstable="keep")
    seconds = {
        **{method: trained.seconds for method, trained in paper.items()},
        NETWORK: between - begin,
        SERIES: time.perf_counter() - between,
    }
    trained = {**paper, NETWORK: network}
    diagonal = paper[SPINOR].diagonal
    distances = {method: one.max_per_diagonal for method, one in trained.items()}
    distances[SERIES] = boundary_distance(exact.surface, gamma) / diagonal
    found = {**{method: one.surface for method, one in trained.items()}, SERIES: exact.surface}
    branched = {method: branch_points(surface) for method, surface in found.items()}
    rows = [
        {
            "curve": curve.name,
            "method": method,
            "steps": len(trained.get(method, exact).history),
            "seconds": seconds[method],
            "distance/diagonal": distances[method],
            "area": surface.area() if isinstance(surface, SpinorSurface) else None,
            "branch points": counted(branched[method]),
            "status": trained[method].status if method in trained else "converged",
        }
        for method, surface in found.items()
    ]
    ratio = distances[ENNEPER] / distances[SPINOR]
    lines = {
        method: ([s.index for s in one.history], [(s.boundary_error or np.nan) / diagonal for s in one.history])
        for method, one in paper.items()
    }
    drawn = {
        method: replace(Drawn.of(surface), marks=positions(surface, branched[method] or ()))
        for method, surface in found.items()
    }
    return Outcome(
        rows=rows,
        holds=ratio >= _FAILED,
        verdict=f"{curve.name}: after {len(paper[SPINOR].history)} epochs the spinors ({paper[SPINOR].status}) are "
        f"{distances[SPINOR]:.1e} of the diagonal from the curve, and the Weierstrass-Enneper form "
        f"({paper[ENNEPER].status}) {distances[ENNEPER]:.1e}, {ratio:.2g} times as far; {poles_of_g(exact.surface)} "
        f"Branch points of the spinors: {counted(branched[SPINOR])}, of the Weierstrass-Enneper form: "
        f"{counted(branched[ENNEPER])}. Ours: {distances[NETWORK]:.1e} in {seconds[NETWORK]:.1f} s by a network, "
        f"{distances[SERIES]:.1e} in {seconds[SERIES]:.2f} s by power series.",
        arrays={f"{name}/{method}": np.array(line) for method, line in lines.items()},
        pictures={
            f"{name}-surfaces": surfaces(drawn, curves=dict.fromkeys(drawn, curve.point)),
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
