"""The tables of a run, as text: a page and markdown files show the same ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import TypeAlias

from spinor_geom.bench.claims import claims, is_whole
from spinor_geom.bench.figures import Figure
from spinor_geom.bench.fillers import FILLERS, SMOOTH
from spinor_geom.bench.isolate import Record
from spinor_geom.bench.machine import is_older
from spinor_geom.bench.methods import LOOP_METHODS
from spinor_geom.bench.solves import SUITES as SOLVED

Show: TypeAlias = Callable[[Record], str]
OLDER = "†"  # a row of ours whose code has changed since
_SAID = 160


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of text.

    Attributes:
        title: its heading.
        columns: names of the columns.
        rows: cells, as many in a row as there are columns.
        note: a sentence below the heading.
        marked: rows that miss what is promised.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    marked: frozenset[int] = field(default_factory=frozenset)

    def __str__(self) -> str:
        """The heading and the table, in markdown."""
        lines = [self.columns, ("---",) * len(self.columns), *self.rows]
        cells = [[cell.replace("|", "\\|") for cell in line] for line in lines]
        note = [self.note, ""] if self.note else []
        return "\n".join([f"### {self.title}", "", *note, *(f"| {' | '.join(line)} |" for line in cells)])


def tables(records: Sequence[Record]) -> list[Table]:
    """All tables of a run that have rows."""
    of = {suite: [r for r in records if r["suite"] == suite] for suite in dict.fromkeys(r["suite"] for r in records)}
    cut_outs = [r for r in of.get("cut-outs", []) if r["status"] != "missing"]
    made = [
        claim_table(claims(records)),
        _shown("Disks over known loops", DISKS, _done(of.get("disks", [])), _DISK_NOTE),
        _shown("Known rims, filled", {**WHERE, **FILLS, **KNOWN_FILLS}, _done(of.get("fills", []))),
        odd_table(of.get("odd", [])),
        filler_table(cut_outs),
        kind_table(cut_outs),
        _shown("Mesh files, all holes", {**WHERE, **FILLS, **SAYS}, _done(of.get("meshes", []))),
        _shown("Noisy rims", {**WHERE, **FILLS}, _done(of.get("noisy", []))),
        *(_shown(f"Ours alone: {suite}", SOLVES, _done(of.get(suite, []))) for suite in SOLVED),
        _shown("Batches", BATCHED, _done(of.get("batch", []))),
        trouble_table(records),
    ]
    return [table for table in made if table.rows]


def _shown(title: str, columns: Mapping[str, Show], records: Iterable[Record], note: str = "") -> Table:
    """A line a record."""
    rows = tuple(tuple(show(record) for show in columns.values()) for record in records)
    return Table(title=title, columns=tuple(columns), rows=rows, note=note)


def _done(records: Iterable[Record]) -> list[Record]:
    return [r for r in records if r["status"] == "done"]


def _number(name: str, form: str) -> Show:
    def show(record: Record) -> str:
        value = record.get(name)
        return "" if value is None or (isinstance(value, float) and math.isnan(value)) else format(value, form)

    return show


def _yes(name: str) -> Show:
    return lambda record: {None: "", True: "yes", False: "no"}[record.get(name)]


def _said(record: Record) -> str:
    return short(record.get("told") or record.get("said") or "nothing")


def short(text: str) -> str:
    """A text in one line, cut where it is long."""
    text = " ".join(text.split())
    return text if len(text) <= _SAID else text[: _SAID - 1].rstrip() + "…"


def method_name(record: Record) -> str:
    """The method, marked where the code has changed since it was measured."""
    return f"{record['method']} {OLDER}" if is_older(record) else str(record["method"])


def closed(record: Record) -> str:
    """Whether a hole is closed, and where it is not, whether the tool says so."""
    problems = [
        f"{record[name]} {text}"
        for name, text in (("open_rim_edges", "edges left open"), ("new_open_edges", "new open edges"))
        if record[name]
    ]
    if not problems:
        return "yes"
    silent = ", without a word" if record["succeeded"] is not False and not record["told"] else ""
    return f"no, {', '.join(problems)}{silent}{', and reports success' if record['succeeded'] else ''}"


WHERE: Mapping[str, Show] = {
    "case": lambda r: Path(r["case"]).name,
    "points": _number("n", "d"),
    "tool": method_name,
    "s": _number("seconds", ".3g"),
}
FILLS: Mapping[str, Show] = {
    "closed": closed,
    "triangles": _number("triangles", "d"),
    "crossings": lambda r: str((r.get("crossings") or 0) + (r.get("mesh_crossings") or 0)),
    "mesh kept": _yes("old_faces_kept"),
    "residual / edge": _number("residual_per_edge", ".1e"),
}
KNOWN_FILLS: Mapping[str, Show] = {
    "surface area error": lambda r: _number("area_error", ".1e")(r) if "spinor" in r["method"] else "",
    "mesh area excess": _number("area_excess", "+.1e"),
    "mesh distance max": _number("distance_max", ".1e"),
    "mesh |H| rms": _number("curvature_rms", ".1e"),
    "min angle °": _number("min_angle", ".0f"),
    "MiB": _number("memory_mib", ".0f"),
}
SAYS: Mapping[str, Show] = {"non-manifold": _number("nonmanifold_edges", "d"), "says": _said}
DISKS: Mapping[str, Show] = {
    "case": lambda r: r["case"],
    "method": method_name,
    "points": _number("n", "d"),
    "s": _number("seconds", ".3g"),
    "MiB": _number("memory_mib", ".0f"),
    "surface area error": lambda r: _number("area_error", ".1e")(r) if "spinor" in r["method"] else "",
    "points' limit": _number("limit_error", ".1e"),
    "surface distance max": _number("surface_distance_max", ".1e"),
    "exact |H| median": _number("exact_curvature_median", ".1e"),
    "triangles": _number("triangles", "d"),
    "mesh area error": _number("mesh_area_error", ".1e"),
    "mesh distance max": _number("distance_max", ".1e"),
    "mesh |H| rms": _number("curvature_rms", ".1e"),
    "rim kept": _yes("rim_kept"),
    "open": _number("open_edges", "d"),
    "crossings": _number("crossings", "d"),
    "min angle °": _number("min_angle", ".0f"),
    "says": lambda r: "" if r["converged"] else "not converged",
}
_DISK_NOTE = (
    "Ours alone have a surface between the vertices; meshes are measured alike for all. The points' limit is the "
    " error of the best usual interpolant of the same points, chosen by who knows the answer."
)
SOLVES: Mapping[str, Show] = {
    "case": lambda r: r["case"] + (f" {OLDER}" if is_older(r) else ""),
    "s": _number("seconds", ".3g"),
    "RMS / edge": _number("rms_per_edge", ".1e"),
    "max / diagonal": _number("max_per_diagonal", ".1e"),
    "area error": _number("area_error", ".1e"),
    "converged": _yes("converged"),
    "stability": lambda r: r.get("verdict") or "",
    "says": lambda r: short(r.get("untrue") or r.get("told") or ""),
}
BATCHED: Mapping[str, Show] = {
    "case": lambda r: r["case"] + (f" {OLDER}" if is_older(r) else ""),
    "files": _number("files", "d"),
    "s": _number("seconds", ".3g"),
    "loops/s": _number("rate", ".2f"),
    "files failed": _number("files_failed", "d"),
    "driver MiB": _number("driver_mib", ".0f"),
    "equal": _yes("equal"),
}


def claim_table(found: Sequence[Figure]) -> Table:
    """The promises, those that are missed marked."""
    rows = tuple((c.suite, c.case, c.text, c.measured, c.kind, "met" if c.met else "**missed**") for c in found)
    missed = frozenset(k for k, c in enumerate(found) if not c.met)
    note = f"{len(found) - len(missed)} of {len(found)} are met. Those of time are told, not checked." if found else ""
    columns = ("suite", "case", "promise", "measured", "kind", "verdict")
    return Table(title="Promises", columns=columns, rows=rows, note=note, marked=missed)


def odd_table(records: Sequence[Record]) -> Table:
    """A line a tool, a column a rim; tools that leave edges open without a word are marked."""
    odd = [r for r in records if r["status"] != "missing"]
    rims, tools = (list(dict.fromkeys(r[name] for r in odd)) for name in ("case", "method"))
    found = {(r["method"], r["case"]): r for r in odd}
    rows = tuple(
        (tool, *(_in_short(found[tool, rim]) if (tool, rim) in found else "" for rim in rims)) for tool in tools
    )
    true = "; ".join(f"{case}: {text}" for case, text in {r["case"]: r["expected"] for r in _done(odd)}.items())
    return Table(
        title="Odd rims, and test cases of other projects",
        columns=("tool", *rims),
        rows=rows,
        note="Patches; pairs of crossing triangles (×); open edges, ! where the tool says nothing about them or tells "
        "of success; the largest angle; seconds. Refused: it says that it did not fill. Doubled: its faces are there "
        f"already. What is true of the rims: {true}.",
        marked=frozenset(k for k, row in enumerate(rows) if any(" !" in cell for cell in row)),
    )


def _in_short(record: Record) -> str:
    if record["status"] != "done":
        return str(record["status"])
    left = record["open_rim_edges"] + record["new_open_edges"]
    patches = record.get("patches") or 0
    if not patches and record["succeeded"] is False:
        return "refused"
    crossings = (record.get("crossings") or 0) + (record.get("mesh_crossings") or 0)
    parts = [
        f"{patches} patches" if patches > 1 else "" if left else "closed" if patches else "doubled",
        f"{crossings} ×" if crossings else "",
        f"{left} open" + ("" if record["succeeded"] is False else " !") if left else "",
        *((f"{record['max_angle']:.0f}°", f"{record['seconds']:.2g} s") if patches else ()),
    ]
    return ", ".join(part for part in parts if part)


def filler_table(records: Sequence[Record]) -> Table:
    """A line a filler: how many cut-outs it closes, how near it is, how smooth, how quick."""
    nearest = list(_nearest(records).values())
    rows = []
    for method in _methods(records):
        here = [r for r in records if r["method"] == method]
        whole = [r for r in here if is_whole(r)]
        bends = [r["bend"] / r["removed_bend"] for r in whole if r["bend"] is not None and r["removed_bend"]]
        rows.append(
            (
                method_name(here[0]),
                f"{len(whole)} of {len(here)}",
                str(sum(bool(r.get("crossings") or r.get("mesh_crossings")) for r in whole)),
                str(sum(r["old_faces_kept"] for r in whole)),
                *(
                    f"{sum(r['method'] == method for r in won) / max(len(won), 1):.0%}"
                    for won in (nearest, [r for r in nearest if r["kind"] == "scan"])
                ),
                _beaten(records, method),
                _median([r["distance"] for r in whole if r["kind"] == "scan"], ".3g"),
                _median(bends, ".2f"),
                _median([r["seconds"] for r in whole], ".3f"),
            )
        )
    columns = ("filler", "closed", "crossing", "mesh kept", "nearest", "nearest on scans", f"{SMOOTH} nearer on scans")
    return Table(
        title="Cut-outs: who puts back what was removed",
        columns=(*columns, "median distance on scans", "median bend", "median s"),
        rows=tuple(rows),
        note="Of patches that close their hole. Distances are per diameter of the hole, the bend across the rim per "
        "the removed piece's.",
    )


def kind_table(records: Sequence[Record]) -> Table:
    """Median distances, a column a kind of hole, a scan a kind of its own; the least of each in bold."""
    whole = [r for r in records if is_whole(r)]
    groups = list(dict.fromkeys(_group(r) for r in whole))
    found = {
        (method, group): [r["distance"] for r in whole if r["method"] == method and _group(r) == group]
        for method in _methods(records)
        for group in groups
    }
    least = {group: min((median(v) for (_, g), v in found.items() if g == group and v), default=0) for group in groups}
    rows = tuple(
        (method, *(_bold(found[method, group], least[group]) for group in groups)) for method in _methods(records)
    )
    return Table(
        title="Cut-outs: median distance by kind",
        columns=("filler", *groups),
        rows=rows if groups else (),
        note="Per diameter of the hole: of new vertices from a known surface, of the triangles from a scan, both ways.",
    )


def _nearest(records: Sequence[Record]) -> dict[str, Record]:
    """The record of the filler that comes nearest, of each case."""
    whole = [r for r in records if is_whole(r)]
    cases = dict.fromkeys(r["case"] for r in whole)
    return {case: min((r for r in whole if r["case"] == case), key=lambda r: r["distance"]) for case in cases}


def _beaten(records: Sequence[Record], method: str) -> str:
    """On what share of the scans' disks our continuation is nearer than a filler."""
    scans = [r for r in records if is_whole(r) and r["kind"] == "scan"]
    mine = {r["case"]: r["distance"] for r in scans if r["method"] == SMOOTH}
    pairs = [(mine[r["case"]], r["distance"]) for r in scans if r["method"] == method != SMOOTH and r["case"] in mine]
    return f"{sum(a < b for a, b in pairs) / len(pairs):.0%}" if pairs else ""


