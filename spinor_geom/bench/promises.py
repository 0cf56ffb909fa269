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
from spinor_geom.bench.ragged import CUT, NOISY
from spinor_geom.bench.solves import SUITES as SOLVED
from spinor_geom.bench.solves import Kind, Limit, solves

# largest seconds of a whole fill per those of the reference, by points of the rim
REFERENCE, REFERENCE_CASE, REFERENCE_SHARE = "meshlib-nicely", "enneper-0.8", {64: 4.0, 256: 1.0, 1000: 0.333}
SAME_LOAD = 1.0  # seconds are compared if the loads differ by at most this
LEAST_POINTS = 64  # of a loop that is compared with its smooth curve
CAP_DISTANCES = dict(zip(HEIGHTS, (2e-3, 4e-3, 8e-3, 2e-2), strict=True))  # from unit spheres, by the caps' heights
WORKER_MIB = 1536.0  # memory of a batch's largest process
_ROUNDING = 1e-15  # smaller errors are rounding
_NOISY_SECONDS = {100: 0.15, 250: 0.5, 600: 2.0, 1200: 6.0}  # by points of noisy rims
_RATES = {  # loops per second
    "smooth loops": 60.0,
    "loops with 5% noise": 10.0,
    "rims cut along triangles": 12.0,
    "solved only, on CUDA": 2e3,
}
# CPU seconds of a new process, with compiled modules, and its memory
_STARTS = {"help": 0.1, "loops of a small mesh": 0.5, "fill of a small mesh": 0.7, "worker of a batch": 1.0}
_START_MIB = 160.0
# ratios of two batches' rates
_FASTER = (
    ("smooth loops", "one worker", "smooth loops, one worker", 1.8),
    ("solved only, 64 at once", "one by one", "solved only, one by one", 8.0),
)
# least ratios of the area errors of discrete surfaces and of other fillers to ours; largest ratio of ours to the limit
# error
_CLOSER, _NEARER, _OF_LIMIT = 1e3, 1e4, 10.0
_SLOWER = 3.0  # largest ratio of our seconds to those of discrete surfaces
_WITHIN = 1e-3  # residual per mean edge
_SHARP = 130.0  # degrees; at sharper rims more than one vertex in ten turns by more than this


@dataclass(frozen=True)
class Promise:
    """A promise and what was measured; those of kind "time" do not change the exit status."""

    suite: str
    case: str
    text: str
    measured: str
    met: bool
    kind: Kind = "accuracy"


def promises(records: Sequence[Record]) -> list[Promise]:
    """All promises about the records."""
    suites = {suite: [r for r in records if r["suite"] == suite] for suite in names(records, "suite")}
    done = {suite: [r for r in here if r["status"] == "done"] for suite, here in suites.items()}
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
    found += _ragged([r for r in done.get("ragged", []) if r["method"] == OURS])
    found += _reports(done.get("reports", []))
    found += _meshes([r for r in done.get("meshes", []) if r["method"] == OURS and "within_1e-2" in r])
    for record in records:
        # an error counts as a missed promise
        if record["suite"] in SOLVED and record["case"] in solves() and record["method"] == "spinor":
            found += [judged(limit, record) for limit in solves()[record["case"]].limits]
    found += _random([r for r in suites.get("curves", []) if r["case"].startswith("random curve")])
    return [*found, *_batch(done.get("batch", [])), *_start(done.get("start", []))]


def names(records: Iterable[Record], field: str) -> list[str]:
    """The values of a field, each once."""
    return list(dict.fromkeys(r[field] for r in records))


def _by_case(records: Sequence[Record]) -> dict[str, list[Record]]:
    return {case: [r for r in records if r["case"] == case] for case in names(records, "case")}


def _comparable(one: Record, other: Record) -> bool:
    """Whether the seconds of two records were measured at similar loads; true if a load is unknown."""
    loads = [load for r in (one, other) if (load := r.get("load")) is not None]
    return len(loads) < 2 or abs(loads[0] - loads[1]) <= SAME_LOAD


