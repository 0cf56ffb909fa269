"""One quadrilateral that covers a disk with few corners, or several between its corners."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TypeVar, cast

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from spinor_geom.domain.delaunay import cross
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.nurbs.rims import Rim
from spinor_geom.nurbs.strips import Grid, QuadMesh, Values

_GRID = np.linspace(0, 1, 65)  # parameters where quadrilaterals are tested for folds
_STEPS = np.concatenate([[0.0], _GRID, [1.0]])
_FOLDED = 0.02  # largest sine of the angles of a quadrilateral that counts as folded
_SHARP = np.pi / 6  # largest angle of a single corner. At larger ones several patches are never too short
_ASIDE = 1e-6  # the angle at a corner is between points at this distance along Γ, relative to its length
_MOST_MARKS = 12  # between which Ω is divided. The time grows with the fourth power

_Row = TypeVar("_Row", bound=np.ndarray)
_Quad = tuple[int, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class CornerPatches:
    """A surface over a disk as one quadrilateral, or several between points of its rim, which is moved to the curve.

    Sides are parts of the curve, or straight cuts in Ω. With fewer than four corners, one side lies in a corner, or one
    in each of two corners: there the patch is singular, as a sphere is at its poles. With a single corner the point
    farthest from it is the other pole, as the nose of an airfoil. Across, points are similarity images of the first and
    the third side, blended. At equal parameters points of opposite sides have equal shares of their sides, so lines of
    constant u or v follow the curve.
    """

    rim: Rim
    marks: Float[np.ndarray, " m"]  # parameters of the corners of all quadrilaterals, increasing
    quads: Int[np.ndarray, "q 4"]  # indices of the corners of each, counter-clockwise. A repeated one is a pole

    @classmethod
    def of(cls, domain: PlaneDomain, rims: Sequence[Rim]) -> CornerPatches | None:
        """One quadrilateral over at most four corners, or several if it would be folded.

        None if they would be folded too, over several curves or no corner, and over a single one that is not sharp.
        """
        if len(rims) > 1 or not 1 <= len(rims[0].corners) <= _MOST_MARKS:
            return None
        (rim,) = rims
        marks = rim.corners
        if len(marks) == 1:
            if _angles(rim)[0] > _SHARP:
                return None
            breaks = rim.curve.breaks[:-1]
            away = rim.curve.point(breaks) - rim.curve.point(marks)
            marks = np.sort(np.append(marks, breaks[np.linalg.norm(away, axis=1).argmax()]))
        while (quads := _divided(domain, rim, marks)) is None:
            if len(marks) == _MOST_MARKS:
                return None
            ends = np.append(marks[1:], marks[0] + 1)
            lengths = np.abs(np.diff(rim.point(_straight(marks, ends, _GRID)), axis=0)).sum(axis=0)
            marks = np.sort(np.append(marks, ((marks + ends) / 2)[lengths.argmax()] % 1.0))
        return cls(rim=rim, marks=marks, quads=np.array(quads))

    @property
    def collapsed(self) -> Bool[np.ndarray, "q 4"]:
        """Which sides lie in a corner."""
        return np.asarray(self.quads == np.roll(self.quads, -1, axis=1))

    @cached_property
    def _is_cut(self) -> Bool[np.ndarray, "q 4"]:
        """Which sides lie in Ω."""
        return np.asarray((np.roll(self.quads, -1, axis=1) - self.quads) % len(self.marks) > 1)

    @property
    def mesh(self) -> QuadMesh:
        """The quadrilaterals as a mesh."""
        on_rim = np.argwhere(~(self.collapsed | self._is_cut))
        order = np.argsort(self.quads[tuple(on_rim.T)])
        return QuadMesh(quads=self.quads, rims=(tuple((quad, side) for quad, side in on_rim[order].tolist()),))

    def on(self, grids: Sequence[Grid]) -> list[tuple[Values, Values]]:
        """For each grid the positions of the minimal surface, and those moved so that the rim is Γ."""
        outlines = [self._outlines(quad, u, v) for quad, u, v, _ in grids]
        is_inside = [self._is_inside(quad, u, v) for quad, u, v, _ in grids]
        z = [points[some] for (points, *_), some in zip(outlines, is_inside, strict=True)]
        parts = np.split(self.rim.positions_inside(np.concatenate(z)), np.cumsum([len(some) for some in z])[:-1])
        for (_, exact, _), some, inner in zip(outlines, is_inside, parts, strict=True):
            exact[some] = inner
        return [(exact, exact + shift) for _, exact, shift in outlines]

    def _is_inside(self, quad: int, u: Float[np.ndarray, " n"], v: Float[np.ndarray, " m"]) -> Bool[np.ndarray, "n m"]:
        """Which points lie in Ω."""
        first, second, third, fourth = self._is_cut[quad].tolist()
        along, across = (u > 0) & (u < 1), (v > 0) & (v < 1)
        in_rows = across | (v == 0) & first | (v == 1) & third
        in_columns = along | (u == 0) & fourth | (u == 1) & second
        return np.asarray(along[:, None] & in_rows | in_columns[:, None] & across)

    def _outlines(
        self, quad: int, u: Float[np.ndarray, " n"], v: Float[np.ndarray, " m"]
    ) -> tuple[Complex[np.ndarray, "n m"], Values, Values]:
        """Points in Ω, and positions on ∂Ω and their differences from Γ, extended from the four sides."""
        steps = [np.concatenate([[0.0], at, [1.0]]) for at in (u, v, (1 - u)[::-1], (1 - v)[::-1])]
        start, end = self.marks[self.quads[quad]], self.marks[np.roll(self.quads[quad], -1)]
        end = end + (end < start)
        x = np.concatenate([(1 - at) * a + at * b for at, a, b in zip(steps, start, end, strict=True)])
        t = self.rim.on_boundary(x)
        on_rim = self.rim.positions(t)
        rows = self.rim.boundary.point(t), on_rim, self.rim.curve.point(self.rim.on_curve(x)[0]) - on_rim
        cuts = np.cumsum([len(at) for at in steps])[:-1]
        z, positions, shifts = (
            _along(
                [
                    _straight(own[0], own[-1], at) if is_cut else own
                    for own, at, is_cut in zip(np.split(row, cuts), steps, self._is_cut[quad], strict=True)
                ]
            )
            for row in rows
        )
        return _across(z, self.collapsed[quad], u, v), _extended(positions, u, v), _extended(shifts, u, v)


def _divided(domain: PlaneDomain, rim: Rim, marks: Float[np.ndarray, " m"]) -> list[_Quad] | None:
    """Quadrilaterals between points of ∂Ω that cover Ω, with the least total cost, or None if none do.

    The cost of a quadrilateral is 1 to 2, depending on its least sine, so that there are few. The division is found by
    dynamic programming over the lines between two points.
    """
    m = len(marks)
    ends = np.append(marks[1:], marks[0] + 1)
    on_rim = rim.point(_straight(marks, ends, _STEPS)).T
    cuts = _straight(np.broadcast_to(on_rim[:, :1], (m, m)), np.broadcast_to(on_rim[:, 0], (m, m)), _STEPS)
    outside = domain.distance_outside(cuts[2:-2].ravel()).reshape(-1, m, m).max(axis=0)

    def side(a: int, b: int) -> Complex[np.ndarray, " g"]:
        return np.asarray(on_rim[a] if (b - a) % m == 1 else cuts[:, a, b])

    def is_free(a: int, b: int) -> bool:
        return (b - a) % m in (0, 1, m - 1) or outside[a, b] < 0

    def between(corners: _Quad, poles: _Quad) -> tuple[float, _Quad]:
        """The cost of a quadrilateral with some corners, and its corners in the better order."""
        options, quad = [], tuple(sorted(corners + poles))
        for turned in (quad, (*quad[1:], quad[0])):
            sides = [side(a, b) for a, b in zip(turned, (*turned[1:], turned[0]), strict=True)]
            sine = _least_sine(_along(sides), np.equal(turned, (*turned[1:], turned[0])))
            options.append((1 + _FOLDED / sine if sine > _FOLDED else math.inf, turned))
        return min(options, key=_rounded)

    @cache
    def found(corners: _Quad) -> tuple[float, _Quad]:
        """The cost of the best of the quadrilaterals with some corners, and its corners in order."""
        choices = itertools.combinations(corners, 4 - len(corners))
        return min((between(corners, poles) for poles in choices), key=_rounded)

    @cache
    def best(first: int, last: int) -> tuple[float, tuple[_Quad, ...]]:
        """The least cost of the part between a line and ∂Ω, and its quadrilaterals."""
        if last - first < 2:
            return 0.0, ()
        least: tuple[float, tuple[_Quad, ...]] = math.inf, ()
        for inner in itertools.chain(*(itertools.combinations(range(first + 1, last), n) for n in (1, 2))):
            lines = list(itertools.pairwise((first, *inner, last)))
            if not all(is_free(*line) for line in lines):
                continue
            costs, parts = zip(*(best(*line) for line in lines), strict=True)
            if sum(costs) + 1 < least[0]:
                cost, quad = found((first, *inner, last))
                least = min(least, (sum(costs) + cost, (quad, *itertools.chain(*parts))), key=_rounded)
        return least

    if m == 2:
        cost, quad = found((0, 1))
        return [quad] if math.isfinite(cost) else None
    if m == len(rim.corners) == 3:
        # with the pole in the sharpest corner the normals at the other two are nearest to those of the surface
        for pole in _angles(rim).argsort().tolist():
            cost, quad = between((0, 1, 2), (pole,))
            if math.isfinite(cost):
                return [quad]
    cost, chosen = best(0, m - 1)
    return list(chosen) if math.isfinite(cost) else None


def _rounded(found: tuple[float, object]) -> float:
    """A cost without rounding errors, so that the first of equal ones is chosen."""
    return round(found[0], 6)


def _least_sine(sides: Sequence[Complex[np.ndarray, " g"]], collapsed: Bool[np.ndarray, "4"]) -> float:
    """The least sine of the angles at the corners of all cells of a grid, except along sides that lie in a corner."""
    z = _across(sides, collapsed, _GRID, _GRID)
    at_v0, at_u1, at_v1, at_u0 = collapsed.astype(int).tolist()
    u, v = np.diff(z, axis=0), np.diff(z, axis=1)
    pairs = [(u[:, 1:], v[1:]), (u[:, 1:], v[:-1]), (u[:, :-1], v[1:]), (u[:, :-1], v[:-1])]
    cells = slice(at_u0, len(u) - at_u1), slice(at_v0, len(u) - at_v1)
    return float(min((cross(a, b)[cells] / np.abs(a * b)[cells]).min() for a, b in pairs))


def _straight(start: _Row, end: _Row, share: Float[np.ndarray, " g"]) -> _Row:
    """Values between two, along a new first axis."""
    return cast(_Row, np.multiply.outer(1 - share, start) + np.multiply.outer(share, end))


def _across(
    sides: Sequence[Complex[np.ndarray, " _"]],
    collapsed: Bool[np.ndarray, "4"],
    u: Float[np.ndarray, " n"],
    v: Float[np.ndarray, " m"],
) -> Complex[np.ndarray, "n m"]:
    """Points of Ω between those of the second and the fourth side."""
    shapes = [
        u if point else (side[1:-1] - side[0]) / (side[-1] - side[0])
        for side, point in zip(sides[::2], collapsed[::2], strict=True)
    ]
    end, start = sides[1][1:-1], sides[3][1:-1]
    return np.asarray(start + (end - start) * (shapes[0][:, None] * (1 - v) + shapes[1][:, None] * v))


def _angles(rim: Rim) -> Float[np.ndarray, " c"]:
    """Angles of Γ at its corners."""
    corner = rim.curve.point(rim.corners)
    before, after = (rim.curve.point((rim.corners + step) % 1.0) - corner for step in (-_ASIDE, _ASIDE))
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(before, after), axis=1), (before * after).sum(axis=1)))


def _along(sides: Sequence[_Row]) -> list[_Row]:
    """Values on sides in the directions of u and v."""
    first, second, third, fourth = sides
    return [first, second, np.flip(third, 0), np.flip(fourth, 0)]


def _extended(
    sides: Sequence[Float[np.ndarray, "_ 3"]], u: Float[np.ndarray, " n"], v: Float[np.ndarray, " m"]
) -> Values:
    """Values on four sides, with both ends of each, extended to all pairs of u and v by transfinite interpolation.

    Source: Gordon & Hall, "Construction of curvilinear co-ordinate systems", Int. J. Numer. Meth. Engng. 7 (1973).
    """
    first, second, third, fourth = sides
    along, across = np.stack([1 - u, u], axis=1), np.stack([1 - v, v], axis=1)
    corners = np.stack([np.stack([first[0], third[0]]), np.stack([first[-1], third[-1]])])
    found = np.einsum("mk,knc->nmc", across, np.stack([first, third])[:, 1:-1])
    found += np.einsum("nk,kmc->nmc", along, np.stack([fourth, second])[:, 1:-1])
    return np.asarray(found - np.einsum("nj,mk,jkc->nmc", along, across, corners))
