"""The frame of a membrane: its edges in order, with all control points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial import legendre
from scipy.interpolate import BSpline, make_interp_spline
from scipy.spatial.distance import cdist

from spinor_geom.errors import OptionError
from spinor_geom.membrane.cables import Cable, Edge, Ring, Stay, SymmetryPlane
from spinor_geom.mesh.boundary_loop import diagonals
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.mesh.open_curve import OpenCurve
from spinor_geom.mesh.triangle_mesh import require_extent
from spinor_geom.plateau.mirrored import MirrorPlanes

_DEGREE = 16  # of the polynomials of a cable
_MEETING = 1e-6  # distance of ends that are one point, relative to the size
_NARROW = 0.8  # twice the largest sag at the start, in distances of the chord from the middle of the film
_MOST_TURN = 2.5  # half the angle by which a cable of given length turns at the start
_ENDS = np.array([0.0, 1.0])

# the length of a cable with its first and second derivative in the control points
LengthTerms: TypeAlias = tuple[float, Float[np.ndarray, "_ 3"], Float[np.ndarray, "_ 3 _ 3"]]


def cable_shapes(x: Float[np.ndarray, " n"], degree: int, order: int = 0) -> Float[np.ndarray, "n _"]:
    """B(x) of a cable c = Σ B_k C_k, or a derivative: B_0 = 1 − x, B_1 = x, then integrals of Legendre polynomials."""
    coefficients = np.zeros((degree + 1, degree + 1))
    coefficients[:2, :2] = [[0.5, 0.5], [-0.5, 0.5]]
    coefficients[:, 2:] = legendre.legint(np.eye(degree), scl=0.5, lbnd=-1)[:, 1:]
    derivative = np.atleast_2d(legendre.legder(coefficients, order, scl=2))
    return np.asarray(legendre.legvander(2 * x - 1, len(derivative) - 1) @ derivative)


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """An edge of a frame, or a reflection.

    Attributes:
        number: that of the given edge.
        copy: 0 for the edge itself, from 1 for its reflections.
        edge: the edge.
        at: its control points: those of `cable_shapes`, the displacement of a ring, none of a fixed edge.
    """

    number: int
    copy: int = 0
    edge: Any  # Cable | Ring | OpenCurve
    at: Int[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, dtype=int))

    @property
    def name(self) -> str:
        """The number, with that of the reflection."""
        return f"{self.number}.{self.copy}" if self.copy else f"{self.number}"

    @property
    def points(self) -> Float[np.ndarray, "m 3"]:
        """The ends of a cable, or all points."""
        edge = self.edge
        return edge.ends if isinstance(edge, Cable) else np.asarray(edge.points, dtype=np.float64)

    def moved(self, points: Float[np.ndarray, "m 3"]) -> Part:
        """The part with other points."""
        is_cable = isinstance(self.edge, Cable)
        given = {"start": points[0], "end": points[-1]} if is_cable else {"points": points}
        return replace(self, edge=replace(self.edge, **given))

    def shapes(self, x: Float[np.ndarray, " n"], order: int = 0) -> Float[np.ndarray, "n k"]:
        """The derivatives of c(x), or of its derivative, in the control points."""
        if isinstance(self.edge, Cable):
            return cable_shapes(x, len(self.at) - 1, order)
        return np.full((len(x), len(self.at)), float(order == 0))

    def point(self, x: Float[np.ndarray, " n"], control: Float[np.ndarray, "c 3"], order: int = 0) -> np.ndarray:
        """c(x) of a cable or a fixed edge, 0 ≤ x ≤ 1, or a derivative."""
        if isinstance(self.edge, Cable):
            return np.asarray(self.shapes(x, order) @ control[self.at])
        return np.asarray(self.spline(x, nu=order))

    @cached_property
    def spline(self) -> BSpline:
        """A fixed edge: the spline through its points."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        degree = next(k for k in (5, 3, 2, 1) if k <= len(steps))
        return make_interp_spline(np.append(0.0, np.cumsum(steps)) / steps.sum(), self.points, k=degree)

    def length(self, control: Float[np.ndarray, "c 3"]) -> LengthTerms:
        """(∫ |c′|² dx)^½ of a cable with its derivatives.

        It is at least the length, and equal for constant speed. The area does not depend on the speed, so that both
        have the same minima, but here the second derivative is positive along the cable too.
        """
        products = np.diag(1 / (2.0 * np.arange(len(self.at)) - 1))  # of B′. Legendre polynomials are orthogonal
        products[:2, :2] = [[1, -1], [-1, 1]]
        slope = products @ control[self.at]
        length = float(np.sqrt((slope * control[self.at]).sum()))
        slope /= length
        bend = products[:, None, :, None] * np.eye(3)[:, None] - slope[:, :, None, None] * slope
        return length, slope, bend / length


