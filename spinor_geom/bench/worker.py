"""The process that runs tasks, `python -m spinor_geom.bench.worker`, and what it measures of disks and filled holes.

It is spoken to by the runner; every figure has one definition, see docs/benchmark.md.
"""

import gc
import importlib
import math
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.adapters import read_mesh
from spinor_geom.bench.cases import Case, Hole, all_rims, hole_over, known_case, odd_holes, points_limit
from spinor_geom.bench.claims import LEAST_POINTS
from spinor_geom.bench.cut_outs import CutOut, named_cut_out, ragged_hole
from spinor_geom.bench.fillers import FILLERS, LOOP_METHODS, Answer, Filled, Mesh
from spinor_geom.bench.machine import Record, Task
from spinor_geom.bench.reports import reported_holes
from spinor_geom.bench.solves import solve_figures, solves
from spinor_geom.comparison import exact_curvature
from spinor_geom.errors import SpinorGeomError
from spinor_geom.gallery.chart import Chart
from spinor_geom.isolate import serve
from spinor_geom.measures import discrete_mean_curvature, distances_to_mesh, mesh_samples, smallest_angles
from spinor_geom.mesh.boundary_loop import BoundaryLoop, turning_angles
from spinor_geom.mesh.intersections import intersections_between, self_intersections
from spinor_geom.mesh.operators import crossing_angles, face_areas, internal_angles
from spinor_geom.mesh.topology import HalfEdges, boundary_edges, face_components
from spinor_geom.meshing.embed import mesh_patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau

_ENOUGH_SECONDS = 5.0  # repeats end when they have taken this long together
_CURVATURE_POINTS = 100  # of the exact |H|: second derivatives cost some milliseconds a point
_DISTANCE_SAMPLES, _SURFACE_TRIANGLES = 5_000, 2_000  # at least so many points of the mesh, and triangles of ours
_MOST_CROSSING_FACES = 300_000  # crossings of more faces than this are not counted: the exact predicates take minutes
_SAME = 1e-6  # vertices nearer than this share of the diagonal are the same: room for tools that keep single precision

DISTANCE, REMOVED = "distance / diameter", "removed"


def run(task: Task) -> Record:
    """Runs a task and measures what it left; nothing that goes wrong in a tool ends the process by itself."""
    gc.collect()
    gc.freeze()  # what is imported and cached by now need not be looked through before the next task
    forget_peak_memory()
    package = task["package"]
    alone = {"disks": _span, "batch": _batch}
    work = _fill if task["method"] in FILLERS else alone.get(task["suite"], _solve)
    try:
        importlib.import_module(package)
        return {"status": "done", **work(task)}
    except ImportError as error:  # there is none, or what is broken is the installation, and not the tool
        return {"status": "missing", "reason": f"{package} cannot be imported here: {_sentence(error)}"}
    except SpinorGeomError as error:
        return {"status": "refused", "reason": _sentence(error)}
    except Exception as error:  # another project's exception: its row says so
        return {"status": "failed", "reason": f"{type(error).__name__}: {_sentence(error)}"}


def _batch(task: Task) -> Record:
    from spinor_geom.bench.batches import BATCHES

    with tempfile.TemporaryDirectory() as folder:
        return BATCHES[task["case"]](Path(folder), task["share"])


def _solve(task: Task) -> Record:
    case = solves()[task["case"]]
    subject: Any = case.subject()
    timed, answer, _ = _timed(lambda: (lambda: solve_plateau(subject, **case.options), None), task["repeat"])
    return {**timed, **solve_figures(case, answer)}


def _span(task: Task) -> Record:
    case = known_case(task["case"])
    loop, method = case.loop(task["n"]), LOOP_METHODS[task["method"]]
    timed, (answer, patch), _ = _timed(lambda: (lambda: method.span(loop), None), task["repeat"])
    figures = disk_figures(answer, patch, loop, case)
    if task["method"] == "spinor" and case.kind == "smooth" and task["n"] >= LEAST_POINTS:
        figures["limit_error"] = points_limit(case, task["n"])
    return {**timed, **figures}


