"""Closed curves of the edges of CAD models, and of rational splines in general."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import BSpline, PPoly
from scipy.spatial import cKDTree

from spinor_geom.adapters.cad_edges import CadEdge, EdgeKind, free_edges
from spinor_geom.adapters.polygon_faces import chained
from spinor_geom.arrays import modulo_one
from spinor_geom.errors import BranchingEdgesError, CurveError, NoEdgesError, OpenWireError
from spinor_geom.mesh.boundary_loop import diagonals
from spinor_geom.mesh.curve import MAX_NEWTON_STEPS, NEWTON_STEP_TOLERANCE, SMOOTH_TURN, ClosedCurve
from spinor_geom.mesh.piece_polynomials import piece_places, through
from spinor_geom.mesh.rational_splines import NurbsCurve, homogeneous
from spinor_geom.mesh.topology import linked

# Relative error of the polynomials that interpolate the speed. It affects s only, all points are on the splines.
SPEED_ERROR = 1e-12
MOST_PARTS = 256  # of a span between two knots, for that error
CHECKS = np.array([0.13, 0.47, 0.81])  # where on each part the error is measured


@dataclass(frozen=True, kw_only=True, eq=False)
class JoinedSplines:
    """Rational B-splines of one degree. Each begins where the one before ends, the first where the last ends."""

    spline: BSpline  # number k on k ≤ t < k + 1, in homogeneous coordinates (w·x, w·y, w·z, w) relative to `origin`
    origin: Float[np.ndarray, " 3"]  # a point of Γ, in mesh units. Derivatives far from 0 would lose digits

    @classmethod
    def of(cls, splines: Sequence[NurbsCurve]) -> JoinedSplines:
        """The curve of splines of one degree whose ends are equal, bit for bit."""
        degree, origin = splines[0].degree, splines[0].control_points[0]
        knots = [number + one.knots[: -degree - 1] for number, one in enumerate(splines)]
        poles = [homogeneous(one.control_points - origin, one.weights) for one in splines]
        last = np.full(degree + 1, float(len(splines)))
        return cls(spline=BSpline(np.concatenate([*knots, last]), np.concatenate(poles), degree), origin=origin)

    def curve(self) -> ClosedCurve:
        """Γ(s), s the share of the length. Raises a CurveError if a spline's derivative is 0 or not finite."""
        at_knots = self._share(self._knots)
        return ClosedCurve(
            point=self.point,
            derivative=self.derivative,
            second_derivative=self.second_derivative,
            corners=tuple(at_knots[self.are_corners].tolist()),
            joints=tuple(at_knots[~self.are_corners].tolist()),
        )

    def point(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Γ(s), in mesh units."""
        return np.asarray(self.origin + self._derivatives(self._parameters(s), 0)[0])

    def derivative(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Γ′(s), at a corner the right-hand one."""
        t = self._parameters(s)
        return np.asarray(self._derivatives(t, 1)[1] / self._share(t, 1)[..., None])

    def second_derivative(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Γ″(s), at a corner or joint the right-hand one."""
        t = self._parameters(s)
        _, first, second = self._derivatives(t, 2)
        speed, change = self._share(t, 1)[..., None], self._share(t, 2)[..., None]
        return np.asarray((second - first * change / speed) / speed**2)

    @cached_property
    def are_corners(self) -> Bool[np.ndarray, " k"]:
        """Whether Γ turns by more than `SMOOTH_TURN`, at each knot but the last."""
        ends = np.nextafter(np.append(self._knots[1:], self._end), 0.0)
        after, before = (self._derivatives(t, 1)[1] for t in (self._knots, np.roll(ends, 1)))
        after, before = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (after, before))
        # arccos of the scalar product would lose half the digits
        turn = 2 * np.arctan2(np.linalg.norm(after - before, axis=1), np.linalg.norm(after + before, axis=1))
        return np.asarray(turn > SMOOTH_TURN)

    @property
    def _end(self) -> float:
        return float(self.spline.t[-1])

    @cached_property
    def _knots(self) -> Float[np.ndarray, " k"]:
        """The different knots but the last."""
        return np.unique(self.spline.t)[:-1]

    @cached_property
    def length(self) -> float:
        """Length of Γ, in mesh units."""
        return float(self._length(self._end))

    @cached_property
    def _share(self) -> PPoly:
        """The share s of the length up to t."""
        return PPoly(self._length.c / self.length, self._length.x)

    @cached_property
    def _length(self) -> PPoly:
        """Length from 0 to t."""
        knots, parts = np.append(self._knots, self._end), 1
        while True:
            divided = knots[:-1, None] + np.diff(knots)[:, None] * np.arange(parts) / parts
            breaks = np.append(divided.ravel(), self._end)
            width = np.diff(breaks)[:, None]
            values = self._speed(breaks[:-1] + width[:, 0] * piece_places()[:, None])
            speed = PPoly(through(values[..., None], width[:, 0])[..., 0], breaks)
            at = breaks[:-1, None] + width * CHECKS
            exact = self._speed(at)
            error = np.abs(speed(at) - exact)
            if error.max() <= SPEED_ERROR * exact.max():
                length: PPoly = speed.antiderivative()
                return length
            parts *= 2
            if parts > MOST_PARTS:
                worst = float(at.flat[int(error.argmax())])
                raise CurveError(
                    reason="has a point where the derivative of its spline is 0", parameter=worst / self._end
                )

    def _speed(self, t: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts"]:
        return np.asarray(np.linalg.norm(self._derivatives(t, 1)[1], axis=-1))

    def _derivatives(self, t: Float[np.ndarray, "*pts"], order: int) -> list[Float[np.ndarray, "*pts 3"]]:
        """The point relative to `origin` and its derivatives in t, up to an order of at most 2."""
        values = [self.spline(t, nu) for nu in range(order + 1)]
        weight = [value[..., 3:] for value in values]
        found: list[Float[np.ndarray, "*pts 3"]] = []
        for k, value in enumerate(values):
            # Leibniz' rule for w·x
            lower = sum(comb(k, j) * weight[j] * found[k - j] for j in range(1, k + 1))
            found.append((value[..., :3] - lower) / weight[0])
        return found

    def _parameters(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts"]:
        """The parameters t of each s, by Newton's method on the part between two breaks that contains it."""
        s = modulo_one(s)
        breaks, starts = self._share.x, self._starts
        part = np.searchsorted(starts, s, side="right") - 1
        low, high = breaks[part], np.nextafter(breaks[part + 1], 0.0)
        ends = np.append(starts[1:], 1.0)
        t = low + (high - low) * (s - starts[part]) / (ends[part] - starts[part])
        for _ in range(MAX_NEWTON_STEPS):
            before, t = t, np.clip(t - (self._share(t) - s) / self._share(t, 1), low, high)
            if np.abs(t - before).max(initial=0.0) <= NEWTON_STEP_TOLERANCE * self._end:
                break
        return np.where(s == starts[part], low, t)

    @cached_property
    def _starts(self) -> Float[np.ndarray, " m"]:
        """The shares at all breaks but the last."""
        return np.asarray(self._share(self._share.x[:-1]))


# Ends of edges at most this far apart are joined, relative to the diagonal of the bounding box of all edges.
CLOSING = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class CadCurve(ClosedCurve):
    """A closed curve of edges of a CAD model, by arc length. Its points are on the edges, to rounding."""

    length: float  # in units of the model
    edges: int  # number of its edges
    kind: EdgeKind  # "edges" that belong to no face, or the "free boundary" of faces
    # the largest distance between ends of edges that were joined, in units of the model. Both were moved by half of it,
    # and the other points of their edges in proportion.
    gap: float

    def __repr__(self) -> str:
        return f"CadCurve({self.edges} edges, {len(self.corners)} corners, length {self.length:.6g})"


def closed_curves(shapes: Sequence[Any]) -> list[CadCurve]:
    """The closed curves that the `free_edges` of shapes form, in the order of their first edges.

    Ends of edges are joined if they are at most 1e-6 of the size of all edges apart, or within the tolerance of their
    vertices. Each curve has the direction of its first edge. Raises a NoEdgesError without such edges, an OpenWireError
    if an end meets no other one, a BranchingEdgesError if more than two meet, and a CurveError if the derivative of a
    spline is 0 at a point.
    """
    kind, edges = free_edges(shapes)
    return [_joined(splines, kind, gap) for splines, gap in _loops(edges)]


def _joined(splines: Sequence[NurbsCurve], kind: EdgeKind, gap: float) -> CadCurve:
    whole = JoinedSplines.of(splines)
    return CadCurve(**vars(whole.curve()), length=whole.length, edges=len(splines), kind=kind, gap=gap)


def _loops(edges: Sequence[CadEdge]) -> Iterator[tuple[list[NurbsCurve], float]]:
    """The splines in order around each closed curve, with equal ends, and the largest gap between their ends."""
    poles = np.concatenate([edge.spline.control_points for edge in edges])
    closing = CLOSING * float(diagonals(poles))
    edges = [edge for edge in edges if np.ptp(edge.spline.control_points, axis=0).max() > max(edge.tolerance, closing)]
    if not edges:
        raise NoEdgesError(what="only edges shorter than their tolerance")
    ends = np.concatenate([edge.spline.ends for edge in edges])
    near = np.repeat([max(edge.tolerance, closing) for edge in edges], 2)
    nodes = _nodes(ends, near)
    links, count = nodes.reshape(-1, 2), np.bincount(nodes)
    _require_cycles(ends, nodes, count, float(near.max()))
    places = np.stack([np.bincount(nodes, weights=x) for x in ends.T], axis=1) / count[:, None]
    gaps = 2 * np.linalg.norm(ends - places[nodes], axis=1).reshape(-1, 2).max(axis=1)
    # each piece has a number of its own between the numbers of its ends, which identifies it in a chain
    pieces = [np.array([first, len(count) + number, last]) for number, (first, last) in enumerate(links.tolist())]
    for _, chain in chained(pieces):
        numbers = chain[1::2] - len(count)
        splines = [edges[number].spline.between(places[links[number]]) for number in numbers]
        is_forward = links[numbers, 0] == chain[:-1:2]
        yield (
            [one if forward else one.reversed() for one, forward in zip(splines, is_forward, strict=True)],
            float(gaps[numbers].max()),
        )


def _nodes(ends: Float[np.ndarray, "n 3"], near: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Numbers, from 0, of the places where ends meet."""
    pairs = cKDTree(ends).query_pairs(float(near.max()), output_type="ndarray")
    pairs = pairs[np.linalg.norm(ends[pairs[:, 0]] - ends[pairs[:, 1]], axis=1) <= near[pairs].max(axis=1)]
    return linked(pairs, len(ends))


def _require_cycles(
    ends: Float[np.ndarray, "n 3"], nodes: Int[np.ndarray, " n"], count: Int[np.ndarray, " k"], closing: float
) -> None:
    """Checks that two ends meet at every place."""
    if (count > 2).any():
        where = ends[nodes == int(np.argmax(count))]
        raise BranchingEdgesError(count=len(where), point=_shown(where[0]))
    loose = ends[count[nodes] == 1]
    if len(loose):
        distance, other = (np.asarray(each)[:, 1] for each in cKDTree(loose).query(loose, k=2))
        first = int(distance.argmin())
        between = [_shown(loose[number]) for number in (first, int(other[first]))]
        raise OpenWireError(gap=float(distance[first]), ends=between, closing=closing)


def _shown(point: Float[np.ndarray, " 3"]) -> list[float]:
    """A point with six digits, for messages."""
    return [float(f"{x:.6g}") for x in point]
