"""One quadrilateral that covers a disk with at most four corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Complex, Float

from spinor_geom.domain.delaunay import cross
from spinor_geom.nurbs.rims import Rim
from spinor_geom.nurbs.strips import Grid, QuadMesh, Values
from spinor_geom.surface.array_surface import ArraySurface

_GRID = np.linspace(0, 1, 65)  # parameters where the quadrilateral is tested for folds
_LEAST_SINE = 0.02  # of its angles
_SHARP = np.pi / 6  # largest angle of a single corner. At larger ones several patches are never too short
_ASIDE = 1e-6  # the angle at a corner is between points at this distance along Γ, relative to its length

_Row = TypeVar("_Row", bound=np.ndarray)


@dataclass(frozen=True, kw_only=True, eq=False)
class OnePatch:
    """A surface over a disk as one quadrilateral, whose rim is moved to the curve.

    Its sides are those of the curve. With fewer than four corners, one side lies in the sharpest corner, or one in each
    of two corners: there the patch is singular, as a sphere is at its poles. With a single corner the point farthest
    from it is the other pole, as the nose of an airfoil. Across, points are similarity images of
    the first and the third side, blended. At equal parameters points of opposite sides have equal shares of their
    sides, so lines of constant u or v follow the curve.
    """

    surface: ArraySurface
    rim: Rim
    sides: Float[np.ndarray, "4 2"]  # parameters of the rim at the ends of each, in the rim's direction

    @classmethod
    def of(cls, surface: ArraySurface, rims: Sequence[Rim]) -> OnePatch | None:
        """The quadrilateral, or None if it would be folded, or the surface has not one curve with 1 to 4 corners.

        A single corner must be sharp.
        """
        if len(rims) > 1 or not 1 <= len(rims[0].corners) <= 4:
            return None
        (rim,) = rims
        corners, angles = rim.corners, _angles(rim)
        if len(corners) == 1:
            if angles[0] > _SHARP:
                return None
            breaks = rim.curve.breaks[:-1]
            away = rim.curve.point(breaks) - rim.curve.point(corners)
            corners = np.append(corners, breaks[np.linalg.norm(away, axis=1).argmax()])
        elif len(corners) == 3:
            corners = np.roll(corners, -1 - angles.argmin())
        corners = np.append(corners, corners[0])
        ends = np.stack([corners[:-1], corners[1:] + (corners[1:] <= corners[:-1])], axis=1)
        # the third side lies in the last corner, or the first and the third in both corners
        before = {2: slice(2), 3: slice(2, 3), 4: slice(0)}[len(ends)]
        sides = np.insert(ends, before, ends[before, :1], axis=0)
        found = cls(surface=surface, rim=rim, sides=sides)
        z, _, _ = found._outlines(_GRID, _GRID)
        rows = slice(1 if found.collapsed[0] else 0, -1 if found.collapsed[2] else None)
        u, v = np.diff(z, axis=0), np.diff(z, axis=1)
        # at the four corners of each cell
        pairs = [(u[:, 1:], v[1:]), (u[:, 1:], v[:-1]), (u[:, :-1], v[1:]), (u[:, :-1], v[:-1])]
        is_open = all((cross(a, b)[:, rows] > _LEAST_SINE * np.abs(a * b)[:, rows]).all() for a, b in pairs)
        return found if is_open else None

    @property
    def collapsed(self) -> Bool[np.ndarray, "4"]:
        """Which sides lie in a corner."""
        return np.asarray(self.sides[:, 0] == self.sides[:, 1])

    @property
    def mesh(self) -> QuadMesh:
        """The quadrilateral as a mesh."""
        own = np.flatnonzero(~self.collapsed).tolist()
        return QuadMesh(quads=np.arange(4)[None], rims=(tuple((0, side) for side in own),))

    def on(self, grids: Sequence[Grid]) -> list[tuple[Values, Values]]:
        """For each grid the positions of the minimal surface, and those moved so that the rim is Γ."""
        outlines = [self._outlines(u, v) for _, u, v, _ in grids]
        is_inside = [_is_inside(u)[:, None] & _is_inside(v) for _, u, v, _ in grids]
        z = [points[some] for (points, *_), some in zip(outlines, is_inside, strict=True)]
        parts = np.split(self.surface.position(np.concatenate(z)), np.cumsum([len(some) for some in z])[:-1])
        for (_, exact, _), some, inner in zip(outlines, is_inside, parts, strict=True):
            exact[some] = inner
        return [(exact, exact + shift) for _, exact, shift in outlines]

    def _outlines(
        self, u: Float[np.ndarray, " n"], v: Float[np.ndarray, " m"]
    ) -> tuple[Complex[np.ndarray, "n m"], Values, Values]:
        """Points in Ω, and positions on ∂Ω and their differences from Γ, extended from the four sides."""
        steps = [np.concatenate([[0.0], at, [1.0]]) for at in (u, v, (1 - u)[::-1], (1 - v)[::-1])]
        x = np.concatenate([(1 - at) * a + at * b for at, (a, b) in zip(steps, self.sides, strict=True)])
        t = self.rim.on_boundary(x)
        on_rim = self.rim.positions(t)
        rows = self.rim.boundary.point(t), on_rim, self.rim.curve.point(self.rim.on_curve(x)[0]) - on_rim
        cuts = np.cumsum([len(at) for at in steps])[:-1]
        z, *values = (_along(np.split(row, cuts)) for row in rows)
        positions, shifts = (_extended(sides, u, v) for sides in values)
        return self._across(z, u, v), positions, shifts

    def _across(
        self, sides: Sequence[Complex[np.ndarray, " _"]], u: Float[np.ndarray, " n"], v: Float[np.ndarray, " m"]
    ) -> Complex[np.ndarray, "n m"]:
        """Points of Ω between those of the second and the fourth side."""
        shapes = [
            u if collapsed else (side[1:-1] - side[0]) / (side[-1] - side[0])
            for side, collapsed in zip(sides[::2], self.collapsed[::2], strict=True)
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


def _is_inside(at: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    return (at > 0) & (at < 1)


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
