"""The figures of disks and filled holes. Each has one definition, see docs/benchmark.md."""

import math
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.bench.cases import Case
from spinor_geom.bench.cut_outs import CutOut
from spinor_geom.bench.fillers import Filled, Mesh, Surface
from spinor_geom.bench.holes import Hole
from spinor_geom.bench.machine import Record
from spinor_geom.comparison import exact_curvature
from spinor_geom.gallery.chart import Chart
from spinor_geom.measures import discrete_mean_curvature, distances_to_mesh, mesh_samples, smallest_angles
from spinor_geom.mesh.boundary_loop import BoundaryLoop, diagonals
from spinor_geom.mesh.intersections import intersections_between, self_intersections
from spinor_geom.mesh.operators import crossing_angles, face_areas, internal_angles
from spinor_geom.mesh.topology import HalfEdges, boundary_edges, face_components
from spinor_geom.meshing.embed import mesh_patch
from spinor_geom.plateau.solution import PlateauSolution

_CURVATURE_POINTS = 100  # of the exact |H|, which takes some milliseconds a point
_DISTANCE_SAMPLES, _SURFACE_TRIANGLES = 5_000, 2_000  # fewest samples of a mesh, and triangles of our surface
_MOST_FACES = 300_000  # intersections of more faces are not counted: the exact predicates take minutes
_SAME = 1e-6  # vertices closer than this, per diagonal, are the same: some tools keep single precision

DISTANCE, REMOVED = "distance / diameter", "removed"


def disk_figures(surface: Surface, mesh: Mesh, loop: BoundaryLoop, case: Case) -> Record:
    """The figures of a disk over a known loop."""
    vertices, faces, diameter, n = mesh.vertices, mesh.faces, case.diameter, len(loop)
    figures = mesh_figures(vertices, faces, diameter, case.chart)
    edges = {tuple(edge) for edge in boundary_edges(faces).tolist()}
    figures |= {
        "area": surface.area,
        "area_error": abs(surface.area / case.area - 1),
        "mesh_area_error": abs(figures["mesh_area"] / case.area - 1),
        "rim_kept": bool((vertices[:n] == loop.points).all()),
        "open_edges": len(edges ^ {(k, (k + 1) % n) for k in range(n)}),
        "converged": surface.converged,
    }
    if isinstance(surface, PlateauSolution):
        figures["message"] = f"route {surface.route}; {surface.reason}"
        figures["residual_per_edge"] = surface.boundary_residual.rms_per_edge
        domain = surface.domain.triangulation
        curvature = exact_curvature(surface, domain.points[domain.boundary_size :], _CURVATURE_POINTS)
        if len(curvature):
            figures["exact_curvature_median"] = float(np.median(curvature)) * diameter
        # only inner vertices are on the surface. Those on the rim are the given points
        fine = mesh_patch(surface, (4 * surface.area / 3**0.5 / _SURFACE_TRIANGLES) ** 0.5)
        distance = case.chart.distances(fine.vertices[fine.boundary_size :])
        figures["surface_distance_max"] = float(distance.max() / diameter) if len(distance) else None
    return figures


def mesh_figures(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], diameter: float, chart: Chart | None
) -> Record:
    """The figures of a triangle mesh. Lengths are divided by the diameter."""
    curvature = discrete_mean_curvature(vertices, faces)
    figures: Record = {
        "triangles": len(faces),
        "mesh_area": float(face_areas(vertices, faces).sum()),
        "curvature_max": curvature.max * diameter,
        "curvature_rms": curvature.rms * diameter,
        "min_angle": float(smallest_angles(vertices, faces).min()),
        # the angle of a degenerate face counts as 180°
        "max_angle": float(np.degrees(np.nan_to_num(internal_angles(vertices, faces), nan=np.pi).max())),
        "nonmanifold_edges": int((HalfEdges.of(faces).counts > 2).sum()),
        "crossings": len(self_intersections(vertices, faces)) if len(faces) <= _MOST_FACES else None,
    }
    if chart is not None and len(faces) <= _MOST_FACES:
        distance = chart.hausdorff(vertices, faces, samples=_DISTANCE_SAMPLES)
        figures["distance_max"] = distance.max / diameter
        figures["distance_mean"] = distance.mean / diameter
    return figures


