"""One mesh file of a batch: its loops, and the record and result files that follow from the patches of the loops."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Float

from spinor_geom.adapters.contents import FileContents
from spinor_geom.adapters.mesh_files import MeshFile, contents_of_bytes, encoded, known_suffix, mesh_of_contents
from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.batching.inputs import Source
from spinor_geom.batching.settings import BatchOptions
from spinor_geom.batching.store import STATUSES, Writer, failure
from spinor_geom.comparison import compare
from spinor_geom.errors import LoopTooShortError, OpenCurveError, SpinorGeomError
from spinor_geom.files import safe_name
from spinor_geom.fill.fill_loop import fill_loop, unfilled
from spinor_geom.fill.fill_options import FillOptions
from spinor_geom.fill.fill_result import FillResult, LoopOutcome
from spinor_geom.fill.filling import Filling
from spinor_geom.fill.merging import merged
from spinor_geom.fill.obj_curves import NamedLoop, curve_loops
from spinor_geom.fill.patched_mesh import LoopPatch, PatchedMesh
from spinor_geom.fill.solved_loops import SolvedLoop
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.triangle_mesh import TriangleMesh, require_faces
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.steps import Clock

OUTLINE_POINTS = 48  # of a loop in a record: enough for a thumbnail
LONGEST_LABEL = 60  # characters of a loop's name in the name of a file


class FileTask:
    """A mesh file of a batch, with its holes and curves.

    Attributes:
        source: where it was read from.
        filling: its holes, or None if it has no faces, or `problem` says why they cannot be filled.
        hole_names: the object and group of each hole, "" where there are none.
        curves: the curves of an OBJ file.
        problem: why its faces cannot be used, if its curves can.
        rims: the holes to solve, in order.
        curve_loops: the curves to solve, in order.
        result: the fill, after `results`, or None if no mesh was filled.
    """

    def __init__(self, data: bytes, source: Source, options: BatchOptions, fill_options: FillOptions) -> None:
        """Reads the file and finds its loops. Raises the SpinorGeomError of `fill_hole` if there is nothing to do."""
        self.source, self._options, self._fill_options, self._clock = source, options, fill_options, Clock()
        suffix = known_suffix(Path(source.member or source.path))
        if options.format not in (None, "npz"):
            known_suffix(Path(f"filled.{options.format}"))
        self._format = options.format or ("obj" if options.what == "loops" else suffix[1:])
        self._curve_contents = contents_of_bytes(data, suffix)
        self.curves = curve_loops(self._curve_contents, closing=options.closing)
        self.filling: Filling | None = None
        self.problem = ""
        try:
            place = None if source.member else Path(source.path)
            mesh = merged(mesh_of_contents(self._curve_contents, suffix, path=place), options.merge)
            mesh = mesh.as_stored(f".{self._format}") if options.what != "loops" else mesh
            self._clock.lap("read")
            if len(mesh.mesh.faces) or not self.curves:
                require_faces(mesh.mesh)
                self.filling = Filling(mesh.mesh, options, fill_options)
        except SpinorGeomError as error:
            if not self.curves:
                raise
            # the curves can be used without the mesh
            self.problem = str(error) if len(self._curve_contents.polygons) else ""
            self._curve_contents = FileContents.without_faces(self._curve_contents.vertices)
            mesh = MeshFile.of_contents(self._curve_contents, path=None)
        self._mesh = mesh
        self.hole_names = [] if self.filling is None else list(_hole_names(self.filling, mesh))
        self._clock.lap("loops")
        is_solved = options.what != "loops"
        self.rims = self.filling.rims if self.filling is not None and is_solved else []
        self.curve_loops = [curve.loop for curve in self.curves if curve.loop and not curve.error and is_solved]
        self.result: FillResult | None = None
        self._files: dict[str, Writer] = {}

    def results(
        self, rims: Iterator[SolvedLoop], curves: Iterator[SolvedLoop]
    ) -> tuple[dict[str, Any], dict[str, Writer]]:
        """The record as JSON values, and the functions that write each result file, by its name.

        `rims` and `curves` are the patches of `self.rims` and `self.curve_loops`. Raises as `fill_hole`.
        """
        record = failure(self.source.key, self.problem)
        entries: list[dict[str, Any]] = []
        if self.filling is not None and self._options.what == "loops":
            entries = [self._listed_hole(self.filling, index) for index in range(len(self.filling.loops))]
        elif self.filling is not None:
            outcomes, patches = self.filling.filled(rims)
            self._clock.lap("fill")
            self.result = result = self.filling.result(self._mesh, outcomes, patches, self._clock)
            patch_of = {patch.index: patch for patch in patches}
            entries = [self._hole(outcome, patch_of.get(outcome.index)) for outcome in outcomes]
            record |= result.to_dict()
            if self._options.what == "fill":
                record["filled"] = name = f"filled.{self._format}"
                record["notes"] += result.mesh.left_out(f".{self._format}")
                is_npz = self._format == "npz"
                self._files[name] = partial(_write, result.mesh.contents) if is_npz else result.mesh.write
        for index, curve in enumerate(self.curves, start=len(entries)):
            entries.append(self._curve(index, curve, curves))
            if entries[-1]["status"] == "open":
                record["notes"].append(f"curve {index}, beside the faces, is not filled: {curve.error}")
        statuses = [*(entry["status"] for entry in entries), *(["failed"] if self.problem else [])]
        status = max((status for status in statuses if status != "open"), key=STATUSES.index, default="done")
        return {**record, "status": status, "curves": len(self.curves), "loops": entries}, self._files

    def _hole(self, outcome: LoopOutcome, patch: LoopPatch | None) -> dict[str, Any]:
        return self._entry(outcome, self.hole_names[outcome.index], "hole", patch, self._mesh.contents)

    def _listed_hole(self, filling: Filling, index: int) -> dict[str, Any]:
        """The entry of a hole that is not solved. Its reason is why `fill` would leave it open."""
        loop = filling.loops[index]
        outcome = filling.left_open.get(index) or unfilled(index, loop, "")
        entry = self._hole(outcome, None)
        if not outcome.requested:
            entry["status"] = "open" if outcome.reason else "done"
            self._add_file(entry, "loop", self._format, partial(_write_loop, loop))
        return entry

    def _curve(self, index: int, curve: NamedLoop, solved: Iterator[SolvedLoop]) -> dict[str, Any]:
        """The entry of a curve, which is filled independently of the faces and of other curves."""
        if curve.loop is None or curve.error is not None:
            figures: dict[str, Any] = {"index": index, "vertices": len(curve.points), "kind": None}
            # exporters leave lines beside faces, which bound nothing
            is_stray = self.filling is not None and isinstance(curve.error, (OpenCurveError, LoopTooShortError))
            figures |= {"reason": str(curve.error), "requested": not is_stray, "filled": False, "converged": False}
            figures |= {"notes": list(curve.notes), "timings": {}}
            return self._with_figures(figures, curve.name, "curve", "open" if is_stray else "failed", curve.points)
        loop, contents = replace(curve.loop, remarks=curve.notes), self._curve_contents
        if self._options.what == "loops":
            entry = self._entry(unfilled(index, loop, ""), curve.name, "curve", None, contents)
            entry["status"], entry["notes"] = "done", list(curve.notes)
            self._add_file(entry, "loop", self._format, partial(_write_loop, loop))
            return entry
        points = TriangleMesh(
            contents.vertices, np.zeros((0, 3), dtype=np.int64), vertex_attributes=contents.attributes
        )
        alone = replace(self._fill_options, continuity="C0")
        outcome, patch = fill_loop(PatchedMesh(points), index, loop, next(solved), alone)
        outcome = replace(outcome, first_face=None)  # the filled mesh does not have its faces
        return self._entry(outcome, curve.name, "curve", patch, contents)

    def _with_figures(
        self, figures: dict[str, Any], name: str, origin: str, status: str, points: Float[np.ndarray, "k 3"]
    ) -> dict[str, Any]:
        """A loop's entry in a record: the figures of `LoopOutcome.to_dict`, and those that batches add."""
        outline = points[np.linspace(0, len(points) - 1, min(len(points), OUTLINE_POINTS)).astype(int)]
        return {
            "source": self.source.key,
            "name": name,
            "origin": origin,
            "status": status,
            **figures,
            "comparison": None,
            "files": {},
            "outline": [[float(f"{x:.6g}") for x in p] for p in outline.tolist()],  # for the summary
        }

    def _entry(
        self, outcome: LoopOutcome, name: str, origin: str, patch: LoopPatch | None, contents: FileContents
    ) -> dict[str, Any]:
        """The entry of a loop, whose files are added. The loop's vertices are those of the contents."""
        loop, solution = outcome.loop, outcome.solution
        figures = outcome.to_dict() | {
            "elongation": loop.elongation,
            "corners": int(loop.corners.sum()),
            "route": None if solution is None else solution.route,
        }
        status, closed = _status(outcome, strict=self._options.strict), np.vstack([loop.points, loop.points[:1]])
        entry = self._with_figures(figures, name, origin, status, closed)
        if patch is None:
            return entry
        self._add_file(entry, "patch", self._format, partial(_write, _patch_contents(contents, patch)))
        if solution is None:
            return entry
        if self._options.what == "surface":
            self._add_file(entry, "surface", "safetensors", solution.array_surface.save)
        if self._options.compare and outcome.kind == "minimal":
            entry["comparison"], entry["timings"]["comparison"] = self._comparison(solution, patch)
        return entry

    def _comparison(self, solution: PlateauSolution, patch: LoopPatch) -> tuple[dict[str, Any], float]:
        start = perf_counter()
        try:
            figures = compare(solution, target_edge_length=self._options.edge_length, patch=patch.patch).to_dict()
        except SpinorGeomError as error:
            figures = {"reason": str(error)}
        kept = {name: value for name, value in figures.items() if not name.endswith("_seconds")}
        return kept, perf_counter() - start

    def _add_file(self, entry: dict[str, Any], what: str, suffix: str, write: Writer) -> None:
        label = f"-{safe_name([entry['name'][:LONGEST_LABEL]])}" if entry["name"] else ""
        entry["files"][what] = name = f"loop-{entry['index']}{label}.{suffix}"
        self._files[name] = write


