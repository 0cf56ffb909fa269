"""From a solved surface to a triangle mesh whose boundary is the loop or both loops, bit for bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface, relaxed_surface
from spinor_geom.domain.delaunay import Rims
from spinor_geom.domain.triangulation import PlaneTriangulation, one_by_one_on_error
from spinor_geom.errors import DomainError, OptionError, SpinorGeomError
from spinor_geom.meshing.size_field import Piece
from spinor_geom.meshing.triangulate import piece_of, triangulate_pieces
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.shown import Shown


@dataclass(frozen=True, kw_only=True, eq=False)
class Patch(Shown):
    """A triangulated piece of a minimal surface over a loop, or between two.

    Attributes:
        vertices: Positions in mesh units; the loops' points come first, in order and bit-equal.
        faces: Counter-clockwise in Ω and so about the surface's normal; the boundary runs along the loops.
        boundary_size: Number M of loop points, of all loops together.
        points: Where the vertices lie in Ω.
        hole_sizes: Numbers of points of the loops after the first.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    boundary_size: int
    points: Complex[np.ndarray, " n"]
    hole_sizes: tuple[int, ...] = ()

    @property
    def rims(self) -> Rims:
        """Numbers of points of the loops."""
        return (self.boundary_size - sum(self.hole_sizes), *self.hole_sizes)

    @cached_property
    def area(self) -> float:
        """Total area of the faces, in squared mesh units."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    def relaxed(self) -> DiscreteMinimalSurface:
        """The discrete minimal surface nearest to this mesh: the same triangles, without discrete mean curvature.

        A mesh with its inner vertices on the exact surface has some at them, about 4 % of the principal curvatures,
        however small its triangles: at a single vertex the cotangent formula is right only where the triangles around
        it are even. To lose it the vertices leave the exact surface, by some 0.5 % of an edge, and by some 10 % beside
        a loss of stability.

        Source: Xu (2004), "Discrete Laplace–Beltrami operators and their convergence", CAGD 21, for the formula's
        pointwise error.
        """
        return relaxed_surface(self.vertices, self.faces, self.boundary_size)


def mesh_patch(solution: PlateauSolution, target_edge_length: float | Literal["auto"] = "auto") -> Patch:
    """Meshes a solved minimal surface; the points of its loop or loops are its boundary vertices, bit-equal.

    The surface's domain is triangulated with edges of about target/λ, beside the boundary as long as the loop's own
    edges; the inner vertices are on the exact surface. The boundary's vertices are the loop's points and not the
    surface's, so the boundary residual of the solution stays visible in the triangles beside the boundary.

    Args:
        solution: A solved Plateau problem.
        target_edge_length: In mesh units; "auto" is the mean edge length of its loops.

    Raises:
        OptionError: The edge length is neither "auto" nor positive and finite.
        TooManyPointsError: The edge length asks for more vertices than anyone can use.
        DomainError: The loop's points in Ω do not form a simple polygon, or the surface is not finite inside it.
    """
    (patch,) = mesh_patches([solution], target_edge_length)
    if isinstance(patch, SpinorGeomError):
        raise patch
    return patch


def mesh_patches(
    solutions: Sequence[PlateauSolution], target_edge_length: float | Literal["auto"] = "auto"
) -> list[Patch | SpinorGeomError]:
    """`mesh_patch` for many surfaces at once, which for small ones is faster; each mesh is the same, to the last bit.

    Returns:
        For each its mesh, or the error that `mesh_patch` raises for it.
    """

    def made(some: Sequence[PlateauSolution]) -> list[Patch]:
        planes = triangulate_pieces([_piece(solution, target_edge_length) for solution in some])
        return [_patch(solution, plane) for solution, plane in zip(some, planes, strict=True)]

    return one_by_one_on_error(made, solutions)


def _piece(solution: PlateauSolution, target_edge_length: float | Literal["auto"]) -> Piece:
    loops = [rim.loop for rim in solution.rims]
    mean_edge = sum(loop.perimeter for loop in loops) / sum(map(len, loops))
    target = mean_edge if target_edge_length == "auto" else target_edge_length
    if isinstance(target, str) or not 0 < target < np.inf:
        raise OptionError(f"target_edge_length must be 'auto' or a positive number, not {target_edge_length!r}")
    return piece_of(solution.surface, [rim.points_in_domain() for rim in solution.rims], target, solution.area)


def _patch(solution: PlateauSolution, plane: PlaneTriangulation) -> Patch:
    inner = solution.surface.positions_inside(plane.points[plane.boundary_size :])
    if not np.isfinite(inner).all():
        raise DomainError("the surface is not finite inside its domain: p or q has a pole there")
    return Patch(
        vertices=np.concatenate([*(rim.loop.points for rim in solution.rims), inner]),
        faces=plane.faces,
        boundary_size=plane.boundary_size,
        points=plane.points,
        hole_sizes=plane.hole_sizes,
    )