def _fill(task: Task) -> Record:
    name, case, cut_out = task["case"], None, None
    if task["suite"] == "cut-outs":
        cut_out = named_cut_out(name, None if task["data"] is None else Path(task["data"]))
        hole = cut_out.hole
    elif task["suite"] == "fills":
        case = known_case(name)
        hole = hole_over(name, case.loop(task["n"]), case.area)
    elif task["suite"] == "meshes":
        mesh = read_mesh(name).mesh
        hole = all_rims(Path(name).name, mesh.vertices, mesh.faces)
    elif task["suite"] == "reports":
        hole = reported_holes()[name]
    else:
        hole = odd_holes()[name] if task["suite"] == "odd" else ragged_hole(name)
    timed, answer, finish = _timed(lambda: FILLERS[task["method"]].prepare(hole), task["repeat"])
    filled = finish(answer)
    if cut_out is not None:
        figures = cut_out_figures(filled, cut_out)
        if task["view"]:
            save_views(filled, cut_out, Path(task["view"]), task["method"])
    else:
        figures = hole_figures(filled, hole, case)
    if task["suite"] == "ragged":
        figures["sharpness"] = float(np.degrees(np.quantile(turning_angles(hole.loops[hole.places[0]].points), 0.9)))
    return {**timed, **figures, "expected": hole.expected}


def _timed(prepare: Callable[[], tuple[Callable[[], Any], Any]], repeat: int) -> tuple[Record, Any, Any]:
    """The median seconds of the calls after one that is not counted, if any; the last answer, and what goes on."""
    seconds: list[float] = []
    while len(seconds) < repeat + 1 and (len(seconds) < 1 or sum(seconds) < _ENOUGH_SECONDS):
        work, beside = prepare()
        start = time.perf_counter()
        answer = work()
        seconds.append(time.perf_counter() - start)
    counted = seconds[1:] or seconds
    timed = {"seconds": statistics.median(counted), "seconds_all": counted, "memory_mib": peak_memory()}
    return timed, answer, beside


def peak_memory() -> float | None:
    """The process's largest resident size since `forget_peak_memory`, in MiB; None where the system does not tell."""
    try:
        with open("/proc/self/status", encoding="ascii") as status:
            return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmHWM"))
    except (OSError, StopIteration):
        return None


def forget_peak_memory() -> None:
    """Starts the search for the largest resident size anew, where the system can do that."""
    try:
        with open("/proc/self/clear_refs", "w", encoding="ascii") as control:
            control.write("5")
    except OSError:
        pass


def _sentence(error: BaseException) -> str:
    return " ".join(str(error).split())


def disk_figures(answer: Answer, patch: Mesh, loop: BoundaryLoop, case: Case) -> Record:
    """The figures of a disk over a known loop."""
    vertices, faces, diameter, n = patch.vertices, patch.faces, case.diameter, len(loop)
    figures = patch_figures(vertices, faces, diameter, case.chart)
    edges = {tuple(edge) for edge in boundary_edges(faces).tolist()}
    figures |= {
        "area": answer.area,
        "area_error": abs(answer.area / case.area - 1),
        "mesh_area_error": abs(figures["mesh_area"] / case.area - 1),
        "rim_kept": bool((vertices[:n] == loop.points).all()),
        "open_edges": len(edges ^ {(k, (k + 1) % n) for k in range(n)}),
        "converged": answer.converged,
    }
    if isinstance(answer, PlateauSolution):
        figures["told"] = f"route {answer.route}; {answer.reason}"
        figures["residual_per_edge"] = answer.boundary_residual.rms_per_edge
        mesh = answer.domain.triangulation
        curvature = exact_curvature(answer, mesh.points[mesh.boundary_size :], _CURVATURE_POINTS)
        if len(curvature):
            figures["exact_curvature_median"] = float(np.median(curvature)) * diameter
        # at vertices inside, which are the surface's own points; those on the rim are given
        fine = mesh_patch(answer, (4 * answer.area / 3**0.5 / _SURFACE_TRIANGLES) ** 0.5)
        distance = case.chart.distances(fine.vertices[fine.boundary_size :])
        figures["surface_distance_max"] = float(distance.max() / diameter) if len(distance) else None
    return figures


