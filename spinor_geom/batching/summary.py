"""What a batch leaves of all files together: tables, a log in the order of the inputs, and a page without scripts."""

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from html import escape
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.mesh_files import read_mesh
from spinor_geom.batching.inputs import Source
from spinor_geom.batching.options import BatchOptions
from spinor_geom.batching.store import Store, failure, log_line, said, summary
from spinor_geom.errors import SpinorGeomError
from spinor_geom.files import atomic_path, write_text
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.operators import face_normals
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.render.page import document, table
from spinor_geom.version import program_version

FIRST, WORST, FAILED, REASONS = 12, 12, 48, 40  # how many of each are shown; all of them are in the table
SIZE = 160
MARGIN = 8
MOST_FACES = 3000  # more triangles than a small picture can show: the outline alone is drawn
TILT = np.radians(35.0)  # against the plane of the points, so that the shape shows
DARK, LIGHT = np.array([28, 78, 128]), np.array([196, 222, 245])
STYLE = """.loops { display: flex; flex-wrap: wrap; gap: 1rem }
.loops figure { margin: 0; width: 170px; font-size: 12px; overflow-wrap: anywhere }
svg { border: 1px solid var(--faint); background: #fff }"""
NO_RESULTS = "has no results: they could not be written, or were removed; resume the batch"
ROWS_AT_ONCE = 10_000
# Of the columns, in order.
_TYPES = (
    ("string", "source"),
    ("int64", "loop"),
    ("string", "name origin kind status reason notes"),
    ("int64", "vertices"),
    ("double", "perimeter elongation"),
    ("int64", "corners"),
    ("double", "residual_rms_per_edge residual_max_per_edge area"),
    ("string", "stability"),
    ("int64", "stability_index"),
    ("string", "route"),
    ("int64", "vertices_added faces_added self_intersections mesh_intersections patch_intersections"),
    ("double", "hausdorff_max hausdorff_mean"),
    ("string", "patch surface curve filled"),
    ("double", "seconds"),
    ("string", "version"),
)
COLUMNS = {name: kind for kind, names in _TYPES for name in names.split()}
TABLE, TABLE_CSV, PAGE = "loops.parquet", "loops.csv", "summary.html"


class PageParts:
    """What the page shows, gathered record by record: it does not grow with their number."""

    def __init__(self) -> None:
        self.files: Counter[str] = Counter()
        self.loops: Counter[str] = Counter()
        self.reasons: Counter[str] = Counter()
        self.first: list[dict[str, Any]] = []
        self.failed: list[dict[str, Any]] = []
        # farthest from their curves, the farthest first, earlier ones first where they are equally far
        self.worst: list[dict[str, Any]] = []

    def add(self, record: dict[str, Any]) -> None:
        """Takes a file's record."""
        self.files[record["status"]] += 1
        if record["reason"]:
            self._fail({**record, "index": None, "name": "", "outline": None})
        for loop in record["loops"]:
            self.loops[loop["status"]] += 1
            if loop["status"] == "failed":
                self._fail(loop)
            elif len(self.first) < FIRST:
                self.first.append(loop)
            if loop.get("residual_rms_per_edge") is not None and loop["files"]:
                self.worst = sorted([*self.worst, loop], key=lambda one: -one["residual_rms_per_edge"])[:WORST]

    def _fail(self, entry: dict[str, Any]) -> None:
        # reasons differ in their numbers; a few of each length are enough
        kind = re.sub(r"\d\d?", "#", said(entry))[:200]
        if len(self.reasons) < REASONS or kind in self.reasons:
            self.reasons[kind] += 1
        if len(self.failed) < FAILED:
            self.failed.append(entry)


