"""One mesh file: its loops, what is to be solved of it, and its results from the answers. Writes nothing by itself."""

import shutil
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, BinaryIO, TypeAlias, cast

import numpy as np
from jaxtyping import Float

from spinor_geom.adapters.contents import FileContents, malformed
from spinor_geom.adapters.mesh_files import (
    FORMATS,
    MeshFile,
    known_suffix,
    mesh_of_bytes,
    require_bytes,
    require_elements,
)
from spinor_geom.adapters.obj import ObjText, added_lines, read_obj_stream
from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.batching.inputs import Source
from spinor_geom.batching.loops import NamedLoop, curve_loops
from spinor_geom.batching.options import BatchOptions
from spinor_geom.batching.store import STATUSES, failure
from spinor_geom.comparison import compare
from spinor_geom.errors import SpinorGeomError
from spinor_geom.files import safe_name
from spinor_geom.fill.exact_patches import SolvedLoop
from spinor_geom.fill.fill_loop import Stopwatch, fill_loop, unfilled
from spinor_geom.fill.fill_options import FillOptions
from spinor_geom.fill.fill_result import FillResult, LoopOutcome
from spinor_geom.fill.filling import Filling
from spinor_geom.fill.merging import merged
from spinor_geom.fill.patched_mesh import LoopPatch, PatchedMesh
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, require_faces
from spinor_geom.plateau.solution import PlateauSolution

Writer: TypeAlias = Callable[[Path], object]

OUTLINE_POINTS = 48  # points of an outline in a record: enough for a thumbnail
LONGEST_LABEL = 60
COPIED_AT_ONCE = 1 << 20


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenedFile:
    """A mesh file that was read, with what is to be solved."""

    source: Source
    suffix: str  # of its format
    stream: BinaryIO  # its bytes, to be copied
    checksum: int  # of them as they were read, for an OBJ file
    text: ObjText | None  # of an OBJ file
    mesh: MeshFile  # of its faces, or a mesh without faces for its curves
    filling: Filling | None  # of its holes; None without faces, or where they could not be looked for
    names: tuple[str, ...]  # of its holes
    curves: tuple[NamedLoop, ...]
    problem: str  # why its holes could not be looked for, if so
    clock: Stopwatch
    options: BatchOptions
    fill_options: FillOptions

    @property
    def rims(self) -> list[BoundaryLoop]:
        """The rims of its holes that are to be solved, in order."""
        return [] if self.filling is None or self.options.what == "loops" else self.filling.rims

    @property
    def curve_loops(self) -> list[BoundaryLoop]:
        """Its curves that are to be solved, in order."""
        if self.options.what == "loops":
            return []
        return [curve.loop for curve in self.curves if curve.loop is not None and curve.error is None]

    @property
    def label(self) -> str:
        """The suffix of the files that are written, without its point."""
        if self.options.format is None and self.options.what == "loops":
            return "obj"
        return self.options.format or self.suffix[1:]


