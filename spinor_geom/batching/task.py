"""One OBJ file: its loops, what is to be solved of it, and its results from the answers. Writes nothing by itself."""

import shutil
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, BinaryIO, TypeAlias, cast

import numpy as np

from spinor_geom.adapters.contents import FileContents, malformed
from spinor_geom.adapters.mesh_files import FORMATS, MeshFile
from spinor_geom.adapters.obj import ObjText, added_lines, read_obj_stream
from spinor_geom.adapters.polygons import Polygons
from spinor_geom.batching.loops import NamedLoop, curve_loops, refuse_what_bounds_no_disk
from spinor_geom.batching.options import BatchOptions
from spinor_geom.batching.store import STATUSES, failure
from spinor_geom.comparison import compare
from spinor_geom.errors import SpinorGeomError
from spinor_geom.files import safe_name
from spinor_geom.fill.discrete_patch import refuse_seams, refuse_what_is_no_hole
from spinor_geom.fill.many_loops import fill_loops
from spinor_geom.fill.one_loop import Answer, FillOptions, unfilled
from spinor_geom.fill.result import LoopOutcome
from spinor_geom.fill.surroundings import LoopPatch, Surroundings, stitch
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.loops import find_boundary_loops
from spinor_geom.mesh.topology import is_watertight
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.version import program_version

Writer: TypeAlias = Callable[[Path], None]

OUTLINE_POINTS = 48  # points of an outline in a record: enough for a thumbnail
FIGURES = ("residual_rms_per_edge", "residual_max_per_edge", "area", "stability", "continuation")
CROSSINGS = ("self_intersections", "mesh_intersections", "patch_intersections")
LONGEST_LABEL = 60
COPIED_AT_ONCE = 1 << 20
LARGEST_COORDINATE = 1e70  # fourth powers of lengths have to be numbers


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenedFile:
    """An OBJ file that was read, with what is to be solved."""

    key: str
    stream: BinaryIO  # its bytes, to be copied
    checksum: int  # of them, as they were read
    text: ObjText
    mesh: MeshFile  # of its faces, or a mesh without faces for its curves
    surroundings: Surroundings
    loops: tuple[NamedLoop, ...]  # holes, then curves
    problem: str  # why its holes could not be looked for, if so
    seconds: float
    options: BatchOptions

    @property
    def holes(self) -> tuple[NamedLoop, ...]:
        """The loops that are holes of the mesh."""
        return tuple(loop for loop in self.loops if loop.kind == "hole")


