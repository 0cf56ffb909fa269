"""What the project promises of a run, beside what the run measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from statistics import median

from spinor_geom.bench.cases import known_kind
from spinor_geom.bench.cut_outs import HEIGHTS
from spinor_geom.bench.figures import Figure, Kind, Limit
from spinor_geom.bench.fillers import OUR_FILLERS, OURS, SMOOTH
from spinor_geom.bench.isolate import Record
from spinor_geom.bench.ragged import CUT, NOISY
from spinor_geom.bench.solves import SUITES as SOLVED
from spinor_geom.bench.solves import solves

# than the libigl baseline, in area and in seconds; or no farther than so many times what the points tell
CLOSER, SLOWER, OF_LIMIT = 1e3, 3.0, 10.0
OUR_DIGITS, UNEVEN_DIGITS = 1e-6, 1e-5  # points at edges of random lengths say less of their curve
PLANE_AREA = 1e-10
CURVATURE = 1e-9  # per diameter
NEARER = 1e4  # area errors of hole fillers, per ours
# largest share of the reference's seconds for a whole fill, by points of the rim
REFERENCE, REFERENCE_CASE, REFERENCE_SHARE = "meshlib-nicely", "enneper-0.8", {64: 4.0, 256: 1.0, 1000: 0.333}
SAME_LOAD = 1.0  # seconds at loads further apart are not compared
# of the smooth continuation: distances from unit spheres by the caps' heights; distances per those of the best other
# filler, on caps, on windows, and in the median on scans; share of the scans' disks where it is nearest of all; bend
# across the rim per the removed piece's; distance in a plane, per diameter
CAP_DISTANCES = dict(zip(HEIGHTS, (2e-3, 4e-3, 8e-3, 2e-2), strict=True))
CAP_SHARE, WINDOW_SHARE, SCAN_SHARE, NEAREST, BEND, FLAT = 1 / 4, 1 / 3, 0.6, 0.85, 1.3, 1e-12
LEAST_POINTS = 64  # of a loop that stands for a smooth curve
BASELINES = ("libigl", "libigl-uniform")
# errors below this are rounding
ROUNDING = 1e-15
# of patches over rims cut along triangles: residual per mean edge; nine points in ten turn by less, in degrees, on the
# milder ones; shares of both that are within; seconds
WITHIN, SHARP, MILD_SHARE, SHARP_SHARE, FILL_SECONDS, SLOWEST_FILL = 1e-3, 130.0, 0.95, 0.6, 0.15, 1.0
NOISY_SECONDS = {100: 0.15, 250: 0.5, 600: 2.0, 1200: 6.0}
MESH_SHARE = 0.9  # of the loops of mesh files, within a hundredth of an edge
# of random curves: within a hundredth of an edge; median distances without noise and with it, in edges
RANDOM_SHARE, RANDOM_MEDIAN, RANDOM_NOISY_MEDIAN = 0.98, 1e-6, 2e-3
# of batches: loops a second; times the rate of one worker; times the driver's memory
RATES = {"smooth loops": 60.0, "loops with 5% noise": 10.0, "rims cut along triangles": 12.0}
SPEED_UP, GROWTH = 1.8, 1.1


def claims(records: Sequence[Record]) -> list[Figure]:
    """All promises that the records speak of."""
    done = [r for r in records if r["status"] == "done"]
    here = {suite: [r for r in done if r["suite"] == suite] for suite in dict.fromkeys(r["suite"] for r in done)}
    found: list[Figure] = []
    for case, group in _by_case(r for r in here.get("disks", []) if r["area_error"] is not None).items():
        found += _disks(case, group)
    for case, group in _by_case(here.get("fills", [])).items():
        found += _fillers(case, group)
    found += _stitched(here.get("odd", []))
    found += _continued(here.get("cut-outs", []))
    found += _ragged(here.get("ragged", []))
    found += _meshes(here.get("meshes", []))
    for record in records:
        # what ours refuses is a promise missed
        if record["suite"] in SOLVED and record["case"] in solves() and record["method"] == "spinor":
            found += [limit.of(record) for limit in solves()[record["case"]].limits]
    return [*found, *_random(records), *_batch(here.get("batch", []))]


def _by_case(records: Sequence[Record] | Iterator[Record]) -> dict[str, list[Record]]:
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(record["case"], []).append(record)
    return groups


def _disks(case: str, here: list[Record]) -> list[Figure]:
    ours = [r for r in here if r["method"] == "spinor"]
    if not ours:
        return []
    found: list[Figure] = []
    kind = known_kind(case)
    if kind == "smooth":
        found += _beside_baselines(case, ours, here)
        found.append(_digits(case, ours))
    if kind == "plane":
        found += _at_Limit("disks", case, "error of the area", [r["area_error"] for r in ours], PLANE_AREA)
    values = [r["exact_curvature_median"] for r in ours if r.get("exact_curvature_median") is not None]
    text = "median exact |H| per diameter"
    found += _at_Limit("disks", case, text, values or [math.nan], CURVATURE)
    text = "every disk keeps the rim bit-equal and leaves no edge open"
    return [*found, _all("disks", case, text, ours, _closed_disk)]


def _beside_baselines(case: str, ours: list[Record], here: list[Record]) -> Iterator[Figure]:
    for baseline in BASELINES:
        pairs = [
            (mine, other)
            for mine in ours
            for other in here
            if other["method"] == baseline and other["n"] == mine["n"] >= LEAST_POINTS
        ]
        if pairs:
            closer, n = min((o["area_error"] / max(m["area_error"], ROUNDING), m["n"]) for m, o in pairs)
            text = f"area {CLOSER:g} times closer than {baseline}, or within {OF_LIMIT:g} times the points' limit"
            met = all(
                m["area_error"] <= max(ROUNDING, o["area_error"] / CLOSER, OF_LIMIT * (m.get("limit_error") or 0))
                for m, o in pairs
            )
            yield _judged("disks", case, text, f"{closer:.1e} times at {n} points", met)
        ratios = [(m["seconds"] / o["seconds"], m["n"]) for m, o in pairs if _comparable(m, o)]
        if ratios:
            slower, n = max(ratios)
            text, measured = f"at most {SLOWER:g} times the seconds of {baseline}", f"{slower:.2f} times at {n} points"
            yield _judged("disks", case, text, measured, slower <= SLOWER, "time")


def _comparable(one: Record, other: Record) -> bool:
    """Whether two records' seconds were measured at like loads."""
    loads = [record["load"] for record in (one, other) if record.get("load") is not None]
    return len(loads) < 2 or abs(loads[0] - loads[1]) <= SAME_LOAD


