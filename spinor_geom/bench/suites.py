"""The suites of the benchmark: the cases of each, and the methods that run them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from spinor_geom.bench.batches import BATCHES
from spinor_geom.bench.cases import KNOWN, SAMPLED, known_kind
from spinor_geom.bench.claims import REFERENCE, REFERENCE_CASE
from spinor_geom.bench.cut_outs import CAPS, WINDOWS, scan_names
from spinor_geom.bench.fillers import FILLERS, LOOP_METHODS, OURS, REPORTED, SMOOTHEST
from spinor_geom.bench.holes import mesh_files
from spinor_geom.bench.machine import Task
from spinor_geom.bench.odd_holes import odd_holes
from spinor_geom.bench.ragged import CUT, NOISY, reported_holes
from spinor_geom.bench.solves import QUICK as QUICK_SOLVES
from spinor_geom.bench.solves import solves

METHODS = (*LOOP_METHODS, *FILLERS)
_QUICK = ("enneper-0.8", "tennis-seam", "random-1", "random-1@even", "random-1@uneven", "plane-l", "schwarz-d-quad")
_QUICK_SHARE = 0.03  # of a batch's files
_SLOW = ("pymeshlab",)  # methods that the short run measures on two cases only
_COMPARED = ("spinor", "libigl", "libigl-uniform")  # methods that are measured at all samplings of the curves


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a run measures; empty names mean all suites, cases or methods."""

    suites: tuple[str, ...] = ()
    cases: tuple[str, ...] = ()  # names or patterns
    methods: tuple[str, ...] = ()
    points: tuple[int, ...] = (32, 64, 128, 256)  # of loops
    hole_points: tuple[int, ...] = (
        64,
        256,
        1000,
    )  # of known rims: all of the reference's, two of smooth ones, else one
    repeat: int = 3  # calls after the first one
    time_limit: float = 180.0  # of each task, in seconds
    data: Path | None = None  # folder of mesh files
    quick: bool = False

    @classmethod
    def short(cls, **changed: Any) -> Settings:
        """The run that takes less than three minutes: a few cases of each suite, every tool once."""
        few: dict[str, Any] = {"points": (32, 64), "hole_points": (64,), "repeat": 1, "time_limit": 60.0}
        return cls(quick=True, **{**few, **changed})


@dataclass(frozen=True)
class Suite:
    """The cases and methods of a suite."""

    cases: Callable[[Settings], Iterable[str]]
    methods: Iterable[str]
    quick: Callable[[Sequence[str]], Iterable[str]] = lambda cases: cases  # the cases of the short run, of all cases
    repeat: int | None = 0  # calls after the first one; None for the number in the settings
    points: Callable[[Settings, str, str], Iterable[int | None]] = lambda *_: (None,)  # of loops, by method and case


def suite_tasks(name: str, settings: Settings) -> Iterator[Task]:
    """All tasks of a suite."""
    suite = SUITES[name]
    cases = list(suite.cases(settings))
    if settings.quick and not settings.cases:
        cases = list(suite.quick(cases))
    # cut-outs are not measured by every filler, unless it is named
    more = [method for method in settings.methods if method in FILLERS] if name == "cut-outs" else []
    common = {
        "repeat": settings.repeat if suite.repeat is None else suite.repeat,
        "data": settings.data and str(settings.data),
        "share": _QUICK_SHARE if settings.quick else 1.0,
    }
    for method in dict.fromkeys((*suite.methods, *more)):
        for case in cases:
            for n in suite.points(settings, method, case):
                yield {"suite": name, "method": method, "case": case, "n": n, **common}


def _known_cases(settings: Settings) -> Iterable[str]:
    """The known cases in all samplings, and "random-SEED" where such cases are named."""
    named = [name for name in settings.cases if name.removeprefix("random-").partition("@")[0].isdigit()]
    return dict.fromkeys((*KNOWN, *SAMPLED, *named))


def _loop_points(settings: Settings, method: str, case: str) -> Iterable[int]:
    few = settings.quick and not settings.cases
    if few and method in _SLOW and case not in _QUICK[:2]:
        return ()
    if "@" in case and not settings.cases and method not in _COMPARED:
        return ()
    return (n for n in settings.points if n <= LOOP_METHODS[method].most_points)


def _hole_points(settings: Settings, method: str, case: str) -> Iterable[int]:
    return settings.hole_points[: 3 if case == REFERENCE_CASE else 2 if known_kind(case) == "smooth" else 1]


def _cut_outs(settings: Settings) -> Iterable[str]:
    return (*CAPS, *WINDOWS, *scan_names(settings.data))


def _ragged(_: Settings) -> Iterable[str]:
    return (*NOISY, *CUT)


def _mesh_files(settings: Settings) -> Iterable[str]:
    return () if settings.data is None else map(str, mesh_files(settings.data, settings.cases))


def _solve_names(suite: str, _: Settings) -> Iterable[str]:
    return (case.name for case in solves().values() if case.suite == suite)


def _quick_solves(cases: Sequence[str]) -> Iterable[str]:
    return (name for name in cases if name in QUICK_SOLVES)


def _batches(settings: Settings) -> Iterable[str]:
    """All batches; the short run has them only if the suite is named."""
    return () if settings.quick and not (settings.cases or settings.suites) else BATCHES


SUITES: Mapping[str, Suite] = {
    "disks": Suite(_known_cases, LOOP_METHODS, quick=lambda _: _QUICK, repeat=None, points=_loop_points),
    "fills": Suite(lambda _: KNOWN, FILLERS, quick=lambda _: _QUICK[:1], repeat=None, points=_hole_points),
    "odd": Suite(lambda _: odd_holes(), FILLERS),
    "cut-outs": Suite(_cut_outs, SMOOTHEST, quick=lambda _: ("icosphere-3-0.7", "torus-outside-0.4"), repeat=1),
    "meshes": Suite(_mesh_files, FILLERS, quick=lambda _: ()),
    "ragged": Suite(_ragged, (OURS, REFERENCE), quick=lambda _: (next(iter(NOISY)), *CUT[:5]), repeat=1),
    "reports": Suite(lambda _: reported_holes(), REPORTED, quick=lambda cases: cases[:: len(cases) // 8], repeat=1),
    "curves": Suite(partial(_solve_names, "curves"), ("spinor",), quick=_quick_solves),
    "rims": Suite(partial(_solve_names, "rims"), ("spinor",), quick=_quick_solves, repeat=None),
    "speed": Suite(partial(_solve_names, "speed"), ("spinor",), quick=_quick_solves, repeat=None),
    "paper": Suite(partial(_solve_names, "paper"), ("spinor",), quick=_quick_solves, repeat=None),
    "batch": Suite(_batches, ("spinor",)),
}
"""All suites, in the order of the tables."""
