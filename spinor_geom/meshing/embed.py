"""Triangulation of solved surfaces with the loops as boundary, and of any surface."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.adapters.mesh_files import write_triangles
from spinor_geom.deadline import require_time, seconds_left
from spinor_geom.discrete.area_descent import harmonic_extension
from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface, relaxed_surface
from spinor_geom.domain.delaunay import Rims, plane_coordinates, rim_successors
from spinor_geom.domain.flattening import dirichlet_to_neumann, flatten_boundary
from spinor_geom.domain.plane_domain import Boundary
from spinor_geom.domain.sizes import EdgeLengths, edge_length_of
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import DomainError, OptionError, SurfaceError, require_positive, require_type
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.loop_frame import LoopFrame
from spinor_geom.mesh.operators import cotangent_laplacian, face_areas
from spinor_geom.mesh.spacing import edge_lengths
from spinor_geom.meshing.patch_angles import PatchAngles
from spinor_geom.meshing.split_edges import edges_far_from_arcs, triangulated_with_split_edges
from spinor_geom.meshing.triangulate import Piece, is_unit_disk, piece_of, require_few_points, triangulate_piece
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.threads import one_thread
from spinor_geom.shown import Shown
from spinor_geom.surface.array_surface import ArraySurface

_FINE = 16  # points at which the length of each piece of the boundary is measured
_FEWEST = 6  # edges of a side between corners
# Upper bound of the seconds that a patch takes for each of its vertices, from its triangulation to the search for its
# intersections: 1.5e-5 on smooth rims of 1,500 points.
_SECONDS_PER_VERTEX = 5e-5


@dataclass(frozen=True, kw_only=True, eq=False)
class Patch(Shown):
    """A triangulated piece of a minimal surface over one loop or several.

    Attributes:
        vertices: Positions in mesh units. The loops' points come first, in order and bit for bit.
        faces: Counter-clockwise in Ω and about the surface's normal, except beside long edges that were split in Ω. The
            boundary half-edges have the direction of the loops.
        boundary_size: Number M of loop points, of all loops together.
        points: Positions of the vertices in Ω.
        hole_sizes: Numbers of points of the loops after the first.
        is_complete: False if a limit on time or on vertices makes the triangles larger than asked for, or a limit on
            time makes the vertices near the rim less accurate.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    boundary_size: int
    points: Complex[np.ndarray, " n"]
    hole_sizes: tuple[int, ...] = ()
    is_complete: bool = True

    def __repr__(self) -> str:
        rims = " + ".join(map(str, self.rims))
        size = f"{len(self.vertices)} vertices, {len(self.faces)} faces"
        return f"Patch({size}, rim of {rims} points, area {self.area:.6g})"

    @classmethod
    def over(cls, plane: PlaneTriangulation, vertices: Float[np.ndarray, "n 3"]) -> Patch:
        """The patch with given vertices over a triangulated part of Ω."""
        return cls(
            vertices=vertices,
            faces=plane.faces,
            boundary_size=plane.boundary_size,
            points=plane.points,
            hole_sizes=plane.hole_sizes,
            is_complete=plane.is_complete,
        )

    def placed_by(self, frame: LoopFrame, rim: Float[np.ndarray, "m 3"]) -> Patch:
        """The patch over loops with the points `rim`, from that over the loops in the coordinates of a frame."""
        m, points = self.boundary_size, self.points
        if frame.is_backward:
            points = np.concatenate([points[:m][frame.order(*self.rims)], points[m:]]).conj()
        return replace(
            self,
            vertices=np.concatenate([rim, frame.outside(self.vertices[m:])]),
            faces=frame.faces(np.asarray(self.faces), *self.rims),
            points=points,
        )

    @property
    def rims(self) -> Rims:
        """Numbers of points of the loops."""
        return (self.boundary_size - sum(self.hole_sizes), *self.hole_sizes)

    @cached_property
    def area(self) -> float:
        """Total area of the faces, in squared mesh units."""
        return float(face_areas(self.vertices, self.faces).sum())

    @cached_property
    def angles(self) -> PatchAngles:
        """Angles of the faces and between them."""
        return PatchAngles.of(self.vertices, np.asarray(self.faces), rim_successors(self.rims))

    def write(self, path: str | os.PathLike[str]) -> tuple[str, ...]:
        """Writes a mesh file in the format of the suffix of `path`. Returns and raises as `MeshFile.write`."""
        return write_triangles(self.vertices, self.faces, path)

    def relaxed(self) -> DiscreteMinimalSurface:
        """The discrete minimal surface near this mesh, with the same triangles and zero discrete mean curvature.

        On the exact surface the discrete mean curvature at a vertex is about 4 % of the principal curvatures, for
        triangles of any size: the cotangent formula converges pointwise only on regular triangles. The vertices of the
        result are about 0.5 % of an edge off the exact surface, or 10 % if the surface is nearly unstable.

        Source: Xu (2004), "Discrete Laplace–Beltrami operators and their convergence", CAGD 21, for the formula's
        pointwise error.
        """
        return relaxed_surface(self.vertices, self.faces, self.boundary_size)


