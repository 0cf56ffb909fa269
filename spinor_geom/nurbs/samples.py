"""Positions of a solved surface on grids of quadrilaterals, with the given curves as its rims."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float, Inexact

from spinor_geom.domain.quadrature import cumulative_matrix, rule
from spinor_geom.holomorphic.arnoldi import barycentric_weights, leja_points
from spinor_geom.holomorphic.cauchy_sums import cauchy_sums
from spinor_geom.mesh.array_checks import shared
from spinor_geom.nurbs.blocks import Blocks
from spinor_geom.nurbs.rims import Rim
from spinor_geom.nurbs.smooth_primitive import SmoothPrimitive
from spinor_geom.nurbs.strips import Breaks, Grid, Values
from spinor_geom.surface.array_surface import ArraySurface
from spinor_geom.surface.formulas import phi

Function = Callable[[Complex[np.ndarray, " k"]], Complex[np.ndarray, "k 3"]]

# Points per side: candidates for nodes, of which half are used, and points where the error is measured. The error is
# 1e-12 on most quadrilaterals.
CANDIDATES, CHECKS = ((1 - np.cos(np.pi * (np.arange(n) + 0.5) / n)) / 2 for n in (32, 13))


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadPolynomials:
    """Polynomials of z that interpolate a holomorphic function on quadrilaterals."""

    function: Function  # with values of three components
    nodes: Complex[np.ndarray, "q m"]  # points of interpolation, on the outline of each quadrilateral
    strengths: Complex[np.ndarray, "q m 4"]  # weights of the barycentric formula times the values, and the weights
    # whether the error is small enough on the outline, where it is largest by the maximum principle
    is_accurate: Bool[np.ndarray, " q"]

    @classmethod
    def through(
        cls,
        function: Function,
        candidates: Complex[np.ndarray, "q n"],
        checks: Complex[np.ndarray, "q c"],
        accuracy: float,
    ) -> QuadPolynomials:
        """Interpolants at half of the candidates, compared with the function at other points of the outlines.

        The accuracy is relative to the largest difference of values.
        """
        nodes = leja_points(candidates, candidates.shape[1] // 2)
        values = function(np.concatenate([nodes, checks], axis=1).ravel()).reshape(len(nodes), -1, 3)
        at_nodes, at_checks = np.split(values, [nodes.shape[1]], axis=1)
        strengths = np.concatenate([at_nodes, np.ones_like(at_nodes[..., :1])], axis=2)
        strengths *= barycentric_weights(nodes)[..., None]
        found = np.array([_interpolated(*row) for row in zip(nodes, strengths, checks, strict=True)])
        errors = np.abs(found - at_checks).max(axis=(1, 2))
        is_accurate = errors <= accuracy * np.abs(values - values[0, 0]).max()
        return cls(function=function, nodes=nodes, strengths=strengths, is_accurate=is_accurate)

    def values(self, quads: Sequence[int], z: Sequence[Complex[np.ndarray, " _"]]) -> list[Complex[np.ndarray, "_ 3"]]:
        """Values at points of quadrilaterals, of the function itself where the polynomials are not accurate."""
        rest = [points for quad, points in zip(quads, z, strict=True) if not self.is_accurate[quad]]
        ends = np.cumsum([len(points) for points in rest])[:-1]
        exact = iter(np.split(self.function(np.concatenate(rest)), ends) if rest else [])
        return [
            _interpolated(self.nodes[quad], self.strengths[quad], points) if self.is_accurate[quad] else next(exact)
            for quad, points in zip(quads, z, strict=True)
        ]


def _interpolated(
    nodes: Complex[np.ndarray, " m"], strengths: Complex[np.ndarray, "m 4"], z: Complex[np.ndarray, " k"]
) -> Complex[np.ndarray, "k 3"]:
    sums = cauchy_sums(nodes, strengths, z)
    return np.asarray(sums[:, :3] / sums[:, 3:])


_ORDER = 10  # Gauss nodes per piece of a line from ∂Ω: exact for twice the degree of the splines
_TOWARDS_RIM = 0.25 ** np.arange(3, 0, -1)  # more ends of pieces next to rims with corners, relative to the first piece


@dataclass(frozen=True, kw_only=True, eq=False)
class _Side:
    """Points of a side on ∂Ω, their positions, and the points of Γ."""

    z: Complex[np.ndarray, " n"]
    on_rim: Float[np.ndarray, "n 3"]
    given: Float[np.ndarray, "n 3"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """A surface whose rims are moved to the given curves.

    The distance of the surface from Γ is the boundary residual. To make Γ the rim, points of a ring are moved: by the
    difference on ∂Ω, by 0 at the inner side, and by a smooth function in between (`_extended`).

    If positions have no closed form, ∫ φ dz over a disk with a smooth boundary is a polynomial on each quadrilateral
    through values by Cauchy's formula. If ∂Ω is not smooth or Ω has holes, positions in a ring are integrals of φ
    along lines of constant u from ∂Ω. Those inside a disk follow from Cauchy's formula, with the same nodes on ∂Ω for
    all.
    """

    surface: ArraySurface
    rims: tuple[Rim, ...]
    blocks: Blocks
    accuracy: float  # of the polynomials, as a share of the size of the surface

    def on(self, grids: Sequence[Grid]) -> list[tuple[Values, Values]]:
        """For each grid the positions of the minimal surface, and those moved so that the rims are Γ."""
        ring = [k for k, (quad, *_) in enumerate(grids) if quad < len(self.blocks.parts)]
        inner = [k for k, (quad, *_) in enumerate(grids) if quad >= len(self.blocks.parts)]
        found: dict[int, tuple[Values, Values]] = {}
        z = [self.blocks.grid(quad, u, v, None) for quad, u, v, _ in (grids[k] for k in inner)]
        for k, exact in zip(inner, self._inside([grids[k][0] for k in inner], z), strict=True):
            found[k] = exact, exact
        sides = self._sides([grids[k] for k in ring])
        for k, side, exact in zip(ring, sides, self._rings([grids[k] for k in ring], sides), strict=True):
            v = grids[k][2]
            exact[:, v == 0] = side.on_rim[:, None]
            moved = exact + _extended(side.given - side.on_rim, grids[k][1], v)
            moved[:, v == 0] = side.given[:, None]
            found[k] = exact, moved
        return [found[k] for k in range(len(grids))]

    def _sides(self, grids: Sequence[Grid]) -> list[_Side]:
        """The sides on ∂Ω. Grids with the same parameters have the same object."""
        keys = {(quad, id(u)): (quad, u) for quad, u, *_ in grids}
        found: dict[tuple[int, int], _Side] = {}
        for number, rim in enumerate(self.rims):
            own = {key: request for key, request in keys.items() if self.blocks.rim_of(request[0]) == number}
            if not own:
                continue
            parts = [(self.blocks.parts[quad], u) for quad, u in own.values()]
            s = np.concatenate([start + u * (end - start) for (start, end), u in parts])
            t = rim.on_boundary(s)
            ends = np.cumsum([len(u) for _, u in parts])[:-1]
            rows = (
                np.split(each, ends)
                for each in (rim.boundary.point(t), rim.positions(t), rim.curve.point(rim.on_curve(s)[0]))
            )
            for key, z, on_rim, given in zip(own, *rows, strict=True):
                found[key] = _Side(z=z, on_rim=on_rim, given=given)
        return [found[quad, id(u)] for quad, u, *_ in grids]

    def _rings(self, grids: Sequence[Grid], sides: Sequence[_Side]) -> list[Values]:
        """Positions of the minimal surface in rings, undefined on ∂Ω."""
        if self._is_smooth:
            inside = [np.where(v > 0, v, 1.0) for _, _, v, _ in grids]
            z = [
                self.blocks.grid(quad, u, w, side.z)
                for (quad, u, *_), w, side in zip(grids, inside, sides, strict=True)
            ]
            return self._inside([quad for quad, *_ in grids], z)
        columns = {
            (id(side), breaks): (quad, u, side, self._pieces(quad, breaks))
            for (quad, u, _, breaks), side in zip(grids, sides, strict=True)
        }
        points = [
            self.blocks.grid_and_steps(quad, u, _gauss(breaks), side.z) for quad, u, side, breaks in columns.values()
        ]
        phi_at = _split(self._phi, [z for z, _ in points])
        moves = [(value * steps[..., None]).real for value, (_, steps) in zip(phi_at, points, strict=True)]
        velocity = dict(zip(columns, moves, strict=True))
        found = []
        for (quad, _, v, breaks), side in zip(grids, sides, strict=True):
            integrals = _integrals(self._pieces(quad, breaks), tuple(v)) @ velocity[id(side), breaks]
            found.append(side.on_rim[:, None] + integrals)
        return found

    def _pieces(self, quad: int, breaks: Breaks) -> Breaks:
        """Ends of the pieces of integrals from a rim, more if it has corners, where φ varies over short distances."""
        if not self.rims[self.blocks.rim_of(quad)].boundary.corners.any():
            return breaks
        return (0.0, *(breaks[1] * _TOWARDS_RIM).tolist(), *breaks[1:])

    def _phi(self, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n 3"]:
        p, q = self.surface.spinors(z).T
        return np.asarray(phi(p, q))

    def _inside(self, quads: Sequence[int], z: Sequence[Complex[np.ndarray, "_ _"]]) -> list[Values]:
        """Positions at arrays of points of quadrilaterals, in rings only if `_is_smooth`."""
        if self.surface.has_closed_positions or len(self.rims) > 1:
            return _split(self.surface.position, z)
        if self._polynomials is None:
            return _split(self.rims[0].positions_inside, z)
        start = self.rims[0].start
        values = self._polynomials.values(quads, [w.ravel() for w in z])
        return [start + value.real.reshape(*w.shape, 3) for value, w in zip(values, z, strict=True)]

    @property
    def _is_smooth(self) -> bool:
        """Whether `_inside` is accurate up to ∂Ω."""
        return self.surface.has_closed_positions or len(self.rims) == 1

    @cached_property
    def _polynomials(self) -> QuadPolynomials | None:
        """∫ φ dz on the quadrilaterals of a disk with a smooth boundary, or None for other surfaces."""
        primitive = self.rims[0].primitive
        if len(self.rims) > 1 or not isinstance(primitive, SmoothPrimitive):
            return None
        candidates, checks = (
            np.concatenate([self._outlines(u, side) for side in range(4)], axis=1) for u in (CANDIDATES, CHECKS)
        )
        return QuadPolynomials.through(primitive.inside, candidates, checks, self.accuracy)

    def _outlines(self, u: Float[np.ndarray, " n"], side: int) -> Complex[np.ndarray, "q n"]:
        """Points of one side of all quadrilaterals."""
        start, end = (self.blocks.points[self.blocks.quads[:, k % 4]][:, None] for k in (side, side + 1))
        points = start + u * (end - start)
        if side == 0:
            first, last = self.blocks.parts[..., None].swapaxes(0, 1)
            points[: len(first)] = self.rims[0].point(first + u * (last - first))
        return np.asarray(points)


def _extended(
    shift: Float[np.ndarray, "n 3"], u: Float[np.ndarray, " n"], v: Float[np.ndarray, " m"]
) -> Float[np.ndarray, "n m 3"]:
    """A displacement at v = 0, extended to the quadrilateral with derivative 0 across its sides u = 0 and u = 1.

    Displacements of the ends decay within about an eighth of the sides. The rest decays where v exceeds the distance to
    the nearer end, because near corners it varies over short distances and would rotate the normals along these sides.
    """
    ends = [np.array([np.interp(end, u, each) for each in shift.T]) for end in (0.0, 1.0)]
    at_ends = sum(((1 - x) ** 8 * (1 + 8 * x))[:, None] * end for x, end in zip((u, 1 - u), ends, strict=True))
    near = (u * (1 - u))[:, None] ** 2
    share = (1 - v) ** 2 * near / np.maximum(near + v**2, np.finfo(np.float64).tiny)
    rest = shift - at_ends
    return np.asarray(((1 - v) ** 8)[:, None] * at_ends[:, None] + share[..., None] * rest[:, None])


def _split(
    function: Callable[[Complex[np.ndarray, " n"]], Inexact[np.ndarray, "n 3"]],
    z: Sequence[Complex[np.ndarray, "_ _"]],
) -> list[Any]:
    """Values of a function at several arrays of points, by one call."""
    if not z:
        return []
    values = function(np.concatenate([each.ravel() for each in z]))
    parts = np.split(values, np.cumsum([each.size for each in z])[:-1])
    return [part.reshape(*each.shape, 3) for part, each in zip(parts, z, strict=True)]


@lru_cache(maxsize=256)
def _gauss(breaks: Breaks) -> Float[np.ndarray, " g"]:
    """Gauss-Legendre nodes on all pieces."""
    ends = np.array(breaks)
    return shared((ends[:-1, None] + np.diff(ends)[:, None] * rule("gauss", _ORDER).nodes).ravel())


@lru_cache(maxsize=256)
def _integrals(breaks: Breaks, v: tuple[float, ...]) -> Float[np.ndarray, "n g"]:
    """The matrix from values at the nodes on all pieces to integrals from 0 to v."""
    ends, at = np.array(breaks), np.array(v)
    width = np.diff(ends)
    inside = np.clip((at[:, None] - ends[:-1]) / width, 0.0, 1.0)  # share of each piece below v
    rows = cumulative_matrix(_ORDER, tuple(inside.ravel())).reshape(len(at), len(width), _ORDER)
    return shared((width[:, None] * rows).reshape(len(at), -1))