def write_page(parts: PageParts, store: Store, settings: dict[str, Any], path: Path) -> None:
    """Writes the page; the settings of the run are shown as they are."""
    shown = [
        ("The first of them", parts.failed),
        ("Farthest from their curves", parts.worst),
        ("The first loops", parts.first),
    ]
    body = [
        "<h1>spinor-geom batch</h1>",
        "<p>All loops: <a href=loops.csv>loops.csv</a>, <a href=loops.parquet>loops.parquet</a>.</p>",
        "<h2>Files</h2>" + _table(parts.files.items(), ("status", "files")),
        "<h2>Loops</h2>" + _table(parts.loops.items(), ("status", "loops")),
        "<h2>Options</h2>" + _table(settings.items(), ("option", "value")),
        *(["<h2>Failures</h2>" + _table(parts.reasons.most_common(), ("reason", "times"))] if parts.failed else []),
        *(
            f"<h2>{title}</h2><div class=loops>{''.join(_figure(store, loop) for loop in loops)}</div>"
            for title, loops in shown
            if loops
        ),
    ]
    write_text(path, document("spinor-geom batch", body, style=STYLE))


def _table(rows: Iterable[tuple[Any, Any]], header: tuple[str, str]) -> str:
    return table(header, [(str(key), str(value)) for key, value in rows])


def _figure(store: Store, loop: dict[str, Any]) -> str:
    residual = loop.get("residual_rms_per_edge")
    lines = [
        loop["source"],
        "" if loop["index"] is None else f"loop {loop['index']} {loop['name']}",
        "" if residual is None else f"residual {residual:.1e} of an edge",
        said(loop)[:200],
    ]
    caption = "<br>".join(map(escape, filter(None, lines)))
    return f"<figure>{_picture(store, loop)}<figcaption>{caption}</figcaption></figure>"


def _picture(store: Store, loop: dict[str, Any]) -> str:
    """The picture of a loop's mesh, or of what its record keeps of it; none where there is neither."""
    names = loop.get("files") or {}
    name = names.get("patch") or names.get("loop")
    try:
        if name is not None:
            return thumbnail(*_shape(store.folder(loop["source"]) / name))
        if loop["outline"]:
            points = np.array(loop["outline"], dtype=np.float64)
            return thumbnail(points, np.zeros((0, 3), dtype=np.int64), np.arange(len(points)))
    except (OSError, KeyError, ValueError, SpinorGeomError):
        return "<p>no picture: the file has changed</p>"
    return ""


def _shape(path: Path) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"], Int[np.ndarray, " k"]]:
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as arrays:
            points = arrays["points"] if "points" in arrays else arrays["vertices"]
            faces = arrays["faces"] if "faces" in arrays else np.zeros((0, 3), dtype=np.int64)
        mesh, curves = TriangleMesh(points, faces), [np.append(np.arange(len(points)), 0)]
    else:
        file = read_mesh(path)
        mesh, curves = file.mesh, list(file.polylines)
    if len(mesh.faces):
        rim = find_boundary_loops(mesh)[0].vertex_ids
        curves = [np.append(rim, rim[0])]
    return np.asarray(mesh.vertices), np.asarray(mesh.faces), curves[0]


def thumbnail(points: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], outline: Int[np.ndarray, " k"]) -> str:
    """A surface, shaded, and its rim (the points of the outline in order), or a curve alone, as one `svg` element."""
    turned = _seen(points)
    low, high = turned.min(axis=0), turned.max(axis=0)
    extent = float((high - low)[:2].max())
    scale = (SIZE - 2 * MARGIN) / extent if extent > np.finfo(np.float64).tiny else 1.0
    flat = SIZE / 2 + (turned - 0.5 * (low + high)) * scale * [1, -1, 1]
    shapes = _triangles(flat, faces) if len(faces) <= MOST_FACES else []
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in flat[outline, :2].tolist())
    shapes.append(f'<polyline points="{path}" fill="none" stroke="#d0021b" stroke-width="1.5"/>')
    return f'<svg viewBox="0 0 {SIZE} {SIZE}" width="{SIZE}" height="{SIZE}">{"".join(shapes)}</svg>'