def mesh_patch(solution: PlateauSolution, target_edge_length: float | Literal["auto"] = "auto") -> Patch:
    """Meshes a solved minimal surface. The points of its loops are boundary vertices, bit for bit.

    If an edge length is given, points of Γ divide longer edges, so that area and boundary converge. Where Γ is known
    only at the points of a rough loop (`route` "vertices"), and with "auto", there are no more boundary vertices.

    Ω is triangulated with edges of about target/λ, and near the boundary as long as the edges of the loop. The inner
    vertices are on the exact surface. The boundary vertices deviate from it by the boundary residual of the solution.
    If chords between the loop's points in Ω cross or leave Ω, inner vertices are inserted beside these edges. Within
    `fill_hole` a time limit may need larger triangles. The patch is not `is_complete` then.

    Args:
        solution: A solved Plateau problem.
        target_edge_length: In mesh units. "auto" is the mean edge length of its loops.

    Raises:
        ArgumentTypeError: `solution` is not a PlateauSolution.
        OptionError: The edge length is neither "auto" nor positive and finite.
        TooManyPointsError: The edge length requires too many vertices.
        DomainError: The loop's points in Ω are not a simple polygon, or the surface is not finite inside it.
    """
    takes = "a PlateauSolution, which solve_plateau returns (mesh_surface meshes a SpinorSurface)"
    require_type(solution, PlateauSolution, function="mesh_patch", takes=takes)
    if target_edge_length != "auto":
        require_positive("target_edge_length", target_edge_length, instead="'auto' or ")
        require_few_points(solution.area, float(target_edge_length))
        solution = replace(solution, rims=tuple(rim.divided(target_edge_length) for rim in solution.rims))
    return mesh_over_points(solution, target_edge_length)


def mesh_over_points(solution: PlateauSolution, target_edge_length: float | Literal["auto"]) -> Patch:
    """`mesh_patch` whose boundary vertices are the points of the loops only, as of a fill."""
    # the order of sums, and therefore the rounding, depends on the number of threads
    with one_thread():
        target = edge_length_over([rim.loop for rim in solution.rims], target_edge_length)
        require_few_points(solution.area, target)
        shortest = edge_length_of(solution.area, seconds_left() / _SECONDS_PER_VERTEX)
        whole = _piece(solution, max(target, shortest))
        try:
            plane = triangulate_piece(whole)
            if not is_unit_disk(solution.domain) and len(edges_far_from_arcs(solution.domain, plane)):
                raise DomainError("the chords between the loop's points in the plane domain run far outside it")
            patch = _patch(solution, plane)
        except DomainError:
            plane = triangulated_with_split_edges(
                solution.rims, solution.domain, lambda polygons: triangulate_piece(replace(whole, rims=polygons))
            )
            patch = _patch(solution, plane)
    return replace(patch, is_complete=patch.is_complete and target >= shortest)


def edge_length_over(loops: Sequence[BoundaryLoop], target: float | Literal["auto"]) -> float:
    """The edge length of a patch over some loops, in mesh units: `target`, or the loops' mean edge length."""
    if target == "auto":
        return sum(loop.perimeter for loop in loops) / sum(map(len, loops))
    require_positive("target_edge_length", target, instead="'auto' or ")
    return float(target)


def _piece(solution: PlateauSolution, target: float) -> Piece:
    return piece_of(solution.array_surface, [rim.points_in_domain() for rim in solution.rims], target, solution.area)


def _patch(solution: PlateauSolution, plane: PlaneTriangulation) -> Patch:
    inner, is_accurate = solution.array_surface.positions_inside(plane.points[plane.boundary_size :])
    if not np.isfinite(inner).all():
        raise DomainError("the surface is not finite inside its domain: p or q has a pole there")
    patch = Patch.over(plane, np.concatenate([*(rim.loop.points for rim in solution.rims), inner]))
    return replace(patch, is_complete=plane.is_complete and is_accurate)