def _disks(case: str, here: list[Record]) -> Iterator[Promise]:
    ours = [r for r in here if r["method"] == "spinor"]
    if not ours:
        return
    errors, kind = [r["area_error"] for r in ours], known_kind(case)
    if kind == "smooth":
        for baseline in ("libigl", "libigl-uniform"):
            yield from _beside(case, baseline, ours, {r["n"]: r for r in here if r["method"] == baseline})
        digits = 1e-5 if case.endswith("@uneven") else 1e-6  # uneven points determine their curve less well
        text = f"area error at most {digits:g} for at least one number of points"
        yield Promise("disks", case, text, f"{min(errors):.1e}", min(errors) <= digits)
    if kind == "plane":
        yield from at_most("disks", case, "error of the area", errors, 1e-10)
    values = [r["exact_curvature_median"] for r in ours if r.get("exact_curvature_median") is not None]
    yield from at_most("disks", case, "median exact |H| per diameter", values or [math.nan], 1e-9)
    closed = [r["rim_kept"] and not r["open_edges"] and not r.get("nonmanifold_edges") for r in ours]
    yield from share("disks", case, "every disk keeps the rim, bit for bit, and leaves no edge open", closed)


def _beside(case: str, name: str, ours: list[Record], baseline: dict[int, Record]) -> Iterator[Promise]:
    """Compares our area error and seconds at each number of points with those of a discrete surface."""
    pairs = [(r, baseline[r["n"]]) for r in ours if r["n"] >= LEAST_POINTS and r["n"] in baseline]
    if pairs:
        closer, n = min((o["area_error"] / max(m["area_error"], _ROUNDING), m["n"]) for m, o in pairs)
        text = f"area error at most that of {name} / {_CLOSER:g}, or {_OF_LIMIT:g} times the limit error"
        met = all(
            m["area_error"] <= max(_ROUNDING, o["area_error"] / _CLOSER, _OF_LIMIT * (m.get("limit_error") or 0))
            for m, o in pairs
        )
        yield Promise("disks", case, text, f"{closer:.1e} times at {n} points", met)
    ratios = [(m["seconds"] / o["seconds"], m["n"]) for m, o in pairs if _comparable(m, o)]
    if ratios:
        slower, n = max(ratios)
        text, measured = f"at most {_SLOWER:g} times the seconds of {name}", f"{slower:.2f} times at {n} points"
        yield Promise("disks", case, text, measured, slower <= _SLOWER, "time")


def _closed(record: Record) -> bool:
    # published records of some suites lack columns
    kept = record.get("rim_kept", True) and record["old_faces_kept"]
    return bool(kept and not any(record.get(f"{kind}_edges") for kind in ("open_rim", "new_open", "nonmanifold")))


def _fills(case: str, here: list[Record]) -> Iterator[Promise]:
    ours = [r for r in here if r["method"] == OURS]
    text = "every fill closes the rim and keeps the mesh, bit for bit"
    yield from share("fills", case, text, [_closed(r) for r in ours])
    reference = {r["n"]: r for r in here if r["method"] == REFERENCE and case == REFERENCE_CASE}
    for mine in ours:
        n, other = mine["n"], reference.get(mine["n"])
        if other is not None and n in REFERENCE_SHARE and _comparable(mine, other):
            ratio, most = mine["seconds"] / other["seconds"], REFERENCE_SHARE[n]
            text = f"whole fill of {n} points in at most {most:g} times the seconds of {REFERENCE}"
            yield Promise("fills", case, text, f"{ratio:.2f} times", ratio <= most, "time")
    if known_kind(case) != "plane":
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


def _ragged(ours: list[Record]) -> Iterator[Promise]:
    rims = [r for r in ours if r["case"] in CUT]
    yield from share("ragged", "cut", "no patch crosses anything", [not crossings(r) for r in rims])
    for name, sharp, least in (("milder rims", False, 0.95), ("sharper rims", True, 0.6)):
        residuals = [r.get("residual_per_edge") for r in rims if (r["sharpness"] >= _SHARP) == sharp]
        near = [residual is not None and residual <= _WITHIN for residual in residuals]
        yield from share("ragged", name, f"patches within {_WITHIN:g} of an edge", near, least)
    if seconds := [r["seconds"] for r in rims]:
        yield from at_most("ragged", "cut", "seconds, median,", [median(seconds)], 0.15, "time")
        yield from at_most("ragged", "cut", "seconds", seconds, 1.0, "time")
    for record in (r for r in ours if r["case"] in NOISY):
        noise, points = NOISY[record["case"]]
        allowed = _WITHIN if noise < 0.2 else 1e-2
        yield judged(Limit("residual_per_edge", "RMS residual, in mean edges,", allowed), record)
        yield judged(Limit("seconds", "seconds", _NOISY_SECONDS[points], "time"), record)


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