def with_images(edges: Sequence[Edge]) -> list[Part]:
    """Edges, each followed by its reflections in planes. Those given already are left out."""
    found, pairs = [], []
    for number, edge in enumerate(edges):
        if isinstance(edge, SymmetryPlane):
            pairs.append((edge.point, edge.normal))
            continue
        own = edge if isinstance(edge, Cable | Ring | OpenCurve) else OpenCurve(np.asarray(edge), corners=())
        if isinstance(own, OpenCurve) and own.is_corner.any():
            raise OptionError(f"fixed edge {number} has corners; divide it there into several edges")
        found.append(Part(number=number, edge=own))
    if not pairs:
        return found
    planes = MirrorPlanes.of(pairs)  # type: ignore[arg-type]
    for k, normal in enumerate(planes.normals):
        for one in list(found):
            image = planes.image(one.points, [k == other for other in range(len(pairs))])
            if any(_is_same(image, other.points) for other in found):
                continue
            heights = planes.heights(one.points)[:, k]
            if min(heights.max(), -heights.min()) > _MEETING * np.ptp(heights):
                raise OptionError(f"edge {one.number} crosses a plane of symmetry; end it at the plane")
            if isinstance(one.edge, Ring) and one.edge.force is not None and abs(normal[2]) > _MEETING:
                raise OptionError(f"edge {one.number}: a ring with a force is reflected in vertical planes only")
            copy = sum(other.number == one.number for other in found)
            found.append(replace(one.moved(image), copy=copy))
    return sorted(found, key=lambda one: (one.number, one.copy))


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """The edges of a membrane and their control points.

    First come the nodes: the corners, then other ends of stays. Then come the other control points of each cable, and
    the displacement of each ring.

    Attributes:
        parts: the edges in order around the film, unless rings bound it alone, then the stays, then the rings.
        nodes: given positions of the nodes.
        is_free: which nodes are free: those where a stay starts.
        size: diagonal of the box around the corners and rings.
    """

    parts: tuple[Part, ...]
    nodes: Float[np.ndarray, "n 3"]
    is_free: Bool[np.ndarray, " n"]
    size: float

    @classmethod
    def of(cls, edges: Sequence[Edge]) -> Frame:
        """The frame of edges in any order and direction, and of their reflections."""
        given = with_images(edges)
        rings = [one for one in given if isinstance(one.edge, Ring)]
        stays = [one for one in given if isinstance(one.edge, Stay)]
        # in a canonical order, so that the film does not depend on the order of the edges
        sides = sorted(
            (one for one in given if not isinstance(one.edge, Ring | Stay)),
            key=lambda one: sorted(one.points[[0, -1]].tolist()),
        )
        if len(sides) == 1 or not given:
            raise OptionError("a membrane needs two edges or more, or rings")
        if not sides and all(one.edge.force is not None for one in rings):
            raise OptionError("all rings have a force, and nothing holds the film; leave out the force of one ring")
        extremes = np.concatenate([*(one.points[[0, -1]] for one in sides), *(one.points for one in rings)])
        require_extent(extremes)
        size = float(diagonals(extremes))
        sides = _chained(sides, _MEETING * size)
        nodes = [one.points[0] for one in sides]
        ends = [[k, (k + 1) % len(sides)] for k in range(len(sides))]
        for stay in stays:
            ends.append([])
            for point in stay.points:
                near = [k for k, node in enumerate(nodes) if np.linalg.norm(node - point) <= _MEETING * size]
                ends[-1].append(near[0] if near else len(nodes))
                nodes += [] if near else [point]
        parts, count = [], len(nodes)
        for one, at in zip([*sides, *stays, *rings], [*ends, *([] for _ in rings)], strict=True):
            own = _DEGREE - 1 if type(one.edge) is Cable else int(isinstance(one.edge, Ring))
            at = [*at * isinstance(one.edge, Cable), *range(count, count + own)]
            parts.append(replace(one, at=np.array(at, dtype=int)))
            count += own
        frame = cls(
            parts=tuple(parts),
            nodes=np.array(nodes).reshape(-1, 3),
            is_free=np.isin(np.arange(len(nodes)), [at[0] for at in ends[len(sides) :]]),
            size=size,
        )
        frame._require_held()
        return frame

    def _require_held(self) -> None:
        """Raises an OptionError for a free node that cannot be in equilibrium."""
        for node in np.flatnonzero(self.is_free).tolist():
            own = [one.edge for one in self.cables if node in one.at[:2]]
            at, beside = self.nodes[node].tolist(), [k for k in (node - 1, node) if node < len(self.sides)]
            if len(own) < 3 or not all(isinstance(self.sides[k].edge, Cable) for k in beside):
                raise OptionError(f"a stay starts at {at}; there must meet three cables or more, and no fixed edge")
            pulls = [cable.tension or np.inf for cable in own]
            if max(pulls) < np.inf and 2 * max(pulls) >= sum(pulls):
                raise OptionError(
                    f"the tensions of the cables that meet at {at} cannot balance: "
                    f"the largest one, {max(pulls):g}, exceeds the others together"
                )

    @cached_property
    def sides(self) -> list[Part]:
        """The edges around the film."""
        return [one for one in self.parts if not isinstance(one.edge, Stay | Ring)]

    @cached_property
    def rings(self) -> list[Part]:
        """The other rims of the film."""
        return [one for one in self.parts if isinstance(one.edge, Ring)]

    @cached_property
    def cables(self) -> list[Part]:
        """The cables around the film, then the stays."""
        return [one for one in self.parts if isinstance(one.edge, Cable)]

    @cached_property
    def order(self) -> list[int]:
        """The numbers of the parts in the order of the given edges."""
        return sorted(range(len(self.parts)), key=lambda k: (self.parts[k].number, self.parts[k].copy))

    @cached_property
    def unknowns(self) -> Int[np.ndarray, " u"]:
        """The unknown coordinates among those of all control points."""
        free = np.ones_like(self.start, dtype=bool)
        free[: len(self.nodes)] = self.is_free[:, None]
        for ring in self.rings:
            free[ring.at] = [False, False, ring.edge.force is not None]
        return np.asarray(np.flatnonzero(free))

    @property
    def is_overturned(self) -> bool:
        """Whether cables between straight edges turn by more than the angles of a polygon, π (n − 2).

        By the theorem of Gauss and Bonnet the angles of a film in equilibrium are positive only below, because its
        Gauss curvature is not positive.
        """
        turn = sum(one.edge.chord / (one.edge.tension or np.inf) for one in self.sides if isinstance(one.edge, Cable))
        has_bends = any(len(one.points) > 2 for one in self.sides)
        return not (self.rings or self.is_hanging or has_bends) and turn >= np.pi * (len(self.sides) - 2)

    @property
    def is_hanging(self) -> bool:
        """Whether forces determine positions of nodes or rings."""
        return bool(self.is_free.any() or any(ring.edge.force is not None for ring in self.rings))

    @cached_property
    def straight(self) -> Float[np.ndarray, "c 3"]:
        """Control points of straight cables."""
        count = 1 + max(int(one.at.max(initial=len(self.nodes) - 1)) for one in self.parts)
        return np.asarray(np.concatenate([self.nodes, np.zeros((count - len(self.nodes), 3))]))

    @cached_property
    def start(self) -> Float[np.ndarray, "c 3"]:
        """Control points of arcs of circles towards the middle of the film."""
        control, x = np.array(self.straight), (np.arange(2 * _DEGREE) + 0.5) / (2 * _DEGREE)
        middle = np.mean([one.point(x, control).mean(axis=0) for one in self.sides], axis=0) if self.sides else None
        for one in self.sides:
            if isinstance(one.edge, Cable):
                chord = one.edge.chord
                along, inward = (one.points[1] - one.points[0]) / chord, middle - one.points.mean(axis=0)
                inward -= (inward @ along) * along
                reach = max(float(np.linalg.norm(inward)), _MEETING * self.size)
                half = min(half_turn(one.edge), 2 * np.arctan(_NARROW * reach / chord))
                angle = half * (2 * x[:, None] - 1)
                slope = chord * half / np.sin(half) * (np.cos(angle) * along - np.sin(angle) * inward / reach)
                control[one.at[2:]] = legendre.legfit(2 * x - 1, slope, _DEGREE - 1)[1:]
        return control

    def tangents(self, control: Float[np.ndarray, "c 3"]) -> Float[np.ndarray, "2 e 3"]:
        """The derivatives of the edges at their starts and at their ends."""
        both = [one.point(_ENDS, control, 1) for one in self.sides]
        return np.asarray(np.array(both).reshape(-1, 2, 3).transpose(1, 0, 2))

    def crossed(self, before: Float[np.ndarray, "c 3"], after: Float[np.ndarray, "c 3"]) -> Int[np.ndarray, " k"]:
        """The corners whose angles become negative from some control points to others."""
        pairs = [(starts, -np.roll(ends, 1, axis=0)) for starts, ends in map(self.tangents, (before, after))]
        old, new = (np.cross(*pair) for pair in pairs)
        return np.flatnonzero(((old * new).sum(axis=1) < 0) & ((pairs[1][0] * pairs[1][1]).sum(axis=1) > 0))

    @cached_property
    def breaks(self) -> Float[np.ndarray, " n1"]:
        """Parameters of Γ at the corners, in proportion to the chords of the edges."""
        chords = np.array([np.linalg.norm(one.points[-1] - one.points[0]) for one in self.sides]) + 0.1 * self.size
        return np.asarray(np.append(0.0, np.cumsum(chords)) / chords.sum())

    def places(self, s: Float[np.ndarray, "*n"]) -> tuple[Int[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """The edges of parameters of Γ, and the parameters on them."""
        s = np.mod(s, 1.0)
        edge = np.searchsorted(self.breaks[1:-1], s, side="right")
        return edge, (s - self.breaks[edge]) / np.diff(self.breaks)[edge]

    def curves(self, control: Float[np.ndarray, "c 3"]) -> list[ClosedCurve | Float[np.ndarray, "m 3"]]:
        """The rings, then Γ around the edges, if there are any."""
        rings = [one.points + control[one.at] for one in self.rings]
        if not self.sides:
            return [*rings]
        widths = np.diff(self.breaks)

        def derivative(order: int, s: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
            edge, x = self.places(np.asarray(s))
            values = np.empty((*np.shape(s), 3))
            for k, one in enumerate(self.sides):
                values[edge == k] = one.point(x[edge == k], control, order) / widths[k] ** order
            return values

        joints = [
            start + width * np.unique(one.spline.t)[1:-1]
            for one, start, width in zip(self.sides, self.breaks, widths, strict=False)
            if isinstance(one.edge, OpenCurve)
        ]
        curve = ClosedCurve(
            point=partial(derivative, 0),
            derivative=partial(derivative, 1),
            second_derivative=partial(derivative, 2),
            corners=tuple(self.breaks[:-1].tolist()),
            joints=tuple(np.concatenate([[], *joints]).tolist()),
        )
        return [*rings, curve]


def half_turn(cable: Cable) -> float:
    """Half the angle by which an arc of a circle with this chord, and this length or curvature 1/tension, turns."""
    if cable.tension is not None:
        return float(np.arcsin(min(1.0, cable.chord / (2 * cable.tension))))
    # by the series of angle / sin(angle)
    return float(np.sqrt(6 * max((cable.length or 0) / cable.chord - 1, _MEETING)).clip(max=_MOST_TURN))


def _chained(sides: Sequence[Part], tolerance: float) -> list[Part]:
    """Edges in order around the frame, in the direction of the first one, with equal ends."""
    chain, left = list(sides[:1]), list(sides[1:])
    while left:
        gaps = np.array([np.linalg.norm(one.points[[0, -1]] - chain[-1].points[-1], axis=1) for one in left])
        at, is_backward = np.unravel_index(gaps.argmin(), gaps.shape)
        own = left.pop(int(at))
        chain.append(own.moved(own.points[::-1]) if is_backward else own)
    joined = []
    for one, after in zip(chain, [*chain[1:], *chain[:1]], strict=True):
        points, start = np.array(one.points), after.points[0]
        gap = float(np.linalg.norm(start - points[-1]))
        if gap > tolerance:
            raise OptionError(
                f"edge {one.number} ends {gap:.3g} away from the nearest end of another, edge {after.number}; join them"
            )
        points[-1] = start
        joined.append(one.moved(points))
    return joined


def _is_same(points: Float[np.ndarray, "m 3"], others: Float[np.ndarray, "n 3"]) -> bool:
    """Whether two edges have the same points, in any order."""
    nearest = cdist(points, others).min(axis=0).max() if len(points) == len(others) else np.inf
    return bool(nearest <= _MEETING * np.ptp(points, axis=0).max())