def mesh_surface(surface: ArraySurface, *, vertices: int = 4000) -> Patch:
    """Meshes a whole surface with edges of about equal length in space. All vertices are on the surface.

    `mesh_patch` meshes a solution with its loop's points as the boundary.

    Args:
        surface: Over any domain.
        vertices: The approximate number of vertices.

    Raises:
        OptionError: `vertices` is less than 3.
        SurfaceError: The surface is not finite on its domain.
    """
    if vertices < 3:
        raise OptionError(f"a mesh needs at least 3 vertices, got {vertices}")
    area = surface.area()
    if not 0 < area < np.inf:
        raise SurfaceError(f"the surface has the area {area}: p or q has a pole in its domain, or both are 0")
    target = edge_length_of(area, vertices)
    rims = [_rim(surface, boundary, target) for boundary in (surface.domain.boundary, *surface.domain.holes)]
    plane = triangulate_piece(piece_of(surface, rims, target, area))
    positions = np.asarray(surface.position(plane.points))
    if not np.isfinite(positions).all():
        raise SurfaceError("the surface is not finite inside its domain: p or q has a pole there")
    return Patch.over(plane, positions)


def _rim(surface: ArraySurface, boundary: Boundary, target: float) -> Complex[np.ndarray, " m"]:
    """Points of a part of ∂Ω about `target` apart in space, including its corners."""
    pieces = boundary.parameters
    t = np.append((pieces[:-1, None] + np.diff(pieces)[:, None] * (np.arange(_FINE) / _FINE)).ravel(), 1.0)
    middle, width = (t[1:] + t[:-1]) / 2, np.diff(t)
    speed = np.asarray(surface.conformal_factor(boundary.point(middle))) * np.abs(boundary.derivative(middle))
    length = np.append(0.0, np.cumsum(speed * width))
    starts = length[np.flatnonzero(boundary.corners) * _FINE] if boundary.corners.any() else length[:1]
    # the last side may wrap around the end of the parameter
    sides = zip(starts, np.append(starts[1:], starts[0] + length[-1]), strict=True)
    at = [np.linspace(a, b, max(_FEWEST, round((b - a) / target)), endpoint=False) for a, b in sides]
    return boundary.point(np.interp(np.concatenate(at) % length[-1], length, t))


def over_domain_of_angles(patch: Patch, angles: Float[np.ndarray, " m"], lengths: EdgeLengths) -> Patch:
    """A harmonic patch over the same loop, on a domain with given interior angles, in radians, at the loop's points.

    The edges of the domain have about the lengths of the loop's edges. The excess of the angles over those of a closed
    polygon is distributed over its length. A domain that overlaps itself is straightened with the metric of the patch.

    Raises:
        DomainError: An angle is not finite, or no simple domain was found.
        SingularMatrixError: The patch's triangles are degenerate.
        TooManyPointsError: There would be too many vertices.
        OutOfTimeError: The time limit was reached.

    Source: Sawhney & Crane (2018), Boundary First Flattening, ACM TOG 37, for domains of given angles.
    """
    m, rim = patch.boundary_size, patch.vertices[: patch.boundary_size]
    boundary = _boundary_of_angles(patch, angles)
    piece = Piece(rims=[boundary], samples=boundary, factor=np.ones(m), lengths=lengths, area=patch.area)
    plan = triangulate_piece(piece)
    require_time()
    vertices = harmonic_extension(cotangent_laplacian(plane_coordinates(plan.points), plan.faces), rim)
    return Patch.over(plan, vertices)


def _boundary_of_angles(patch: Patch, angles: Float[np.ndarray, " m"]) -> Complex[np.ndarray, " m"]:
    """A simple polygon with about the edge lengths of a patch's loop and the given interior angles."""
    m = patch.boundary_size
    edge = edge_lengths(patch.vertices[:m])
    share = (edge + np.roll(edge, 1)) / (2 * edge.sum())
    if not np.isfinite(angles).all():
        raise DomainError("a triangle at the loop has no area and so no angles; merge or move its vertices")
    turning = np.pi - angles
    turning += (2 * np.pi - turning.sum()) * share
    neumann, _ = dirichlet_to_neumann(patch.vertices, np.asarray(patch.faces), m)
    return flatten_boundary(edge, turning, neumann).boundary
