"""The triangulation of a patch in Ω."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.domain.triangulation import PlaneTriangulation, triangulate_polygon
from spinor_geom.errors import TooManyPointsError
from spinor_geom.meshing.seeds import even_seeds, is_unit_disk
from spinor_geom.meshing.size_field import size_field
from spinor_geom.surface.spinor_surface import SpinorSurface

# points allowed per boundary vertex, and per equilateral triangle of the target size that fits on the patch's area:
# several times what a sound size field asks for, so that a wild λ cannot ask for millions
POINTS_PER_VERTEX = 12
POINTS_PER_TRIANGLE = 2
# Of one patch: a mesh that takes gigabytes and minutes to make.
MOST_POINTS = 10**7


def require_few_points(area: float, target: float) -> None:
    """Checks that a patch of some area with edges of some length can be made, before any of it is.

    Raises:
        TooManyPointsError: it has more vertices than anyone can use.
    """
    points = 2 * area / (np.sqrt(3) * target**2)
    if points > MOST_POINTS:
        raise TooManyPointsError(target=target, area=area, points=points, most=MOST_POINTS)


def triangulate_patch(
    surface: SpinorSurface, rims: Sequence[Complex[np.ndarray, " _"]], target: float, area: float
) -> PlaneTriangulation:
    """Triangulates the part of Ω inside a patch's boundaries; angles in space are those in Ω, the surface is conformal.

    Args:
        surface: Gives λ.
        rims: The patch's boundary vertices in Ω, counter-clockwise, then those of holes, clockwise; they are the
            triangulation's boundary.
        target: Edge length in space.
        area: The patch's area in space.

    Raises:
        TooManyPointsError: The edge length asks for more vertices than anyone can use.
        DomainError: The boundary is not a simple polygon, with holes inside.
    """
    require_few_points(area, target)
    mesh = surface.domain.triangulation
    factor = np.asarray(surface.conformal_factor(mesh.points))
    on_boundary, seeds = factor[: mesh.boundary_size], None
    if is_unit_disk(surface.domain) and (np.isfinite(on_boundary) & (on_boundary > 0)).all():
        seeds = even_seeds(on_boundary, target, area)
    return triangulate_domain(rims, mesh.points, factor, target, area, seeds=seeds)


def triangulate_domain(
    rims: Sequence[Complex[np.ndarray, " _"]],
    samples: Complex[np.ndarray, " n"],
    factor: Float[np.ndarray, " n"],
    target: float,
    area: float,
    *,
    seeds: Complex[np.ndarray, " k"] | None = None,
) -> PlaneTriangulation:
    """As `triangulate_patch`, from the factor λ at some points of Ω, and from points to start from, if there are."""
    require_few_points(area, target)
    boundary = np.concatenate(rims)
    triangles = 4 * area / (np.sqrt(3) * target**2)
    return triangulate_polygon(
        rims[0],
        size_field(samples, factor, boundary, target, rims=tuple(map(len, rims))),
        holes=rims[1:],
        seeds=seeds,
        max_points=int(POINTS_PER_VERTEX * len(boundary) + POINTS_PER_TRIANGLE * triangles),
    )
