"""The discrete baseline on triangles that MeshLab's filters make: isotropic remeshing and cotangent smoothing."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.discrete.area_descent import descend_area
from spinor_geom.discrete.first_fill import disk_without_inner_points
from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface, Disk
from spinor_geom.errors import FirstFillError, OptionError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import face_areas
from spinor_geom.mesh.topology import HalfEdges, face_components, is_watertight

if TYPE_CHECKING:
    import pymeshlab

# Triangles without inner vertices are far from minimal. They are remeshed and smoothed first with about so many edges
# across, then with edges half as long, and so on: coarse meshes move far in few steps.
_EDGES_ACROSS = 6
# Remeshing and smoothing take turns until the area falls by less than this share, at most so often per edge length.
_ROUND_CHANGE = 3e-3
_ROUNDS = 6
_ROUND_STEPS = 50
_REMESHING_STEPS = 5
# MeshLab splits edges longer than 4/3 of the wanted length.
_LONGEST = 4 / 3
_BISECTIONS = 64
# An edge length that is not given is raised until about so many vertices are enough; a given one may ask for more.
_VERTICES = 20_000
_MOST_VERTICES = 500_000


def meshlab_minimal_surface(
    loop: BoundaryLoop, *, target_edge_length: float | None, relative_change: float
) -> DiscreteMinimalSurface:
    """A disk over a loop whose triangles MeshLab makes, with an area that is stationary along its normals.

    The loop's triangulation of least area, as fillers of holes make it, is remeshed isotropically and smoothed with
    cotangent weights in turns, with edges of halving length down to the target. That smoothing does not end: it creeps
    along the surface, by half a millionth of the area in 25 steps, and degenerates triangles. So it is left when a turn
    gains little, and `descend_area` makes the area stationary, as for the other baseline.

    Time grows with the square of the loop's number of points, as the number of vertices does.

    Args:
        loop: a closed loop.
        target_edge_length: edge length inside, in mesh units; None for the loop's mean edge, or longer where that would
            take more than 20,000 vertices. Loop edges stay as they are.
        relative_change: as for `discrete_minimal_surface`.

    Raises:
        OptionError: the edge length would take more than 500,000 vertices.
        FirstFillError: MeshLab's remeshing or smoothing fails, or tears the disk.

    Source: Pinkall & Polthier (1993) for cotangent weights; Liepa (2003), "Filling holes in meshes", for its way.
    """
    import pymeshlab

    start = time.perf_counter()
    boundary = (loop.points - loop.centroid) / loop.diagonal
    try:
        faces = disk_without_inner_points(boundary)
        size = _edge_length(target_edge_length, loop, area=_area(boundary, faces))
        vertices, faces = _remeshed(boundary, faces, size)
    except pymeshlab.PyMeshLabException as error:
        raise FirstFillError(f"MeshLab did not fill a loop of {len(loop)} points: {error}") from error
    finally:
        _forget_remeshing_options()
    disk = Disk.of(descend_area(vertices, faces, len(loop), relative_change=relative_change), faces)
    return disk.result(loop.points, scale=loop.diagonal, centre=loop.centroid, method="pymeshlab", start=start)


def _edge_length(target: float | None, loop: BoundaryLoop, *, area: float) -> float:
    """The edge length inside, at unit size."""
    cell = area * 2 / 3**0.5  # n equilateral pairs of triangles of edge h have the area n·h²·√3/2
    if target is None:
        return float(max(loop.mean_edge_length / loop.diagonal, (cell / _VERTICES) ** 0.5))
    size = target / loop.diagonal
    if cell > _MOST_VERTICES * size**2:
        shortest = (cell / _MOST_VERTICES) ** 0.5 * loop.diagonal
        raise OptionError(
            f"target_edge_length {target:g} takes more than {_MOST_VERTICES} vertices; give at least {shortest:.2g}"
        )
    return size


# --- remeshing --------------------------------------------------------------------------------------------------------


def _remeshed(
    boundary: Float[np.ndarray, "m 3"], faces: Int[np.ndarray, "f 3"], size: float
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "k 3"]]:
    """Triangles with inner edges of a given length and about the least area, from coarse to fine.

    Raises:
        FirstFillError: the remeshing moved the boundary or tore the disk.
    """
    m, vertices = len(boundary), boundary
    area = _area(vertices, faces)
    step = max(size, area**0.5 / _EDGES_ACROSS)
    while True:
        vertices, faces = _split(vertices, faces, _LONGEST * step)
        for _ in range(_ROUNDS):
            before = area
            vertices, faces = _remesh_once(vertices, faces, m, step)
            if not np.array_equal(vertices[:m], boundary) or not _is_disk(
                faces, vertices=len(vertices), boundary_size=m
            ):
                raise FirstFillError(f"MeshLab's remeshing tore the fill of a loop of {m} points")
            vertices = _smooth(vertices, faces, m, _ROUND_STEPS)
            area = _area(vertices, faces)
            if before - area < _ROUND_CHANGE * area:
                break
        if step <= size:
            return vertices, faces
        step = max(size, step / 2)


def _split(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], longest: float
) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "t 3"]]:
    """Halves inner edges until none is longer than `longest`.

    MeshLab's remeshing splits edges of the boundary as well, unless it leaves alone the triangles beside it; between
    those it would split nothing.
    """
    for _ in range(_BISECTIONS):
        half = HalfEdges.of(faces)
        length = np.linalg.norm(vertices[half.target] - vertices[half.origin], axis=1)
        edge = np.empty(len(length), dtype=np.int64)
        edge[half.order] = np.repeat(np.arange(len(half.counts)), half.counts)
        # one order of all edges, so that the longest is the longest of both its faces even where lengths are equal
        rank = np.empty(len(length), dtype=np.int64)
        rank[np.lexsort([edge, length])] = np.arange(len(length))
        rank = np.where(half.twin < 0, -1, np.maximum(rank, rank[half.twin]))
        side = 3 * np.arange(len(faces)) + rank.reshape(-1, 3).argmax(axis=1)
        twin = half.twin[side]
        split = (length[side] > longest) & (side[twin // 3] == twin)
        if not split.any():
            break
        middle = np.full(len(half.counts), -1)
        halved = np.unique(edge[side[split]])
        middle[halved] = len(vertices) + np.arange(len(halved))
        ends = np.stack([half.origin, half.target], axis=1)[half.order[half.starts[halved]]]
        new, apex = middle[edge[side[split]]], half.opposite[side[split]]
        vertices = np.concatenate([vertices, vertices[ends].mean(axis=1)])
        faces = np.concatenate(
            [
                faces[~split],
                np.stack([half.origin[side[split]], new, apex], axis=1),
                np.stack([new, half.target[side[split]], apex], axis=1),
            ]
        )
    return vertices, faces


def _remesh_once(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], m: int, size: float
) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "t 3"]]:
    """Splits, collapses and flips away from the boundary's edges, then flips only, everywhere."""
    import pymeshlab

    inner = ~((faces < m) & (np.roll(faces, -1, axis=1) == (faces + 1) % m)).any(axis=1)
    if not inner.any():
        return vertices, faces
    meshes = _mesh_set(vertices, faces, selected=inner)
    for everywhere in (False, True):
        # MeshLab remembers options from call to call: each is given
        meshes.meshing_isotropic_explicit_remeshing(
            iterations=_REMESHING_STEPS,
            adaptive=False,
            selectedonly=not everywhere,
            targetlen=pymeshlab.PureValue(size),
            featuredeg=180.0,
            checksurfdist=False,
            splitflag=not everywhere,
            collapseflag=not everywhere,
            swapflag=True,
            smoothflag=True,
            reprojectflag=False,
        )
    return _arrays(meshes)