def _digits(case: str, ours: list[Record]) -> Figure:
    digits = UNEVEN_DIGITS if case.endswith("@uneven") else OUR_DIGITS
    best = min(r["area_error"] for r in ours)
    return _judged("disks", case, f"area right to {digits:g} at some number of points", f"{best:.1e}", best <= digits)


def _all(suite: str, case: str, text: str, records: Sequence[Record], holds: Callable[[Record], bool]) -> Figure:
    count = sum(map(holds, records))
    return Figure(suite=suite, case=case, text=text, measured=f"{count} of {len(records)}", met=count == len(records))


def _closed_disk(record: Record) -> bool:
    return bool(record["rim_kept"] and record["open_edges"] == 0 and record.get("nonmanifold_edges", 0) == 0)


def _closed_hole(record: Record) -> bool:
    # columns of earlier measurements may be missing
    kept = record.get("rim_kept", True) and record["old_faces_kept"]
    return bool(kept and not any(record.get(f"{kind}_edges") for kind in ("open_rim", "new_open", "nonmanifold")))


def _fillers(case: str, here: list[Record]) -> list[Figure]:
    ours = [r for r in here if r["method"] == OURS]
    if not ours:
        return []
    found = [_all("fills", case, "every fill closes the rim and keeps the mesh bit-equal", ours, _closed_hole)]
    for mine in ours if case == REFERENCE_CASE else ():
        other = next((r for r in here if r["method"] == REFERENCE and r["n"] == mine["n"]), None)
        if other is not None and mine["n"] in REFERENCE_SHARE and _comparable(mine, other):
            share, limit = mine["seconds"] / other["seconds"], REFERENCE_SHARE[mine["n"]]
            text = f"whole fill of {mine['n']} points in at most {limit:g} times the seconds of {REFERENCE}"
            found.append(_judged("fills", case, text, f"{share:.2f} times", share <= limit, "time"))
    if known_kind(case) != "plane":
        found += _nearer("fills", case, ours, here)
    return found


def _nearer(suite: str, case: str, ours: Sequence[Record], here: Sequence[Record]) -> Iterator[Figure]:
    """How much nearer our area is than that of any other filler that closes the hole."""
    ratios = [
        (other["area_error"] / max(mine["area_error"], ROUNDING), other["method"])
        for mine in ours
        for other in here
        if other["method"] not in OUR_FILLERS
        and other.get("n") == mine.get("n")
        and None not in (other.get("area_error"), mine.get("area_error"))
        and other["open_rim_edges"] == 0
    ]
    if ratios:
        least, method = min(ratios)
        text = f"filled area at least {NEARER:g} times closer than every other filler's"
        yield _judged(suite, case, text, f"{least:.1e} times {method}'s, the least", least >= NEARER)