def _methods(records: Sequence[Record]) -> list[str]:
    return list(dict.fromkeys(r["method"] for r in records))


def _group(record: Record) -> str:
    return str(record["case"].rpartition("-")[0] if record["kind"] == "scan" else record["kind"])


def _bold(distances: Sequence[float], least: float) -> str:
    text = _median(distances, ".3g")
    return f"**{text}**" if distances and median(distances) == least else text


def _median(values: Sequence[float], form: str) -> str:
    return format(median(values), form) if values else ""


def trouble_table(records: Sequence[Record]) -> Table:
    """What is missing, refused, failed, crashed or took too long."""
    cases: dict[tuple[str, str, str], list[str]] = {}
    for r in records:
        if r["status"] != "done" and r["suite"] != "odd":
            where = "all" if r["status"] == "missing" else Path(r["case"]).name
            where += f", {r['n']} points" if r.get("n") and where != "all" else ""
            cases.setdefault((r["method"], r["status"], short(r.get("reason") or "")), []).append(where)
    rows = tuple(
        (method, status, on[0] + (f" and {len(set(on)) - 1} more" if len(set(on)) > 1 else ""), reason)
        for (method, status, reason), on in cases.items()
    )
    return Table(
        title="Missing, refused, failed, crashed or too slow", columns=("method", "status", "on", "reason"), rows=rows
    )


def option_table() -> Table:
    """What every method and filler is asked for."""
    rows = [(method.name, "spinor-geom", method.options) for method in LOOP_METHODS.values()]
    rows += [(peer.name, peer.distribution, peer.options) for peer in FILLERS.values()]
    return Table(title="Methods and tools", columns=("name", "package", "options"), rows=tuple(rows))