def hole_figures(filled: Filled, hole: Hole, case: Case | None) -> Record:
    """The figures of a mesh with its rims closed, or not."""
    old, of_patch, vertex_of = _parts(filled, hole)
    patch, known = filled.faces[of_patch], vertex_of >= 0
    step = np.abs(filled.vertices[known] - hole.vertices[vertex_of[known]]).max(initial=0.0)
    diagonal = float(np.linalg.norm(np.ptp(hole.vertices, axis=0)))
    still = set(map(tuple, np.sort(vertex_of[boundary_edges(filled.faces)], axis=1).tolist()))
    # how many edges of the rims, and of the other boundaries, are boundary edges still
    rim_left, outer_left = (
        sum(tuple(edge) in still for edge in np.sort(edges, axis=1).tolist()) for edges in hole.edges
    )
    half = HalfEdges.of(filled.faces)
    figures: Record = {
        "open_rim_edges": rim_left,
        "new_open_edges": int((half.counts == 1).sum()) - rim_left - outer_left,
        "outer_kept_open": outer_left == len(hole.edges[1]),
        "nonmanifold_edges": int((half.counts > 2).sum()),
        "old_faces_kept": int(old.sum()) == len(hole.faces) and bool(step <= _SAME * diagonal),
        "rim_kept": set(map(bytes, hole.vertices[hole.rim])) <= set(map(bytes, filled.vertices)),  # bit for bit
        "triangles": len(patch),
        "told": filled.told,
        "succeeded": filled.succeeded,
        **filled.figures,
    }
    if not len(patch):
        return figures
    used, faces = np.unique(patch, return_inverse=True)
    vertices, faces = filled.vertices[used], faces.reshape(-1, 3)
    known_as = (diagonal, None) if case is None else (case.diameter, case.chart)
    figures |= patch_figures(vertices, faces, *known_as)
    figures["area"] = figures["mesh_area"] if filled.area is None else filled.area
    if hole.area is not None:
        figures["area_error"] = abs(figures["area"] / hole.area - 1)
        figures["mesh_area_error"] = abs(figures["mesh_area"] / hole.area - 1)
        figures["area_excess"] = figures["mesh_area"] / hole.area - 1
    figures["patches"] = 1 + int(face_components(patch).max())
    if len(filled.faces) <= _MOST_CROSSING_FACES:
        crossing = intersections_between(vertices, faces, filled.vertices, filled.faces[~of_patch])
        figures["mesh_crossings"] = len(crossing)
    return figures


def cut_out_figures(filled: Filled, cut_out: CutOut) -> Record:
    """The figures of a hole of which it is known what was in it; lengths per largest distance of points of the rims."""
    figures = hole_figures(filled, cut_out.hole, None) | {"diameter": cut_out.diameter, "kind": cut_out.kind}
    _, of_patch, vertex_of = _parts(filled, cut_out.hole)
    patch = filled.faces[of_patch]
    if not len(patch):
        return figures
    new = np.unique(patch)
    new = new[vertex_of[new] < 0]
    there = mesh_samples(filled.vertices, patch, _DISTANCE_SAMPLES)
    missed = mesh_samples(cut_out.vertices, cut_out.faces, _DISTANCE_SAMPLES)
    forth = _rms(cut_out.distances(there.points), there.areas)
    back = _rms(distances_to_mesh(missed.points, filled.vertices, patch), missed.areas)
    figures["surface_distance"] = math.sqrt((forth**2 + back**2) / 2) / cut_out.diameter
    if len(new):
        figures["vertex_distance"] = _rms(cut_out.distances(filled.vertices[new])) / cut_out.diameter
    # chords are off an exact surface however good their ends are
    of_ends = cut_out.exact is not None and len(new) > 0
    figures["distance"] = figures["vertex_distance" if of_ends else "surface_distance"]
    rest = cut_out.places[cut_out.hole.faces]
    figures["bend"] = rim_bend(filled.vertices, patch, filled.faces[~of_patch])
    figures["removed_bend"] = rim_bend(cut_out.vertices, cut_out.faces, rest)
    return figures


def save_views(filled: Filled, cut_out: CutOut, folder: Path, method: str) -> None:
    """Writes what was removed and the patches, with the vertices' distances from it per diameter of the hole."""
    folder.mkdir(parents=True, exist_ok=True)
    patch = filled.faces[_parts(filled, cut_out.hole)[1]]
    for name, vertices, faces in ((REMOVED, cut_out.vertices, cut_out.faces), (method, filled.vertices, patch)):
        if len(faces):
            used, index = np.unique(faces, return_inverse=True)
            values = cut_out.distances(vertices[used]) / cut_out.diameter
            known = {"vertices": vertices[used].astype(np.float32), "values": values.astype(np.float32)}
            np.savez_compressed(folder / f"{name}.npz", faces=index.reshape(-1, 3).astype(np.int32), **known)


