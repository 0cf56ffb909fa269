"""What a run leaves: CSV, plots, markdown, and one page with everything in it."""

from __future__ import annotations

import csv
import html
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from spinor_geom.bench.isolate import Record
from spinor_geom.bench.machine import told
from spinor_geom.bench.measure import DISTANCE
from spinor_geom.bench.pieces import pieces_of, scale_of
from spinor_geom.bench.runner import Run
from spinor_geom.bench.suites import VIEWS
from spinor_geom.bench.tables import Table, option_table, tables
from spinor_geom.files import atomic_path
from spinor_geom.render import page
from spinor_geom.render.layers import Faces
from spinor_geom.render.plots import log_log
from spinor_geom.render.viewer import STYLE, Scene, Views

PAGE, TABLES, CSV, PLOTS = "report.html", "tables.md", "records.csv", "plots"
# fields that say how it was measured here: nothing for others
LOCAL = ("key", "package", "data", "view", "repeat", "said", "seconds_all")
_RESOLUTION = 110
# errors of zero have no place on a logarithmic axis
_ROUNDING = 1e-17


def write(run: Run) -> None:
    """Writes all files of a run beside its records, each whole or not at all."""
    made = tables(run.records)
    pictures = plots(run.records)
    write_text(run.folder / TABLES, markdown(run, made))
    write_text(run.folder / CSV, table_of(run.records))
    (run.folder / PLOTS).mkdir(exist_ok=True)
    images = {name: _drawn(figure, run.folder / PLOTS / f"{name}.png") for name, figure in pictures.items()}
    write_text(run.folder / PAGE, report(run, made, images))


def markdown(run: Run, made: Sequence[Table]) -> str:
    """All tables, below what they were measured with."""
    return "\n\n".join([told(run.description["machine"]), *map(str, made), str(option_table())]) + "\n"


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
    made: dict[str, Figure] = {}
    disks = [r for r in records if r["suite"] == "disks" and r["status"] == "done"]
    for case in dict.fromkeys(r["case"] for r in disks):
        here = [r for r in disks if r["case"] == case]
        lines: dict[str, tuple[Sequence[float], Sequence[float]]] = {}
        for method in dict.fromkeys(r["method"] for r in here):
            points = sorted((r["seconds"], max(r["area_error"], _ROUNDING)) for r in here if r["method"] == method)
            lines[method] = ([p[0] for p in points], [p[1] for p in points])
        figure = log_log(lines, x="seconds", y="relative error of the area")
        figure.suptitle(case, fontsize="medium")
        made[f"{case}-error-time"] = figure
    return made


def report(run: Run, made: Sequence[Table], images: Mapping[str, bytes]) -> str:
    """The page."""
    settings: Mapping[str, Any] = run.description["settings"]
    views = Views()
    body = [
        "<h1>Minimal surfaces: exact, discrete, and every hole filler</h1>",
        f"<p>{'Quick' if settings['quick'] else 'Full'} run, {len(run.records)} records. "
        f"{html.escape(told(run.description['machine']))}</p>",
        "<p>Areas and distances are measured against exact formulas; the definition of every column is in "
        "<code>docs/benchmark.md</code>. A row in red misses a promise, or leaves edges open without saying so.</p>",
        *_rows(made[:1]),
        *_cut_outs(run, views),
        "<h2>Error against cost</h2>",
        *(
            f"<figure>{page.picture(data, name)}<figcaption>{name}</figcaption></figure>"
            for name, data in images.items()
        ),
        "<h2>Figures</h2>",
        *_rows(made[1:]),
        *_rows([option_table()]),
    ]
    return page.document("spinor-geom bench", [*body, views.script()], style=STYLE)


def _cut_outs(run: Run, views: Views) -> list[str]:
    """A view of each pictured cut-out: what was removed, and what the fillers put there."""
    found = []
    for folder in sorted(path for path in (run.folder / VIEWS).glob("*") if path.is_dir()):
        pieces = pieces_of(folder)
        layers = [Faces(vertices=p.vertices, faces=p.faces, fields={DISTANCE: p.values}, edges=True) for p in pieces]
        view = Scene(title="", layers=layers, scales={DISTANCE: scale_of(pieces)}, shape="wide")
        names = ", ".join(piece.name for piece in pieces)
        found.append(f"<h3>{folder.name}</h3><p>From left to right: {names}.</p>{views.figure(view)}")
    return ["<h2>Cut-outs</h2><p>Drag to turn, wheel to zoom.</p>", *found] if found else []


def _rows(made: Sequence[Table]) -> list[str]:
    """Tables in HTML."""
    parts = []
    for table in made:
        parts.append(f"<h3>{html.escape(table.title)}</h3>")
        if table.note:
            parts.append(f"<p>{html.escape(table.note)}</p>")
        rows = [[cell.strip("*") for cell in row] for row in table.rows]
        parts.append(page.table(table.columns, rows, marked=table.marked))
    return parts


def _drawn(figure: Figure, path: Path) -> bytes:
    """Saves a plot; returns its PNG."""
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=_RESOLUTION)
    return path.read_bytes()


def write_text(path: Path, text: str) -> None:
    """Writes a text file so that it is either whole or as it was."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