def _hole_names(filling: Filling, mesh: MeshFile) -> Iterator[str]:
    """The most frequent name of the faces at each hole, or "" without names, or if merging removed faces."""
    names, of_polygons = mesh.contents.names, mesh.contents.polygon_names
    for loop in filling.loops:
        if of_polygons is None or len(names) < 2 or len(of_polygons) != len(mesh.polygons):
            yield ""
            continue
        faces = filling.patched.faces_at(loop.vertex_ids)
        beside = faces[np.isin(mesh.mesh.faces[faces], loop.vertex_ids).sum(axis=1) > 1]
        yield names[int(np.bincount(of_polygons[mesh.face_polygons[beside]]).argmax())]


def _status(outcome: LoopOutcome, *, strict: bool) -> str:
    """The status of a loop, one of `STATUSES`, by its outcome."""
    if not outcome.requested:
        return "open"
    if not outcome.filled:
        return "failed"
    return "done" if outcome.intersection_free and (outcome.converged or not strict) else "imperfect"


def _patch_contents(whole: FileContents, patch: LoopPatch) -> FileContents:
    return FileContents(
        vertices=patch.patch.vertices,
        polygons=Polygons.of_triangles(np.asarray(patch.patch.faces)),
        attributes={
            name: np.concatenate([np.asarray(whole.attributes[name])[patch.rim], values])
            for name, values in patch.attributes.items()
        },
        labels=whole.labels,
        color_scale=whole.color_scale,
        representatives=np.arange(len(patch.patch.vertices)),
        unit=whole.unit,
        is_text_stl=whole.is_text_stl,
    )


def _write_loop(loop: BoundaryLoop, path: Path) -> None:
    if path.suffix == ".npz":
        np.savez(path, points=loop.points, vertex_ids=loop.vertex_ids, corners=loop.corners)
    else:
        _write(FileContents.without_faces(loop.points, np.append(np.arange(len(loop)), 0)), path)


def _write(contents: FileContents, path: Path) -> None:
    if path.suffix == ".npz":
        triangles, _ = contents.polygons.triangulated(contents.vertices)
        np.savez(path, vertices=contents.vertices, faces=contents.representatives[triangles])
    else:
        path.write_bytes(encoded(contents, path.suffix))
