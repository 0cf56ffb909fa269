"""The smooth boundary curve Γ: a cubic spline through all vertices of a loop, with its corners kept."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from spinor_geom.mesh.boundary_loop import BoundaryLoop, require_distinct_neighbours

LENGTH_NODES = 16
SAMPLES_PER_PIECE = 8
NEAREST_SAMPLES = 2
MAX_NEWTON_STEPS = 30
NEWTON_STEP_TOLERANCE = 1e-15


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundaryCurve:
    """A closed curve Γ(s) in space, s in [0, 1), of M cubic pieces; piece i starts at vertex i of its loop.

    s is taken mod 1 everywhere. Within piece i, Γ(s) = Σ_k coefficients[k, i] (s − breaks[i])^(3 − k).

    Attributes:
        breaks: (M + 1,) parameters of the vertices, from 0 to 1: chord length over perimeter.
        coefficients: (4, M, 3) of the pieces, highest power first, as in `scipy.interpolate.PPoly`.
        corners: (M,) bool, at which vertices Γ′ jumps; elsewhere Γ is twice continuously differentiable.
    """

    breaks: Float[np.ndarray, " m_plus_1"]
    coefficients: Float[np.ndarray, "4 m 3"]
    corners: Bool[np.ndarray, " m"]

    @classmethod
    def from_loop(cls, loop: BoundaryLoop) -> BoundaryCurve:
        """The interpolating cubic spline through all vertices of a loop, by chord length.

        Without corners it is periodic. With corners it is one not-a-knot spline from each corner to the next (from a
        single corner back to itself); a side of two or one edges is a parabola or a straight line.

        Raises:
            RepeatedPointError: two neighbouring points of the loop are equal.
        """
        require_distinct_neighbours(loop.points)
        breaks, coefficients = piecewise_cubic(loop.points, loop.corners)
        return cls(breaks=breaks, coefficients=coefficients, corners=loop.corners)

    @property
    def corner_parameters(self) -> Float[np.ndarray, " c"]:
        """Parameters of the corners, ascending."""
        parameters: Float[np.ndarray, " c"] = self.breaks[:-1][self.corners]
        return parameters

    def point(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Γ(s), in mesh units; at the parameter of a vertex it is that vertex, to the last bit."""
        a, b, c, d, h = self._local(s)
        value: Float[np.ndarray, "*pts 3"] = ((a * h + b) * h + c) * h + d
        return value

    def derivative(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Γ′(s), in mesh units per unit of s; at a corner the side that starts there counts."""
        a, b, c, _, h = self._local(s)
        value: Float[np.ndarray, "*pts 3"] = (3 * a * h + 2 * b) * h + c
        return value

    def second_derivative(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Γ″(s), in mesh units per squared unit of s; at a corner the side that starts there counts."""
        a, b, _, _, h = self._local(s)
        value: Float[np.ndarray, "*pts 3"] = 6 * a * h + 2 * b
        return value

    def length(self) -> float:
        """Length of Γ in mesh units, by 16-point Gauss–Legendre quadrature on every piece."""
        nodes, weights = np.polynomial.legendre.leggauss(LENGTH_NODES)
        widths = np.diff(self.breaks)[:, None]
        s = self.breaks[:-1, None] + widths * (nodes + 1) / 2
        speed = np.linalg.norm(self.derivative(s), axis=-1)
        return float((speed * weights * widths).sum() / 2)

    def nearest(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Parameter in [0, 1) of the point of Γ nearest to each point, (N,).

        The two nearest of 8 samples a piece are found first; on the parts of Γ to both sides of them the distance is
        then minimised by Newton's method to round-off. Where two parts of Γ are equally near to within the spacing of
        the samples, either may be chosen.
        """
        tree, parameters = self._samples
        _, found = tree.query(points, k=NEAREST_SAMPLES)
        starts = np.stack([found, found - 1], axis=-1).reshape(len(points), 2 * NEAREST_SAMPLES) % len(parameters)
        piece = starts // SAMPLES_PER_PIECE
        low = parameters[starts] - self.breaks[piece]
        high = np.append(parameters, 1.0)[starts + 1] - self.breaks[piece]
        local = self._minimise_distance(points[:, None, :], piece, low, high)
        distance = np.linalg.norm(self._piece_values(piece, local)[0] - points[:, None, :], axis=-1)
        best = np.argmin(distance, axis=1)[:, None]
        s = np.take_along_axis(self.breaks[piece] + local, best, axis=1)[:, 0]
        return np.where(s < 1.0, s, 0.0)

    @cached_property
    def _samples(self) -> tuple[cKDTree, Float[np.ndarray, " k"]]:
        fractions = np.arange(SAMPLES_PER_PIECE) / SAMPLES_PER_PIECE
        parameters = (self.breaks[:-1, None] + np.diff(self.breaks)[:, None] * fractions).reshape(-1)
        return cKDTree(self.point(parameters)), parameters

    def _local(self, s: Float[np.ndarray, "*pts"]) -> tuple[np.ndarray, ...]:
        """The four coefficients (..., 3) of each parameter's piece, highest first, and its local parameter (..., 1)."""
        wrapped = np.mod(s, 1.0)
        piece = np.clip(np.searchsorted(self.breaks, wrapped, side="right") - 1, 0, len(self.breaks) - 2)
        return (*self.coefficients[:, piece], (wrapped - self.breaks[piece])[..., None])

    def _piece_values(
        self, piece: Int[np.ndarray, "n c"], local: Float[np.ndarray, "n c"]
    ) -> tuple[Float[np.ndarray, "n c 3"], Float[np.ndarray, "n c 3"], Float[np.ndarray, "n c 3"]]:
        """Γ, Γ′ and Γ″ at local parameters of given pieces, their right ends included."""
        a, b, c, d = self.coefficients[:, piece]
        h = local[..., None]
        return ((a * h + b) * h + c) * h + d, (3 * a * h + 2 * b) * h + c, 6 * a * h + 2 * b

    def _minimise_distance(
        self,
        points: Float[np.ndarray, "n 1 3"],
        piece: Int[np.ndarray, "n c"],
        low: Float[np.ndarray, "n c"],
        high: Float[np.ndarray, "n c"],
    ) -> Float[np.ndarray, "n c"]:
        """Local parameter between `low` and `high` where the distance to a point is least, by Newton's method."""
        local: Float[np.ndarray, "n c"] = (low + high) / 2
        for _ in range(MAX_NEWTON_STEPS):
            value, first, second = self._piece_values(piece, local)
            offset = value - points
            slope = (offset * first).sum(axis=-1)
            speed = (first * first).sum(axis=-1)
            bend = speed + (offset * second).sum(axis=-1)
            # where the squared distance is not convex, the Gauss–Newton step still goes downhill
            curvature = np.where(bend > 0.1 * speed, bend, speed)
            step = np.divide(slope, curvature, out=np.zeros_like(slope), where=curvature > 0)
            new = np.clip(local - step, low, high)
            moved = np.abs(new - local).max(initial=0.0)
            local = new
            if moved <= NEWTON_STEP_TOLERANCE:
                break
        return local


def piecewise_cubic(
    points: Float[np.ndarray, "m k"], corners: Bool[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, " m_plus_1"], Float[np.ndarray, "4 m k"]]:
    """The closed interpolating cubic spline through points of any dimension, by chord length, with kinks at corners.

    Returns:
        Breaks from 0 to 1, and coefficients of the pieces, highest power first, as in `scipy.interpolate.PPoly`.
    """
    closed = np.vstack([points, points[:1]])
    chord = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    breaks = np.append(0.0, np.cumsum(chord) / chord.sum())
    breaks[-1] = 1.0
    if corners.any():
        coefficients = _sides(breaks, closed, np.flatnonzero(corners))
    else:
        coefficients = CubicSpline(breaks, closed, bc_type="periodic").c
    return breaks, np.ascontiguousarray(coefficients)


def _sides(
    breaks: Float[np.ndarray, " m_plus_1"], closed: Float[np.ndarray, "m_plus_1 k"], corners: Int[np.ndarray, " c"]
) -> Float[np.ndarray, "4 m k"]:
    """Coefficients of the separate splines between consecutive corners."""
    count = len(breaks) - 1
    coefficients = np.empty((4, count, closed.shape[1]))
    for first, last in zip(corners, np.append(corners[1:], corners[0] + count), strict=True):
        vertices = np.arange(first, last + 1)
        parameters = breaks[vertices % count] + vertices // count
        coefficients[:, vertices[:-1] % count] = CubicSpline(parameters, closed[vertices % count]).c
    return coefficients