class _Checked:
    """A stream that is read once, and the checksum of what was read."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream, self.sum = stream, 0

    def read(self, size: int = -1, /) -> bytes:
        data = self._stream.read(size)
        self.sum = zlib.crc32(data, self.sum)
        return data


def open_file(stream: BinaryIO, key: str, options: BatchOptions) -> OpenedFile:
    """Reads a file and finds its loops; SpinorGeomError where it is no OBJ file, or malformed."""
    start = perf_counter()
    checked = _Checked(stream)
    text = read_obj_stream(cast(BinaryIO, checked))
    if not len(text.contents.polygons) and not text.contents.polylines:
        raise malformed("", "has vertices but no faces and no curves", "give a file with a surface or a curve in it")
    largest = float(np.abs(text.contents.vertices[np.isfinite(text.contents.vertices)]).max(initial=0.0))
    if largest > LARGEST_COORDINATE:
        raise malformed("", f"has a coordinate of size {largest:.1e}, whose powers are no numbers", "scale the file")
    mesh, rims, problem = _mesh_and_rims(text)
    surroundings = Surroundings(mesh.mesh, rims)
    holes = [_hole(rim, text, mesh, surroundings) for rim in rims]
    return OpenedFile(
        key=key,
        stream=stream,
        checksum=checked.sum,
        text=text,
        mesh=mesh,
        surroundings=surroundings,
        loops=(*holes, *curve_loops(text, closing=options.closing)),
        problem=problem,
        seconds=perf_counter() - start,
        options=options,
    )


def _mesh_and_rims(text: ObjText) -> tuple[MeshFile, list[BoundaryLoop], str]:
    try:
        mesh = MeshFile.of_contents(text.contents, path=None)
        return mesh, find_boundary_loops(mesh.mesh), ""
    except SpinorGeomError as error:
        usable = np.isfinite(text.contents.vertices).all(axis=1)  # curves need no more than their own points
        bare = FileContents.without_faces(np.where(usable[:, None], text.contents.vertices, 0.0))
        problem = str(error) if len(text.contents.polygons) else ""
        return MeshFile.of_contents(bare, path=None), [], problem


def _hole(loop: BoundaryLoop, text: ObjText, mesh: MeshFile, surroundings: Surroundings) -> NamedLoop:
    """A hole, which has the name that most of the faces beside it have."""
    name, error = "", None
    if len(text.names) > 1:
        faces = surroundings.faces_at(loop.vertex_ids)
        beside = faces[np.isin(mesh.mesh.faces[faces], loop.vertex_ids).sum(axis=1) > 1]
        name = text.names[int(np.bincount(text.face_names[mesh.face_polygons[beside]]).argmax())]
    try:
        refuse_what_is_no_hole(loop, surroundings)
        refuse_seams(loop)
        refuse_what_bounds_no_disk(loop)
    except SpinorGeomError as refusal:
        error = refusal
    return NamedLoop(kind="hole", name=name, points=loop.points, loop=loop, error=error)


def wanted(opened: OpenedFile) -> list[NamedLoop]:
    """The loops of a file over which surfaces are to be found, in order."""
    if opened.options.what == "loops":
        return []
    return [loop for loop in opened.loops if loop.loop is not None and loop.error is None]


def fill_options(options: BatchOptions) -> FillOptions:
    """What each loop is filled with."""
    return FillOptions(
        target_edge_length=options.edge_length, model="auto", tolerance=options.tolerance, continuity=options.continuity
    )


def results_of(opened: OpenedFile, answers: Iterator[Answer]) -> tuple[dict[str, Any], dict[str, Writer]]:
    """The record of a file, JSON-ready, and what writes each of its files, by name.

    The answers are the exact patch of each loop that is `wanted`, in order, or why it has none.
    """
    start = perf_counter()
    files: dict[str, Writer] = {}
    filled: dict[str, Any] | None = None
    if opened.options.what == "loops":
        entries = [_listed(opened, place, files) for place in range(len(opened.loops))]
    else:
        entries, extension = _solved(opened, answers, files)
        if opened.options.what == "fill" and opened.holes:
            filled = _filled(opened, extension, files)
    statuses = [*(entry["status"] for entry in entries), *(["failed"] if opened.problem else [])]
    status = max(statuses, key=STATUSES.index, default="done")
    record = failure(opened.key, opened.problem, status=status) | {
        "vertices": len(opened.text.contents.vertices),
        "faces": len(opened.text.contents.polygons),
        "curves": len(opened.text.contents.polylines),
        "filled": filled,
        "loops": entries,
        "seconds": {"read": opened.seconds, "results": perf_counter() - start},
    }
    return record, files


def _solved(
    opened: OpenedFile, answers: Iterator[Answer], files: dict[str, Writer]
) -> tuple[list[dict[str, Any]], MeshExtension]:
    """An entry for every loop; what is written of them joins the files."""
    mesh, holes = opened.mesh.mesh, opened.holes
    options = fill_options(opened.options)
    rims = [hole.loop for hole in holes if hole.loop is not None]
    left_open = {
        place: unfilled(place, rims[place], hole.error) for place, hole in enumerate(holes) if hole.error is not None
    }
    outcomes, patches = fill_loops(opened.surroundings, rims, answers, options, left_open=left_open)
    of_place = {patch.place: patch for patch in patches}
    entries = [
        _solved_entry(opened, place, outcome, of_place.get(place), files) for place, outcome in enumerate(outcomes)
    ]
    extension = stitch(mesh, patches)
    if len(holes) < len(opened.loops):
        # curves have nothing to do with the faces, nor with each other
        mesh = TriangleMesh(mesh.vertices, np.zeros((0, 3), dtype=np.int64), vertex_attributes=mesh.vertex_attributes)
    for place, curve in enumerate(opened.loops[len(holes) :], start=len(holes)):
        if curve.loop is None or curve.error is not None:
            entries.append(_entry(opened, place, "failed", str(curve.error)))
            continue
        alone = replace(options, continuity="C0")
        (outcome,), own = fill_loops(Surroundings(mesh), [curve.loop], answers, alone)
        entries.append(_solved_entry(opened, place, outcome, own[0] if own else None, files))
    return entries, extension


def _entry(opened: OpenedFile, place: int, status: str, reason: str) -> dict[str, Any]:
    """What is known of a loop before it is solved."""
    loop = opened.loops[place]
    count = len(loop.points)
    shown = loop.points[np.linspace(0, count - 1, min(count, OUTLINE_POINTS)).astype(int)].tolist()
    return {
        "source": opened.key,
        "loop": place,
        "name": loop.name,
        "kind": loop.kind,
        "status": status,
        "reason": reason,
        "notes": list(loop.notes),
        "vertices": count,
        "perimeter": None if loop.loop is None else loop.loop.perimeter,
        "elongation": None if loop.loop is None else loop.loop.elongation,
        "corners": None if loop.loop is None else int(loop.loop.corners.sum()),
        **dict.fromkeys((*FIGURES, "route", "patch_vertices", "patch_faces", *CROSSINGS, "comparison")),
        "files": {},
        # what cannot be seen in a file of results is drawn from here
        "outline": [[float(f"{x:.6g}") for x in point] for point in shown] if status == "failed" else None,
        "version": program_version(),
        "seconds": {},
    }


def _listed(opened: OpenedFile, place: int, files: dict[str, Writer]) -> dict[str, Any]:
    loop = opened.loops[place]
    entry = _entry(opened, place, "done" if loop.error is None else "failed", str(loop.error or ""))
    if loop.loop is not None and loop.error is None:
        name = _file_name(opened, place, opened.options.format)
        files[name] = partial(_write_loop, loop.loop)
        entry["files"]["loop"] = name
    return entry


def _solved_entry(
    opened: OpenedFile, place: int, outcome: LoopOutcome, piece: LoopPatch | None, files: dict[str, Writer]
) -> dict[str, Any]:
    good = outcome.converged and not outcome.intersections
    status = "failed" if not outcome.filled else "done" if good else "imperfect"
    entry = _entry(opened, place, status, outcome.reason or "; ".join(outcome.notes))
    entry["notes"] += outcome.notes
    solution, figures = outcome.solution, outcome.to_dict()
    # "solve" is the time until the surface was there, which may have been solved with others before
    entry["seconds"] = {name: time for name, time in figures["timings"].items() if name not in ("solve", "total")}
    entry |= {key: figures[key] for key in FIGURES} | {"route": None if solution is None else solution.route}
    if piece is None:
        return entry
    entry |= {
        "patch_vertices": len(piece.patch.vertices),
        "patch_faces": len(piece.patch.faces),
        **{key: figures[key] for key in CROSSINGS},
    }
    entry["files"]["patch"] = name = _file_name(opened, place, opened.options.format)
    files[name] = partial(_write_mesh, _patch_contents(opened, piece))
    if solution is None:
        return entry
    if opened.options.what == "surface":
        entry["files"]["surface"] = name = _file_name(opened, place, "safetensors")
        files[name] = solution.surface.save
    if opened.options.compare and outcome.kind == "minimal":
        entry["comparison"], entry["seconds"]["comparison"] = _comparison(opened, solution, piece)
    return entry


def _comparison(opened: OpenedFile, solution: PlateauSolution, piece: LoopPatch) -> tuple[dict[str, Any], float]:
    start = perf_counter()
    try:
        figures = compare(solution, target_edge_length=opened.options.edge_length, patch=piece.patch).to_dict()
    except SpinorGeomError as error:
        figures = {"reason": str(error)}
    kept = {name: value for name, value in figures.items() if not name.endswith("_seconds")}
    return kept, perf_counter() - start


def _file_name(opened: OpenedFile, place: int, suffix: str) -> str:
    label = safe_name([opened.loops[place].name[:LONGEST_LABEL]]) if opened.loops[place].name else ""
    return f"loop-{place}{'-' if label else ''}{label}.{suffix}"


def _patch_contents(opened: OpenedFile, piece: LoopPatch) -> FileContents:
    rim = opened.mesh.mesh.vertex_attributes
    return FileContents(
        vertices=piece.patch.vertices,
        polygons=Polygons.of_triangles(np.asarray(piece.patch.faces)),
        attributes={
            name: np.concatenate([np.asarray(rim[name])[piece.rim], values])
            for name, values in piece.attributes.items()
        },
        color_scale=opened.text.contents.color_scale,
        representatives=np.arange(len(piece.patch.vertices)),
    )


def _filled(opened: OpenedFile, extension: MeshExtension, files: dict[str, Writer]) -> dict[str, Any]:
    """The mesh with its patches: the file's own bytes and what is new where it stays an OBJ file."""
    name = f"filled.{opened.options.format}"
    if opened.options.format == "obj":
        files[name] = partial(_append, opened, extension)
    else:
        files[name] = partial(_write_mesh, opened.mesh.extended(extension).contents)
    return {
        "file": name,
        "watertight": is_watertight(np.concatenate([opened.mesh.mesh.faces, extension.faces])),
        "vertices_added": len(extension.vertices),
        "faces_added": len(extension.faces),
    }


def _append(opened: OpenedFile, extension: MeshExtension, path: Path) -> None:
    opened.stream.seek(0)
    checked = _Checked(opened.stream)
    with path.open("wb") as file:
        shutil.copyfileobj(checked, file, COPIED_AT_ONCE)
        if checked.sum != opened.checksum:
            raise malformed("", "the file changed while it was read", "resume the batch when it is complete")
        file.write(added_lines(opened.text, extension))


def _write_loop(loop: BoundaryLoop, path: Path) -> None:
    if path.suffix == ".npz":
        np.savez(path, points=loop.points, vertex_ids=loop.vertex_ids, corners=loop.corners)
        return
    _write_mesh(FileContents.without_faces(loop.points, np.append(np.arange(len(loop)), 0)), path)


def _write_mesh(contents: FileContents, path: Path) -> None:
    if path.suffix == ".npz":
        triangles, _ = contents.polygons.triangulated(contents.vertices)
        np.savez(path, vertices=contents.vertices, faces=contents.representatives[triangles])
        return
    path.write_bytes(FORMATS[path.suffix][1](contents))
