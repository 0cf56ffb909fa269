"""Discrete minimal surfaces: triangulated disks over a loop, or annuli between two."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.adapters import to_rims
from spinor_geom.arrays import TINY
from spinor_geom.deadline import require_time
from spinor_geom.discrete.area_descent import FIRST_CHANGE, Disk, descend_area, descend_from_plane, harmonic_extension
from spinor_geom.discrete.first_fill import disk_without_inner_points, unfolded_loop
from spinor_geom.discrete.strip import discrete_annulus
from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.domain.flattening import flatten
from spinor_geom.domain.sizes import SizeField
from spinor_geom.domain.triangulation import MOST_POINTS, triangulate_polygon
from spinor_geom.errors import (
    DomainError,
    FirstFillError,
    OptionError,
    TooManyRimsError,
    require_positive,
)
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import face_areas, mollified_laplacian
from spinor_geom.mesh.spacing import edge_lengths
from spinor_geom.mesh.topology import boundary_edges, is_disk
from spinor_geom.shown import Shown, shortened

if TYPE_CHECKING:
    import pymeshlab

DiscreteMethod = Literal["libigl", "pymeshlab"]
FINE_CHANGE = 1e-8
_FINE_GROWTH = 0.15
_MOST_STRETCHED = 4.0  # times the mean stretch from the plane; a larger one does not refine the mesh further
_REMESHING_STEPS = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscreteMinimalSurface(Shown):
    """A triangulated disk or annulus whose boundary is a loop or two, and whose discrete mean curvature is zero.

    Attributes:
        vertices: (n, 3), mesh units; the loops' points come first, bit for bit.
        faces: (f, 3), counter-clockwise about the loop.
        boundary_size: number of loop points, of all loops together.
        area: total area of the triangles.
        area_history: total area after each step of the last descent.
        converged: whether the area became stationary for motions along the vertex normals, to `relative_change`.
        reason: why it did not converge, or the fallback that was used, in one sentence; else empty.
        method: the `method` argument.
        seconds: wall time.
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
    near it and grow inwards; for an area that converges with the loop's edge length give `target_edge_length`.

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
        target_edge_length: upper bound of the edge length in mesh units; None lets edges grow inwards, and for
            "pymeshlab" is the loop's mean edge length.
        relative_change: the area is stationary when a step lowers it, or its slope predicts a decrease, by less than
            this share.

    Raises:
        OptionError: unknown method, an option that annuli do not support, or a number that is not positive.
        TooManyRimsError: a sequence of other than one or two loops.
        FirstFillError: MeshLab did not remesh the surface; "libigl" fills every loop.
        DomainError: no annulus can be meshed between the two loops.

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
    start = time.perf_counter()
    unit = (loop.points - loop.centroid) / loop.diagonal
    length = loop.mean_edge_length if target_edge_length is None and method == "pymeshlab" else target_edge_length
    target = None if length is None else length / loop.diagonal
    disk = _stationary_disk(unit, relative_change, target)
    if method == "pymeshlab" and target is not None:
        # n equilateral pairs of triangles of edge h have the area n·h²·√3/2
        shortest = math.sqrt(2 * disk.areas[-1] / (math.sqrt(3) * MOST_POINTS))
        vertices, faces = remeshed(disk.vertices, disk.faces, len(loop), max(target, shortest))
        disk = descend_area(vertices, faces, len(loop), relative_change=relative_change)
    return _result(disk, loop.points, scale=loop.diagonal, centre=loop.centroid, method=method, start=start)


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
    """The result of a disk at unit size, with the exact boundary; `start` is the time when the computation began."""
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


def _stationary_disk(points: Float[np.ndarray, "m 3"], relative_change: float, target: float | None) -> Disk:
    """A disk of stationary area over any closed curve, or the best one found, with the reason.

    The domain of the first disk is the unfolding, or else a round one. The domain of the final disk is the flattened
    first disk, or else the first domain.
    """
    domain, failure = np.empty(0), ""
    try:
        domain = unfolded_loop(points)
        first = descend_from_plane(triangulate_polygon(domain), points, relative_change=FIRST_CHANGE)
    except (DomainError, FirstFillError) as error:
        # on the unit circle, by the mean of index and arc length
        length = edge_lengths(points)
        domain = np.exp(1j * np.cumsum(np.pi * (length / length.sum() + 1 / len(points))))
        failure = f"it started from a round domain: {error}"
        first = descend_from_plane(triangulate_polygon(domain), points, relative_change=FIRST_CHANGE)
    try:
        flat = flatten(first.vertices, first.faces, len(points)).boundary
        plane = triangulate_polygon(flat, _capped(flat, first, target))
        disk = descend_from_plane(plane, points, relative_change=relative_change)
    except DomainError as error:
        failure = f"it was not remeshed on its flattening: {error}"
        plane = triangulate_polygon(domain, _capped(domain, first, target))
        disk = descend_from_plane(plane, points, relative_change=relative_change)
    if disk.converged and not failure:
        return disk
    faces = disk_without_inner_points(points)
    area = float(face_areas(points, faces).sum())
    if area < disk.areas[-1]:
        why = "the triangulation without inner vertices has less area"
        return Disk(vertices=points, faces=faces, areas=(area,), converged=False, reason=why)
    return replace(disk, reason=disk.reason or failure)


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
        plane = triangulate_polygon(flat, SizeField(growth=_FINE_GROWTH))
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
    """A disk remeshed by MeshLab with inner edges of about equal length; the boundary is unchanged and comes first.

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
