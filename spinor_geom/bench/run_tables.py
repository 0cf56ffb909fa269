"""The files of a run: CSV, and a page with plots, tables and the pictured cut-outs."""

import csv
import html
import io
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from textwrap import shorten
from typing import Any

import numpy as np

from spinor_geom.bench.fillers import FILLERS, SMOOTH
from spinor_geom.bench.machine import Record, machine_text
from spinor_geom.bench.measured import DISTANCE, REMOVED
from spinor_geom.bench.plots import plots
from spinor_geom.bench.promises import Promise, bend_ratios, crossings, is_whole, names, promises
from spinor_geom.bench.runner import METHODS, VIEWS, Run
from spinor_geom.files import together, write_text
from spinor_geom.render.page import Table, Views, document, folded
from spinor_geom.render.scene import Faces, Scale, Scene

PAGE, CSV = "report.html", "records.csv"
LOCAL = ("key", "data", "view", "repeat", "output", "seconds_all")  # fields that the CSV leaves out
_GAP = 1.15  # distance between the pieces of a view, per width
_short = partial(shorten, width=160, placeholder="…")


def write(run: Run) -> None:
    """Writes the files of a run into its folder, all or none."""
    with together():
        write_text(run.folder / CSV, csv_text(run.records))
        write_text(run.folder / PAGE, page_text(run))


def csv_text(records: Sequence[Record]) -> str:
    """The records as CSV, one line each, without the fields `LOCAL`."""
    flat = [{k: v for k, v in r.items() if k not in LOCAL} for r in records]
    columns = list(dict.fromkeys(name for record in flat for name in record))
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(flat)
    return buffer.getvalue()


def page_text(run: Run) -> str:
    """The page: plots, a row for each tool, the pictured cut-outs, all figures. The promises are folded."""
    views, figures = Views(), []
    for case in sorted(path for path in (run.folder / VIEWS).glob("*") if path.is_dir()):
        pieces = pieces_of(case)
        view = Scene(title="", layers=[*pieces.values()], scales={DISTANCE: scale_of(pieces)}, shape="wide")
        figures.append(f"<h3>{case.name}</h3><p>From left to right: {', '.join(pieces)}.</p>{views.figure(view)}")
    summary, *others = tables(run.records)
    promised = promise_table(promises(run.records))
    body = [
        "<h1>Exact and discrete minimal surfaces, and hole fillers</h1>",
        f"<p>{'Quick' if run.description['settings']['quick'] else 'Full'} run, {len(run.records)} records. "
        f"{html.escape(machine_text(run.description['machine']))}</p>",
        "<p>Areas and distances are measured against exact formulas; the definition of every column is in "
        "<code>docs/benchmark.md</code>.</p>",
        *(plot.html() for plot in plots(run.records)),
        summary.html(),
        *(["<h2>Cut-outs</h2><p>Drag to turn, wheel to zoom.</p>", *figures] if figures else []),
        "<h2>Tables</h2><p>A row in red leaves edges open without reporting it. "
        f"The figures of each measurement are in {CSV}.</p>",
        *(table.html() for table in (*others, option_table())),
        f"<h2>Promises</h2>{folded(promised.note, promised.html())}",
        *([views.script()] if figures else []),
    ]
    return document("spinor-geom bench", body)


def pieces_of(folder: Path) -> dict[str, Faces]:
    """The removed piece and each filler's patch side by side, by name, from the files that a run left in a folder.

    The hole's normal is the third axis. Fields are distances from the removed piece, per diameter of the hole.
    """
    pieces: dict[str, Faces] = {}
    for name in (name for name in (REMOVED, *FILLERS) if (folder / f"{name}.npz").exists()):
        with np.load(folder / f"{name}.npz") as arrays:
            vertices, faces = arrays["vertices"].astype(np.float64), arrays["faces"].astype(np.int64)
            values = arrays["values"].astype(np.float64)
        if not pieces:
            middle, corners = vertices.mean(axis=0), vertices[faces]
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
            normal /= np.linalg.norm(normal)
            flat = vertices - middle
            along = np.linalg.svd(flat - np.outer(flat @ normal, normal), full_matrices=False)[2][0]
            axes = np.stack([np.cross(normal, along), along, normal], axis=1)
            width = _GAP * np.ptp(flat @ axes, axis=0)[0]
        moved = (vertices - middle) @ axes + [len(pieces) * width, 0, 0]
        pieces[name] = Faces(vertices=moved, faces=faces, fields={DISTANCE: values}, edges=True)
    return pieces