class _Checked:
    """A stream that is read once, and the checksum of what was read."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream, self.sum = stream, 0

    def read(self, size: int = -1, /) -> bytes:
        data = self._stream.read(size)
        self.sum = zlib.crc32(data, self.sum)
        return data


def open_file(stream: BinaryIO, source: Source, options: BatchOptions, fill_options: FillOptions) -> OpenedFile:
    """Reads a file and finds its loops; the SpinorGeomError of `fill_hole` where there is nothing to fill."""
    clock = Stopwatch()
    suffix = known_suffix(Path(source.member or source.path))
    if options.format not in (None, "npz"):
        known_suffix(Path(f"filled.{options.format}"))
    text, curves, checked, problem = None, list[NamedLoop](), _Checked(stream), ""
    if suffix == ".obj":
        require_bytes(stream.read(1))
        stream.seek(0)
        text = read_obj_stream(cast(BinaryIO, checked))
        require_elements(text.contents)
        curves = curve_loops(text, closing=options.closing)
    filling: Filling | None = None
    try:
        if text is None:
            mesh = mesh_of_bytes(stream.read(), suffix)
        else:
            mesh = MeshFile.of_contents(replace(text.contents, suffix=suffix), path=None)
        mesh = merged(mesh, options.merge)
        clock.lap("read")
        if len(mesh.mesh.faces) or not curves:
            require_faces(mesh.mesh)
            filling = Filling(mesh.mesh, options.choice, fill_options)
    except SpinorGeomError as error:
        if text is None or not curves:
            raise
        # curves need no more than their own points
        problem = str(error) if len(text.contents.polygons) else ""
        usable = np.isfinite(text.contents.vertices).all(axis=1)
        bare = FileContents.without_faces(np.where(usable[:, None], text.contents.vertices, 0.0))
        mesh = MeshFile.of_contents(bare, path=None)
    names = () if filling is None else tuple(_names(filling, mesh, text))
    clock.lap("loops")
    return OpenedFile(
        source=source,
        suffix=suffix,
        stream=stream,
        checksum=checked.sum,
        text=text,
        mesh=mesh,
        filling=filling,
        names=names,
        curves=tuple(curves),
        problem=problem,
        clock=clock,
        options=options,
        fill_options=fill_options,
    )


def _names(filling: Filling, mesh: MeshFile, text: ObjText | None) -> Iterator[str]:
    """The names of holes: each has that of most of the faces beside it; none where merging left faces out."""
    has_names = text is not None and len(text.names) > 1 and len(text.face_names) == len(mesh.polygons)
    for loop in filling.loops:
        if text is None or not has_names:
            yield ""
            continue
        faces = filling.patched.faces_at(loop.vertex_ids)
        beside = faces[np.isin(mesh.mesh.faces[faces], loop.vertex_ids).sum(axis=1) > 1]
        yield text.names[int(np.bincount(text.face_names[mesh.face_polygons[beside]]).argmax())]


def results_of(
    opened: OpenedFile, rims: Iterator[SolvedLoop], curves: Iterator[SolvedLoop]
) -> tuple[dict[str, Any], dict[str, Writer]]:
    """The record of a file, JSON-ready, and what writes each of its files, by name.

    The answers are those of the file's `rims` and `curve_loops`, in order. Raises as `fill_hole`.
    """
    files: dict[str, Writer] = {}
    record = failure(opened.source.key, opened.problem)
    entries: list[dict[str, Any]] = []
    if opened.filling is not None and opened.options.what == "loops":
        entries = [_listed(opened, place, loop, files) for place, loop in enumerate(opened.filling.loops)]
    elif opened.filling is not None:
        outcomes, patches = opened.filling.filled(rims)
        opened.clock.lap("fill")
        result = opened.filling.result(opened.mesh, outcomes, patches, opened.clock)
        of_place = {patch.place: patch for patch in patches}
        entries = [
            _entry(opened, outcome, opened.names[outcome.index], "hole", of_place.get(outcome.index), files)
            for outcome in outcomes
        ]
        record |= result.to_dict()
        if opened.options.what == "fill":
            record["filled"] = name = f"filled.{opened.label}"
            files[name] = _filled(opened, result)
            record["notes"] += result.mesh.left_out(f".{opened.label}")
    entries += [
        _curve_entry(opened, place, curve, curves, files)
        for place, curve in enumerate(opened.curves, start=len(entries))
    ]
    statuses = [*(entry["status"] for entry in entries), *(["failed"] if opened.problem else [])]
    status = max((status for status in statuses if status != "open"), key=STATUSES.index, default="done")
    return {**record, "status": status, "curves": len(opened.curves), "loops": entries}, files


def _listed(opened: OpenedFile, place: int, loop: BoundaryLoop, files: dict[str, Writer]) -> dict[str, Any]:
    """A hole that is listed alone, with the reason why it would not be filled, if so."""
    assert opened.filling is not None
    outcome = opened.filling.left_open.get(place) or unfilled(place, loop, "")
    entry = _entry(opened, outcome, opened.names[place], "hole", None, files)
    if not outcome.requested:
        entry["status"] = "open" if outcome.reason else "done"
        _add_loop(opened, entry, loop, files)
    return entry


def _curve_entry(
    opened: OpenedFile, place: int, curve: NamedLoop, answers: Iterator[SolvedLoop], files: dict[str, Writer]
) -> dict[str, Any]:
    """A curve that was listed, solved, or refused; curves have nothing to do with the faces, nor with each other."""
    if curve.loop is None or curve.error is not None:
        figures: dict[str, Any] = {
            "index": place,
            "vertices": len(curve.points),
            "kind": None,
            "reason": str(curve.error),
        }
        figures |= {"requested": True, "filled": False, "converged": False, "notes": list(curve.notes), "timings": {}}
        return _described(opened, figures, curve.name, "curve", "failed", curve.points)
    loop = replace(curve.loop, remarks=curve.notes)
    if opened.options.what == "loops":
        entry = _entry(opened, unfilled(place, loop, ""), curve.name, "curve", None, files)
        entry["status"], entry["notes"] = "done", list(curve.notes)
        _add_loop(opened, entry, loop, files)
        return entry
    points = opened.mesh.mesh
    mesh = TriangleMesh(points.vertices, np.zeros((0, 3), dtype=np.int64), vertex_attributes=points.vertex_attributes)
    alone = replace(opened.fill_options, continuity="C0")
    outcome, piece = fill_loop(PatchedMesh(mesh), place, loop, next(answers), alone)
    outcome = replace(outcome, first_face=None)  # its faces are in no filled mesh
    return _entry(opened, outcome, curve.name, "curve", piece, files)


def _described(
    opened: OpenedFile,
    figures: dict[str, Any],
    name: str,
    origin: str,
    status: str,
    points: Float[np.ndarray, "k 3"],
) -> dict[str, Any]:
    """A loop's entry in a record: what `LoopOutcome.to_dict` says, and what batches add."""
    shown = points[np.linspace(0, len(points) - 1, min(len(points), OUTLINE_POINTS)).astype(int)].tolist()
    return {
        "source": opened.source.key,
        "name": name,
        "origin": origin,
        "status": status,
        **figures,
        "comparison": None,
        "files": {},
        # what cannot be seen in a file of results is drawn from here
        "outline": [[float(f"{x:.6g}") for x in point] for point in shown] if status == "failed" else None,
    }


