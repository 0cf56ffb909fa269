"""When it is certain that no minimal annulus spans two rims: a cone parts them."""

from __future__ import annotations

from math import comb

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from spinor_geom.mesh.curve import BoundaryCurve


def parted_by_cone(first: BoundaryCurve, second: BoundaryCurve) -> bool:
    """Whether two curves lie in the two halves of the cone ρ < 1.5089·|ζ| about the line between their centres.

    Then no connected minimal surface spans them: as the catenoids around that line shrink from outside to a point, the
    surface, whose boundary none of them meets, touches none of them. Coaxial circles have an annulus wherever no cone
    parts them; other curves may have none without one. Each half is convex, so that it holds a curve if it holds the
    control points of its pieces.

    Source: Dierkes, Hildebrandt & Tromba, "Regularity of Minimal Surfaces" (2010), chapter 4, the cone theorem.
    """
    # the catenoids around an axis, of all sizes, touch the cone with this radius at height 1
    opening = np.sinh(brentq(lambda x: x * np.tanh(x) - 1, 1, 2))
    points = [_control_points(curve) for curve in (first, second)]
    centres = [some.mean(axis=0) for some in points]
    axis = centres[1] - centres[0]
    length = float(np.linalg.norm(axis))
    if not length:
        return False
    ends = []
    for some, side in zip(points, (1, -1), strict=True):
        away = some - centres[0]
        height = away @ axis / length
        radius = np.linalg.norm(away - height[:, None] * axis / length, axis=1)
        # the apex has to lie beyond this height to the side of the other curve
        ends.append(side * float((side * height + radius / opening).max()))
    return ends[0] < ends[1]


def _control_points(curve: BoundaryCurve) -> Float[np.ndarray, "n 3"]:
    """The Bernstein coefficients of all pieces: each lies in the convex hull of its own."""
    degree = curve.degree
    scaled = curve.coefficients[::-1] * np.diff(curve.breaks)[:, None] ** np.arange(degree + 1)[:, None, None]
    to_bernstein = np.array([[comb(j, k) / comb(degree, k) for k in range(degree + 1)] for j in range(degree + 1)])
    return np.asarray(np.tensordot(to_bernstein, scaled, axes=1).reshape(-1, 3))
