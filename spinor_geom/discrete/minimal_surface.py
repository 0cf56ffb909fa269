"""Discrete minimal surfaces: triangulated disks over a loop, or annuli between two."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.adapters import to_rims
from spinor_geom.arrays import TINY
from spinor_geom.deadline import require_time, seconds_left
from spinor_geom.discrete.area_descent import FIRST_CHANGE, Disk, descend_area, descend_from_plane, harmonic_extension
from spinor_geom.discrete.first_fill import disk_without_inner_points, unfolded_loop
from spinor_geom.discrete.strip import discrete_annulus
from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.domain.flattening import flatten
from spinor_geom.domain.sizes import SizeField, edge_length_of
from spinor_geom.domain.triangulation import MOST_POINTS, PlaneTriangulation, triangulate_polygon
from spinor_geom.errors import (
    DomainError,
    FirstFillError,
    OptionError,
    OutOfTimeError,
    TooManyRimsError,
    require,
    require_positive,
)
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import face_areas, mollified_laplacian, vertices_to_factor
from spinor_geom.mesh.spacing import edge_lengths
from spinor_geom.mesh.topology import boundary_edges, is_disk
from spinor_geom.shown import Shown, shortened

if TYPE_CHECKING:
    import pymeshlab

DiscreteMethod = Literal["libigl", "pymeshlab"]
FINE_CHANGE = 1e-8
FINE_GROWTH = 0.15
_MOST_STRETCHED = 4.0  # times the mean stretch from the plane. A larger one does not refine the mesh further
_REMESHING_STEPS = 5
_STEPS = 10  # of a descent, each with a factorisation. Most descents take fewer


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscreteMinimalSurface(Shown):
    """A triangulated disk or annulus whose boundary is a loop or two, and whose discrete mean curvature is zero.

    Attributes:
        vertices: (n, 3), mesh units. The loops' points come first, bit for bit.
        faces: (f, 3), counter-clockwise about the loop.
        boundary_size: number of loop points, of all loops together.
        area: total area of the triangles.
        area_history: total area after each step of the last descent.
        converged: whether the area became stationary for motions along the vertex normals, to `relative_change`.
        reason: why it did not converge, or the fallback that was used, in one sentence, else empty.
        method: the `method` argument.
        seconds: wall time.
        is_complete: false if a limit on time or on vertices makes the triangles larger than asked for.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    boundary_size: int
    area: float
    area_history: tuple[float, ...]
    converged: bool
    reason: str
    method: DiscreteMethod
    seconds: float
    is_complete: bool = True

    def __repr__(self) -> str:
        state = "converged" if self.converged else f"not converged: {self.reason}"
        size = f"{len(self.vertices)} vertices, {len(self.faces)} faces, rim of {self.boundary_size} points"
        return shortened(f"DiscreteMinimalSurface({size}, area {self.area:.6g}, {self.method}, {state})")