def scale_of(pieces: Mapping[str, Faces]) -> Scale:
    """One scale for all pieces, up to the median of their 95 % quantiles."""
    tops = [float(np.quantile(piece.fields[DISTANCE], 0.95)) for name, piece in pieces.items() if name != REMOVED]
    return Scale(low=0.0, high=float(np.median(tops)))


def tables(records: Sequence[Record]) -> list[Table]:
    """The tables of a run that have rows, the summary first."""
    there = [r for r in records if r["status"] != "missing"]
    odd, cut_outs = ([r for r in there if r["suite"] == suite] for suite in ("odd", "cut-outs"))
    every = (odd_table(odd), filler_table(cut_outs), trouble_table(records))
    return [summary_table(records), *(table for table in every if table.rows)]


def summary_table(records: Sequence[Record]) -> Table:
    """One row for each method: what it was measured on, and medians."""
    rows = []
    for method in names(records, "method"):
        here = [r for r in records if r["method"] == method]
        done = [r for r in here if r["status"] == "done"]
        holes = [r for r in done if "open_rim_edges" in r]
        of_suite = {suite: [r for r in done if r["suite"] == suite] for suite in names(records, "suite")}

        def middle(suite: str, field: str, form: str = ".3g", of_suite: Any = of_suite) -> str:
            return _median([r[field] for r in of_suite.get(suite, []) if r.get(field) is not None], form)

        rows.append(
            (
                method,
                f"{len(done)} of {len(here)}",
                _count([not r["open_rim_edges"] + r["new_open_edges"] for r in holes]),
                _count([bool(r["old_faces_kept"]) for r in holes]),
                _count([crossings(r) > 0 for r in holes]),
                middle("disks", "area_error"),
                middle("fills", "area_error"),
                middle("cut-outs", "distance"),
                *(middle(suite, "seconds") for suite in ("disks", "fills", "cut-outs", "meshes")),
                format(max((r["memory_mib"] or 0 for r in done), default=0), ".0f"),
            )
        )
    columns = ("method", "measured", "holes closed", "mesh kept", "crossing", "area error, disks", "area error, fills")
    more = ("distance, cut-outs", *(f"seconds, {suite}" for suite in ("disks", "fills", "cut-outs", "meshes")))
    return Table(
        title="Methods",
        columns=(*columns, *more, "memory, MiB"),
        rows=rows,
        note="Holes are those of all suites. Crossing: patches that intersect themselves or the mesh. Figures are "
        "medians, memory is the largest.",
    )


def _count(met: Sequence[bool]) -> str:
    return f"{sum(met)} of {len(met)}" if met else ""


def left_open(record: Record) -> str:
    """The number of open edges, with ! unless the tool reports a failure, empty if there are none."""
    left = record["open_rim_edges"] + record["new_open_edges"]
    return f"{left} open{'' if record['succeeded'] is False else ' !'}" if left else ""


def promise_table(found: Sequence[Promise]) -> Table:
    """The promises, missed ones marked."""
    rows = [(c.suite, c.case, c.text, c.measured, "met" if c.met else "**missed**") for c in found]
    missed = frozenset(k for k, c in enumerate(found) if not c.met)
    note = f"{len(found) - len(missed)} of {len(found)} are met." if found else ""
    columns = ("suite", "case", "promise", "measured", "verdict")
    return Table(title="Promises", columns=columns, rows=rows, note=note, marked=missed)


def odd_table(records: Sequence[Record]) -> Table:
    """One row for each tool, one column for each hole. Tools that leave edges open without reporting it are marked."""
    holes = names(records, "case")
    found = {(r["method"], r["case"]): _odd_cell(r) for r in records}
    rows = [(tool, *(found.get((tool, hole), "") for hole in holes)) for tool in names(records, "method")]
    expected = {r["case"]: r["expected"] for r in records if r.get("expected")}
    return Table(
        title="Odd rims, and test cases of other projects",
        columns=("tool", *holes),
        rows=rows,
        note="Each cell has the patches; pairs of crossing triangles (×); open edges, with ! unless the tool reports a "
        "failure; the largest angle; seconds. Refused: the tool reports that it did not fill the hole. Doubled: the "
        "result has faces of the mesh twice. "
        f"Correct results: {'; '.join(f'{case}: {text}' for case, text in expected.items())}.",
        marked=frozenset(k for k, row in enumerate(rows) if any(" !" in text for text in row)),
    )


