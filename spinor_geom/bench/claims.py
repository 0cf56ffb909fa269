"""What the project promises of a run, beside what the run measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Literal

from spinor_geom.bench.cases import KNOWN
from spinor_geom.bench.cut_outs import HEIGHTS
from spinor_geom.bench.fillers import OUR_FILLERS, OURS, SMOOTH
from spinor_geom.bench.isolate import Record

CLOSER, SLOWER = 1e3, 3.0  # than the libigl baseline, in area and in seconds
OUR_DIGITS, THEIR_DIGITS = 1e-6, 1e-4
UNEVEN_DIGITS = 1e-5  # points at edges of random lengths say less of their curve
CURVATURE = 1e-9  # per diameter
NEARER = 1e4  # area errors of hole fillers, per ours
# largest share of the reference's seconds for a whole fill, by points of the rim
REFERENCE, REFERENCE_CASE, REFERENCE_SHARE = "meshlib-nicely", "enneper-0.8", {64: 4.0, 256: 1.0, 1000: 0.333}
# of the smooth continuation: distances from unit spheres by the caps' heights; distances per those of the best other
# filler, on caps, on windows, and in the median on scans; share of the scans' disks where it is nearest of all; bend
# across the rim per the removed piece's; distance in a plane, per diameter
CAP_DISTANCES = dict(zip(HEIGHTS, (2e-3, 4e-3, 8e-3, 2e-2), strict=True))
CAP_SHARE, WINDOW_SHARE, SCAN_SHARE, NEAREST, BEND, FLAT = 1 / 4, 1 / 3, 0.6, 0.85, 1.3, 1e-12
LEAST_POINTS = 64  # of a loop that stands for a smooth curve
BASELINES = ("libigl", "libigl-uniform")
DISCRETE = (*BASELINES, "pymeshlab")
# errors below this are rounding
ROUNDING = 1e-15


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A promise and what became of it.

    Attributes:
        kind: "accuracy" holds on any machine; "time" is told and never checked.
        case: on which.
        text: the promise.
        measured: what was measured.
        met: whether it is kept.
    """

    kind: Literal["accuracy", "time"]
    case: str
    text: str
    measured: str
    met: bool


def claims(records: Sequence[Record]) -> list[Claim]:
    """All promises that the records speak of."""
    done = [r for r in records if r["status"] == "done" and not r.get("scaling")]
    found: list[Claim] = []
    for case in dict.fromkeys(r["case"] for r in done if r["suite"] == "loop"):
        here = [r for r in done if r["suite"] == "loop" and r["case"] == case and r["area_error"] is not None]
        ours = [r for r in here if r["method"] == "spinor"]
        if not ours:
            continue
        if case not in KNOWN or KNOWN[case][0] == "smooth":
            found += _beside_baselines(case, ours, here)
            found += _digits(case, ours, here)
        found.append(_curvature(case, ours))
        found.append(_all(case, "every disk keeps the rim bit-equal and leaves no edge open", ours, _closed_disk))
    for case in dict.fromkeys(r["case"] for r in done if r["suite"] == "hole"):
        found += _fillers(case, [r for r in done if r["suite"] == "hole" and r["case"] == case])
    return found + _continued([r for r in done if r["suite"] == "cut-out"])


def _beside_baselines(case: str, ours: list[Record], here: list[Record]) -> list[Claim]:
    found = []
    for baseline in BASELINES:
        pairs = [
            (mine, other)
            for mine in ours
            for other in here
            if other["method"] == baseline and other["n"] == mine["n"] >= LEAST_POINTS
        ]
        if not pairs:
            continue
        closer, n = min((other["area_error"] / max(mine["area_error"], ROUNDING), mine["n"]) for mine, other in pairs)
        slower, m = max((mine["seconds"] / other["seconds"], mine["n"]) for mine, other in pairs)
        found += [
            Claim(
                kind="accuracy",
                case=case,
                text=f"area at least {CLOSER:g} times closer than {baseline}",
                measured=f"{closer:.1e} times at {n} points, the least",
                met=bool(closer >= CLOSER),
            ),
            Claim(
                kind="time",
                case=case,
                text=f"at most {SLOWER:g} times the seconds of {baseline}",
                measured=f"{slower:.2f} times at {m} points, the most",
                met=bool(slower <= SLOWER),
            ),
        ]
    return found