def _meshes(ours: list[Record]) -> Iterator[Promise]:
    if ours:
        loops, near = (sum(r[name] for r in ours) for name in ("requested", "within_1e-2"))
        text = "at least 90% of the loops within 1e-2 of an edge"
        yield Promise("meshes", "all meshes", text, f"{near} of {loops}", near >= 0.9 * loops)
    explained = [not r.get("unexplained") for r in ours]
    yield from share("meshes", "all meshes", "every loop that is left open has a reason", explained)


def _random(curves: list[Record]) -> Iterator[Promise]:
    """The promises of all random curves together; an error counts as an infinite distance."""
    rms = {r["case"]: math.inf if r.get("rms_per_edge") is None else r["rms_per_edge"] for r in curves}
    near, true = [value <= 1e-2 for value in rms.values()], [not r.get("untrue") for r in curves]
    yield from share("curves", "random curves", "within 1e-2 of an edge", near, 0.98)
    yield from share("curves", "random curves", "reported properties agree with measurements", true)
    for odd, noise, limit in ((0, "without noise", 1e-6), (1, "with 15% noise", 2e-3)):
        if chosen := [v for name, v in rms.items() if int(name.rpartition(" ")[2]) % 2 == odd]:
            text = f"median RMS distance from Γ, in mean edges, {noise}"
            yield from at_most("curves", "random curves", text, [median(chosen)], limit)


def _batch(done: list[Record]) -> Iterator[Promise]:
    here = {r["case"]: r for r in done}
    for case in (name for name in _RATES if name in here):
        rate, least = here[case]["rate"], _RATES[case]
        yield Promise("batch", case, f"loops per second at least {least:g}", f"{rate:.3g}", rate >= least, "time")
    for case, name, of, least in _FASTER:
        whole, alone = here.get(case), here.get(of)
        if whole and alone and _comparable(whole, alone):
            ratio, text = whole["rate"] / alone["rate"], f"rate / that of {name} at least {least:g}"
            yield Promise("batch", case, text, f"{ratio:.3g}", ratio >= least, "time")
    for case, record in here.items():
        if record.get("worker_mib"):
            yield from at_most("batch", case, "MiB of the largest process", [record["worker_mib"]], WORKER_MIB)
    few, many = here.get("few inputs"), here.get("ten times as many inputs")
    if few and many:
        growth = [many["driver_mib"] / few["driver_mib"]]
        yield from at_most("batch", many["case"], "memory of the driver / that for few inputs", growth, 1.1)
    for record in (r for r in done if r.get("equal") is not None):
        yield judged(Limit("equal", "equal to the last bit", True), record)


def _start(done: list[Record]) -> Iterator[Promise]:
    for record in (r for r in done if r["case"] in _STARTS):
        yield from at_most("start", record["case"], "CPU seconds", [record["seconds"]], _STARTS[record["case"]], "time")
    for record in done:
        yield from at_most("start", record["case"], "MiB of memory", [record["memory_mib"]], _START_MIB)
        yield judged(Limit("torch", "torch is imported", False), record)


def judged(limit: Limit, record: Record) -> Promise:
    """Compares a record with a limit; a missing value or NaN misses it."""
    exact = isinstance(limit.value, str | bool)
    found = record.get(limit.field) if record["status"] == "done" else record["status"]
    if exact or found is None or isinstance(found, str):
        met, measured = found == limit.value, {True: "yes", False: "no", None: "not measured"}.get(found, str(found))
    else:
        met, measured = bool(found <= limit.value), f"{found:.3g}"
    text = limit.name if limit.value is True else f"{limit.name}: {limit.value}"
    text = text if exact else f"{limit.name} at most {limit.value:g}"
    return Promise(record["suite"], record["case"], text, measured, met, limit.kind)


def at_most(
    suite: str, case: str, text: str, values: Sequence[float], limit: float, kind: Kind = "accuracy"
) -> Iterator[Promise]:
    """The promise that no value exceeds a limit; nothing without values."""
    if values:
        measured = f"{max(values):.3g}" + (f" at most, {median(values):.3g} in the median" if len(values) > 1 else "")
        yield Promise(suite, case, f"{text} at most {limit:.3g}", measured, max(values) <= limit, kind)


def share(suite: str, case: str, text: str, met: Sequence[bool], least: float = 1.0) -> Iterator[Promise]:
    """The promise that at least a share of the records meets a condition; nothing without records."""
    if met:
        text += "" if least == 1 else f", at least {least:.0%}"
        yield Promise(suite, case, text, f"{sum(met)} of {len(met)}", sum(met) >= least * len(met))