def discrete_minimal_surface(
    loop: Any,
    *,
    method: DiscreteMethod = "libigl",
    target_edge_length: float | None = None,
    relative_change: float = 1e-8,
) -> DiscreteMinimalSurface:
    """A discrete disk over any closed loop, or an annulus between two, of zero discrete mean curvature.

    "libigl": the loop's minimum-area triangulation is unfolded, the plane polygon is triangulated, and the inner
    vertices are moved by Pinkall-Polthier iteration. The surface is then flattened, which gives a nearly conformal
    domain, remeshed there, and minimised by Newton's method until no motion along the vertex normals changes the area.
    Tangential motions are excluded, as they degrade the triangles: on Enneper's surface with rims of 48 and 64 points
    they would lower the area by 0.1 to 0.3 % and the smallest angle from 33° to 16°. Edges are as long as the loop's
    near it and grow inwards. For an area that converges with the loop's edge length give `target_edge_length`.

    A loop that does not unfold into a simple polygon (ragged rims, loops that cross themselves) starts from a round
    domain. If the result has more area than the triangulation without inner vertices, that is returned. `reason`
    reports both cases.

    "pymeshlab": MeshLab's isotropic remeshing of that surface, then the same minimisation. Both methods are limited to
    200,000 vertices.

    Two loops start from the strip of least area between them, by "libigl" and with edges that grow inwards only.

    Args:
        loop: a closed loop, (m, 3) points, a mesh with one loop or its path, or a sequence of one loop or of two that
            both have the annulus on their left, as in `PlateauSolution.rims`.
        method: the library that meshes the surface.
        target_edge_length: upper bound of the edge length in mesh units. None lets edges grow inwards, and for
            "pymeshlab" is the loop's mean edge length.
        relative_change: the area is stationary when a step lowers it, or its slope predicts a decrease, by less than
            this share.

    Raises:
        OptionError: unknown method, an option that annuli do not support, or a number that is not positive.
        TooManyRimsError: a sequence of other than one or two loops.
        FirstFillError: MeshLab did not remesh the surface. "libigl" fills every loop.
        DomainError: no annulus can be meshed between the two loops.
        MissingPackageError: the method is "pymeshlab", which is not installed.

    Source: Pinkall & Polthier (1993); the first fill after Barequet & Sharir (1995).
    """
    require_positive("relative_change", relative_change)
    if target_edge_length is not None:
        require_positive("target_edge_length", target_edge_length)
    loops = [rim for rim in to_rims(loop) if isinstance(rim, BoundaryLoop)]
    if len(loops) != 1:
        if method != "libigl" or target_edge_length is not None:
            raise OptionError("for two loops only method='libigl' without target_edge_length is supported")
        if len(loops) != 2:
            raise TooManyRimsError(sizes=[len(one) for one in loops])
        start, rims = time.perf_counter(), [one.points for one in loops]
        return _result(discrete_annulus(*rims, relative_change=relative_change)[1], np.concatenate(rims), start=start)
    (loop,) = loops
    if method not in ("libigl", "pymeshlab"):
        raise OptionError(f"unknown method {method!r}; choose 'libigl' or 'pymeshlab'")
    if method == "pymeshlab":
        require("pymeshlab", extra="meshlab")
    start = time.perf_counter()
    if method == "libigl":
        return surface_over_plane(loop, target_edge_length, relative_change)[0]
    target = (loop.mean_edge_length if target_edge_length is None else target_edge_length) / loop.diagonal
    disk, _ = _stationary_disk(_at_unit_size(loop), relative_change, target)
    shortest = edge_length_of(disk.areas[-1], MOST_POINTS)
    vertices, faces = remeshed(disk.vertices, disk.faces, len(loop), max(target, shortest))
    disk = descend_area(vertices, faces, len(loop), relative_change=relative_change)
    surface = _result(disk, loop.points, scale=loop.diagonal, centre=loop.centroid, method=method, start=start)
    return replace(surface, is_complete=target >= shortest)


def surface_over_plane(
    loop: BoundaryLoop, target: float | None, relative_change: float = FINE_CHANGE
) -> tuple[DiscreteMinimalSurface, PlaneTriangulation]:
    """The discrete minimal surface over one loop by "libigl", and the plane triangulation it was made from.

    Under a time limit it has at most as many vertices as can be moved ten times in the time that is left.

    Raises:
        OutOfTimeError: the time limit was reached before there was a surface.
    """
    start, scale = time.perf_counter(), loop.diagonal
    disk, plane = _stationary_disk(_at_unit_size(loop), relative_change, None if target is None else target / scale)
    surface = _result(disk, loop.points, scale=scale, centre=loop.centroid, start=start)
    return replace(surface, is_complete=plane.is_complete), plane


def graded_surface(loop: BoundaryLoop, growth: float) -> tuple[DiscreteMinimalSurface, PlaneTriangulation]:
    """A discrete surface of about the least area, with edges that grow inwards, and its plane triangulation.

    Raises:
        OutOfTimeError: the time limit was reached before there was a surface.
    """
    start, points = time.perf_counter(), _at_unit_size(loop)
    _, plane, disk, failure = _first_descended(points, SizeField(growth=growth))
    disk, plane = _or_flat(points, disk, plane, failure)
    return _result(disk, loop.points, scale=loop.diagonal, centre=loop.centroid, start=start), plane


def _at_unit_size(loop: BoundaryLoop) -> Float[np.ndarray, "m 3"]:
    return np.asarray((loop.points - loop.centroid) / loop.diagonal)


def relaxed_surface(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], boundary_size: int
) -> DiscreteMinimalSurface:
    """The discrete minimal surface that `descend_area` finds from a mesh, with the same triangles."""
    start = time.perf_counter()
    disk = descend_area(vertices, faces, boundary_size, relative_change=FINE_CHANGE)
    return _result(disk, vertices[:boundary_size], start=start)


