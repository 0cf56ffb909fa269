"""How rough a loop is, in one definition for every route."""

import numpy as np

from spinor_geom.mesh.boundary_loop import BoundaryLoop, turning_angles
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.interpolation import DEGREES

# Angle by which one point in ten turns where a loop bends at many of its points: noise of a twentieth of an edge.
ROUGH_TURN = np.radians(12.0)
_STRAIGHT = 1e-4  # largest turn on a straight side, for coordinates in float32
FEW_POINTS = 8  # so few points are a polygon: no curve is seen in them
# Gradient of the energy at which slides along rough loops stop, as a share of the distance allowed in edges.
ROUGH_GRADIENT = 3e-2


def roughness(loop: BoundaryLoop) -> float:
    """Turning angle that nine in ten of a loop's points do not exceed, corners aside."""
    turning = turning_angles(loop.points)[~loop.corners]
    return float(np.quantile(turning, 0.9)) if len(turning) else 0.0


def roundest(points: int) -> float:
    """Angle by which a loop of so many points turns at some of them however smooth it is."""
    return 3 * np.pi / points


def negligible_energy(edges: int, allowed: float) -> float:
    """A fall of the energy that is none on a rough loop: a thousandth of that of waves as long and high as an edge."""
    return 1e-3 * 2 * np.pi * edges * allowed**2


def is_rough(loop: BoundaryLoop, curve: BoundaryCurve) -> bool:
    """Whether a loop bends at many of its points, more than the roundest one, where the curve through them is cubic."""
    return bool(curve.degree == min(DEGREES) and roughness(loop) - roundest(len(loop)) > ROUGH_TURN)


def shows_sides(loop: BoundaryLoop) -> bool:
    """Whether the points between the corners of a loop lie on smooth sides: straight, or many that turn little."""
    corners = np.count_nonzero(loop.corners)
    turn, points_of_a_side = turning_angles(loop.points)[~loop.corners].max(initial=0.0), len(loop) / corners + 1
    return bool((points_of_a_side > FEW_POINTS and turn <= ROUGH_TURN) or (points_of_a_side > 2 and turn <= _STRAIGHT))
