"""Rims as curves: the loops that are given, what they must not do, and the smooth averages that lead to rough ones."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float

from spinor_geom.errors import LoopsMeetError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, turning_angles
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.mesh.interpolation import DEGREES
from spinor_geom.mesh.intersections import crossings_between, require_simple
from spinor_geom.plateau.task import sampled_formula

# Turning angle, exceeded by one point in ten, from which a loop counts as rough; the smooth curve that leads to it: its
# width, in points and at least as a share of the loop; and how many curves there are between.
_ROUGH_TURN, _SMOOTHING, _NARROWEST_AVERAGE, _DEFORMATIONS = np.radians(12.0), 3.0, 0.03, 4


def sampled(given: BoundaryLoop | ClosedCurve) -> tuple[BoundaryLoop, BoundaryCurve | None]:
    """The loop, or that of a formula's polynomials with them."""
    return (given, None) if isinstance(given, BoundaryLoop) else sampled_formula(given)


def require_apart(loops: Sequence[BoundaryLoop]) -> None:
    """Checks that loops neither cross or touch themselves nor each other.

    Raises:
        SelfCrossingLoopError: a loop crosses or touches itself.
        LoopsMeetError: two loops cross or touch each other.
    """
    for loop in loops:
        require_simple(loop)
    for first, second in combinations(loops, 2):
        meeting = crossings_between(first.points, second.points)
        if len(meeting):
            i, j = meeting[0].tolist()
            raise LoopsMeetError(edges=[_edge(first, i), _edge(second, j)])


def at_unit_size(
    loop: BoundaryLoop, formula: BoundaryCurve | None, centre: Float[np.ndarray, "3"], scale: float
) -> BoundaryCurve:
    """The curve through a loop, with the loops' common centre at 0 and their diagonal 1."""
    points = (loop.points - centre) / scale
    if formula is not None:
        return formula.placed(points, 1 / scale)
    return BoundaryCurve.from_loop(BoundaryLoop(points=points, vertex_ids=loop.vertex_ids, corners=loop.corners))


def is_rough(curve: BoundaryCurve, loop: BoundaryLoop) -> bool:
    """Whether one point in ten of a loop turns too far for samples of a smooth curve; analytic curves are smooth."""
    turn = np.quantile(turning_angles(loop.points), 0.9) - 3 * np.pi / len(loop)
    return curve.degree == min(DEGREES) and bool(turn > _ROUGH_TURN)


def grown(curve: BoundaryCurve, points: int) -> list[BoundaryCurve]:
    """Curves from a smooth average to a rough one.

    Averaged once, curves shrink; twice the average less the average's average keeps what is much longer than its width.
    """
    width = max(_SMOOTHING / points, _NARROWEST_AVERAGE)
    once = curve.smoothed(width)
    average = once.towards(once.smoothed(width), -1.0)
    shares = np.arange(1, _DEFORMATIONS + 1) / _DEFORMATIONS
    return [average, *(average.towards(curve, share) for share in shares)]


def _edge(loop: BoundaryLoop, number: int) -> list[int]:
    return [int(loop.vertex_ids[number]), int(loop.vertex_ids[(number + 1) % len(loop)])]
