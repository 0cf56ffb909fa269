"""Runs of the benchmark: the suites' tasks one after the other, each record appended to a file before the next task."""

from __future__ import annotations

import difflib
import itertools
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from spinor_geom.bench.cases import KNOWN, REFERENCE_CASE, SAMPLED, SMOOTH, known_kind
from spinor_geom.bench.cut_outs import CAPS, WINDOWS, scan_names
from spinor_geom.bench.fillers import FILLERS, LOOP_METHODS, REPORTED, SMOOTHEST, Tool
from spinor_geom.bench.frames import FRAME_METHODS, FRAMES
from spinor_geom.bench.holes import mesh_files
from spinor_geom.bench.machine import Record, Task, machine, stamp
from spinor_geom.bench.odd_holes import odd_holes
from spinor_geom.bench.ragged import reported_holes
from spinor_geom.errors import OptionError
from spinor_geom.files import finite, write_json
from spinor_geom.isolate import FaultError, Process

RECORDS, DESCRIPTION, VIEWS = "records.jsonl", "run.json", "views"
TASKS = "spinor_geom.bench.tasks"
# cut-outs for which the page shows the removed piece and each filler's patch
PICTURED = ("icosphere-4-0.3", "torus-outside-0.4", "bunny_scan-02", "demosthenes_low_res-03")
METHODS: Mapping[str, Tool[Any]] = {**LOOP_METHODS, **FILLERS, **FRAME_METHODS}
_QUICK = ("enneper-0.8", "tennis-seam", "random-1", "random-1@even", "random-1@uneven")
_SLOW = ("pymeshlab",)  # methods that the short run measures on two cases only
_COMPARED = ("spinor", "libigl", "libigl-uniform")  # methods that are measured at all samplings of the curves


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a run measures. Empty names mean all suites, cases or methods."""

    suites: tuple[str, ...] = ()
    cases: tuple[str, ...] = ()  # names or patterns
    methods: tuple[str, ...] = ()
    points: tuple[int, ...] = (32, 64, 128, 256)  # of loops
    hole_points: tuple[int, ...] = (64, 256, 1000)  # of known rims, see `_hole_points`
    repeat: int = 3  # calls after the first one
    time_limit: float = 180.0  # of each task, in seconds
    data: Path | None = None  # folder of mesh files
    quick: bool = False

    def __post_init__(self) -> None:
        if self.data is not None:  # the same records under each name of the folder
            object.__setattr__(self, "data", self.data.resolve())

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
    quick: Callable[[Sequence[str]], Iterable[str]] = lambda cases: cases  # selects the cases of the short run
    repeat: int | None = 0  # calls after the first one, or None for the number in the settings
    points: Callable[[Settings, str, str], Iterable[int | None]] = lambda *_: (None,)  # of loops, by method and case


def suite_tasks(name: str, settings: Settings) -> Iterator[Task]:
    """All tasks of a suite."""
    suite = SUITES[name]
    cases = list(suite.cases(settings))
    if settings.quick and not settings.cases:
        cases = list(suite.quick(cases))
    # other fillers of cut-outs are measured only if they are named
    more = [method for method in settings.methods if method in FILLERS] if name == "cut-outs" else []
    common = {
        "repeat": settings.repeat if suite.repeat is None else suite.repeat,
        "data": settings.data and str(settings.data),
    }
    for method in dict.fromkeys((*suite.methods, *more)):
        for case in cases:
            for n in suite.points(settings, method, case):
                yield {"suite": name, "method": method, "case": case, "n": n, **common}


def _curves(settings: Settings) -> Iterable[str]:
    """The smooth cases in all samplings, and the cases "random-SEED" that the settings name."""
    named = [name for name in settings.cases if name.removeprefix("random-").partition("@")[0].isdigit()]
    return dict.fromkeys((*SMOOTH, *SAMPLED, *named))


def _loop_points(settings: Settings, method: str, case: str) -> Iterable[int]:
    few = settings.quick and not settings.cases
    if few and method in _SLOW and case not in _QUICK[:2]:
        return ()
    if "@" in case and not settings.cases and method not in _COMPARED:
        return ()
    return (n for n in settings.points if n <= LOOP_METHODS[method].most_points)


def _hole_points(settings: Settings, method: str, case: str) -> Iterable[int]:
    """All numbers of points for the reference's case, two for other smooth ones, else one."""
    return settings.hole_points[: 3 if case == REFERENCE_CASE else 2 if known_kind(case) == "smooth" else 1]


def _cut_outs(settings: Settings) -> Iterable[str]:
    return (*CAPS, *WINDOWS, *scan_names(settings.data))