def _result(
    disk: Disk,
    boundary: Float[np.ndarray, "m 3"],
    *,
    start: float,
    method: DiscreteMethod = "libigl",
    scale: float = 1.0,
    centre: Float[np.ndarray, "3"] | float = 0.0,
) -> DiscreteMinimalSurface:
    """The result of a disk at unit size, with the exact boundary. `start` is the time when the computation began."""
    areas = tuple(area * scale**2 for area in disk.areas)
    return DiscreteMinimalSurface(
        vertices=np.concatenate([boundary, disk.vertices[len(boundary) :] * scale + centre]),
        faces=disk.faces,
        boundary_size=len(boundary),
        area=areas[-1],
        area_history=areas,
        converged=disk.converged,
        reason=disk.reason,
        method=method,
        seconds=time.perf_counter() - start,
    )


def _stationary_disk(
    points: Float[np.ndarray, "m 3"], relative_change: float, target: float | None
) -> tuple[Disk, PlaneTriangulation]:
    """A disk of stationary area over any closed curve, or the best one found, with the reason, and its plane mesh.

    The domain of the first disk is the unfolding, or else a round one. The domain of the final disk is the flattened
    first disk, or else the first domain.
    """
    domain, first_plane, first, failure = _first_descended(points, SizeField())
    # an edge length for which the area can be lowered in several steps
    shortest = edge_length_of(first.areas[-1], min(MOST_POINTS, vertices_to_factor(seconds_left() / _STEPS)))
    length = None if target is None else max(target, shortest)
    try:
        flat = flatten(first.vertices, first.faces, len(points)).boundary
        plane, disk = _descended(flat, _capped(flat, first, length), points, relative_change)
    except DomainError as error:
        failure = f"it was not remeshed on its flattening: {error}"
        plane, disk = _descended(domain, _capped(domain, first, length), points, relative_change)
    except OutOfTimeError:
        plane, disk = replace(first_plane, is_complete=False), replace(first, converged=False)
        failure = "the time limit was reached after the first fill"
    plane = replace(plane, is_complete=plane.is_complete and length == target)
    return _or_flat(points, disk, plane, failure)


def _first_descended(
    points: Float[np.ndarray, "m 3"], size: SizeField
) -> tuple[Complex[np.ndarray, " m"], PlaneTriangulation, Disk, str]:
    """The domain, triangulation and disk of a first fill, and why it is over a round domain if it is."""
    failure = ""
    try:
        domain = unfolded_loop(points)
        return domain, *_descended(domain, size, points, FIRST_CHANGE), failure
    except (DomainError, FirstFillError) as error:
        domain = on_circle(points)
        failure = f"it started from a round domain: {error}"
        return domain, *_descended(domain, size, points, FIRST_CHANGE), failure


def _or_flat(
    points: Float[np.ndarray, "m 3"], disk: Disk, plane: PlaneTriangulation, failure: str
) -> tuple[Disk, PlaneTriangulation]:
    """A disk, or where it failed the triangulation without inner vertices if that has less area."""
    if disk.converged and not failure:
        return disk, plane
    faces = disk_without_inner_points(points)
    area = float(face_areas(points, faces).sum())
    if area < disk.areas[-1]:
        why = "the triangulation without inner vertices has less area"
        without = PlaneTriangulation(points=on_circle(points), faces=faces, boundary_size=len(points))
        return Disk(vertices=points, faces=faces, areas=(area,), converged=False, reason=why), without
    return replace(disk, reason=disk.reason or failure), plane


def _descended(
    domain: Complex[np.ndarray, " m"], size: SizeField, points: Float[np.ndarray, "m 3"], relative_change: float
) -> tuple[PlaneTriangulation, Disk]:
    """A triangulated plane domain, and the disk of stationary area over it. Raises as `descend_from_plane`."""
    plane = triangulate_polygon(domain, size, seconds=seconds_left())
    return plane, descend_from_plane(plane, points, relative_change=relative_change)


def on_circle(points: Float[np.ndarray, "m 3"]) -> Complex[np.ndarray, " m"]:
    """Points of the unit circle for those of a closed curve, by the mean of index and arc length."""
    length = edge_lengths(points)
    return np.asarray(np.exp(1j * np.cumsum(np.pi * (length / length.sum() + 1 / len(points)))))


def first_disk(points: Float[np.ndarray, "m 3"]) -> Disk:
    """The first fill of a closed curve: a disk of minimal area to about three digits, accurate enough to flatten it.

    Raises:
        FirstFillError: the curve's least-area triangulation does not unfold.
        OutOfTimeError: the time limit was reached.
    """
    disk = descend_from_plane(triangulate_polygon(unfolded_loop(points)), points, relative_change=FIRST_CHANGE)
    require_time()
    return disk


