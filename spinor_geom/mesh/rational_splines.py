"""Rational B-spline curves and surfaces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from math import comb
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline

from spinor_geom.mesh.piece_polynomials import gauss_nodes

_MORE_NODES = 16  # Gauss nodes above the degree: areas of rational patches are then exact to rounding
_AT_ONCE = 1 << 20  # points of a patch that are evaluated together. All of a large patch need gigabytes


@dataclass(frozen=True, kw_only=True, eq=False)
class NurbsCurve:
    """A rational B-spline curve on [0, 1].

    Attributes:
        control_points: in mesh units.
        weights: of the control points, positive.
        knots: the knot vector, with repetitions, from 0 to 1. Both ends are repeated once more than the degree.
    """

    control_points: Float[np.ndarray, "n 3"]
    weights: Float[np.ndarray, " n"]
    knots: Float[np.ndarray, " k"]

    def __repr__(self) -> str:
        return f"NurbsCurve({len(self.control_points)} control points, degree {self.degree})"

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return len(self.knots) - len(self.control_points) - 1

    @property
    def ends(self) -> Float[np.ndarray, "2 3"]:
        """First and last point."""
        return self.control_points[[0, -1]]

    def point(self, u: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3"]:
        """Points of the curve."""
        values = BSpline(self.knots, homogeneous(self.control_points, self.weights), self.degree)(u)
        return np.asarray(values[:, :3] / values[:, 3:])

    def reversed(self) -> NurbsCurve:
        """The curve with the opposite direction."""
        back = self.control_points[::-1]
        return NurbsCurve(control_points=back, weights=self.weights[::-1], knots=1 - self.knots[::-1])

    def between(self, ends: Float[np.ndarray, "2 3"]) -> NurbsCurve:
        """The curve with its ends moved to given points, and its other control points in proportion."""
        # Greville's abscissae: a straight spline at constant speed keeps both properties
        share = np.lib.stride_tricks.sliding_window_view(self.knots[1:-1], self.degree).mean(axis=1)[:, None]
        first, last = ends - self.ends
        return replace(self, control_points=self.control_points + (1 - share) * first + share * last)


@dataclass(frozen=True, kw_only=True, eq=False)
class NurbsPatch:
    """A rational B-spline surface on the unit square.

    The normal of the surface has the direction of ∂r/∂u × ∂r/∂v. Sides 0 to 3 lie at v = 0, u = 1, v = 1 and u = 0:
    sides 0 and 2 run with u, sides 1 and 3 with v.

    Attributes:
        control_points: in mesh units, in rows of equal u.
        weights: of the control points. All are 1 unless p and q are polynomials on a disk.
        knots: the knot vectors of u and v, as in `NurbsCurve`.
    """

    control_points: Float[np.ndarray, "n m 3"]
    weights: Float[np.ndarray, "n m"]
    knots: tuple[Float[np.ndarray, " k"], Float[np.ndarray, " l"]]

    def __repr__(self) -> str:
        n, m, _ = self.control_points.shape
        return f"NurbsPatch({n} × {m} control points, degrees {self.degrees})"

    @property
    def degrees(self) -> tuple[int, int]:
        """Degrees in u and in v."""
        (n, m), (u, v) = self.weights.shape, self.knots
        return len(u) - n - 1, len(v) - m - 1

    def grid(
        self, u: Float[np.ndarray, " a"], v: Float[np.ndarray, " b"], *, derivatives: tuple[int, int] = (0, 0)
    ) -> Float[np.ndarray, "a b 3"]:
        """Points, or partial derivatives of given orders, at all pairs of parameters."""
        net = homogeneous(self.control_points, self.weights)
        bases = [
            [BSpline(knots, np.eye(len(knots) - degree - 1), degree)(at, nu=order) for order in range(most + 1)]
            for knots, degree, at, most in zip(self.knots, self.degrees, (u, v), derivatives, strict=True)
        ]
        found: dict[tuple[int, int], Float[np.ndarray, "a b 3"]] = {}
        weights: dict[tuple[int, int], Float[np.ndarray, "a b 1"]] = {}
        for k, m in product(*map(range, map(len, bases))):
            values = np.tensordot(bases[0][k], bases[1][m] @ net, axes=1)
            weights[k, m], total = values[..., 3:], values[..., :3]
            for i, j in product(range(k + 1), range(m + 1)):  # Leibniz's rule for weight times position
                if i or j:
                    total = total - comb(k, i) * comb(m, j) * weights[i, j] * found[k - i, m - j]
            found[k, m] = total / weights[0, 0]
        return np.asarray(found[derivatives])

    def side(self, number: int) -> NurbsCurve:
        """One of the four sides as a curve."""
        points, weights = self.control_points[on_side(number)], self.weights[on_side(number)]
        return NurbsCurve(control_points=points, weights=weights, knots=self.knots[number % 2])

    def normals_on(self, number: int, at: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Normals of the patch at points of a side, not of unit length."""
        end = np.array([0.0 if number in (0, 3) else 1.0])
        u, v = (at, end) if number % 2 == 0 else (end, at)
        along, across = (self.grid(u, v, derivatives=orders).reshape(-1, 3) for orders in ((1, 0), (0, 1)))
        return np.cross(along, across)

    @property
    def area(self) -> float:
        """Area by Gauss-Legendre quadrature, in squared mesh units."""
        more = 3 if (self.weights == 1).all() else _MORE_NODES
        (u, by_u), (v, by_v) = (spline_nodes(*each, more) for each in zip(self.knots, self.degrees, strict=True))
        area = 0.0
        for part in np.array_split(np.arange(len(u)), len(u) * len(v) // _AT_ONCE + 1):
            along, across = (self.grid(u[part], v, derivatives=orders) for orders in ((1, 0), (0, 1)))
            area += float(by_u[part] @ np.linalg.norm(np.cross(along, across), axis=2) @ by_v)
        return area


def on_side(number: int) -> tuple[Any, Any]:
    """The place of a side in an array of control points, or of values at points of a patch."""
    return ((slice(None), 0), (-1, slice(None)), (slice(None), -1), (0, slice(None)))[number]


def homogeneous(points: Float[np.ndarray, "*n 3"], weights: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 4"]:
    """Points times weights, and the weights."""
    return np.concatenate([points * weights[..., None], weights[..., None]], axis=-1)


def spline_nodes(
    knots: Float[np.ndarray, " k"], degree: int, more: int
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Gauss-Legendre nodes and weights on all pieces: degree + `more` of them on each."""
    (nodes, weights), ends = gauss_nodes(degree + more), np.unique(knots)
    half = np.diff(ends)[:, None] / 2
    return (ends[:-1, None] + half * (nodes + 1)).ravel(), (half * weights).ravel()