def _digits(case: str, ours: list[Record], here: list[Record]) -> list[Claim]:
    digits = UNEVEN_DIGITS if case.endswith("@uneven") else OUR_DIGITS
    mine = time_to_reach(ours, digits)
    others = [r for r in here if r["method"] in DISCRETE]
    reached = Claim(
        kind="accuracy",
        case=case,
        text=f"area right to {digits:g} at some number of points",
        measured=f"{min(r['area_error'] for r in ours):.1e} at best",
        met=mine is not None,
    )
    theirs = time_to_reach(others, THEIR_DIGITS)
    if theirs is None:  # nothing to be quicker than
        return [reached]
    return [
        reached,
        Claim(
            kind="time",
            case=case,
            text=f"{digits:g} in less time than the discrete methods take for {THEIR_DIGITS:g}",
            measured=f"{'not reached' if mine is None else f'{mine:.3g} s'} against {theirs:.3g} s",
            met=mine is not None and mine < theirs,
        ),
    ]


def time_to_reach(records: Sequence[Record], error: float, *, field: str = "area_error") -> float | None:
    """Least seconds of the records whose error is at most so large; None where none is."""
    return min((r["seconds"] for r in records if r.get(field) is not None and r[field] <= error), default=None)


def _curvature(case: str, ours: list[Record]) -> Claim:
    values = [r["exact_curvature_median"] for r in ours if r.get("exact_curvature_median") is not None]
    largest = max(values, default=float("nan"))
    return Claim(
        kind="accuracy",
        case=case,
        text=f"median exact |H| at most {CURVATURE:g}/diameter",
        measured=f"{largest:.1e}, the largest of {len(values)} samplings",
        met=bool(largest <= CURVATURE),
    )


def _all(case: str, text: str, records: list[Record], holds: Callable[[Record], bool]) -> Claim:
    count = sum(holds(r) for r in records)
    measured = f"{count} of {len(records)}"
    return Claim(kind="accuracy", case=case, text=text, measured=measured, met=count == len(records))


def _closed_disk(record: Record) -> bool:
    return bool(record["rim_kept"] and record["open_edges"] == 0 and record["nonmanifold_edges"] == 0)


def _closed_hole(record: Record) -> bool:
    return bool(
        record["rim_kept"]
        and record["old_faces_kept"]
        and record["open_rim_edges"] == record["new_open_edges"] == record["nonmanifold_edges"] == 0
    )


def _fillers(case: str, here: list[Record]) -> list[Claim]:
    ours = [r for r in here if r["method"] == OURS]
    if not ours:
        return []
    found = [_all(case, "every fill closes the rim and keeps the mesh bit-equal", ours, _closed_hole)]
    for mine in ours if case == REFERENCE_CASE else ():
        other = next((r for r in here if r["method"] == REFERENCE and r["n"] == mine["n"]), None)
        if other is not None and mine["n"] in REFERENCE_SHARE:
            share, most = mine["seconds"] / other["seconds"], REFERENCE_SHARE[mine["n"]]
            found.append(
                Claim(
                    kind="time",
                    case=case,
                    text=f"whole fill of {mine['n']} points in at most {most:g} times the seconds of {REFERENCE}",
                    measured=f"{share:.2f} times",
                    met=bool(share <= most),
                )
            )
    ratios = [
        (other["area_error"] / max(mine["area_error"], ROUNDING), other["method"], mine["n"])
        for mine in ours
        for other in here
        if other["method"] not in OUR_FILLERS
        and other["n"] == mine["n"]
        and None not in (other.get("area_error"), mine.get("area_error"))
        and other["open_rim_edges"] == 0
    ]
    if ratios and (case not in KNOWN or KNOWN[case][0] != "plane"):
        least, method, n = min(ratios)
        found.append(
            Claim(
                kind="accuracy",
                case=case,
                text=f"filled area at least {NEARER:g} times closer than every other filler's",
                measured=f"{least:.1e} times {method}'s at {n} points, the least",
                met=bool(least >= NEARER),
            )
        )
    return found


