"""Interpolation on strips of quadrilaterals. The common knots of a strip are refined until it is accurate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.deadline import seconds_left
from spinor_geom.mesh.rational_splines import on_side
from spinor_geom.nurbs.spline_space import SplineSpace

Breaks: TypeAlias = tuple[float, ...]
Values: TypeAlias = Float[np.ndarray, "_ _ 3"]
Errors: TypeAlias = Float[np.ndarray, "_"]
# number of a quadrilateral, u, v, and the pieces of v on which splines are smooth
Grid: TypeAlias = tuple[int, Float[np.ndarray, "_"], Float[np.ndarray, "_"], Breaks]
Sampler: TypeAlias = Callable[[Sequence[Grid]], list[tuple[Values, Values]]]

DEGREE = 9  # of splines with inner knots
NEARER_AT_RIMS = 10.0  # ratio of the tolerances inside and at rims, so that shells fit adjacent parts
_ROUNDS = 20  # of halving pieces
_MOST_POINTS = 200_000  # control points of all patches: 1 GB


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadMesh:
    """Sides and strips of a mesh of quadrilaterals.

    Sides 0 to 3 of a quadrilateral lie at v = 0, u = 1, v = 1 and u = 0: sides 0 and 2 run with u, sides 1 and 3 with
    v. A strip is a row of quadrilaterals that are neighbours along opposite sides. All have the same knots across it.
    """

    quads: Int[np.ndarray, "q 4"]  # the corners of each, counter-clockwise from u = v = 0
    rims: tuple[tuple[tuple[int, int], ...], ...]  # the sides on each rim, given by quadrilateral and side, in order

    @cached_property
    def on_rims(self) -> Bool[np.ndarray, "q 4"]:
        """Which sides lie on rims."""
        found = np.zeros(self.quads.shape, dtype=bool)
        found[tuple(np.transpose([side for rim in self.rims for side in rim]))] = True
        return found

    @cached_property
    def _sides(self) -> Int[np.ndarray, "q 4 2"]:
        return self.quads[:, [[0, 1], [1, 2], [3, 2], [0, 3]]]

    @cached_property
    def edges(self) -> Int[np.ndarray, "q 4"]:
        """The number of the edge of the mesh at each side. Sides on rims, and in corners, are edges of their own."""
        ends = np.sort(self._sides.reshape(-1, 2), axis=1)
        own = np.where(self.on_rims.ravel() | (ends[:, 0] == ends[:, 1]), np.arange(len(ends)), -1)
        _, index = np.unique(np.column_stack([ends, own]), axis=0, return_inverse=True)
        return np.asarray(index).reshape(-1, 4)

    @cached_property
    def ahead(self) -> Bool[np.ndarray, "q 4"]:
        """Whether a side runs from the corner of smaller number to the other one."""
        return np.asarray(self._sides[..., 0] < self._sides[..., 1])

    @cached_property
    def strips(self) -> tuple[Int[np.ndarray, "q 2"], Bool[np.ndarray, "q 2"]]:
        """For both parameters of each quadrilateral: the strip, and whether the parameter runs against it."""
        strip = np.full(int(self.edges.max()) + 1, -1)
        against = np.zeros(len(strip), dtype=bool)
        of_edge: list[list[tuple[int, int]]] = [[] for _ in strip]
        for quad, row in enumerate(self.edges.tolist()):
            for side, edge in enumerate(row):
                of_edge[edge].append((quad, side))
        count = 0
        for first in range(len(strip)):
            if strip[first] >= 0:
                continue
            strip[first], front = count, [first]
            while front:
                edge = front.pop()
                for quad, side in of_edge[edge]:
                    other = int(self.edges[quad, side ^ 2])
                    if strip[other] < 0:
                        strip[other] = count
                        against[other] = against[edge] ^ (self.ahead[quad, side] != self.ahead[quad, side ^ 2])
                        front.append(other)
            count += 1
        along = self.edges[:, [0, 3]]
        return strip[along], against[along] ^ ~self.ahead[:, [0, 3]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """B-spline patches on the quadrilaterals of a mesh."""

    spaces: tuple[tuple[SplineSpace, SplineSpace], ...]  # the splines in u and v of each
    nets: tuple[Values, ...]  # their control points. Neighbours have equal ones along the side that they share
    error: float  # an estimate of the largest distance of the patches from the positions to interpolate

    @property
    def points(self) -> int:
        """Number of control points of all patches."""
        return sum(net.shape[0] * net.shape[1] for net in self.nets)


def fitted(mesh: QuadMesh, sample: Sampler, tolerance: float, rounding: float) -> Fit:
    """Patches of the least degree without inner knots, or of degree `DEGREE` with the knots that a tolerance needs.

    `sample` returns positions of the surface, and those moved near the rims, which are interpolated at the nodes. The
    error is measured halfway between nodes, along u and along v, for the surface itself and for the rims. Pieces of a
    strip where it exceeds half of the tolerance, and the rounding of positions, both in mesh units, are halved. Pieces
    whose error is below the displacement of the rim, by the boundary residual of the solution, are not halved. None is
    halved at the time limit, or if twice the points are not nearer, as with inaccurate positions.
    """
    begin = perf_counter()
    strip, against = mesh.strips
    breaks: list[Breaks] = [(0.0, 1.0)] * (int(strip.max()) + 1)
    whole = _Sampled.of(mesh, sample, breaks, DEGREE, {})
    degree = next((d for d in range(1, DEGREE) if whole.error_of_degree(d) <= tolerance / (2 * NEARER_AT_RIMS)), DEGREE)
    if degree < DEGREE:
        return _Sampled.of(mesh, sample, breaks, degree, {}).fit(mesh)
    known = best = whole
    for _ in range(_ROUNDS):
        # a round takes about as long as all before it, and so do the measurements at the end
        if seconds_left() < 2 * (perf_counter() - begin):
            break
        chosen = known.inaccurate(strip, against, breaks, max(tolerance / 2, NEARER_AT_RIMS * rounding))
        halved = [_halved(own, some) for own, some in zip(breaks, chosen, strict=True)]
        sizes = np.array([len(own) - 1 + DEGREE for own in halved])
        if halved == breaks or sizes[strip].prod(axis=1).sum() > _MOST_POINTS:
            break
        breaks, known = halved, _Sampled.of(mesh, sample, halved, DEGREE, known.values)
        if known.error < best.error:
            best = known
        elif known.points > 2 * best.points:
            break
    return best.fit(mesh)


def _halved(breaks: Breaks, chosen: Bool[np.ndarray, " k"]) -> Breaks:
    """Breaks with the chosen pieces halved.

    A chosen piece at an end is halved twice, towards this end, if its neighbour is not chosen, as near corners.
    """
    ends = np.array(breaks)
    new = [((ends[1:] + ends[:-1]) / 2)[chosen]]
    if len(chosen) > 1:
        at_ends = chosen[[0, -1]] & ~chosen[[1, -2]]
        new.append((ends[[0, -1]] + (ends[[1, -2]] - ends[[0, -1]]) / 4)[at_ends])
    return tuple(np.sort(np.concatenate([ends, *new])).tolist())


_Key: TypeAlias = tuple[int, SplineSpace, SplineSpace]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Values:
    """Positions of a patch at its nodes, and its largest error.

    `along_u` and `along_v` have, halfway between nodes in u and in v, the largest errors that exceed the displacement
    of the rim, and 0 elsewhere.
    """

    at_nodes: Values
    error: float
    along_u: Errors
    along_v: Errors


_Known: TypeAlias = dict[_Key, _Values]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sampled:
    """Positions at the nodes of all patches, and errors between them."""

    spaces: tuple[tuple[SplineSpace, SplineSpace], ...]
    values: _Known

    @classmethod
    def of(
        cls,
        mesh: QuadMesh,
        sample: Sampler,
        breaks: Sequence[Breaks],
        degree: int,
        known: _Known,
    ) -> _Sampled:
        """Samples for given breaks. Patches whose splines are among the known ones are not sampled again."""
        spaces = []
        for strips, flips in zip(*mesh.strips, strict=True):
            own = (
                breaks[k] if not flip else tuple(1 - b for b in breaks[k][::-1])
                for k, flip in zip(strips, flips, strict=True)
            )
            u, v = (SplineSpace.on(degree, each) for each in own)
            spaces.append((u, v))
        keys = [(quad, *pair) for quad, pair in enumerate(spaces)]
        new = [key for key in keys if key not in known]
        grids = []
        for quad, u, v in new:
            pairs = (u.nodes, v.nodes), (u.between, v.nodes), (u.nodes, v.between)
            grids += [(quad, *pair, v.breaks) for pair in pairs]
        found = sample(grids) if grids else []
        values = {key: known[key] for key in keys if key in known}
        for key, at_nodes, between_u, between_v in zip(new, found[::3], found[1::3], found[2::3], strict=True):
            quad, u, v = key
            exact, (exact_u, _), (exact_v, _) = at_nodes[0], between_u, between_v
            along_u = np.linalg.norm(np.tensordot(u.to_between, exact, axes=1) - exact_u, axis=2)
            along_v = np.linalg.norm(v.to_between @ exact - exact_v, axis=2)
            shifts = []
            for side in np.flatnonzero(mesh.on_rims[quad]).tolist():
                if side % 2 == 0:
                    one, two, middle, errors = u, v, between_u, (along_u, along_v)
                else:
                    one, two, middle, errors = v, u, between_v, (along_v.T, along_u.T)
                on, at, on_middle, at_middle = (each[on_side(side)] for each in (*at_nodes, *middle))
                is_first = side in (0, 3)
                missed = np.linalg.norm(one.to_between @ at - at_middle, axis=1)
                errors[0][:, 0 if is_first else -1] = NEARER_AT_RIMS * missed
                for own, shift, x in zip(
                    errors, (at_middle - on_middle, at - on), (two.nodes, two.between), strict=True
                ):
                    near = (1 - x if is_first else x) ** 2
                    shifts.append((own, np.linalg.norm(shift, axis=1)[:, None] * near))
            error = float(max(along_u.max(), along_v.max()))
            for own, shift in shifts:
                own *= own > shift  # pieces whose error is below the displacement, which decays so, are not halved
            values[key] = _Values(
                at_nodes=at_nodes[1], error=error, along_u=along_u.max(axis=1), along_v=along_v.max(axis=0)
            )
        return cls(spaces=tuple(spaces), values=values)

    @property
    def points(self) -> int:
        """Number of control points."""
        return sum(u.dimension * v.dimension for u, v in self.spaces)

    def error_of_degree(self, degree: int) -> float:
        """An estimate of the error at a lower degree, for patches without inner knots.

        It is the largest distance of both interpolants at the nodes, plus the error at the present degree.
        """
        low = SplineSpace.on(degree, (0.0, 1.0))
        (high, _), *_ = self.spaces
        to_low = high.basis(low.nodes) @ high.interpolation
        back = low.basis(high.nodes) @ low.interpolation @ to_low - np.eye(high.dimension)
        lost = max(
            max(np.abs(np.tensordot(back, each.at_nodes, axes=1)).max(), np.abs(back @ each.at_nodes).max())
            for each in self.values.values()
        )
        return float(lost) + self.error

    @property
    def error(self) -> float:
        """The largest error."""
        return max(each.error for each in self.values.values())

    def inaccurate(
        self, strip: Int[np.ndarray, "q 2"], against: Bool[np.ndarray, "q 2"], breaks: Sequence[Breaks], allowed: float
    ) -> list[Bool[np.ndarray, " _"]]:
        """Whether the error of each piece is above the allowed one and above the displacement of the rim, by strips."""
        chosen = [np.zeros(len(own) - 1, dtype=bool) for own in breaks]
        for quad, pair in enumerate(self.spaces):
            u, v = pair
            own = self.values[quad, u, v]
            for axis, (space, error) in enumerate(zip(pair, (own.along_u, own.along_v), strict=True)):
                pieces = space.pieces[error > allowed]
                if against[quad, axis]:
                    pieces = len(space.breaks) - 2 - pieces
                chosen[strip[quad, axis]][pieces] = True
        return chosen

    def fit(self, mesh: QuadMesh) -> Fit:
        """The control points."""
        nets = []
        for quad, (u, v) in enumerate(self.spaces):
            values = self.values[(quad, u, v)].at_nodes
            nets.append(np.tensordot(u.interpolation, v.interpolation @ values, axes=1))
        share_sides(mesh, nets)
        return Fit(spaces=self.spaces, nets=tuple(nets), error=self.error)


def share_sides(mesh: QuadMesh, nets: Sequence[Float[np.ndarray, "_ _ c"]]) -> None:
    """Copies each shared side and corner from the first control net that has it to the others, in place."""
    rows: dict[int, tuple[Float[np.ndarray, "_ c"], bool]] = {}
    corners: dict[int, Float[np.ndarray, " c"]] = {}
    for quad, net in enumerate(nets):
        for corner, (a, b) in zip(mesh.quads[quad].tolist(), ((0, 0), (-1, 0), (-1, -1), (0, -1)), strict=True):
            net[a, b] = corners.setdefault(corner, net[a, b].copy())
        for side in range(4):
            row = net[on_side(side)]
            ahead = bool(mesh.ahead[quad, side])
            first, direction = rows.setdefault(int(mesh.edges[quad, side]), (row.copy(), ahead))
            row[:] = first if direction == ahead else first[::-1]
