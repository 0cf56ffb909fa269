"""Roughness of loops, with one definition for all routes."""

from dataclasses import replace

import numpy as np

from spinor_geom.arrays import shifted
from spinor_geom.mesh.boundary_loop import (
    MIN_LOOP_WITH_CORNERS,
    PREDICTED,
    STRAIGHT,
    BoundaryLoop,
    detect_corners,
    have_predicted_sides,
    turning_angles,
)
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.interpolation import missed

# A loop is rough if cubics through four neighbours miss its points by more than `PREDICTED` of an edge, as with noise
# of 0.04 edges, and by more than this share of what lines through two neighbours do. Of 2,400 smooth curves of 32 to 96
# points with uneven spacing 19 are rough, all of at most 48 points.
_HARDLY_LESS = 0.75
ROUGH_GRADIENT = 3e-2  # relative gradient to stop at on rough loops, as a share of the tolerance


def roughness(loop: BoundaryLoop) -> float:
    """Mean distance of points from the cubics through their four neighbours, in mean edges. It is 0 for straight sides.

    The cubics are over chord lengths. Points within two edges of a corner are left out.
    """
    return _mean_missed(loop, 2) / loop.mean_edge_length


def _mean_missed(loop: BoundaryLoop, reach: int) -> float:
    near_corner = np.logical_or.reduce([shifted(loop.corners, k) for k in range(-2, 3)])
    return 0.0 if near_corner.all() else float(missed(loop.points, reach)[~near_corner].mean())


def negligible_energy(edges: int, allowed: float) -> float:
    """A negligible decrease of the energy on a rough loop: a thousandth of that of waves of the allowed height."""
    return 1e-3 * 2 * np.pi * edges * allowed**2


def is_rough(loop: BoundaryLoop, curve: BoundaryCurve) -> bool:
    """Whether neighbours do not predict the points of a loop, and its curve was not chosen for its predictions."""
    return curve.kind in ("cubic", "quintic") and not is_predicted(loop)


def is_predicted(loop: BoundaryLoop) -> bool:
    """Whether neighbours predict the points of a loop, so that they lie on a smooth curve."""
    return roughness(loop) <= PREDICTED or _mean_missed(loop, 2) <= _HARDLY_LESS * _mean_missed(loop, 1)


def shows_no_curve(loop: BoundaryLoop, curve: BoundaryCurve) -> bool:
    """Whether the points of a loop without corners are too few or too rough to be samples of a smooth curve."""
    # Γ overshoots at corners that were removed, for any degree
    if not loop.corners_given and detect_corners(loop.points).any():
        return True
    return curve.kind == "cubic" and (_is_polygon(loop) or is_rough(loop, curve))


def _is_polygon(loop: BoundaryLoop) -> bool:
    """Whether the points of a loop are too few to be samples of a curve."""
    return len(loop) <= MIN_LOOP_WITH_CORNERS and not loop.corners.any()


def as_polygon(loop: BoundaryLoop) -> BoundaryLoop:
    """The loop with corners at all bends if its points are too few to be samples of a curve, or else itself."""
    if not _is_polygon(loop):
        return loop
    return replace(loop, corners=turning_angles(loop.points) > STRAIGHT, corners_given=True)


def has_stray_corners(loop: BoundaryLoop) -> bool:
    """Whether corners were only detected, and the sides between them are not smooth, so that Γ need not have them.

    Smooth sides are straight up to rounding to float32, or have points that their neighbours predict.
    """
    corners = np.count_nonzero(loop.corners)
    if loop.corners_given or not corners:
        return False
    is_straight = len(loop) > corners and turning_angles(loop.points)[~loop.corners].max() <= STRAIGHT
    return not (is_straight or have_predicted_sides(loop.points, loop.corners))