def is_whole(record: Record) -> bool:
    """Whether a cut-out was closed, so that its patch can be measured."""
    done = record["status"] == "done" and record.get("distance") is not None
    return done and record["open_rim_edges"] == record["new_open_edges"] == 0


def cap_distances(records: Sequence[Record], height: float) -> list[float]:
    """Distances of the new vertices of caps above a height from their unit spheres, where there are new vertices."""
    caps = [r for r in records if is_whole(r) and r["kind"] == "dome" and r["case"].endswith(f"-{height:g}")]
    return [r["vertex_distance"] * r["diameter"] for r in caps if "vertex_distance" in r]


def _continued(done: list[Record]) -> list[Claim]:
    """What is promised of the smooth continuation, on pieces cut out of known surfaces and scans."""
    ours = [r for r in done if r["method"] == SMOOTH]
    if not ours:
        return []
    found = [_all("cut-outs", "every continuation closes the rim and keeps the mesh bit-equal", ours, _closed_hole)]
    whole = [r for r in ours if is_whole(r)]
    least: dict[str, float] = {}  # of the other fillers, by case
    for r in done:
        if r["method"] not in OUR_FILLERS and is_whole(r):
            least[r["case"]] = min(least.get(r["case"], math.inf), r["distance"])
    for height, limit in CAP_DISTANCES.items():
        text = f"new vertices of caps above z = {height:g} at most {limit:g} from the unit sphere, root mean square"
        found += _at_most("caps", text, cap_distances(ours, height), limit)
    for case, kinds, share in (("caps", ("dome",), CAP_SHARE), ("windows", ("curved", "long"), WINDOW_SHARE)):
        ratios = [r["distance"] / least[r["case"]] for r in whole if r["kind"] in kinds and r["case"] in least]
        found += _at_most(case, f"at most {share:.2g} times as far as the best other filler", ratios, share)
    flat = [r["surface_distance"] for r in whole if r["kind"] == "flat"]
    found += _at_most("plane-window", "plane to rounding, per diameter", flat, FLAT)
    bends = [r["bend"] / r["removed_bend"] for r in whole if r["bend"] is not None and r["removed_bend"]]
    found += _at_most("cut-outs", f"bend across the rim at most {BEND:g} times the removed piece's", bends, BEND)
    return found + _on_scans(done, least)


def _on_scans(done: list[Record], least: Mapping[str, float]) -> list[Claim]:
    scans = [r for r in done if is_whole(r) and r["kind"] == "scan"]
    mine = {r["case"]: r["distance"] for r in scans if r["method"] == SMOOTH}
    rivals = {r["method"]: [q["distance"] for q in scans if q["method"] == r["method"]] for r in scans}
    theirs = [median(distances) for method, distances in rivals.items() if method not in OUR_FILLERS]
    if not (mine and theirs):
        return []
    text = f"median distance at most {SCAN_SHARE:g} times the best other filler's"
    won = sum(distance <= least.get(case, math.inf) for case, distance in mine.items()) / len(mine)
    nearest = Claim(
        kind="accuracy",
        case="scans",
        text=f"nearer than every other filler on at least {NEAREST:.0%} of the disks",
        measured=f"{won:.0%} of {len(mine)}",
        met=bool(won >= NEAREST),
    )
    return [nearest, *_at_most("scans", text, [median(mine.values()) / min(theirs)], SCAN_SHARE)]


def _at_most(case: str, text: str, values: Sequence[float], limit: float) -> list[Claim]:
    """A limit that all values have to keep; nothing where there is none."""
    if not values:
        return []
    measured = f"{max(values):.3g}" + (f" at most, {median(values):.3g} in the median" if len(values) > 1 else "")
    return [Claim(kind="accuracy", case=case, text=text, measured=measured, met=bool(max(values) <= limit))]