def hole_figures(filled: Filled, hole: Hole, case: Case | None) -> Record:
    """The figures of a filler's result. `case` is the known disk whose loop the hole has, if any."""
    old, of_patch, vertex_of = _parts(filled, hole)
    patch, known = filled.faces[of_patch], vertex_of >= 0
    step = np.abs(filled.vertices[known] - hole.vertices[vertex_of[known]]).max(initial=0.0)
    diagonal = _diagonal(hole)
    still_open = set(map(tuple, np.sort(vertex_of[boundary_edges(filled.faces)], axis=1).tolist()))
    rim_left, outer_left = (
        sum(tuple(edge) in still_open for edge in np.sort(edges, axis=1).tolist()) for edges in hole.edges
    )
    counts = HalfEdges.of(filled.faces).counts
    figures: Record = {
        "open_rim_edges": rim_left,
        "new_open_edges": int((counts == 1).sum()) - rim_left - outer_left,
        "outer_kept_open": outer_left == len(hole.edges[1]),
        "nonmanifold_edges": int((counts > 2).sum()),
        "old_faces_kept": int(old.sum()) == len(hole.faces) and bool(step <= _SAME * diagonal),
        "rim_kept": set(map(bytes, hole.vertices[hole.rim])) <= set(map(bytes, filled.vertices)),  # bit for bit
        "triangles": len(patch),
        "message": filled.message,
        "succeeded": filled.succeeded,
        **filled.figures,
    }
    if not len(patch):
        return figures
    used, faces = np.unique(patch, return_inverse=True)
    vertices, faces = filled.vertices[used], faces.reshape(-1, 3)
    figures |= mesh_figures(vertices, faces, *((diagonal, None) if case is None else (case.diameter, case.chart)))
    figures["area"] = figures["mesh_area"] if filled.area is None else filled.area
    if hole.area is not None:
        figures["area_error"] = abs(figures["area"] / hole.area - 1)
        figures["area_excess"] = figures["mesh_area"] / hole.area - 1
        figures["mesh_area_error"] = abs(figures["area_excess"])
    figures["patches"] = 1 + int(face_components(patch).max())
    if len(filled.faces) <= _MOST_FACES:
        crossing = intersections_between(vertices, faces, filled.vertices, filled.faces[~of_patch])
        figures["mesh_crossings"] = len(crossing)
    return figures


def cut_out_figures(filled: Filled, cut_out: CutOut) -> Record:
    """The figures of a filled cut-out. Lengths are divided by the largest distance of two rim points."""
    figures = hole_figures(filled, cut_out.hole, None) | {"diameter": cut_out.diameter, "kind": cut_out.kind}
    _, of_patch, vertex_of = _parts(filled, cut_out.hole)
    patch = filled.faces[of_patch]
    if not len(patch):
        return figures
    new = np.unique(patch)
    new = new[vertex_of[new] < 0]
    samples = mesh_samples(filled.vertices, patch, _DISTANCE_SAMPLES)
    removed = mesh_samples(cut_out.vertices, cut_out.faces, _DISTANCE_SAMPLES)
    forward = _rms(cut_out.distances(samples.points), samples.areas)
    backward = _rms(distances_to_mesh(removed.points, filled.vertices, patch), removed.areas)
    figures["surface_distance"] = math.sqrt((forward**2 + backward**2) / 2) / cut_out.diameter
    if len(new):
        figures["vertex_distance"] = _rms(cut_out.distances(filled.vertices[new])) / cut_out.diameter
    # on a known surface most of the distance of the triangles is due to their flatness
    of_vertices = cut_out.exact is not None and len(new) > 0
    figures["distance"] = figures["vertex_distance" if of_vertices else "surface_distance"]
    figures["bend"] = rim_bend(filled.vertices, patch, filled.faces[~of_patch])
    figures["removed_bend"] = rim_bend(cut_out.vertices, cut_out.faces, cut_out.kept[cut_out.hole.faces])
    return figures