def _seen(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """The points with their plane almost across the line of sight, the third coordinate towards the eye."""
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1][:, ::-1]
    axes[:, 2] *= np.linalg.det(axes)
    x, y, z = (centred @ axes).T
    return np.stack([x, np.cos(TILT) * y + np.sin(TILT) * z, np.cos(TILT) * z - np.sin(TILT) * y], axis=1)


def _triangles(flat: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> list[str]:
    corners = flat[faces]
    colors = (DARK + np.abs(face_normals(flat, faces)[:, 2:]) * (LIGHT - DARK)).astype(int)
    order = np.argsort(corners[:, :, 2].mean(axis=1), kind="stable")
    return [
        f'<path d="M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}L{e:.1f} {f:.1f}Z" fill="#{red:02x}{green:02x}{blue:02x}"/>'
        for (a, b, c, d, e, f), (red, green, blue) in zip(
            corners[order, :, :2].reshape(-1, 6).tolist(), colors[order].tolist(), strict=True
        )
    ]


def write_summary(
    store: Store, sources: Iterable[Source], options: BatchOptions, progress: dict[str, Any]
) -> dict[str, Path]:
    """Writes tables, page and log from the records, and tells where they are by the names of `BatchResult`."""
    root = Path(store.output)
    parts = PageParts()

    def records() -> Iterator[dict[str, Any]]:
        with atomic_path(store.log) as log, log.open("w", encoding="utf-8") as file:
            for source in sources:
                record = store.record(source.key) or failure(source.key, NO_RESULTS)
                parts.add(record)
                if record["status"] != "done":
                    file.write(log_line(summary(record)))
                yield record

    paths = {"table": root / TABLE, "table_csv": root / TABLE_CSV, "page": root / PAGE}
    write_tables(records(), paths["table"], paths["table_csv"])
    figures = {**asdict(options), "seconds": f"{progress['seconds']:.1f}", "version": program_version()}
    write_page(parts, store, figures, paths["page"])
    return paths


def rows_of(record: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The rows of a file: one for each loop, or one for the file itself where it has none or could not be read."""
    of_file = {key: record[key] for key in ("filled", "version")}
    if record["reason"] or not record["loops"]:
        own = {key: record[key] for key in ("source", "status", "reason")}
        yield {**dict.fromkeys(COLUMNS), **own, "notes": "; ".join(record["notes"]), **of_file}
    for loop in record["loops"]:
        stability, hausdorff = loop.get("stability") or {}, (loop["comparison"] or {}).get("hausdorff", {})
        yield {
            **{key: loop.get(key) for key in COLUMNS},
            **of_file,
            "loop": loop["index"],
            "notes": "; ".join(loop["notes"]),
            "stability": stability.get("verdict"),
            "stability_index": stability.get("index"),
            "hausdorff_max": hausdorff.get("max"),
            "hausdorff_mean": hausdorff.get("mean"),
            "patch": loop["files"].get("patch"),
            "surface": loop["files"].get("surface"),
            "curve": loop["files"].get("loop"),
            "seconds": loop["timings"].get("total", 0.0) + loop["timings"].get("comparison", 0.0),
        }


def write_tables(records: Iterable[dict[str, Any]], parquet: Path, text: Path) -> None:
    """Writes both tables, Parquet and CSV, each whole or not at all."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema([(name, pa.type_for_alias(kind)) for name, kind in COLUMNS.items()])
    rows = (row for record in records for row in rows_of(record))
    with (
        atomic_path(parquet) as parquet_path,
        atomic_path(text) as text_path,
        text_path.open("w", encoding="utf-8", newline="") as file,
        pq.ParquetWriter(parquet_path, schema) as writer,
    ):
        lines = csv.DictWriter(file, list(COLUMNS), lineterminator="\n")
        lines.writeheader()
        while part := list(islice(rows, ROWS_AT_ONCE)):
            writer.write_table(pa.Table.from_pylist(part, schema))
            lines.writerows({key: _harmless(value) for key, value in row.items()} for row in part)


def _harmless(value: Any) -> Any:
    """Text that a spreadsheet does not take for a formula."""
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t") else value