def _stitched(odd: list[Record]) -> Iterator[Figure]:
    """Facing rims between which a catenoid is known, beside those that join them too."""
    for case, group in _by_case(odd).items():
        joined = [r for r in group if r.get("area_error") is not None and r.get("patches") == 1]
        yield from _nearer("odd", case, [r for r in joined if r["method"] == OURS], joined)


def is_whole(record: Record) -> bool:
    """Whether a cut-out was closed, so that its patch can be measured."""
    done = record["status"] == "done" and record.get("distance") is not None
    return done and record["open_rim_edges"] == record["new_open_edges"] == 0


def cap_distances(records: Sequence[Record], height: float) -> list[float]:
    """Distances of the new vertices of caps above a height from their unit spheres, where there are new vertices."""
    caps = [r for r in records if is_whole(r) and r["kind"] == "dome" and r["case"].endswith(f"-{height:g}")]
    return [r["vertex_distance"] * r["diameter"] for r in caps if r.get("vertex_distance") is not None]


def _continued(done: list[Record]) -> list[Figure]:
    """What is promised of the smooth continuation, on pieces cut out of known surfaces and scans."""
    ours = [r for r in done if r["method"] == SMOOTH]
    if not ours:
        return []
    text = "every continuation closes the rim and keeps the mesh bit-equal"
    found = [_all("cut-outs", "cut-outs", text, ours, _closed_hole)]
    whole = [r for r in ours if is_whole(r)]
    least: dict[str, float] = {}  # of the other fillers, by case
    for r in done:
        if r["method"] not in OUR_FILLERS and is_whole(r):
            least[r["case"]] = min(least.get(r["case"], math.inf), r["distance"])

    def limited(case: str, text: str, values: Sequence[float], limit: float) -> None:
        found.extend(_at_Limit("cut-outs", case, text, values, limit))

    for height, limit in CAP_DISTANCES.items():
        text = f"new vertices of caps above z = {height:g}, root mean square distance from the unit sphere,"
        limited("caps", text, cap_distances(ours, height), limit)
    for case, kinds, share in (("caps", ("dome",), CAP_SHARE), ("windows", ("curved", "long"), WINDOW_SHARE)):
        ratios = [r["distance"] / least[r["case"]] for r in whole if r["kind"] in kinds and r["case"] in least]
        limited(case, "distance by the best other filler's", ratios, share)
    flat = [r["surface_distance"] for r in whole if r["kind"] == "flat"]
    limited("plane-window", "distance from the plane, per diameter", flat, FLAT)
    bends = [r["bend"] / r["removed_bend"] for r in whole if r["bend"] is not None and r["removed_bend"]]
    limited("cut-outs", "bend across the rim by the removed piece's", bends, BEND)
    return found + _on_scans(done, least)


def _on_scans(done: list[Record], least: Mapping[str, float]) -> list[Figure]:
    scans = [r for r in done if is_whole(r) and r["kind"] == "scan"]
    mine = {r["case"]: r["distance"] for r in scans if r["method"] == SMOOTH}
    rivals = {r["method"]: [q["distance"] for q in scans if q["method"] == r["method"]] for r in scans}
    theirs = [median(distances) for method, distances in rivals.items() if method not in OUR_FILLERS]
    if not (mine and theirs):
        return []
    won = [distance <= least.get(case, math.inf) for case, distance in mine.items()]
    ratio = median(mine.values()) / min(theirs)
    return [
        _share("cut-outs", "scans", "nearer than every other filler", won, NEAREST),
        *_at_Limit("cut-outs", "scans", "median distance by the best other filler's", [ratio], SCAN_SHARE),
    ]


def _ragged(done: list[Record]) -> list[Figure]:
    """Ours on rims with noise, and on those cut along triangles."""
    ours = [r for r in done if r["method"] == OURS]
    found = _cut_along_triangles([r for r in ours if r["case"] in CUT])
    for record in (r for r in ours if r["case"] in NOISY):
        noise, points = NOISY[record["case"]]
        within = WITHIN if noise < 0.2 else 1e-2
        found.append(Limit("residual_per_edge", "RMS residual, in mean edges,", within).of(record))
        found.append(Limit("seconds", "seconds", NOISY_SECONDS[points], "time").of(record))
    return found


