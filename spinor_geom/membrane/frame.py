"""The frame of a membrane: its edges in order, with all control points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from operator import itemgetter
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.distance import cdist

from spinor_geom.errors import OptionError
from spinor_geom.membrane.cables import Cable, CableEdge, Edge, FixedEdge, Ring, Stay, SymmetryPlane
from spinor_geom.mesh.boundary_loop import diagonals
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.mesh.open_curve import OpenCurve
from spinor_geom.mesh.triangle_mesh import require_extent
from spinor_geom.plateau.mirrored import MirrorPlanes

E = TypeVar("E", bound=Cable | Ring | OpenCurve)

_MEETING = 1e-6  # distance of ends that are one point, relative to the size
_ENDS = np.array([0.0, 1.0])


def with_images(edges: Sequence[Edge]) -> list[tuple[int, Cable | Ring | OpenCurve]]:
    """Edges, each followed by its reflections in planes, with their numbers. Those given already are left out."""
    found: list[tuple[int, Cable | Ring | OpenCurve]] = []
    for number, one in enumerate(edges):
        if isinstance(one, SymmetryPlane):
            continue
        own = one if isinstance(one, Cable | Ring | OpenCurve) else OpenCurve(np.asarray(one), corners=())
        if isinstance(own, OpenCurve) and own.is_corner.any():
            raise OptionError(f"fixed edge {number} has corners; divide it there into several edges")
        found.append((number, own))
    pairs = [(one.point, one.normal) for one in edges if isinstance(one, SymmetryPlane)]
    if not pairs:
        return found
    planes = MirrorPlanes.of(pairs)  # type: ignore[arg-type]
    for k, normal in enumerate(planes.normals):
        for number, own in list(found):
            points = _points(own)
            image = planes.image(points, [k == other for other in range(len(planes.normals))])
            if any(_is_same(image, _points(other)) for _, other in found):
                continue
            heights = planes.heights(points)[:, k]
            if min(heights.max(), -heights.min()) > _MEETING * np.ptp(heights):
                raise OptionError(f"edge {number} crosses a plane of symmetry; end it at the plane")
            if isinstance(own, Ring) and own.force is not None and abs(normal[2]) > _MEETING:
                raise OptionError(f"edge {number}: a ring with a force is reflected in vertical planes only")
            found.append((number, _moved(own, image)))
    return sorted(found, key=itemgetter(0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """The edges of a membrane and their control points.

    First come the nodes: the corners, then other ends of stays. Then come the other control points of each cable, and
    the displacement of each ring.

    Attributes:
        edges: in order around the film, or empty if rings bound it alone.
        stays: the stays.
        rings: the other rims of the film.
        numbers: those of edges, stays and rings among the given edges.
        nodes: given positions of the nodes.
        stay_ends: the nodes at which each stay starts and ends.
        size: diagonal of the box around the corners and rings.
    """

    edges: tuple[CableEdge | FixedEdge, ...]
    stays: tuple[CableEdge, ...]
    rings: tuple[Ring, ...]
    numbers: tuple[int, ...]
    nodes: Float[np.ndarray, "n 3"]
    stay_ends: Int[np.ndarray, "m 2"]
    size: float

    @classmethod
    def of(cls, edges: Sequence[Edge]) -> Frame:
        """The frame of edges in any order and direction, and of their reflections."""
        given = with_images(edges)
        rings = [(k, one) for k, one in given if isinstance(one, Ring)]
        stays = [(k, one) for k, one in given if isinstance(one, Stay)]
        # in a canonical order, so that the film does not depend on the order of the edges
        sides = sorted(
            ((k, one) for k, one in given if not isinstance(one, Ring | Stay)),
            key=lambda one: sorted(_points(one[1])[[0, -1]].tolist()),
        )
        if len(sides) == 1 or not given:
            raise OptionError("a membrane needs two edges or more, or rings")
        if not sides and all(ring.force is not None for _, ring in rings):
            raise OptionError("all rings have a force, and nothing holds the film; leave out the force of one ring")
        corners = [_points(one)[[0, -1]] for _, one in sides]
        extremes = np.concatenate([*corners, *(_points(one) for _, one in rings)])
        require_extent(extremes)
        size = float(diagonals(extremes))
        sides = _chained(sides, _MEETING * size)
        nodes = [_points(one)[0] for _, one in sides]
        at = []
        for point in (point for _, stay in stays for point in stay.ends):
            near = [k for k, node in enumerate(nodes) if np.linalg.norm(node - point) <= _MEETING * size]
            at.append(near[0] if near else len(nodes))
            nodes += [] if near else [point]
        frame = cls(
            edges=tuple(CableEdge(one) if isinstance(one, Cable) else FixedEdge(one) for _, one in sides),
            stays=tuple(CableEdge(stay) for _, stay in stays),
            rings=tuple(ring for _, ring in rings),
            numbers=tuple(k for k, _ in (*sides, *stays, *rings)),
            nodes=np.array(nodes).reshape(-1, 3),
            stay_ends=np.array(at, dtype=int).reshape(-1, 2),
            size=size,
        )
        frame._require_held()
        return frame

    def _require_held(self) -> None:
        """Raises an OptionError for a free node that cannot be in equilibrium."""
        for node in np.flatnonzero(self.is_free).tolist():
            own = [one for one, ends in zip(self.cables, self.cable_ends, strict=True) if node in ends]
            at = self.nodes[node].tolist()
            fixed = [k for k in (node - 1, node) if node < len(self.edges) and isinstance(self.edges[k], FixedEdge)]
            if fixed or len(own) < 3:
                raise OptionError(f"a stay starts at {at}; there must meet three cables or more, and no fixed edge")
            pulls = [one.cable.tension or np.inf for one in own]
            if max(pulls) < np.inf and 2 * max(pulls) >= sum(pulls):
                raise OptionError(
                    f"the tensions of the cables that meet at {at} cannot balance: "
                    f"the largest one, {max(pulls):g}, exceeds the others together"
                )

    @cached_property
    def is_free(self) -> Bool[np.ndarray, " n"]:
        """Which nodes are free: those where a stay starts."""
        return np.isin(np.arange(len(self.nodes)), self.stay_ends[:, 0])

    @cached_property
    def cables(self) -> list[CableEdge]:
        """The cables around the film, then the stays."""
        return [*(edge for edge in self.edges if isinstance(edge, CableEdge)), *self.stays]

    @property
    def cable_given(self) -> list[int]:
        """The numbers of the cables among the given edges."""
        count = len(self.edges)
        return [*(self.numbers[k] for k in self.cable_numbers), *self.numbers[count : count + len(self.stays)]]

    @cached_property
    def cable_numbers(self) -> dict[int, int]:
        """The numbers of the cables among all, by edge."""
        sides = [k for k, edge in enumerate(self.edges) if isinstance(edge, CableEdge)]
        return {edge: number for number, edge in enumerate(sides)}

    @cached_property
    def cable_ends(self) -> list[tuple[int, int]]:
        """The nodes at the ends of each cable."""
        sides = [(k, (k + 1) % len(self.edges)) for k in self.cable_numbers]
        return [*sides, *((a, b) for a, b in self.stay_ends.tolist())]

    @cached_property
    def controls(self) -> list[Int[np.ndarray, " _"]]:
        """The control points of each cable."""
        own = [one.degree - 1 for one in self.cables]
        first = len(self.nodes) + np.append(0, np.cumsum(own))
        return [
            np.append(np.array(ends), at + np.arange(count))
            for ends, at, count in zip(self.cable_ends, first.tolist(), own, strict=False)
        ]

    @property
    def ring_controls(self) -> Int[np.ndarray, " r"]:
        """The displacements of the rings, among the control points."""
        return np.asarray(np.arange(self.count - len(self.rings), self.count))

    @cached_property
    def count(self) -> int:
        """Number of control points."""
        return len(self.nodes) + sum(one.degree - 1 for one in self.cables) + len(self.rings)

    @cached_property
    def unknowns(self) -> Int[np.ndarray, " u"]:
        """The unknown coordinates among those of all control points."""
        free = np.ones((self.count, 3), dtype=bool)
        free[: len(self.nodes)] = self.is_free[:, None]
        free[self.ring_controls] = [[False, False, ring.force is not None] for ring in self.rings] or False
        return np.asarray(np.flatnonzero(free))

    @cached_property
    def straight(self) -> Float[np.ndarray, "c 3"]:
        """Control points of straight cables."""
        return np.asarray(np.concatenate([self.nodes, np.zeros((self.count - len(self.nodes), 3))]))

    @property
    def start(self) -> Float[np.ndarray, "c 3"]:
        """Control points of arcs of circles, twisted into the frame."""
        control = np.array(self.straight)
        if not self.edges:
            return control
        inside = self.tangents(control) * [[[1]], [[-1]]]
        x = (np.arange(9) + 0.5) / 9
        middle = np.mean([self._on(k, x, control).mean(axis=0) for k in range(len(self.edges))], axis=0)
        for edge, number in self.cable_numbers.items():
            own, at = self.cables[number], self.controls[number]
            after = (edge + 1) % len(self.edges)
            inward = np.stack([inside[1, edge - 1], middle - own.cable.ends.mean(axis=0), inside[0, after]])
            control[at[2:]] = own.start(inward)
        return control

    def _on(
        self, edge: int, x: Float[np.ndarray, " n"], control: Float[np.ndarray, "c 3"], order: int = 0
    ) -> Float[np.ndarray, "n 3"]:
        """Points of an edge, or a derivative."""
        own = self.edges[edge]
        if isinstance(own, FixedEdge):
            return own.point(x, order)
        return np.asarray(own.shapes(x, order) @ control[self.controls[self.cable_numbers[edge]]])

    def tangents(self, control: Float[np.ndarray, "c 3"]) -> Float[np.ndarray, "2 e 3"]:
        """The derivatives of the edges at their starts and at their ends."""
        both = [self._on(k, _ENDS, control, 1) for k in range(len(self.edges))]
        return np.asarray(np.array(both).reshape(-1, 2, 3).transpose(1, 0, 2))

    def crossed(self, before: Float[np.ndarray, "c 3"], after: Float[np.ndarray, "c 3"]) -> Int[np.ndarray, " k"]:
        """The corners whose angles become negative from some control points to others."""
        pairs = [(starts, -np.roll(ends, 1, axis=0)) for starts, ends in map(self.tangents, (before, after))]
        old, new = (np.cross(*pair) for pair in pairs)
        return np.flatnonzero(((old * new).sum(axis=1) < 0) & ((pairs[1][0] * pairs[1][1]).sum(axis=1) > 0))

    @cached_property
    def starts(self) -> Float[np.ndarray, " n1"]:
        """Parameters of Γ at the corners, in proportion to the chords of the edges."""
        corners = self.nodes[: len(self.edges)]
        chords = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1) + 0.1 * self.size
        return np.asarray(np.append(0.0, np.cumsum(chords)) / chords.sum())

    def places(self, s: Float[np.ndarray, "*n"]) -> tuple[Int[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """The edges of parameters of Γ, and the parameters on them."""
        s = np.mod(s, 1.0)
        edge = np.searchsorted(self.starts[1:-1], s, side="right")
        return edge, (s - self.starts[edge]) / np.diff(self.starts)[edge]

    def curves(self, control: Float[np.ndarray, "c 3"]) -> list[ClosedCurve | Float[np.ndarray, "m 3"]]:
        """The rings, then Γ around the edges, if there are any."""
        rings = [
            np.asarray(ring.points, dtype=np.float64) + control[k]
            for ring, k in zip(self.rings, self.ring_controls.tolist(), strict=True)
        ]
        if not self.edges:
            return [*rings]
        widths = np.diff(self.starts)

        def derivative(order: int, s: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
            edge, x = self.places(np.asarray(s))
            values = np.empty((*np.shape(s), 3))
            for k in range(len(self.edges)):
                values[edge == k] = self._on(k, x[edge == k], control, order) / widths[k] ** order
            return values

        inner = [own.knots[1:-1] if isinstance(own, FixedEdge) else np.array([]) for own in self.edges]
        joints = [start + width * x for start, width, x in zip(self.starts, widths, inner, strict=False)]
        curve = ClosedCurve(
            point=partial(derivative, 0),
            derivative=partial(derivative, 1),
            second_derivative=partial(derivative, 2),
            corners=tuple(self.starts[:-1].tolist()),
            joints=tuple(np.concatenate(joints).tolist()),
        )
        return [*rings, curve]


def _chained(sides: Sequence[tuple[int, E]], tolerance: float) -> list[tuple[int, E]]:
    """Numbered edges in order around the frame, in the direction of the first one."""
    chain, left = list(sides[:1]), list(sides[1:])
    while left:
        ends = np.array([_points(one)[[0, -1]] for _, one in left])
        gaps = np.linalg.norm(ends - _points(chain[-1][1])[-1], axis=2)
        at, is_backward = np.unravel_index(gaps.argmin(), gaps.shape)
        number, own = left.pop(int(at))
        chain.append((number, _moved(own, _points(own)[::-1]) if is_backward else own))
    joined = []
    for (first, one), (second, other) in zip(chain, [*chain[1:], *chain[:1]], strict=True):
        points, start = np.array(_points(one)), _points(other)[0]
        gap = float(np.linalg.norm(start - points[-1]))
        if gap > tolerance:
            raise OptionError(
                f"edge {first} ends {gap:.3g} away from the nearest end of another, edge {second}; join them"
            )
        points[-1] = start
        joined.append((first, _moved(one, points)))
    return joined


def _points(edge: Cable | Ring | OpenCurve) -> Float[np.ndarray, "m 3"]:
    return edge.ends if isinstance(edge, Cable) else np.asarray(edge.points, dtype=np.float64)


def _moved(edge: E, points: Float[np.ndarray, "m 3"]) -> E:
    """An edge with other points."""
    return replace(edge, **({"start": points[0], "end": points[-1]} if isinstance(edge, Cable) else {"points": points}))


def _is_same(points: Float[np.ndarray, "m 3"], others: Float[np.ndarray, "n 3"]) -> bool:
    """Whether two edges have the same points, in any order."""
    nearest = cdist(points, others).min(axis=0).max() if len(points) == len(others) else np.inf
    return bool(nearest <= _MEETING * np.ptp(points, axis=0).max())
