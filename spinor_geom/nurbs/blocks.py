"""Ω divided into quadrilaterals: a ring of them along each boundary, and others inside the rings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from spinor_geom.domain.delaunay import constrained_delaunay, cross, rim_successors
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.polygons import bound_domain
from spinor_geom.errors import DomainError
from spinor_geom.nurbs.quadrangulation import LEAST_SINE, cut_open, quadrangulated, sides_of
from spinor_geom.nurbs.rims import Rim

_FEWEST, _FINE = 4, 64  # fewest quadrilaterals along a boundary, and first number along smooth ones
_DEPTHS = 0.5 ** (np.arange(60) / 3)  # possible depths of rings, in diameters of Ω
_DEEPEST = 0.35  # largest depth of a ring with corners, relative to the shorter of two neighbouring sides
_SHALLOWER = 0.7  # factor that reduces the depth of folded quadrilaterals
_SLOPE = 0.15  # largest change of depth between two marks, relative to their distance
# A depth is allowed where no other part of ∂Ω is nearer to the inner corner than this share of the distance from its
# own part.
_CLEAR = 0.9
# Parameters along a side where quadrilaterals are tested for folds, and those for joined ones that are folded between
# them, which takes three times as long.
_GRID, _DENSE = np.linspace(0, 1, 17), np.linspace(0, 1, 65)
_ASIDE = 0.005  # one-sided derivatives are taken this share of the side inside its ends
# Largest turn of ∂Ω along a quadrilateral that replaces several, in radians: smaller gives more quadrilaterals, larger
# more knots.
_TURN = 1.65
_BLEND = 4  # order to which quadrilaterals are bilinear in a power at one corner, if not at the next one
_EVEN = 0.1  # least ratio of smallest to largest thickness of a quadrilateral
_LONGEST = 8.0  # largest ratio of length to depth before neighbours are joined
_MOST_CORNERS = 100  # of a polygon that is divided into quadrilaterals: the time grows with the fourth power
_MOST_PAIRS = 2**22  # of points of ∂Ω whose distances are computed at once
_ROUNDS = 10  # largest number of rounds that halve sides on ∂Ω
# Most sides on ∂Ω, as a multiple of the first ones. Where the boundary of the surface runs back and forth, a round
# doubles them in vain.
_MOST_HALVED = 8
_NOT_DIVIDED = (
    "the plane domain cannot be divided into quadrilaterals: a part of it is too narrow, or the surface is too far "
    "from its curve; write a mesh instead (mesh_patch, or solve -o film.stl)"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Blocks:
    """Quadrilaterals that cover Ω, counter-clockwise.

    The first ones form rings along the boundaries, in order. The side from the first to the second corner of such a
    quadrilateral is a part of ∂Ω. All other sides are straight.

    Where ∂Ω is smooth at a corner of angle πβ of the surface, positions are smooth functions of (z − c)^β, c the image
    of the corner. Quadrilaterals there are bilinear in that power.
    """

    points: Complex[np.ndarray, " n"]  # the corners of all quadrilaterals
    quads: Int[np.ndarray, "q 4"]  # indices of the corners of each
    # parameters, as in `Rim`, of both ends of each side on ∂Ω, increasing. The last may exceed 1
    parts: Float[np.ndarray, "r 2"]
    powers: Float[np.ndarray, "r 2"]  # β at both ends of each side on ∂Ω, 1 but at such corners
    sizes: tuple[int, ...]  # numbers of quadrilaterals along each boundary

    @classmethod
    def of(cls, domain: PlaneDomain, rims: Sequence[Rim]) -> Blocks:
        """Quadrilaterals with corners at all corners of ∂Ω, whose sides on ∂Ω are halved until none is folded.

        Raises a DomainError if a part of Ω is too narrow, or the boundary of the surface runs back and forth along Γ.
        """
        rings = [_Ring.along(domain, rim) for rim in rims]
        most = _MOST_HALVED * max(_FINE, sum(map(len, rings)))
        for _ in range(_ROUNDS):
            folded = [ring.folded() for ring in rings]
            if not any(some.any() for some in folded):
                if _bounds_region(rings):
                    break
                folded = [~some for some in folded]
            rings = [ring.improved(domain, some) for ring, some in zip(rings, folded, strict=True)]
            if sum(map(len, rings)) > most:
                raise DomainError(_NOT_DIVIDED)
        else:
            raise DomainError(_NOT_DIVIDED)
        rings = _shortened(domain, rings)
        while (found := _filled(rings)) is None:
            fewer = _coarser(rings)
            if sum(map(len, fewer)) == sum(map(len, rings)):
                break
            rings = fewer
        finer = rings
        while found is None and sum(map(len, finer)) < 2 * sum(map(len, rings)):
            finer = _longest_halved(domain, finer)
            found = _filled(finer)
        return _with_triangles(rings) if found is None else _assembled(*found)

    def rim_of(self, quad: int) -> int:
        """The number of the boundary on which the first side of a quadrilateral lies."""
        return int(np.searchsorted(np.cumsum(self.sizes), quad, side="right"))

    def grid(
        self, quad: int, u: Float[np.ndarray, " n"], v: Float[np.ndarray, " m"], first: Complex[np.ndarray, " n"] | None
    ) -> Complex[np.ndarray, "n m"]:
        """Points of a quadrilateral at all pairs of parameters in [0, 1]: u along its first side, v away from it.

        `first` has the points of its first side at u, or None for a straight one.
        """
        return self.grid_and_steps(quad, u, v, first)[0]

    def grid_and_steps(
        self, quad: int, u: Float[np.ndarray, " n"], v: Float[np.ndarray, " m"], first: Complex[np.ndarray, " n"] | None
    ) -> tuple[Complex[np.ndarray, "n m"], Complex[np.ndarray, "n m"]]:
        """`grid`, and its derivatives with respect to v."""
        a, b, c, d = self.points[self.quads[quad]]
        side, across = a + u * (b - a) if first is None else first, d + u * (c - d)
        powers = self.powers[quad] if quad < len(self.powers) else np.ones(2)
        if (powers == 1).all():
            return (1 - v) * side[:, None] + v * across[:, None], np.repeat((across - side)[:, None], len(v), axis=1)
        total = np.zeros((2, len(u), len(v)), dtype=np.complex128)
        near, far = u**_BLEND, (1 - u) ** _BLEND
        for start, end, power, share in ((a, d, powers[0], far), (b, c, powers[1], near)):
            begin, finish = (_power((some - start) / (end - start), power)[:, None] for some in (side, across))
            between = (1 - v) * begin + v * finish
            steps = _power(between, 1 / power - 1) * (finish - begin) / power
            values = start + (end - start) * _power(between, 1 / power), (end - start) * steps
            total += (share / (near + far))[:, None] * np.stack(values)
        return total[0], total[1]


def _power(z: Complex[np.ndarray, "*pts"], power: float) -> Complex[np.ndarray, "*pts"]:
    """Principal values of z^power, 0 for z = 0."""
    return np.asarray(np.abs(z) ** power * np.exp(1j * power * np.angle(z)))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Ring:
    """Quadrilaterals along a boundary."""

    rim: Rim
    marks: Float[np.ndarray, " k"]  # parameters of their corners, increasing
    outer: Complex[np.ndarray, " k"]  # the corners on ∂Ω
    depth: Float[np.ndarray, " k"]  # distances of the inner corners from the outer ones
    inwards: Complex[np.ndarray, " k"]  # unit vectors from outer to inner corners, bisectors of the angles of ∂Ω
    fixed: Bool[np.ndarray, " k"]  # which marks are corners of ∂Ω

    def __len__(self) -> int:
        return len(self.marks)

    @classmethod
    def along(cls, domain: PlaneDomain, rim: Rim) -> _Ring:
        """Many short quadrilaterals along a smooth boundary, or one between each two neighbouring corners."""
        marks = rim.corners if len(rim.corners) else np.arange(_FINE) / _FINE
        while len(marks) < _FEWEST:
            lengths = _lengths(rim, marks)
            marks = np.sort(np.append(marks, ((marks + _ends(marks)) / 2)[lengths.argmax()] % 1.0))
        return cls.at(domain, rim, marks)

    @classmethod
    def at(cls, domain: PlaneDomain, rim: Rim, marks: Float[np.ndarray, " k"]) -> _Ring:
        """Quadrilaterals between marks.

        Depths are half of the largest at which inner corners are nearest to their own part of ∂Ω.
        """
        before, after = rim.tangents(marks)
        half = (np.pi - np.angle(after / before)) / 2
        inwards, outer, fixed = after * np.exp(1j * half), rim.point(marks), np.isin(marks, rim.corners)
        depths = domain.diameter * _DEPTHS[:, None]
        clear = -domain.distance_outside((outer + depths * inwards).ravel()).reshape(len(depths), -1)
        possible = clear >= _CLEAR * depths * np.sin(np.minimum(half, np.pi / 2))
        possible[-1] = True
        depth = depths[possible.argmax(axis=0), 0] / 2
        if fixed.any():
            lengths = _lengths(rim, marks)
            depth = np.minimum(depth, _DEEPEST * np.minimum(lengths, np.roll(lengths, 1)))
        depth = _levelled(depth, outer)
        return cls(rim=rim, marks=marks, outer=outer, depth=depth, inwards=inwards, fixed=fixed)

    @property
    def inner(self) -> Complex[np.ndarray, " k"]:
        """The inner corners."""
        return np.asarray(self.outer + self.depth * self.inwards)

    @property
    def powers(self) -> Float[np.ndarray, " k"]:
        """`Rim.powers` at the marks that are corners, 1 at the others."""
        powers = np.ones(len(self))
        powers[self.fixed] = self.rim.powers
        return powers

    @property
    def lengths(self) -> Float[np.ndarray, " k"]:
        """Lengths of the sides on ∂Ω."""
        return _lengths(self.rim, self.marks)

    def improved(self, domain: PlaneDomain, folded: Bool[np.ndarray, " k"]) -> _Ring:
        """The ring with folded quadrilaterals halved, or made shallower if they are deeper than long."""
        deep = folded & (np.maximum(self.depth, np.roll(self.depth, -1)) > self.lengths)
        depth = np.where(deep | np.roll(deep, 1), _SHALLOWER * self.depth, self.depth)
        finer = self.halved(domain, folded & ~deep)
        most = np.interp(finer.marks, self.marks, depth, period=1.0)
        return replace(finer, depth=_levelled(np.minimum(finer.depth, most), finer.outer))

    def halved(self, domain: PlaneDomain, chosen: Bool[np.ndarray, " k"]) -> _Ring:
        """The ring with the chosen quadrilaterals halved."""
        middle = ((self.marks + _ends(self.marks)) / 2)[chosen] % 1.0
        return _Ring.at(domain, self.rim, np.sort(np.append(self.marks, middle))) if len(middle) else self

    def coarser(self) -> _Ring:
        """The ring with pairs of neighbours joined, the shortest first, where the result is not folded."""
        k = len(self)
        end, after = np.append(self.marks[2:], self.marks[:2] + 1), np.roll(np.arange(k), -2)
        folded = _folded(self.rim, self.marks, end, self.inner, self.inner[after])
        # rounded, so that equal lengths are joined in order
        length = np.round((self.lengths + np.roll(self.lengths, -1)) / self.lengths.sum(), 9)
        kept, used = np.ones(k, dtype=bool), np.zeros(k, dtype=bool)
        for first in np.argsort(length, kind="stable").tolist():
            second = (first + 1) % k
            if not (folded[first] or self.fixed[second] or used[first] or used[second]) and kept.sum() > _FEWEST:
                kept[second], used[first], used[second] = False, True, True
        return self.kept(kept)

    def kept(self, which: Bool[np.ndarray, " k"]) -> _Ring:
        """The ring with some of its marks."""
        left = {name: getattr(self, name)[which] for name in ("marks", "outer", "depth", "inwards", "fixed")}
        return replace(self, **left)

    def joins(self, grid: Float[np.ndarray, " g"]) -> Int[np.ndarray, "j 3"]:
        """First mark, last mark and number of the quadrilaterals that one unfolded one can replace, for all choices."""
        k = len(self)
        first, more = np.nonzero(np.ones((k, max(1, k // _FEWEST)), dtype=bool))
        last = first + more + 1
        crossed = np.append(0, np.cumsum(np.append(self.fixed, self.fixed)))
        free = (more > 0) & (crossed[last] == crossed[first + 1])
        first, last = first[free], last[free]
        marks, inner = np.append(self.marks, self.marks + 1), np.append(self.inner, self.inner)
        folded = _folded(self.rim, marks[first], marks[last], inner[first], inner[last], grid, most_turn=_TURN)
        return np.asarray(np.stack([first, last % k, last - first], axis=1)[~folded])

    def folded(self, grid: Float[np.ndarray, " g"] = _GRID) -> Bool[np.ndarray, " k"]:
        """Which quadrilaterals are folded, or nearly so."""
        return _folded(self.rim, self.marks, _ends(self.marks), self.inner, np.roll(self.inner, -1), grid)


def _levelled(depth: Float[np.ndarray, " k"], outer: Complex[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Depths that change slowly along ∂Ω."""
    parts = np.array_split(outer, 1 + len(outer) ** 2 // _MOST_PAIRS)
    return np.concatenate([(depth + _SLOPE * np.abs(some[:, None] - outer)).min(axis=1) for some in parts])


def _ends(marks: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    return np.append(marks[1:], marks[0] + 1)


def _lengths(rim: Rim, marks: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    t = marks[:, None] + (_ends(marks) - marks)[:, None] * _GRID
    return np.asarray(np.abs(np.diff(rim.point(t), axis=1)).sum(axis=1))


def _folded(
    rim: Rim,
    start: Float[np.ndarray, " k"],
    end: Float[np.ndarray, " k"],
    before: Complex[np.ndarray, " k"],
    after: Complex[np.ndarray, " k"],
    grid: Float[np.ndarray, " g"] = _GRID,
    most_turn: float = np.inf,
) -> Bool[np.ndarray, " k"]:
    """Which quadrilaterals between boundary points and inner corners are folded, or nearly so.

    Those along parts of ∂Ω that turn by more than `most_turn` count as folded.
    """
    width = (end - start)[:, None]
    t, step = start[:, None] + width * grid, (after - before)[:, None]
    velocity = width * rim.derivative(start[:, None] + width * np.clip(grid, _ASIDE, 1 - _ASIDE))
    across = before[:, None] + grid * step - rim.point(t)
    along = (1 - grid) * velocity[..., None] + grid * step[..., None]
    area = cross(along, across[..., None])
    thickness = np.abs(across)
    even = thickness.min(axis=1) > _EVEN * thickness.max(axis=1)
    turn = np.abs(np.angle(velocity[:, 1:] / velocity[:, :-1])).sum(axis=1)
    is_open = (area > LEAST_SINE * np.abs(along) * thickness[..., None]).all(axis=(1, 2))
    return np.asarray(~(even & is_open & (turn <= most_turn)))


def _bounds_region(rings: Sequence[_Ring]) -> bool:
    """Whether the inner corners bound a region."""
    return bound_domain(tuple(ring.inner for ring in rings))


def _coarser(rings: list[_Ring]) -> list[_Ring]:
    """The rings, coarser where the inner corners then still bound a region."""
    for k, ring in enumerate(rings):
        fewer = [*rings[:k], ring.coarser(), *rings[k + 1 :]]
        rings = fewer if _bounds_region(fewer) else rings
    return rings


def _longest_halved(domain: PlaneDomain, rings: Sequence[_Ring]) -> list[_Ring]:
    """The rings after halving the quadrilateral with the longest side on ∂Ω."""
    lengths = [ring.lengths for ring in rings]
    number = int(np.argmax([own.max() for own in lengths]))
    longest = np.arange(len(rings[number])) == lengths[number].argmax()
    return [ring.halved(domain, longest) if ring is rings[number] else ring for ring in rings]


def _shortened(domain: PlaneDomain, rings: Sequence[_Ring]) -> list[_Ring]:
    """The rings with long quadrilaterals halved, so that corners on both sides of a narrow part can face each other."""
    for _ in range(_ROUNDS):
        long = [ring.lengths > _LONGEST * np.minimum(ring.depth, np.roll(ring.depth, -1)) for ring in rings]
        finer = [ring.halved(domain, some) for ring, some in zip(rings, long, strict=True)]
        unchanged = sum(map(len, finer)) == sum(map(len, rings))
        if unchanged or sum(map(len, finer)) > _MOST_CORNERS or any(ring.folded().any() for ring in finer):
            break
        rings = finer
    return list(rings)


def _filled(rings: Sequence[_Ring]) -> tuple[list[_Ring], Int[np.ndarray, "q 4"]] | None:
    """The rings with some neighbours joined, and the quadrilaterals inside, of least cost, or None without any."""
    found = _joined(rings, _GRID)
    is_folded = found is not None and any(ring.folded(_DENSE).any() for ring in found[0])
    return _joined(rings, _DENSE) if is_folded else found


def _joined(rings: Sequence[_Ring], grid: Float[np.ndarray, " g"]) -> tuple[list[_Ring], Int[np.ndarray, "q 4"]] | None:
    """`_filled`, with joined quadrilaterals that are not folded at some parameters."""
    sizes = tuple(map(len, rings))
    if sum(sizes) > _MOST_CORNERS:
        return None
    inner = np.concatenate([ring.inner for ring in rings])
    polygon = cut_open(inner, sizes)
    joins = [ring.joins(grid) for ring in rings]
    ends = [own[:, :2] + first for own, first in zip(joins, np.cumsum((0, *sizes)), strict=False)]
    sides = sides_of(polygon, np.concatenate(ends), np.concatenate([own[:, 2] for own in joins]))
    quads = quadrangulated(inner[polygon], sides)
    if quads is None:
        return None
    used = np.zeros(len(inner), dtype=bool)
    used[polygon[quads]] = True
    kept = np.split(used, np.cumsum(sizes)[:-1])
    return [ring.kept(own) for ring, own in zip(rings, kept, strict=True)], (np.cumsum(used) - 1)[polygon[quads]]


def _assembled(rings: Sequence[_Ring], inside: Int[np.ndarray, "q 4"]) -> Blocks:
    """All quadrilaterals, those of the rings first."""
    sizes = tuple(map(len, rings))
    n, after = sum(sizes), rim_successors(sizes)
    own = np.arange(n)
    return Blocks(
        points=np.concatenate([ring.outer for ring in rings] + [ring.inner for ring in rings]),
        quads=np.concatenate([np.stack([own, after, n + after, n + own], axis=1), n + inside]),
        parts=np.concatenate([np.stack([ring.marks, _ends(ring.marks)], axis=1) for ring in rings]),
        powers=np.concatenate([np.stack([ring.powers, np.roll(ring.powers, -1)], axis=1) for ring in rings]),
        sizes=sizes,
    )


def _with_triangles(rings: Sequence[_Ring]) -> Blocks:
    """Quadrilaterals of the rings, each halved, and triangles inside, each divided into three quadrilaterals."""
    blocks = _assembled(rings, np.zeros((0, 4), dtype=np.int64))
    inner = np.concatenate([ring.inner for ring in rings])
    triangles = len(inner) + constrained_delaunay(inner, blocks.sizes)
    ring = blocks.quads
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    ends, index = np.unique(np.sort(np.concatenate([ring[:, 2:], sides]), axis=1), axis=0, return_inverse=True)
    halfway = blocks.parts.mean(axis=1)
    outside = [
        ring.rim.point(part) for ring, part in zip(rings, np.split(halfway, np.cumsum(blocks.sizes)[:-1]), strict=True)
    ]
    new = [blocks.points[ends].mean(axis=1), np.concatenate(outside), blocks.points[triangles].mean(axis=1)]
    first = len(blocks.points) + np.cumsum([0, *map(len, new)])
    inner, middle = np.split(first[0] + index.ravel(), [len(ring)])
    outer, middle = first[1] + np.arange(len(ring)), middle.reshape(-1, 3)
    centre = np.broadcast_to(first[2] + np.arange(len(triangles))[:, None], triangles.shape)
    a, b, c, d = ring.T
    halves = np.stack([np.stack([a, outer, inner, d], axis=1), np.stack([outer, b, c, inner], axis=1)], axis=1)
    thirds = np.stack([triangles, middle, centre, np.roll(middle, 1, axis=1)], axis=-1)
    (start, end), smooth = blocks.parts.T, np.ones(len(ring))
    return Blocks(
        points=np.concatenate([blocks.points, *new]),
        quads=np.concatenate([halves.reshape(-1, 4), thirds.reshape(-1, 4)]),
        parts=np.stack([start, halfway, halfway, end], axis=1).reshape(-1, 2),
        powers=np.stack([blocks.powers[:, 0], smooth, smooth, blocks.powers[:, 1]], axis=1).reshape(-1, 2),
        sizes=tuple(2 * size for size in blocks.sizes),
    )