def finer_disk(disk: Disk, boundary_size: int) -> Disk:
    """The disk flattened and remeshed twice, finer inside, with its area minimised, to resolve folds and narrow parts.

    Raises:
        DomainError: the disk has no simple flattening.
        OutOfTimeError: the time limit was reached.
    """
    points = disk.vertices[:boundary_size]
    for _ in range(2):
        require_time()
        flat = flatten(disk.vertices, disk.faces, boundary_size).boundary
        require_time()
        plane = triangulate_polygon(flat, SizeField(growth=FINE_GROWTH))
        disk = descend_from_plane(plane, points, relative_change=FINE_CHANGE)
    return disk


def _capped(polygon: Complex[np.ndarray, " m"], first: Disk, target: float | None) -> SizeField:
    """Sizes bounded by the target edge length in space over the local stretch."""
    if target is None:
        return SizeField()
    laplacian = mollified_laplacian(first.vertices, first.faces)
    flat = harmonic_extension(laplacian, plane_coordinates(polygon))
    plane_area = np.abs(face_areas(flat, first.faces))
    area = np.maximum(face_areas(first.vertices, first.faces), TINY)
    stretch = np.sqrt(area / np.maximum(plane_area, TINY))
    # on the round domain of a loop that does not unfold the stretch is unbounded
    stretch = np.minimum(stretch, _MOST_STRETCHED * np.sqrt(area.sum() / max(plane_area.sum(), TINY)))
    x, y = flat[first.faces].mean(axis=1).T
    return SizeField(samples=x + 1j * y, lengths=target / stretch)


def remeshed(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], boundary_size: int, size: float
) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "t 3"]]:
    """A disk remeshed by MeshLab with inner edges of about equal length. The boundary is unchanged and comes first.

    Edges away from the boundary triangles are split, collapsed and flipped, then all inner edges are flipped. A disk of
    boundary triangles only is returned unchanged.

    Raises:
        FirstFillError: MeshLab failed, moved the boundary, or its result is not a disk.
    """
    import pymeshlab

    m, meshes = boundary_size, _mesh_set(vertices, faces)
    meshes.compute_selection_from_mesh_border()
    meshes.apply_selection_inverse(invfaces=True)
    if not meshes.current_mesh().selected_face_number():
        return vertices, faces
    ours = {"iterations": _REMESHING_STEPS, "targetlen": pymeshlab.PureValue(size), "featuredeg": 180.0}
    ours |= {"checksurfdist": False, "reprojectflag": False}
    try:
        _remesh(meshes, **ours, selectedonly=True)
        _remesh(meshes, **ours, splitflag=False, collapseflag=False)
        mesh = meshes.current_mesh()
        new, new_faces = mesh.vertex_matrix(), mesh.face_matrix().astype(np.int64)
    except pymeshlab.PyMeshLabException as error:
        raise FirstFillError(f"MeshLab did not fill a loop of {m} points: {error}") from error
    finally:
        # restore the defaults, which the caller's next calls would inherit
        _remesh(_mesh_set(np.eye(3), np.array([[0, 1, 2]])))
    rim, boundary = np.arange(m), boundary_edges(new_faces)
    kept = np.array_equal(boundary[boundary[:, 0].argsort()], np.stack([rim, np.roll(rim, -1)], axis=1))
    kept = kept and np.array_equal(new[:m], vertices[:m])
    if not kept or len(np.unique(new_faces)) < len(new) or not is_disk(new_faces):
        raise FirstFillError(f"MeshLab's remeshing tore the fill of a loop of {m} points")
    return new, new_faces


def _remesh(meshes: pymeshlab.MeshSet, **options: Any) -> None:
    """MeshLab's remeshing with explicit defaults: it keeps the options of the previous call."""
    import pymeshlab

    defaults = {"iterations": 10, "adaptive": False, "selectedonly": False, "targetlen": pymeshlab.PercentageValue(100)}
    defaults |= {"featuredeg": 30.0, "checksurfdist": True, "splitflag": True, "collapseflag": True, "swapflag": True}
    defaults |= {"smoothflag": True, "reprojectflag": True}
    meshes.meshing_isotropic_explicit_remeshing(**defaults | options)


def _mesh_set(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> pymeshlab.MeshSet:
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32)))
    return meshes