SUITES: Mapping[str, Suite] = {
    "disks": Suite(_curves, LOOP_METHODS, quick=lambda _: _QUICK, repeat=None, points=_loop_points),
    "fills": Suite(lambda _: KNOWN, FILLERS, quick=lambda _: _QUICK[:1], repeat=None, points=_hole_points),
    "odd": Suite(lambda _: odd_holes(), FILLERS),
    "cut-outs": Suite(_cut_outs, SMOOTHEST, quick=lambda _: ("icosphere-3-0.7", "torus-outside-0.4"), repeat=1),
    "meshes": Suite(lambda s: map(str, mesh_files(s.data, s.cases) if s.data else ()), FILLERS, quick=lambda _: ()),
    "reports": Suite(lambda _: reported_holes(), REPORTED, quick=lambda cases: cases[:: len(cases) // 8], repeat=1),
    "cad": Suite(lambda _: FRAMES, FRAME_METHODS, quick=lambda _: FRAMES[1:4:2], repeat=1),
}
"""All suites, in the order of the tables."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A finished run: its settings and machine, and the records of all tasks in their order."""

    folder: Path
    description: Mapping[str, Any]
    records: Sequence[Record]


def case_name(task: Task) -> str:
    """The name of a task's case, without the folder of a mesh file."""
    return Path(task["case"]).name if task["suite"] == "meshes" else str(task["case"])


def chosen_tasks(settings: Settings) -> list[Task]:
    """All tasks of a run, sorted by method. An OptionError names a suite, case, method or folder that is unknown."""
    if settings.data is not None and not settings.data.is_dir():
        raise OptionError(f"{settings.data} is not a folder; name a folder of mesh files")
    for kind, names, known in (("suite", settings.suites, tuple(SUITES)), ("method", settings.methods, tuple(METHODS))):
        for name in names:
            if name not in known:
                raise OptionError(f"there is no {kind} {name!r}; choose from: {', '.join(known)}")
    suites, methods = settings.suites or tuple(SUITES), settings.methods or METHODS
    found = [task for suite in suites for task in suite_tasks(suite, settings)]
    there = list(dict.fromkeys(map(case_name, found)))
    for pattern in settings.cases:
        if not any(fnmatchcase(name, pattern) for name in there):
            near = ", ".join(difflib.get_close_matches(pattern, there, 5, 0.4) or there[:5])
            raise OptionError(
                f"there is no case {pattern!r} in the suites {', '.join(suites)} (folder of mesh files: "
                f"{settings.data or 'none'}); choose from {near}, … (docs/benchmark.md lists the names)"
            )
    chosen = [task for task in found if task["method"] in methods]
    if settings.cases:
        chosen = [task for task in chosen if any(fnmatchcase(case_name(task), p) for p in settings.cases)]
    if not chosen:
        raise OptionError("none of the chosen methods applies to the chosen cases; choose others")
    return sorted(chosen, key=lambda task: list(METHODS).index(task["method"]))


def measure(
    settings: Settings, folder: str | os.PathLike[str], *, on_record: Callable[[Record, int, int], None] | None = None
) -> Run:
    """Runs all tasks whose records are not yet in the folder.

    `on_record` is called after each task, with the numbers of finished tasks and of all. Raises an OptionError as
    `chosen_tasks`, or if the folder has a run on another machine or with other package versions.
    """
    place, tasks = Path(folder), chosen_tasks(settings)
    place.mkdir(parents=True, exist_ok=True)
    description = _description(settings, place)
    done = {record["key"]: record for record in read_records(place)}
    todo = [
        {**task, "view": str(place / VIEWS / task["case"]) if task["case"] in PICTURED else None}
        for task in tasks
        if key(task) not in done
    ]
    finished = itertools.count(len(tasks) - len(todo) + 1)

    def keep(task: Task, result: Record) -> None:
        record: Record = finite({"key": key(task), **task, **result, **stamp()})
        with open(place / RECORDS, "a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
            file.flush()
            os.fsync(file.fileno())
        done[record["key"]] = record
        if on_record is not None:
            on_record(record, next(finished), len(tasks))

    # one process per method, so that it imports only its own libraries. One for all in the short run, to save time
    for _, group in itertools.groupby(todo, key=lambda task: None if settings.quick else task["method"]):
        run_isolated(group, module=TASKS, time_limit=settings.time_limit, on_record=keep)
    return Run(folder=place, description=description, records=[done[key(task)] for task in tasks])


def key(task: Task) -> str:
    """The identifier of a task's record, equal for equal tasks."""
    return json.dumps({name: value for name, value in task.items() if name != "view"}, sort_keys=True)


def run_isolated(
    tasks: Iterable[Task], *, module: str, time_limit: float, on_record: Callable[[Task, Record], None]
) -> None:
    """Runs tasks in a process that is replaced after a crash or a time-out. "output" is what it printed."""
    process = Process(module)
    try:
        for task in tasks:
            record: Record = {}
            try:
                output = process.run(task, record.update, seconds=time_limit)
            except FaultError as fault:
                record = {"status": "timed out" if fault.kind == "time" else "crashed", "reason": str(fault)}
                output = fault.output
            on_record(task, {**record, "output": output} if output else record)
    finally:
        process.end()


def read_records(folder: Path) -> list[Record]:
    """The records of a run's folder. An unfinished last line is removed from the file."""
    path = folder / RECORDS
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    if text and not text.endswith("\n"):
        text = text[: text.rfind("\n") + 1]
        path.write_text(text, encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()]


def _description(settings: Settings, folder: Path) -> dict[str, Any]:
    """Writes the settings and the machine. The machine must be that of earlier parts of the run."""
    here, path = machine(), folder / DESCRIPTION
    if path.exists():
        before = json.loads(path.read_text(encoding="utf-8"))["machine"]
        # our version may change, because every record has its commit
        here["versions"]["spinor-geom"] = before["versions"]["spinor-geom"]
        if differ := [name for name in ("versions", "cores", "processor") if here[name] != before[name]]:
            raise OptionError(
                f"{folder} has a run on another machine or with other versions ({', '.join(differ)} differ); "
                "name another folder"
            )
        here = before
    description = {"settings": {**asdict(settings), "data": settings.data and str(settings.data)}, "machine": here}
    write_json(path, description)
    return description
