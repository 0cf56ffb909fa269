"""Promises: limits for the records of a benchmark, and whether the records meet them."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from statistics import median

from spinor_geom.bench.cases import known_kind
from spinor_geom.bench.cut_outs import HEIGHTS
from spinor_geom.bench.fillers import CLEAREST, OUR_FILLERS, OURS, SMOOTH
from spinor_geom.bench.frames import CAD
from spinor_geom.bench.machine import Record
from spinor_geom.bench.odd_holes import NOTHING_MISSING

LEAST_POINTS = 64  # of a loop that is compared with its smooth curve
CAP_DISTANCES = dict(zip(HEIGHTS, (2e-3, 4e-3, 8e-3, 2e-2), strict=True))  # from unit spheres, by the caps' heights
_ROUNDING = 1e-15  # smaller errors are rounding
# least ratios of the area errors of discrete surfaces and of other fillers to ours, largest ratio of ours to the limit
# error
_CLOSER, _NEARER, _OF_LIMIT = 1e3, 1e4, 10.0


@dataclass(frozen=True)
class Promise:
    """A promise and what was measured."""

    suite: str
    case: str
    text: str
    measured: str
    met: bool


def promises(records: Sequence[Record]) -> list[Promise]:
    """All promises about the records."""
    finished = [r for r in records if r["status"] == "done"]
    done = {suite: [r for r in finished if r["suite"] == suite] for suite in names(finished, "suite")}
    found: list[Promise] = []
    for case, here in _by_case(done.get("disks", [])).items():
        found += _disks(case, [r for r in here if r["area_error"] is not None])
    for case, here in _by_case(done.get("fills", [])).items():
        found += _fills(case, here)
    for case, here in _by_case(done.get("odd", [])).items():
        # a catenoid between two rims is compared with other fillers that join them
        found += _nearer("odd", case, [r for r in here if r.get("area_error") is not None and r.get("patches") == 1])
    found += _cut_outs(done.get("cut-outs", []))
    for case, here in _by_case([r for r in done.get("cad", []) if r["method"] == CAD]).items():
        found += _frame(case, here)
    found += _reports(done.get("reports", []))
    return found


def names(records: Iterable[Record], field: str) -> list[str]:
    """The values of a field, each once."""
    return list(dict.fromkeys(r[field] for r in records))


def _by_case(records: Sequence[Record]) -> dict[str, list[Record]]:
    return {case: [r for r in records if r["case"] == case] for case in names(records, "case")}


def _disks(case: str, here: list[Record]) -> Iterator[Promise]:
    ours = [r for r in here if r["method"] == "spinor"]
    if not ours:
        return
    for baseline in ("libigl", "libigl-uniform"):
        yield from _beside(case, baseline, ours, {r["n"]: r for r in here if r["method"] == baseline})
    least, digits = min(r["area_error"] for r in ours), 1e-5 if case.endswith("@uneven") else 1e-6
    text = f"area error at most {digits:g} for at least one number of points"
    yield Promise("disks", case, text, f"{least:.1e}", least <= digits)
    values = [r["exact_curvature_median"] for r in ours if r.get("exact_curvature_median") is not None]
    yield from at_most("disks", case, "median exact |H| per diameter", values or [math.nan], 1e-9)
    closed = [r["rim_kept"] and not r["open_edges"] and not r.get("nonmanifold_edges") for r in ours]
    yield from share("disks", case, "every disk keeps the rim, bit for bit, and leaves no edge open", closed)


def _beside(case: str, name: str, ours: list[Record], baseline: dict[int, Record]) -> Iterator[Promise]:
    """Compares our area error at each number of points with that of a discrete surface."""
    pairs = [(r, baseline[r["n"]]) for r in ours if r["n"] >= LEAST_POINTS and r["n"] in baseline]
    if pairs:
        closer, n = min((o["area_error"] / max(m["area_error"], _ROUNDING), m["n"]) for m, o in pairs)
        text = f"area error at most that of {name} / {_CLOSER:g}, or {_OF_LIMIT:g} times the limit error"
        met = all(
            m["area_error"] <= max(_ROUNDING, o["area_error"] / _CLOSER, _OF_LIMIT * (m.get("limit_error") or 0))
            for m, o in pairs
        )
        yield Promise("disks", case, text, f"{closer:.1e} times at {n} points", met)


def _closed(record: Record) -> bool:
    # published records of some suites lack columns
    kept = record.get("rim_kept", True) and record["old_faces_kept"]
    return bool(kept and not any(record.get(f"{kind}_edges") for kind in ("open_rim", "new_open", "nonmanifold")))


def _fills(case: str, here: list[Record]) -> Iterator[Promise]:
    ours = [r for r in here if r["method"] == OURS]
    text = "every fill closes the rim and keeps the mesh, bit for bit"
    yield from share("fills", case, text, [_closed(r) for r in ours])
    if known_kind(case) == "plane":
        areas = [r["area_error"] for r in ours if r.get("area_error") is not None]
        yield from at_most("fills", case, "error of the area", areas, 1e-10)
    else:
        yield from _nearer("fills", case, here)


def _nearer(suite: str, case: str, here: Sequence[Record]) -> Iterator[Promise]:
    """Compares our area error with those of the other fillers that close the hole."""
    known = [r for r in here if r.get("area_error") is not None and r["open_rim_edges"] == 0]
    ratios = [
        (other["area_error"] / max(mine["area_error"], _ROUNDING), other["method"])
        for mine in known
        for other in known
        if mine["method"] == OURS and other["method"] not in OUR_FILLERS and other.get("n") == mine.get("n")
    ]
    if ratios:
        least, method = min(ratios)
        text = f"area error at most that of every other filler / {_NEARER:g}"
        yield Promise(suite, case, text, f"that of {method} / {least:.1e}", least >= _NEARER)


def is_whole(record: Record) -> bool:
    """Whether a cut-out was closed, so that the distance of its patch is comparable."""
    done = record["status"] == "done" and record.get("distance") is not None
    return done and record["open_rim_edges"] == record["new_open_edges"] == 0


def _frame(case: str, ours: list[Record]) -> Iterator[Promise]:
    """The promises of shells over CAD edges, after a round trip through STEP."""
    area = 1e-6 if known_kind(case) == "corners" else 1e-7
    yield from at_most("cad", case, "error of the area", [r["area_error"] for r in ours], area)
    distances = [r["rim_distance"] for r in ours]
    yield from at_most("cad", case, "largest distance of the rim from the edges, per diameter", distances, 1e-7)
    yield from at_most("cad", case, "number of faces", [r["faces"] for r in ours], 30)
    yield from share("cad", case, "valid for Open CASCADE", [r["valid"] for r in ours])


def _cut_outs(done: list[Record]) -> Iterator[Promise]:
    """The promises of the smooth continuation."""
    suite = "cut-outs"
    closed = [_closed(r) for r in done if r["method"] == SMOOTH]
    yield from share(suite, suite, "every continuation closes the rim and keeps the mesh, bit for bit", closed)
    whole = [r for r in done if is_whole(r)]
    ours, others = [r for r in whole if r["method"] == SMOOTH], [r for r in whole if r["method"] not in OUR_FILLERS]
    least = {case: min(r["distance"] for r in here) for case, here in _by_case(others).items()}
    for height, limit in CAP_DISTANCES.items():
        caps = [r for r in ours if r["kind"] == "dome" and r["case"].endswith(f"-{height:g}")]
        away = [r["vertex_distance"] * r["diameter"] for r in caps if r.get("vertex_distance") is not None]
        text = f"new vertices of caps above z = {height:g}, root mean square distance from the unit sphere,"
        yield from at_most(suite, "caps", text, away, limit)
    for case, kinds, most in (("caps", ("dome",), 1 / 4), ("windows", ("curved", "long"), 1 / 3)):
        ratios = [r["distance"] / least[r["case"]] for r in ours if r["kind"] in kinds and r["case"] in least]
        yield from at_most(suite, case, "distance / that of the best other filler", ratios, most)
    flat = [r["surface_distance"] for r in ours if r["kind"] == "flat"]
    yield from at_most(suite, "plane-window", "distance from the plane, per diameter", flat, 1e-12)
    yield from at_most(suite, suite, "bend across the rim / that of the removed piece", bend_ratios(ours), 1.3)
    mine, theirs = ([r for r in some if r["kind"] == "scan"] for some in (ours, others))
    if mine and theirs:
        won = [r["distance"] <= least.get(r["case"], math.inf) for r in mine]
        yield from share(suite, "scans", "nearer than every other filler", won, 0.85)
        best = min(median(r["distance"] for r in theirs if r["method"] == name) for name in names(theirs, "method"))
        ratio = median(r["distance"] for r in mine) / best
        yield from at_most(suite, "scans", "median distance / that of the best other filler", [ratio], 0.6)


def bend_ratios(records: Iterable[Record]) -> list[float]:
    """Ratios of the bends across rims to those of the removed pieces."""
    return [r["bend"] / r["removed_bend"] for r in records if r["bend"] is not None and r["removed_bend"]]


def _reports(done: list[Record]) -> Iterator[Promise]:
    for method in OUR_FILLERS:
        here = [r for r in done if r["method"] == method]
        clear = {r["case"] for r in done if r["method"] in CLEAREST and _closed(r) and not crossings(r)}
        text = "no patch crosses anything if a patch of CGAL or PyMeshFix does not"
        yield from share("reports", method, text, [not crossings(r) for r in here if r["case"] in clear])
        steep = [_closed(r) for r in here if r["case"].startswith(("bowl", "tube"))]
        yield from share("reports", method, "every bowl and tube is closed, the mesh is kept, bit for bit", steep)
        kept = [not r.get("patches") for r in here if r["case"] in NOTHING_MISSING]
        yield from share("reports", method, "no patch over loops that are not holes", kept)


def crossings(record: Record) -> int:
    """Pairs of crossing triangles, of patches and of patches and the mesh."""
    return (record.get("crossings") or 0) + (record.get("mesh_crossings") or 0)


def at_most(suite: str, case: str, text: str, values: Sequence[float], limit: float) -> Iterator[Promise]:
    """The promise that no value exceeds a limit, and nothing without values."""
    if values:
        measured = "not measured" if math.isnan(max(values)) else f"{max(values):.3g}"
        measured += f" at most, {median(values):.3g} in the median" if len(values) > 1 else ""
        yield Promise(suite, case, f"{text} at most {limit:.3g}", measured, max(values) <= limit)


def share(suite: str, case: str, text: str, met: Sequence[bool], least: float = 1.0) -> Iterator[Promise]:
    """The promise that at least a share of the records meets a condition, and nothing without records."""
    if met:
        text += "" if least == 1 else f", at least {least:.0%}"
        yield Promise(suite, case, text, f"{sum(met)} of {len(met)}", sum(met) >= least * len(met))
