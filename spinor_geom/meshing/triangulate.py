"""Triangulation of parts of Ω with edge lengths that are uniform on the surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import TINY, median, shifted
from spinor_geom.deadline import seconds_left
from spinor_geom.domain.plane_domain import FourierBoundary, PlaneDomain
from spinor_geom.domain.polygons import lattice_inside
from spinor_geom.domain.sizes import DECAY, EdgeLengths, SizeField
from spinor_geom.domain.triangulation import PlaneTriangulation, Seeds, triangulate_polygon
from spinor_geom.errors import TooManyPointsError
from spinor_geom.holomorphic.cauchy_sums import cauchy_sums
from spinor_geom.surface.array_surface import ArraySurface

SMALLEST_STRETCH = 1e-3  # lower bound of λ per median, for branch points
NEIGHBOURS = 4
# Most points per boundary vertex, and per equilateral triangle of the target size on the patch's area: several times
# the usual numbers.
POINTS_PER_VERTEX = 12
POINTS_PER_TRIANGLE = 2
MOST_POINTS = 10**7  # of one patch, which would take gigabytes and minutes
# Of the time left. The positions of the points take as long, crossings, attributes and writing into the mesh a third.
_SHARE_TO_REFINE = 0.45
_WINDING_ERROR = 1e-3  # of winding numbers by quadrature, larger beside the boundary
_MOST_STRETCHED = 1.2  # ratio of the areas of flattening and surface beyond which seeds are of no use


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """A part of Ω to be triangulated, with the metric of the surface over it."""

    rims: Sequence[Complex[np.ndarray, " _"]]  # outer boundary in Ω, counter-clockwise, then holes, clockwise
    samples: Complex[np.ndarray, " n"]  # points of Ω
    factor: Float[np.ndarray, " n"]  # λ there, lengths in space per length in Ω
    lengths: EdgeLengths  # in space
    area: float  # of the surface over it
    seeds: Seeds | None = None  # initial inner points and their spacings


def require_few_points(area: float, target: float) -> None:
    """Raises a TooManyPointsError for a patch of some area with edges of some length."""
    points = 2 * area / (np.sqrt(3) * target**2)
    if points > MOST_POINTS:
        raise TooManyPointsError(target=target, area=area, points=points, most=MOST_POINTS)


def most_points(boundary_size: int, area: float, target: float) -> int:
    """Largest number of inner points of a patch of some area with edges of some length."""
    triangles = 4 * area / (np.sqrt(3) * target**2)
    return int(POINTS_PER_VERTEX * boundary_size + POINTS_PER_TRIANGLE * triangles)


def piece_of(surface: ArraySurface, rims: Sequence[Complex[np.ndarray, " _"]], target: float, area: float) -> Piece:
    """The part of Ω bounded by `rims`, for a target edge length in space. Raises a TooManyPointsError."""
    require_few_points(area, target)
    mesh = surface.domain.triangulation
    factor = np.asarray(surface.conformal_factor(mesh.points))
    on_boundary, seeds = factor[: mesh.boundary_size], None
    if is_unit_disk(surface.domain) and (np.isfinite(on_boundary) & (on_boundary > 0)).all():
        seeds = even_seeds(on_boundary, target, area)
    return Piece(rims=rims, samples=mesh.points, factor=factor, lengths=EdgeLengths(target), area=area, seeds=seeds)


def triangulate_piece(piece: Piece) -> PlaneTriangulation:
    """Triangulates a part of Ω. Its refinement takes less than half of the time that is left.

    Raises:
        TooManyPointsError: the edge length requires too many vertices.
        DomainError: the boundary is not a simple polygon with holes inside.
    """
    require_few_points(piece.area, piece.lengths.target)
    most = most_points(sum(map(len, piece.rims)), piece.area, piece.lengths.target)
    outer, *holes = piece.rims
    return triangulate_polygon(
        outer,
        size_field(piece),
        holes=holes,
        seeds=piece.seeds,
        max_points=most,
        seconds=_SHARE_TO_REFINE * seconds_left(),
    )


def size_field(piece: Piece) -> SizeField:
    """About the target in space, near the boundary the length of the boundary edges: h = target/λ with bounds."""
    target, growth = piece.lengths
    if np.isinf(target):
        return SizeField(growth=growth)
    lengths = target / _bounded_factor(piece.factor)
    return SizeField(growth=growth, decay=DECAY, samples=piece.samples, lengths=lengths, neighbours=NEIGHBOURS)


def _bounded_factor(factor: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """λ with its median where it is not finite, and bounded from below, as it is 0 at branch points."""
    finite = np.isfinite(factor)
    usual = median(factor[finite]) if finite.any() else 1.0
    return np.asarray(np.maximum(np.where(finite, factor, usual), max(SMALLEST_STRETCH * usual, TINY)))


def is_unit_disk(domain: PlaneDomain) -> bool:
    """Whether a domain is the unit disk about 0 with its boundary parametrised by angle."""
    boundary = domain.boundary
    if domain.holes or not isinstance(boundary, FourierBoundary):
        return False
    return np.array_equal(boundary.coefficients, boundary.frequencies == 1)


def even_seeds(stretch: Float[np.ndarray, " n"], target: float, area: float) -> Seeds | None:
    """Points of the unit disk, with spacings, whose images on a flattening of the surface form a triangular lattice.

    The flattening G is conformal and preserves the lengths of the boundary: log |G′| is the harmonic function with the
    boundary values log λ, given at equal steps from angle 0. The lattice has as many points as cover the surface with
    a spacing of `target`. Parts that the flattening covers more than once have no points. None if the flattening is
    much larger than the surface, which is then strongly curved.
    """
    n = len(stretch)
    # twice as many nodes as samples resolve the exponential
    series = np.fft.fft(np.log(stretch), n) / n
    series = np.concatenate([series[:1], 2 * series[1 : n // 2]])
    slope = np.exp(np.fft.ifft(series, 2 * n) * 2 * n)
    powers = np.fft.fft(slope)[:n] / (2 * n)
    rim = np.fft.ifft(np.append(0, powers / np.arange(1, n + 1)), 2 * n) * 2 * n
    circle = np.exp(1j * np.pi * np.arange(2 * n) / n)
    covered = 0.5 * float((np.conj(rim) * shifted(rim, -1)).imag.sum())
    if not covered < _MOST_STRETCHED * area:
        return None
    spacing = target * np.sqrt(covered / area)
    lattice = lattice_inside(rim, spacing)
    # Cauchy's formula for the inverse of G and its derivative, over that for 1
    strengths = np.stack([slope * circle, slope * circle**2, circle], axis=1)
    turns, inverse, widening = cauchy_sums(rim, strengths, lattice).T
    once = np.abs(turns / (2 * n) - 1) < _WINDING_ERROR
    return Seeds(inverse[once] / turns[once], spacing * np.abs(widening[once] / turns[once]))
