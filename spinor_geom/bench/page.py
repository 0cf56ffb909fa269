"""What a run leaves: CSV, markdown, and one page with everything in it."""

import csv
import html
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from spinor_geom.bench.fillers import FILLERS
from spinor_geom.bench.machine import Record, told
from spinor_geom.bench.measure import DISTANCE, REMOVED
from spinor_geom.bench.runner import VIEWS, Run
from spinor_geom.bench.tables import Table, option_table, tables
from spinor_geom.files import write_text
from spinor_geom.render import page
from spinor_geom.render.layers import Faces, Scale
from spinor_geom.render.page import Scene, Views

PAGE, TABLES, CSV = "report.html", "tables.md", "records.csv"
# fields that say how it was measured here: nothing for others
LOCAL = ("key", "package", "data", "view", "repeat", "said", "seconds_all")
_GAP = 1.15  # from piece to piece, per width


def write(run: Run) -> None:
    """Writes all files of a run beside its records, each whole or not at all."""
    made, machine = tables(run.records), told(run.description["machine"])
    write_text(run.folder / TABLES, "\n\n".join([machine, *map(str, made), str(option_table())]) + "\n")
    write_text(run.folder / CSV, table_of(run.records))
    write_text(run.folder / PAGE, report(run, made))


def table_of(records: Sequence[Record]) -> str:
    """The records as CSV: a line a record, a column a field."""
    flat = [{k: v for k, v in r.items() if k not in LOCAL} for r in records]
    columns = list(dict.fromkeys(name for record in flat for name in record))
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(flat)
    return buffer.getvalue()


def report(run: Run, made: Sequence[Table]) -> str:
    """The page, with a view of each pictured cut-out: what was removed, and what the fillers put there."""
    views, found = Views(), []
    for case in sorted(path for path in (run.folder / VIEWS).glob("*") if path.is_dir()):
        pieces = pieces_of(case)
        view = Scene(title="", layers=[*pieces.values()], scales={DISTANCE: scale_of(pieces)}, shape="wide")
        found.append(f"<h3>{case.name}</h3><p>From left to right: {', '.join(pieces)}.</p>{views.figure(view)}")
    body = [
        "<h1>Minimal surfaces: exact, discrete, and every hole filler</h1>",
        f"<p>{'Quick' if run.description['settings']['quick'] else 'Full'} run, {len(run.records)} records. "
        f"{html.escape(told(run.description['machine']))}</p>",
        "<p>Areas and distances are measured against exact formulas; the definition of every column is in "
        "<code>docs/benchmark.md</code>. A row in red misses a promise, or leaves edges open without saying so.</p>",
        *map(_html, made[:1]),
        *(["<h2>Cut-outs</h2><p>Drag to turn, wheel to zoom.</p>", *found] if found else []),
        "<h2>Figures</h2>",
        *map(_html, [*made[1:], option_table()]),
        *([views.script()] if found else []),
    ]
    return page.document("spinor-geom bench", body)


def _html(table: Table) -> str:
    note = f"<p>{html.escape(table.note)}</p>" if table.note else ""
    rows = [[text.strip("*") for text in row] for row in table.rows]
    return f"<h3>{html.escape(table.title)}</h3>{note}{page.table(table.columns, rows, marked=table.marked)}"


def pieces_of(folder: Path) -> dict[str, Faces]:
    """The pieces that a run left in a folder, by name, side by side: what was removed, then what each filler put there.

    The hole's normal is along the third axis; fields are distances from what was removed, per diameter of the hole.
    """
    made: dict[str, Faces] = {}
    for name in (name for name in (REMOVED, *FILLERS) if (folder / f"{name}.npz").exists()):
        with np.load(folder / f"{name}.npz") as arrays:
            vertices, faces = arrays["vertices"].astype(np.float64), arrays["faces"].astype(np.int64)
            values = arrays["values"].astype(np.float64)
        if not made:
            middle, corners = vertices.mean(axis=0), vertices[faces]
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
            normal /= np.linalg.norm(normal)
            flat = vertices - middle
            along = np.linalg.svd(flat - np.outer(flat @ normal, normal), full_matrices=False)[2][0]
            axes = np.stack([np.cross(normal, along), along, normal], axis=1)
            width = _GAP * np.ptp(flat @ axes, axis=0)[0]
        moved = (vertices - middle) @ axes + [len(made) * width, 0, 0]
        made[name] = Faces(vertices=moved, faces=faces, fields={DISTANCE: values}, edges=True)
    return made


def scale_of(pieces: Mapping[str, Faces]) -> Scale:
    """One scale for all: from zero to what all but one vertex in twenty of a typical piece stay below."""
    tops = [float(np.quantile(piece.fields[DISTANCE], 0.95)) for name, piece in pieces.items() if name != REMOVED]
    return Scale(low=0.0, high=float(np.median(tops)))