def rim_bend(
    vertices: Float[np.ndarray, "n 3"], patch: Int[np.ndarray, "p 3"], rest: Int[np.ndarray, "f 3"]
) -> float | None:
    """RMS angle, in radians and by length, between a patch and its mesh along their common edges, if there are any."""
    half = HalfEdges.of(np.concatenate([patch, rest]))
    across = np.flatnonzero(half.twin[: 3 * len(patch)] >= 3 * len(patch))
    if not len(across):
        return None
    start, end, angles = half.origin[across], half.target[across], crossing_angles(half, vertices)[across]
    # faces that run through their edge in the same direction have their normals on different sides
    angles = np.where(start == half.origin[half.twin[across]], np.pi - angles, angles)
    return _rms(angles, np.linalg.norm(vertices[start] - vertices[end], axis=1))


def patch_figures(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], diameter: float, chart: Chart | None
) -> Record:
    """The figures of a triangle mesh, in units of the diameter where they are lengths."""
    curvature = discrete_mean_curvature(vertices, faces)
    figures: Record = {
        "triangles": len(faces),
        "mesh_area": float(face_areas(vertices, faces).sum()),
        "curvature_max": curvature.max * diameter,
        "curvature_rms": curvature.rms * diameter,
        "min_angle": float(smallest_angles(vertices, faces).min()),
        # of a triangle without area as of one that is flat
        "max_angle": float(np.degrees(np.nan_to_num(internal_angles(vertices, faces), nan=np.pi).max())),
        "nonmanifold_edges": int((HalfEdges.of(faces).counts > 2).sum()),
        "crossings": len(self_intersections(vertices, faces)) if len(faces) <= _MOST_CROSSING_FACES else None,
    }
    if chart is not None and len(faces) <= _MOST_CROSSING_FACES:
        distance = chart.hausdorff(vertices, faces, samples=_DISTANCE_SAMPLES)
        figures["distance_max"] = distance.max / diameter
        figures["distance_mean"] = distance.mean / diameter
    return figures


def _parts(filled: Filled, hole: Hole) -> tuple[Bool[np.ndarray, " f"], Bool[np.ndarray, " f"], Int[np.ndarray, " n"]]:
    """Which faces were there before, which are of the patches, and each vertex's number in the hole's mesh, or −1.

    By positions: some tools renumber, and some keep single precision only; by numbers where the tool keeps them. Sides
    of old triangles that a tool divided or moved are no part of the patches, nor are caps on other boundaries.
    """
    count, room = len(hole.vertices), _SAME * float(np.linalg.norm(np.ptp(hole.vertices, axis=0)))
    distance, nearest = cKDTree(hole.vertices).query(filled.vertices)
    vertex_of = np.where(np.asarray(distance) <= room, np.asarray(nearest), -1)
    first = filled.vertices[:count]
    if filled.in_order or (len(first) == count and bool((np.abs(first - hole.vertices) <= room).all())):
        # vertices of equal position are told apart where the order was kept
        vertex_of[:count] = np.arange(count)
    mapped = vertex_of[filled.faces]
    old = (mapped >= 0).all(axis=1) & np.isin(_face_keys(np.maximum(mapped, 0), count), _face_keys(hole.faces, count))
    elsewhere = np.setdiff1d(np.arange(count), hole.rim)
    new = np.flatnonzero(~old & ~np.isin(mapped, elsewhere).any(axis=1))
    # the inside of a cap has no old vertex: it is told by its piece, which meets no rim
    pieces = face_components(filled.faces[new])
    patch = np.zeros(len(filled.faces), dtype=bool)
    patch[new[np.isin(pieces, pieces[(mapped[new] >= 0).any(axis=1)])]] = True
    return old, patch, vertex_of


def _face_keys(faces: Int[np.ndarray, "f 3"], count: int) -> Int[np.ndarray, " f"]:
    """One number for each set of three vertices."""
    a, b, c = np.sort(faces, axis=1).astype(np.int64).T
    return np.asarray((a * count + b) * count + c)  # meshes have fewer than two million vertices here


def _rms(values: Float[np.ndarray, " k"], weights: Float[np.ndarray, " k"] | None = None) -> float:
    return float(np.sqrt(np.average(values**2, weights=weights)))


if __name__ == "__main__":
    serve(lambda task, tell: tell(run(task)))
