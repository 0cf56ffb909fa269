"""What a run leaves: CSV, plots, markdown, and one page with everything in it."""

from __future__ import annotations

import csv
import html
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure

from spinor_geom.bench.fillers import FILLERS
from spinor_geom.bench.machine import Record, told
from spinor_geom.bench.measure import DISTANCE, REMOVED
from spinor_geom.bench.runner import VIEWS, Run
from spinor_geom.bench.tables import Table, option_table, tables
from spinor_geom.files import atomic_path, write_text
from spinor_geom.render import page
from spinor_geom.render.layers import Faces, Scale
from spinor_geom.render.page import Scene, Views
from spinor_geom.render.plots import log_log

PAGE, TABLES, CSV, PLOTS = "report.html", "tables.md", "records.csv", "plots"
# fields that say how it was measured here: nothing for others
LOCAL = ("key", "package", "data", "view", "repeat", "said", "seconds_all")
_RESOLUTION = 110
_GAP = 1.15  # from piece to piece, per width
# errors of zero have no place on a logarithmic axis
_ROUNDING = 1e-17


def write(run: Run) -> None:
    """Writes all files of a run beside its records, each whole or not at all."""
    made, machine = tables(run.records), told(run.description["machine"])
    write_text(run.folder / TABLES, "\n\n".join([machine, *map(str, made), str(option_table())]) + "\n")
    write_text(run.folder / CSV, table_of(run.records))
    (run.folder / PLOTS).mkdir(exist_ok=True)
    images = {}
    for case, figure in plots(run.records).items():
        path = run.folder / PLOTS / f"{case}-error-time.png"
        with atomic_path(path) as temporary:
            figure.savefig(temporary, dpi=_RESOLUTION)
        images[path.stem] = path.read_bytes()
    write_text(run.folder / PAGE, report(run, made, images))


def table_of(records: Sequence[Record]) -> str:
    """The records as CSV: a line a record, a column a field."""
    flat = [{k: v for k, v in r.items() if k not in LOCAL} for r in records]
    columns = list(dict.fromkeys(name for record in flat for name in record))
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(flat)
    return buffer.getvalue()


def plots(records: Sequence[Record]) -> dict[str, Figure]:
    """Error against time for each known case."""
    points: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for r in records:
        if r["suite"] == "disks" and r["status"] == "done":
            here = points.setdefault(r["case"], {}).setdefault(r["method"], [])
            here.append((r["seconds"], max(r["area_error"], _ROUNDING)))
    made = {}
    for case, by_method in points.items():
        ordered = {method: sorted(here) for method, here in by_method.items()}
        lines = {method: ([s for s, _ in here], [e for _, e in here]) for method, here in ordered.items()}
        made[case] = log_log(lines, x="seconds", y="relative error of the area")
        made[case].suptitle(case, fontsize="medium")
    return made


def report(run: Run, made: Sequence[Table], images: Mapping[str, bytes]) -> str:
    """The page."""
    views = Views()
    cut_outs = _cut_outs(run.folder / VIEWS, views)
    pictures = (f"{page.picture(data, name)}<figcaption>{name}</figcaption>" for name, data in images.items())
    body = [
        "<h1>Minimal surfaces: exact, discrete, and every hole filler</h1>",
        f"<p>{'Quick' if run.description['settings']['quick'] else 'Full'} run, {len(run.records)} records. "
        f"{html.escape(told(run.description['machine']))}</p>",
        "<p>Areas and distances are measured against exact formulas; the definition of every column is in "
        "<code>docs/benchmark.md</code>. A row in red misses a promise, or leaves edges open without saying so.</p>",
        *_rows(made[:1]),
        *cut_outs,
        "<h2>Error against cost</h2>",
        *(f"<figure>{one}</figure>" for one in pictures),
        "<h2>Figures</h2>",
        *_rows([*made[1:], option_table()]),
        *([views.script()] if cut_outs else []),
    ]
    return page.document("spinor-geom bench", body)


def _cut_outs(folder: Path, views: Views) -> list[str]:
    """A view of each pictured cut-out: what was removed, and what the fillers put there."""
    found = []
    for case in sorted(path for path in folder.glob("*") if path.is_dir()):
        pieces = pieces_of(case)
        view = Scene(title="", layers=[*pieces.values()], scales={DISTANCE: scale_of(pieces)}, shape="wide")
        found.append(f"<h3>{case.name}</h3><p>From left to right: {', '.join(pieces)}.</p>{views.figure(view)}")
    return ["<h2>Cut-outs</h2><p>Drag to turn, wheel to zoom.</p>", *found] if found else []


def _rows(made: Sequence[Table]) -> list[str]:
    """Tables in HTML."""
    parts = []
    for table in made:
        note = f"<p>{html.escape(table.note)}</p>" if table.note else ""
        rows = [[text.strip("*") for text in row] for row in table.rows]
        parts.append(f"<h3>{html.escape(table.title)}</h3>{note}")
        parts.append(page.table(table.columns, rows, marked=table.marked))
    return parts


def pieces_of(folder: Path) -> dict[str, Faces]:
    """The pieces that a run left in a folder, by name: what was removed, then the fillers' in their order.

    They lie side by side, the hole's normal along the third axis, each with its distance from what was removed, per
    diameter of the hole, at every vertex.
    """
    made: dict[str, Faces] = {}
    for name in (name for name in (REMOVED, *FILLERS) if (folder / f"{name}.npz").exists()):
        with np.load(folder / f"{name}.npz") as arrays:
            vertices, faces = arrays["vertices"].astype(np.float64), arrays["faces"].astype(np.int64)
            values = arrays["values"].astype(np.float64)
        if not made:
            middle = vertices.mean(axis=0)
            axes = _axes(vertices, faces)
            width = _GAP * np.ptp((vertices - middle) @ axes.T, axis=0)[0]
        moved = (vertices - middle) @ axes.T + [len(made) * width, 0, 0]
        made[name] = Faces(vertices=moved, faces=faces, fields={DISTANCE: values}, edges=True)
    return made


def scale_of(pieces: Mapping[str, Faces]) -> Scale:
    """One scale for all: from zero to what all but one vertex in twenty of a typical piece stay below."""
    tops = [float(np.quantile(piece.fields[DISTANCE], 0.95)) for name, piece in pieces.items() if name != REMOVED]
    return Scale(low=0.0, high=float(np.median(tops)))


def _axes(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "3 3"]:
    """Rows: along the longest extent across the hole's normal, across, and the normal."""
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    normal /= np.linalg.norm(normal)
    flat = vertices - vertices.mean(axis=0)
    flat = flat - np.outer(flat @ normal, normal)
    first = np.linalg.svd(flat, full_matrices=False)[2][0]
    return np.stack([np.cross(normal, first), first, normal])