def _entry(
    opened: OpenedFile, outcome: LoopOutcome, name: str, origin: str, piece: LoopPatch | None, files: dict[str, Writer]
) -> dict[str, Any]:
    """The entry of a loop; what is written of it joins the files."""
    loop, solution = outcome.loop, outcome.solution
    figures = outcome.to_dict() | {
        "elongation": loop.elongation,
        "corners": int(loop.corners.sum()),
        "route": None if solution is None else solution.route,
    }
    status = _status(outcome, strict=opened.options.strict)
    entry = _described(opened, figures, name, origin, status, loop.points)
    if piece is None:
        return entry
    _add_file(opened, entry, "patch", opened.label, partial(_write_mesh, _patch_contents(opened, piece)), files)
    if solution is None:
        return entry
    if opened.options.what == "surface":
        _add_file(opened, entry, "surface", "safetensors", solution.surface.save, files)
    if opened.options.compare and outcome.kind == "minimal":
        entry["comparison"], entry["timings"]["comparison"] = _comparison(opened, solution, piece)
    return entry


def _status(outcome: LoopOutcome, *, strict: bool) -> str:
    """What of a loop counts for the exit status of `spinor-geom fill`."""
    if not outcome.requested:
        return "open"
    if not outcome.filled:
        return "failed"
    return "imperfect" if outcome.intersections or (strict and not outcome.converged) else "done"


def _comparison(opened: OpenedFile, solution: PlateauSolution, piece: LoopPatch) -> tuple[dict[str, Any], float]:
    start = perf_counter()
    try:
        figures = compare(solution, target_edge_length=opened.options.edge_length, patch=piece.patch).to_dict()
    except SpinorGeomError as error:
        figures = {"reason": str(error)}
    kept = {name: value for name, value in figures.items() if not name.endswith("_seconds")}
    return kept, perf_counter() - start


def _add_loop(opened: OpenedFile, entry: dict[str, Any], loop: BoundaryLoop, files: dict[str, Writer]) -> None:
    _add_file(opened, entry, "loop", opened.label, partial(_write_loop, loop), files)


def _add_file(
    opened: OpenedFile, entry: dict[str, Any], what: str, suffix: str, write: Writer, files: dict[str, Writer]
) -> None:
    """A file of a loop, under a harmless name."""
    label = f"-{safe_name([entry['name'][:LONGEST_LABEL]])}" if entry["name"] else ""
    entry["files"][what] = name = f"loop-{entry['index']}{label}.{suffix}"
    files[name] = write


def _patch_contents(opened: OpenedFile, piece: LoopPatch) -> FileContents:
    rim, whole = opened.mesh.mesh.vertex_attributes, opened.mesh.contents
    return FileContents(
        vertices=piece.patch.vertices,
        polygons=Polygons.of_triangles(np.asarray(piece.patch.faces)),
        attributes={
            name: np.concatenate([np.asarray(rim[name])[piece.rim], values])
            for name, values in piece.attributes.items()
        },
        labels=whole.labels,
        color_scale=whole.color_scale,
        representatives=np.arange(len(piece.patch.vertices)),
        unit=whole.unit,
        is_text_stl=whole.is_text_stl,
    )


def _filled(opened: OpenedFile, result: FillResult) -> Writer:
    """Writes the filled mesh as `fill` does; an OBJ file is copied, not held in memory."""
    filled = cast(MeshFile, result.mesh)
    if opened.label == "npz":
        return partial(_write_mesh, filled.contents)
    if opened.text is not None and f".{opened.label}" == filled.contents.suffix:
        return partial(_append, opened, result.extension)
    return filled.write


def _append(opened: OpenedFile, extension: MeshExtension, path: Path) -> None:
    assert opened.text is not None
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
    path.write_bytes(FORMATS[path.suffix].encode(contents))
