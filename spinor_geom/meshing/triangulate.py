"""The triangulation of a patch in Ω."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex

from spinor_geom.domain.triangulation import PlaneTriangulation, Seeds, triangulate_regions
from spinor_geom.errors import TooManyPointsError
from spinor_geom.meshing.seeds import even_seeds, is_unit_disk
from spinor_geom.meshing.size_field import Piece, size_field
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


def piece_of(surface: SpinorSurface, rims: Sequence[Complex[np.ndarray, " _"]], target: float, area: float) -> Piece:
    """The part of Ω inside a patch's boundaries; angles in space are those in Ω, the surface is conformal.

    Args:
        surface: Gives λ.
        rims: The patch's boundary vertices in Ω, counter-clockwise, then those of holes, clockwise.
        target: Edge length in space.
        area: The patch's area in space.

    Raises:
        TooManyPointsError: The edge length asks for more vertices than anyone can use.
    """
    require_few_points(area, target)
    mesh = surface.domain.triangulation
    factor = np.asarray(surface.conformal_factor(mesh.points))
    on_boundary, seeds = factor[: mesh.boundary_size], None
    if is_unit_disk(surface.domain) and (np.isfinite(on_boundary) & (on_boundary > 0)).all():
        seeds = even_seeds(on_boundary, target, area)
    return Piece(rims=rims, samples=mesh.points, factor=factor, target=target, area=area, seeds=seeds)


def triangulate_pieces(pieces: Sequence[Piece]) -> list[PlaneTriangulation]:
    """Triangulates parts of Ω, together; each is the same as by itself, to the last bit.

    Raises:
        TooManyPointsError: An edge length asks for more vertices than anyone can use.
        DomainError: A boundary is not a simple polygon, with holes inside.
    """
    found: dict[int, PlaneTriangulation] = {}
    for is_seeded in (True, False):
        some = {place: piece for place, piece in enumerate(pieces) if (piece.seeds is not None) == is_seeded}
        if some:
            found |= zip(some, _triangulated(list(some.values())), strict=True)
    return [found[place] for place in range(len(pieces))]


def _triangulated(pieces: Sequence[Piece]) -> list[PlaneTriangulation]:
    """All of them from seeds, or none."""
    most = []
    for piece in pieces:
        require_few_points(piece.area, piece.target)
        triangles = 4 * piece.area / (np.sqrt(3) * piece.target**2)
        most.append(int(POINTS_PER_VERTEX * sum(map(len, piece.rims)) + POINTS_PER_TRIANGLE * triangles))
    given = [piece.seeds for piece in pieces if piece.seeds is not None]
    seeds = None
    if given:
        seeds = Seeds(
            points=np.concatenate([points for points, _ in given]),
            spacing=np.concatenate([spacing for _, spacing in given]),
            region=np.repeat(np.arange(len(given)), [len(points) for points, _ in given]),
        )
    return triangulate_regions([piece.rims for piece in pieces], size_field(pieces), seeds=seeds, max_points=most)