def _forget_remeshing_options() -> None:
    """Gives MeshLab its own defaults again: it would use our options in the caller's next calls."""
    import pymeshlab

    _mesh_set(np.eye(3), np.array([[0, 1, 2]])).meshing_isotropic_explicit_remeshing(
        iterations=10,
        adaptive=False,
        selectedonly=False,
        targetlen=pymeshlab.PercentageValue(100),
        featuredeg=30.0,
        checksurfdist=True,
        splitflag=True,
        collapseflag=True,
        swapflag=True,
        smoothflag=True,
        reprojectflag=True,
    )


def _smooth(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], m: int, steps: int
) -> Float[np.ndarray, "n 3"]:
    """MeshLab's cotangent smoothing of the vertices after the first m."""
    if len(vertices) == m:
        return vertices
    meshes = _mesh_set(vertices, faces)
    meshes.compute_selection_from_mesh_border()
    meshes.apply_selection_inverse(invverts=True, invfaces=False)
    # without `selected` it moves the boundary, whatever `boundary` says
    meshes.apply_coord_laplacian_smoothing(stepsmoothnum=steps, boundary=False, cotangentweight=True, selected=True)
    return _arrays(meshes)[0]


# --- what MeshLab takes and gives -------------------------------------------------------------------------------------


def _mesh_set(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], *, selected: Bool[np.ndarray, " f"] | None = None
) -> pymeshlab.MeshSet:
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    if selected is None:
        meshes.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32)))
        return meshes
    # faces can be selected only by a condition on their scalar
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32), f_scalar_array=selected.astype(np.float64)))
    meshes.compute_selection_by_condition_per_face(condselect="fq > 0.5")
    return meshes


def _arrays(meshes: pymeshlab.MeshSet) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"]]:
    mesh = meshes.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int64)


def _area(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> float:
    return float(face_areas(vertices, faces).sum())


def _is_disk(faces: Int[np.ndarray, "f 3"], *, vertices: int, boundary_size: int) -> bool:
    """Whether faces are one disk on all vertices whose boundary runs 0, 1, … boundary_size − 1."""
    here = np.arange(boundary_size)
    # a cone over the boundary closes a disk, and nothing else, to a sphere
    cone = np.stack([np.roll(here, -1), here, np.full(boundary_size, vertices)], axis=1)
    closed = np.concatenate([faces, cone])
    return bool(
        len(np.unique(closed)) == vertices + 1
        and 2 * (vertices + 1) - len(closed) == 4  # Euler's formula for triangles without a boundary
        and is_watertight(closed)
        and face_components(closed).max() == 0
    )