def save_views(filled: Filled, cut_out: CutOut, folder: Path, method: str) -> None:
    """Writes the removed piece and the patch with their vertices' distances per diameter, for the page's views."""
    folder.mkdir(parents=True, exist_ok=True)
    patch = filled.faces[_parts(filled, cut_out.hole)[1]]
    for name, vertices, faces in ((REMOVED, cut_out.vertices, cut_out.faces), (method, filled.vertices, patch)):
        if len(faces):
            used, index = np.unique(faces, return_inverse=True)
            values = cut_out.distances(vertices[used]) / cut_out.diameter
            arrays = {"vertices": vertices[used].astype(np.float32), "values": values.astype(np.float32)}
            np.savez_compressed(folder / f"{name}.npz", faces=index.reshape(-1, 3).astype(np.int32), **arrays)


def rim_bend(
    vertices: Float[np.ndarray, "n 3"], patch: Int[np.ndarray, "p 3"], rest: Int[np.ndarray, "f 3"]
) -> float | None:
    """RMS angle, in radians and by length, between patch and mesh along their common edges, or None without any."""
    half = HalfEdges.of(np.concatenate([patch, rest]))
    across = np.flatnonzero(half.twin[: 3 * len(patch)] >= 3 * len(patch))
    if not len(across):
        return None
    start, end, angles = half.origin[across], half.target[across], crossing_angles(half, vertices)[across]
    # the normals of faces with opposite orientations lie on different sides
    angles = np.where(start == half.origin[half.twin[across]], np.pi - angles, angles)
    return _rms(angles, np.linalg.norm(vertices[start] - vertices[end], axis=1))


def _parts(filled: Filled, hole: Hole) -> tuple[Bool[np.ndarray, " f"], Bool[np.ndarray, " f"], Int[np.ndarray, " n"]]:
    """Whether each face is a face of the hole's mesh, or of a patch, and each vertex's id in the hole's mesh, or −1.

    Vertices are matched by position, because some tools renumber them, and by index where their order was kept.
    Parts of old triangles that a tool divided or moved, and caps on other boundaries, are neither.
    """
    count, tolerance = len(hole.vertices), _SAME * _diagonal(hole)
    distance, nearest = cKDTree(hole.vertices).query(filled.vertices)
    vertex_of = np.where(np.asarray(distance) <= tolerance, np.asarray(nearest), -1)
    first = filled.vertices[:count]
    if filled.in_order or (len(first) == count and bool((np.abs(first - hole.vertices) <= tolerance).all())):
        vertex_of[:count] = np.arange(count)  # this distinguishes vertices of equal position
    mapped = vertex_of[filled.faces]
    old = (mapped >= 0).all(axis=1) & np.isin(_face_keys(np.maximum(mapped, 0), count), _face_keys(hole.faces, count))
    elsewhere = np.setdiff1d(np.arange(count), hole.rim)
    new = np.flatnonzero(~old & ~np.isin(mapped, elsewhere).any(axis=1))
    # inner faces of a cap have no old vertex, so it is tested whether the whole piece has a vertex of a rim
    pieces = face_components(filled.faces[new])
    patch = np.zeros(len(filled.faces), dtype=bool)
    patch[new[np.isin(pieces, pieces[(mapped[new] >= 0).any(axis=1)])]] = True
    return old, patch, vertex_of


def _face_keys(faces: Int[np.ndarray, "f 3"], count: int) -> Int[np.ndarray, " f"]:
    """One number for each set of three of `count` vertices, fewer than two million."""
    a, b, c = np.sort(faces, axis=1).astype(np.int64).T
    return np.asarray((a * count + b) * count + c)


def _diagonal(hole: Hole) -> float:
    return float(diagonals(hole.vertices))


def _rms(values: Float[np.ndarray, " k"], weights: Float[np.ndarray, " k"] | None = None) -> float:
    return float(np.sqrt(np.average(values**2, weights=weights)))