def _cut_along_triangles(rims: list[Record]) -> list[Figure]:
    if not rims:
        return []
    found = [_all("ragged", "cut", "no patch crosses anything", rims, _clean)]
    for name, sharp, share in (("milder rims", False, MILD_SHARE), ("sharper rims", True, SHARP_SHARE)):
        met = [_residual(r) <= WITHIN for r in rims if (r["sharpness"] >= SHARP) == sharp]
        if met:
            found.append(_share("ragged", name, f"patches within {WITHIN:g} of an edge", met, share))
    seconds = [r["seconds"] for r in rims]
    found += _at_Limit("ragged", "cut", "seconds, median,", [median(seconds)], FILL_SECONDS, "time")
    return [*found, *_at_Limit("ragged", "cut", "seconds", seconds, SLOWEST_FILL, "time")]


def _residual(record: Record) -> float:
    value = record.get("residual_per_edge")
    return math.inf if value is None else value


def _clean(record: Record) -> bool:
    return not (record.get("crossings") or record.get("mesh_crossings"))


def _meshes(done: list[Record]) -> list[Figure]:
    """Ours on every hole of every mesh file."""
    ours = [r for r in done if r["method"] == OURS and "within_1e-2" in r]
    if not ours:
        return []
    loops, near = (sum(r[name] for r in ours) for name in ("requested", "within_1e-2"))
    text = f"at least {MESH_SHARE:.0%} of the loops within 1e-2 of an edge"
    return [
        _judged("meshes", "all meshes", text, f"{near} of {loops}", near >= MESH_SHARE * loops),
        _all("meshes", "all meshes", "loops that are left open say why", ours, lambda r: not r.get("unexplained")),
    ]


def _random(records: Sequence[Record]) -> list[Figure]:
    """What is promised of random curves together; what is refused is far."""
    curves = [r for r in records if r["suite"] == "curves" and r["case"].startswith("random curve")]
    if not curves:
        return []
    rms = {r["case"]: math.inf if r.get("rms_per_edge") is None else r["rms_per_edge"] for r in curves}
    case = "random curves"
    found = [
        _share("curves", case, "within 1e-2 of an edge", [value <= 1e-2 for value in rms.values()], RANDOM_SHARE),
        _all("curves", case, "what a solution says of itself is so", curves, lambda r: not r.get("untrue")),
    ]
    for noise, limit in (("without noise", RANDOM_MEDIAN), ("with 15% noise", RANDOM_NOISY_MEDIAN)):
        chosen = [v for name, v in rms.items() if int(name.rpartition(" ")[2]) % 2 == (noise != "without noise")]
        if chosen:
            text = f"median RMS distance from Γ, in mean edges, {noise}"
            found += _at_Limit("curves", case, text, [median(chosen)], limit)
    return found


def _batch(done: list[Record]) -> list[Figure]:
    here = {r["case"]: r for r in done}
    found = []
    whole, alone = here.get("smooth loops"), here.get("smooth loops, one worker")
    few, many = here.get("few inputs"), here.get("ten times as many inputs")
    for record in (r for r in done if r["case"] in RATES):
        rate, least = record["rate"], RATES[record["case"]]
        found.append(
            _judged("batch", record["case"], f"loops a second at least {least:g}", f"{rate:.3g}", rate >= least, "time")
        )
    if whole and alone and _comparable(whole, alone):
        ratio = whole["rate"] / alone["rate"]
        text, met = f"times the rate of one worker at least {SPEED_UP:g}", ratio >= SPEED_UP
        found.append(_judged("batch", whole["case"], text, f"{ratio:.3g}", met, "time"))
    if few and many:
        ratio = many["driver_mib"] / few["driver_mib"]
        found += _at_Limit("batch", many["case"], "times the driver's memory", [ratio], GROWTH)
    same = Limit("equal", "equal to the last bit", True)
    return found + [same.of(r) for r in done if r.get("equal") is not None]


def _share(suite: str, case: str, text: str, met: Sequence[bool], share: float) -> Figure:
    measured = f"{sum(met) / len(met):.0%} of {len(met)}"
    return _judged(suite, case, f"{text}, at least {share:.0%}", measured, sum(met) >= share * len(met))


def _at_Limit(
    suite: str, case: str, text: str, values: Sequence[float], limit: float, kind: Kind = "accuracy"
) -> list[Figure]:
    """A limit that all values have to keep; nothing where there is none."""
    if not values:
        return []
    measured = f"{max(values):.3g}" + (f" at most, {median(values):.3g} in the median" if len(values) > 1 else "")
    return [_judged(suite, case, f"{text} at most {limit:.3g}", measured, max(values) <= limit, kind)]


def _judged(suite: str, case: str, text: str, measured: str, met: bool, kind: Kind = "accuracy") -> Figure:
    return Figure(suite=suite, case=case, text=text, measured=measured, met=bool(met), kind=kind)
