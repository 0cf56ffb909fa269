"""The tables of a run: the same rows for the terminal, markdown and the page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from spinor_geom.bench.claims import Claim, claims, time_to_reach
from spinor_geom.bench.fillers import FILLERS
from spinor_geom.bench.isolate import Record
from spinor_geom.bench.methods import LOOP_METHODS
from spinor_geom.bench.scaling import fits

DIGITS = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)
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
    made = [
        claim_table(claims(records)),
        reach_table(records),
        *disk_tables(records),
        hole_table(records),
        odd_summary(records),
        file_table(records),
        file_loop_table(records),
        scaling_table(records),
        cold_table(records),
        trouble_table(records),
        odd_table(records),
    ]
    return [table for table in made if table.rows]


def claim_table(found: Sequence[Claim]) -> Table:
    """The promises, those that are missed marked."""
    rows = tuple((c.case, c.text, c.measured, c.kind, "met" if c.met else "**missed**") for c in found)
    missed = frozenset(k for k, c in enumerate(found) if not c.met)
    note = f"{len(found) - len(missed)} of {len(found)} are met. Those of time are told, not checked." if found else ""
    columns = ("case", "promise", "measured", "kind", "verdict")
    return Table(title="Promises", columns=columns, rows=rows, note=note, marked=missed)


def reach_table(records: Sequence[Record]) -> Table:
    """The cost of a digit: seconds of the quickest measured sampling whose area is right to so much."""
    loops = [r for r in _done(records, "loop") if not r.get("scaling") and r.get("area_error") is not None]
    rows = []
    for case, method in dict.fromkeys((r["case"], r["method"]) for r in loops):
        here = [r for r in loops if (r["case"], r["method"]) == (case, method)]
        seconds = [time_to_reach(here, error) for error in DIGITS]
        if len(here) > 1:
            rows.append((case, method, *("–" if s is None else f"{s:.3g}" for s in seconds)))
    return Table(
        title="Seconds to reach a relative error of the area",
        columns=("case", "method", *(f"{error:.0e}" for error in DIGITS)),
        rows=tuple(rows),
        note="Of the quickest measured sampling that does; – where none does.",
    )


_DISK_COLUMNS: Mapping[str, Callable[[Record], str]] = {
    "method": lambda r: r["method"],
    "points": lambda r: str(r["n"]),
    "edge": lambda r: f"{r['edge']:.3g}",
    "s": lambda r: f"{r['seconds']:.3g}",
    "of that solve": lambda r: _number(r.get("solve_seconds"), ".3g"),
    "MiB": lambda r: _number(r.get("memory_mib"), ".0f"),
    "triangles": lambda r: str(r["triangles"]),
    "area error": lambda r: _number(r.get("area_error"), ".1e"),
    "mesh area error": lambda r: _number(r.get("mesh_area_error"), ".1e"),
    "distance max": lambda r: _number(r.get("distance_max"), ".1e"),
    "mean": lambda r: _number(r.get("distance_mean"), ".1e"),
    "|H| max": lambda r: _number(r.get("curvature_max"), ".1e"),
    "rms": lambda r: _number(r.get("curvature_rms"), ".1e"),
    "exact |H| median": lambda r: _number(r.get("exact_curvature_median"), ".1e"),
    "rim kept": lambda r: _yes(r["rim_kept"]),
    "open": lambda r: str(r["open_edges"]),
    "crossings": lambda r: _number(r.get("crossings"), "d"),
    "min angle": lambda r: f"{r['min_angle']:.0f}°",
    "says": lambda r: "" if r["converged"] else "not converged",
}


def disk_tables(records: Sequence[Record]) -> list[Table]:
    """A table a known case: every method at every sampling."""
    loops = [r for r in _done(records, "loop") if not r.get("scaling")]
    made = []
    for case in dict.fromkeys(r["case"] for r in loops):
        rows = tuple(tuple(show(r) for show in _DISK_COLUMNS.values()) for r in loops if r["case"] == case)
        made.append(Table(title=f"Disks: {case}", columns=tuple(_DISK_COLUMNS), rows=rows))
    return made


def hole_table(records: Sequence[Record]) -> Table:
    """Known rims filled by every tool."""
    rows = tuple(
        (
            r["case"],
            str(r["n"]),
            r["method"],
            f"{r['seconds']:.3g}",
            _number(r.get("memory_mib"), ".0f"),
            str(r["triangles"]),
            _number(r.get("area_excess"), "+.1e"),
            _number(r.get("area_error"), ".1e") if "spinor" in r["method"] else "",
            _number(r.get("distance_max"), ".1e"),
            _number(r.get("curvature_rms"), ".1e"),
            _number(r.get("min_angle"), ".0f"),
            _closed(r),
            _yes(r["rim_kept"]),
            _yes(r["old_faces_kept"]),
            _number(r.get("crossings"), "d"),
        )
        for r in _done(records, "hole")
    )
    columns = (
        *("case", "points", "tool", "s", "MiB", "triangles", "area excess", "exact area error", "distance max"),
        *("|H| rms", "min angle °", "closed", "rim kept", "mesh kept", "crossings"),
    )
    return Table(title="Holes with a known answer", columns=columns, rows=rows)


def odd_table(records: Sequence[Record]) -> Table:
    """What every tool does and says on odd rims."""
    rows: list[tuple[str, ...]] = []
    marked: set[int] = set()
    for r in (r for r in records if r["suite"] == "odd" and r["status"] != "missing"):
        if r["status"] != "done":
            rows.append((r["case"], r["method"], r["status"], "", "", "", _short(r.get("reason", ""))))
            continue
        if r["open_rim_edges"] and r["succeeded"] is not False:
            marked.add(len(rows))
        rows.append(
            (
                r["case"],
                r["method"],
                _closed(r),
                str(r.get("patches", 0)),
                str(r["nonmanifold_edges"]),
                _number(r.get("crossings"), "d"),
                _says(r),
            )
        )
    rows, marked = _by_rim(rows, marked)
    return Table(
        title="Odd rims, in full",
        columns=("rim", "tool", "closed", "patches", "non-manifold edges", "crossings", "says"),
        rows=tuple(rows),
        marked=frozenset(marked),
    )


def odd_summary(records: Sequence[Record]) -> Table:
    """The same in short: a line a tool, a column a rim."""
    odd = [r for r in records if r["suite"] == "odd" and r["status"] != "missing"]
    rims, tools = (list(dict.fromkeys(r[name] for r in odd)) for name in ("case", "method"))
    found = {(r["method"], r["case"]): r for r in odd}
    rows = tuple(
        (tool, *(_in_short(found[tool, rim]) if (tool, rim) in found else "" for rim in rims)) for tool in tools
    )
    note = (
        "Patches, crossings of their triangles (×), and open edges, ! where the tool says nothing about them or "
        f"tells of success; refused: it says that it did not fill. {_expected(records)}"
    )
    return Table(title="Odd rims", columns=("tool", *rims), rows=rows, note=note)


def _in_short(record: Record) -> str:
    if record["status"] != "done":
        return str(record["status"])
    left = record["open_rim_edges"] + record["new_open_edges"]
    if not record.get("patches") and record["succeeded"] is False:
        return "refused"
    patches = record.get("patches", 0)
    parts = [f"{patches} patches" if patches > 1 else "filled" if patches else ""]
    if record.get("crossings"):
        parts.append(f"{record['crossings']} ×")
    if left:
        parts.append(f"{left} open" + ("" if record["succeeded"] is False else " !"))
    return ", ".join(part for part in parts if part)


def _by_rim(rows: list[tuple[str, ...]], marked: set[int]) -> tuple[list[tuple[str, ...]], set[int]]:
    order = sorted(range(len(rows)), key=lambda k: list(dict.fromkeys(r[0] for r in rows)).index(rows[k][0]))
    return [rows[k] for k in order], {place for place, k in enumerate(order) if k in marked}


def _expected(records: Sequence[Record]) -> str:
    told = {r["case"]: r["expected"] for r in _done(records, "odd")}
    return "What is true of them: " + "; ".join(f"{case}: {text}" for case, text in told.items()) + "." if told else ""


def file_table(records: Sequence[Record]) -> Table:
    """Mesh files with all their holes, by every tool."""
    rows = []
    for r in (r for r in records if r["suite"] == "file" and r["status"] != "missing"):
        name = Path(r["case"]).name
        if r["status"] != "done":
            rows.append((name, r["method"], r["status"], "", "", "", "", "", _short(r.get("reason", ""))))
            continue
        rows.append(
            (
                name,
                r["method"],
                _closed(r),
                f"{r['seconds']:.3g}",
                str(r["triangles"]),
                str(r["nonmanifold_edges"]),
                _yes(r["old_faces_kept"]),
                _number(r.get("crossings"), "d"),
                _says(r),
            )
        )
    columns = ("mesh", "tool", "closed", "s", "new triangles", "non-manifold", "mesh kept", "crossings", "says")
    return Table(title="Mesh files, all holes", columns=columns, rows=tuple(rows))


def file_loop_table(records: Sequence[Record]) -> Table:
    """The loops of mesh files as bare curves: how many each method spans, and how much."""
    loops = [r for r in records if r["suite"] == "file loop"]
    rows = []
    for case, method in dict.fromkeys((r["case"], r["method"]) for r in loops):
        here = [r for r in loops if (r["case"], r["method"]) == (case, method)]
        done = [r for r in here if r["status"] == "done"]
        converged = [r for r in done if r["converged"]]
        rows.append(
            (
                Path(case).name,
                method,
                str(len(here)),
                str(len(done)),
                str(len(converged)),
                f"{sum(r['seconds'] for r in done):.3g}",
                _number(_median([r["curvature_rms"] for r in done]), ".1e"),
                _number(_median([r["residual_per_edge"] for r in done if "residual_per_edge" in r]), ".1e"),
                str(sum(r.get("crossings") or 0 for r in done)),
            )
        )
    columns = (
        *("mesh", "method", "loops", "spanned", "converged", "s"),
        *("median |H| rms · diameter", "median residual / edge", "crossings"),
    )
    return Table(title="Mesh files, loops as bare curves", columns=columns, rows=tuple(rows))


def scaling_table(records: Sequence[Record]) -> Table:
    """Fitted exponents with what they were fitted over."""
    rows = []
    for fit in fits(records):
        exponent = "" if fit.exponent is None else f"{fit.exponent:.2f} ± {fit.error:.2f}"
        measured = ", ".join(f"{n:g}: {s:.3g} s" for n, s in zip(fit.sizes, fit.seconds, strict=True))
        rows.append((fit.method, fit.size, exponent, measured))
    return Table(
        title="Growth of the time",
        columns=("method", "with", "exponent", "measured"),
        rows=tuple(rows),
        note="Slope of log(seconds) by log(size) with its standard error.",
    )


def cold_table(records: Sequence[Record]) -> Table:
    """First calls of a process, imports and all, beside the same call again."""
    rows = tuple(
        (r["method"], r["case"], f"{r['cold_seconds']:.3g}", f"{r['seconds']:.3g}")
        for r in records
        if r["status"] == "done" and r.get("cold_seconds") is not None
    )
    return Table(title="Cold starts", columns=("method", "case", "first call s", "later calls s"), rows=rows)


def trouble_table(records: Sequence[Record]) -> Table:
    """What is missing, refused, failed, crashed or took too long."""
    reasons: dict[tuple[str, str, str], list[str]] = {}
    for r in records:
        if r["status"] != "done" and r["suite"] not in ("odd", "file"):
            where = Path(r["case"]).name + (f", {r['n']} points" if r.get("n") else "")
            reasons.setdefault((r["method"], r["status"], _short(r.get("reason", ""))), []).append(where)
    missing = {r["method"]: r["reason"] for r in records if r["status"] == "missing"}
    rows = [(method, "missing", "all", reason) for method, reason in missing.items()]
    rows += [
        (method, status, cases[0] + (f" and {len(cases) - 1} more" if len(cases) > 1 else ""), reason)
        for (method, status, reason), cases in reasons.items()
        if status != "missing"
    ]
    columns = ("method", "status", "on", "reason")
    return Table(title="Missing, refused, failed, crashed or too slow", columns=columns, rows=tuple(rows))


def option_table() -> Table:
    """What every method and filler is asked for."""
    rows = [(method.name, "spinor-geom", method.options) for method in LOOP_METHODS.values()]
    rows += [(peer.name, peer.distribution, peer.options) for peer in FILLERS.values()]
    return Table(title="Methods and tools", columns=("name", "package", "options"), rows=tuple(rows))


def _done(records: Sequence[Record], suite: str) -> list[Record]:
    return [r for r in records if r["suite"] == suite and r["status"] == "done"]


def _closed(record: Record) -> str:
    problems = []
    if record["open_rim_edges"]:
        problems.append(f"{record['open_rim_edges']} edges left open")
    if record["new_open_edges"]:
        problems.append(f"{record['new_open_edges']} new open edges")
    if not problems:
        return "yes"
    silent = record["succeeded"] is not False
    return (
        "no, "
        + ", ".join(problems)
        + (", without a word" if silent and not record["told"] else "")
        + (", and reports success" if record["succeeded"] else "")
    )


def _says(record: Record) -> str:
    return _short(record["told"] or record.get("said", "") or "nothing")


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= _SAID else text[: _SAID - 1].rstrip() + "…"


def _number(value: Any, form: str) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return format(value, form)


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _median(values: Sequence[float]) -> float | None:
    ordered = sorted(values)
    return ordered[len(ordered) // 2] if ordered else None
