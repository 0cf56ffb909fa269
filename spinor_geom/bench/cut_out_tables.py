"""The tables of cut-outs: which filler puts back what was removed, and what all do with other projects' test cases."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from spinor_geom.bench.claims import cap_distances, is_whole
from spinor_geom.bench.cut_outs import HEIGHTS
from spinor_geom.bench.fillers import SMOOTH
from spinor_geom.bench.holes import PEER_TESTS
from spinor_geom.bench.isolate import Record
from spinor_geom.bench.tables import Table


def cut_out_tables(records: Sequence[Record]) -> list[Table]:
    """All of them that have rows."""
    cut_outs = [r for r in records if r["suite"] == "cut-out" and r["status"] != "missing"]
    made = [filler_table(cut_outs), kind_table(cut_outs), cap_table(cut_outs), peer_test_table(records)]
    return [table for table in made if table.rows]


def filler_table(records: Sequence[Record]) -> Table:
    """A line a filler: how many holes it closes, how near it is, how smooth, how quick."""
    nearest = list(_nearest(records).values())
    rows = []
    for method in _methods(records):
        here = [r for r in records if r["method"] == method]
        whole = [r for r in here if is_whole(r)]
        bends = [r["bend"] / r["removed_bend"] for r in whole if r["bend"] is not None and r["removed_bend"]]
        rows.append(
            (
                method,
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
        rows=rows,
        note="Per diameter of the hole: of new vertices from a known surface, of the triangles from a scan, both ways.",
    )


def cap_table(records: Sequence[Record]) -> Table:
    """Distances of the new vertices from unit spheres, a column a height."""
    rows = []
    for method in _methods(records):
        cells = []
        for height in HEIGHTS:
            found = cap_distances([r for r in records if r["method"] == method], height)
            cells.append(f"{median(found):.1e} to {max(found):.1e}" if found else "")
        rows.append((method, *cells))
    return Table(
        title="Caps of unit spheres",
        columns=("filler", *(f"z > {height:g}" for height in HEIGHTS)),
        rows=tuple(row for row in rows if any(row[1:])),
        note="Root mean square distance of the new vertices from the sphere: median and largest of four meshes.",
    )


def peer_test_table(records: Sequence[Record]) -> Table:
    """A line a tool, a column a case: open edges, crossings, the largest angle and the seconds."""
    odd = {(r["method"], r["case"]): r for r in records if r["suite"] == "odd" and r["status"] != "missing"}
    cases = [name for name in PEER_TESTS if any(case == name for _, case in odd)]
    rows = tuple(
        (method, *(_told(odd[method, case]) if (method, case) in odd else "" for case in cases))
        for method in dict.fromkeys(method for method, _ in odd)
    )
    return Table(
        title="Test cases of other projects",
        columns=("tool", *cases),
        rows=rows if cases else (),
        note="Closed or the number of open edges; pairs of crossing triangles (×); the largest angle; seconds.",
    )


def _told(record: Record) -> str:
    if record["status"] != "done":
        return str(record["status"])
    left = record["open_rim_edges"] + record["new_open_edges"]
    if not record.get("patches"):
        # faces on the same three vertices as others are no new ones
        return "refused" if record["succeeded"] is False else f"{left} open" if left else "doubled"
    crossings = record["crossings"] + record["mesh_crossings"]
    parts = [f"{left} open" if left else "closed", f"{crossings} ×" if crossings else ""]
    return ", ".join(part for part in (*parts, f"{record['max_angle']:.0f}°", f"{record['seconds']:.2g} s") if part)


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