def _odd_cell(record: Record) -> str:
    if record["status"] != "done":
        return str(record["status"])
    patches, left = record.get("patches") or 0, left_open(record)
    if not patches and record["succeeded"] is False:
        return "refused"
    crossing = crossings(record)
    parts = [
        f"{patches} patches" if patches > 1 else "" if left else "closed" if patches else "doubled",
        f"{crossing} ×" if crossing else "",
        left,
        *((f"{record['max_angle']:.0f}°", f"{record['seconds']:.2g} s") if patches else ()),
    ]
    return ", ".join(filter(None, parts))


def filler_table(records: Sequence[Record]) -> Table:
    """One row for each filler: the number of cut-outs that it closes, and medians, also by kind of hole and scan."""
    whole = [r for r in records if is_whole(r)]
    by_case = ([r for r in whole if r["case"] == case] for case in names(whole, "case"))
    nearest = [min(here, key=lambda r: r["distance"]) for here in by_case]
    smooth = {r["case"]: r["distance"] for r in whole if r["method"] == SMOOTH}
    kinds: dict[str, dict[str, list[float]]] = {}
    for r in whole:
        kind = r["case"].rpartition("-")[0] if r["kind"] == "scan" else r["kind"]
        kinds.setdefault(kind, {}).setdefault(r["method"], []).append(r["distance"])
    rows = []
    for method in names(records, "method"):
        here, mine = [r for r in records if r["method"] == method], [r for r in whole if r["method"] == method]
        scans = [r for r in mine if r["kind"] == "scan"]
        medians = []
        for by_method in kinds.values():
            values = by_method.get(method, [])
            best = values and median(values) == min(map(median, by_method.values()))
            medians.append(f"**{_median(values, '.3g')}**" if best else _median(values, ".3g"))
        rows.append(
            (
                method,
                f"{len(mine)} of {len(here)}",
                str(sum(crossings(r) > 0 for r in mine)),
                str(sum(r["old_faces_kept"] for r in mine)),
                _share([r["method"] == method for r in nearest]),
                _share([r["method"] == method for r in nearest if r["kind"] == "scan"]),
                _share([smooth[r["case"]] < r["distance"] for r in scans if r["case"] in smooth and method != SMOOTH]),
                _median(bend_ratios(mine), ".2f"),
                _median([r["seconds"] for r in mine], ".3f"),
                _median([r["distance"] for r in scans], ".3g"),
                *medians,
            )
        )
    columns = ("filler", "closed", "crossing", "mesh kept", "nearest", "nearest on scans", f"{SMOOTH} nearer on scans")
    return Table(
        title="Cut-outs: fillers compared with what was removed",
        columns=(*columns, "bend", "seconds", "distance on scans", *kinds),
        rows=rows,
        note="Figures are medians over the patches that close their hole. Bend: across the rim, divided by that of the "
        "removed piece. Distances, on scans and by kind of hole, are divided by the diameter of the hole: from new "
        "vertices to a known surface; on scans between the triangles of the patch and the removed ones, in both "
        "directions.",
    )


def _share(met: Sequence[bool]) -> str:
    return f"{sum(met) / len(met):.0%}" if met else ""


def _median(values: Sequence[float], form: str) -> str:
    return format(median(values), form) if values else ""


def trouble_table(records: Sequence[Record]) -> Table:
    """The tasks that are not done, one row for each method, status and reason."""
    cases: dict[tuple[str, str, str], list[str]] = {}
    for r in records:
        if r["status"] != "done" and r["suite"] != "odd":
            where = Path(r["case"]).name + (f", {r['n']} points" if r.get("n") else "")
            where = "all" if r["status"] == "missing" else where
            cases.setdefault((r["method"], r["status"], _short(r.get("reason") or "")), []).append(where)
    rows = [
        (method, status, on[0] + (f" and {len(set(on)) - 1} more" if len(set(on)) > 1 else ""), reason)
        for (method, status, reason), on in cases.items()
    ]
    columns = ("method", "status", "on", "reason")
    return Table(title="Missing, refused, failed, crashed or too slow", columns=columns, rows=rows)


def option_table() -> Table:
    """The options of every method and tool."""
    rows = [(name, tool.package, tool.options) for name, tool in METHODS.items()]
    return Table(title="Methods and tools", columns=("name", "package", "options"), rows=rows)
