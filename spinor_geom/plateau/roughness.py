"""Roughness of loops, with one definition for all routes."""

import numpy as np

from spinor_geom.mesh.boundary_loop import BoundaryLoop, turning_angles
from spinor_geom.mesh.curve import BoundaryCurve

ROUGH_TURN = np.radians(12.0)  # a tenth of a rough loop's turning angles exceed it: noise of 0.05 edges
_STRAIGHT = 1e-4  # largest turn on a straight side, for coordinates in float32
FEW_POINTS = 8  # a loop of at most this many points is a polygon, not samples of a curve
ROUGH_GRADIENT = 3e-2  # relative gradient to stop at on rough loops, as a share of the tolerance


def roughness(loop: BoundaryLoop) -> float:
    """The 90 % quantile of a loop's turning angles, without corners, in radians."""
    turning = turning_angles(loop.points)[~loop.corners]
    # np.quantile takes seven times as long for few angles
    place = 0.9 * (len(turning) - 1)
    return float(np.interp(place, np.arange(len(turning)), np.sort(turning))) if len(turning) else 0.0


def roundest(points: int) -> float:
    """A turning angle that even smooth loops of this many points have, in radians."""
    return 3 * np.pi / points


def negligible_energy(edges: int, allowed: float) -> float:
    """A negligible decrease of the energy on a rough loop: a thousandth of that of waves of the allowed height."""
    return 1e-3 * 2 * np.pi * edges * allowed**2


def is_rough(loop: BoundaryLoop, curve: BoundaryCurve) -> bool:
    """Whether a loop turns at many points by more than a smooth one would, and its curve is a cubic spline."""
    return bool(curve.kind == "cubic" and roughness(loop) - roundest(len(loop)) > ROUGH_TURN)


def has_stray_corners(loop: BoundaryLoop) -> bool:
    """Whether corners were only detected, and the sides between them are not smooth, so that Γ need not have them.

    Smooth sides are straight, or have many points with small turns.
    """
    corners = np.count_nonzero(loop.corners)
    if loop.corners_given or not corners:
        return False
    turn, points_of_a_side = turning_angles(loop.points)[~loop.corners].max(initial=0.0), len(loop) / corners + 1
    return not ((points_of_a_side > FEW_POINTS and turn <= ROUGH_TURN) or (points_of_a_side > 2 and turn <= _STRAIGHT))
