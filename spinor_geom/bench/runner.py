"""A run: suites of tasks, each a method on a case; its folder has every record before the next task starts."""

from __future__ import annotations

import difflib
import itertools
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any

from spinor_geom.bench.batches import BATCHES
from spinor_geom.bench.cases import KNOWN, SAMPLED, known_kind, mesh_files, odd_holes
from spinor_geom.bench.claims import REFERENCE, REFERENCE_CASE
from spinor_geom.bench.cut_outs import CAPS, CUT, NOISY, WINDOWS, scan_names
from spinor_geom.bench.fillers import FILLERS, LOOP_METHODS, OURS, REPORTED, SMOOTHEST
from spinor_geom.bench.machine import Record, Task, machine, stamp
from spinor_geom.bench.reports import reported_holes
from spinor_geom.bench.solves import QUICK as QUICK_SOLVES
from spinor_geom.bench.solves import SUITES as SOLVED
from spinor_geom.bench.solves import solves
from spinor_geom.errors import OptionError
from spinor_geom.files import finite, write_json
from spinor_geom.isolate import FaultError, Process

RECORDS, DESCRIPTION = "records.jsonl", "run.json"
WORKER = "spinor_geom.bench.worker"
VIEWS = "views"
# cut-outs of which the page shows what was removed and what each filler put there
PICTURED = ("icosphere-4-0.3", "torus-outside-0.4", "bunny_scan-02", "demosthenes_low_res-03")
QUICK_CUT_OUTS = ("icosphere-3-0.7", "torus-outside-0.4")
QUICK_CASES = (
    *("enneper-0.8", "tennis-seam", "random-1", "random-1@even", "random-1@uneven", "plane-l", "schwarz-d-quad"),
)
QUICK_SHARE = 0.03  # of a batch's files
SLOW = ("pymeshlab",)  # what a short run measures on its first two cases only
COMPARED = ("spinor", "libigl", "libigl-uniform")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a run measures: names of suites, of their cases (or patterns) and of methods, all of those that are empty.

    Of `hole_points`, those of known rims, all count where there is a reference, two for other smooth rims, else one.
    The short run takes a few cases of each suite where none are named.
    """

    suites: tuple[str, ...] = ()
    cases: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    points: tuple[int, ...] = (32, 64, 128, 256)
    hole_points: tuple[int, ...] = (64, 256, 1000)
    repeat: int = 3  # counted calls of each task
    time_limit: float = 180.0  # of each task, in seconds
    data: Path | None = None  # folder of mesh files
    quick: bool = False

    @classmethod
    def short(cls, **changed: Any) -> Settings:
        """The run that takes less than three minutes: the promises' own cases, every tool once."""
        few: dict[str, Any] = {"points": (32, 64), "hole_points": (64,), "repeat": 1, "time_limit": 60.0}
        return cls(quick=True, **{**few, **changed})

    @property
    def few(self) -> bool:
        """Whether each suite chooses some of its cases."""
        return self.quick and not self.cases


def case_name(task: Task) -> str:
    """The name of a task's case: of a mesh file without its folder."""
    return Path(task["case"]).name if task["suite"] == "meshes" else str(task["case"])


def chosen_tasks(settings: Settings, folder: Path) -> list[Task]:
    """All tasks of a run into a folder, those of one method after each other; an OptionError where there are none."""
    if settings.data is not None and not settings.data.is_dir():
        raise OptionError(f"{settings.data}: is not a folder; name one that holds mesh files")
    places = {name: place for place, name in enumerate((*LOOP_METHODS, *FILLERS))}
    for kind, names, there in (("suite", settings.suites, SUITES), ("method", settings.methods, places)):
        for name in names:
            if name not in there:
                raise OptionError(f"there is no {kind} {name!r}; choose from: {', '.join(there)}")
    found = [task for suite in settings.suites or SUITES for task in SUITES[suite](settings, folder)]
    here = list(dict.fromkeys(case_name(task) for task in found))
    for pattern in settings.cases:
        if not any(fnmatchcase(name, pattern) for name in here):
            near = ", ".join(difflib.get_close_matches(pattern, here, 5, 0.4)) or ", ".join(here[:5])
            raise OptionError(
                f"there is no case {pattern!r} in the suites {', '.join(settings.suites or SUITES)}, of the mesh files "
                f"in {settings.data or 'no folder'}; there are {near}, … (docs/benchmark.md has the names)"
            )
    patterns, methods = settings.cases or ("*",), settings.methods or places
    wanted = [
        task
        for task in found
        if task["method"] in methods and any(fnmatchcase(case_name(task), pattern) for pattern in patterns)
    ]
    if not wanted:
        raise OptionError("the chosen methods do not work on the chosen cases; nothing is left to measure")
    return sorted(wanted, key=lambda task: places[task["method"]])


def _disks(settings: Settings, _: Path) -> Iterator[Task]:
    more = [name for name in settings.cases if name.removeprefix("random-").partition("@")[0].isdigit()]
    cases = QUICK_CASES if settings.few else tuple(dict.fromkeys((*KNOWN, *SAMPLED, *more)))
    for name, method in LOOP_METHODS.items():
        for case in cases[:2] if settings.few and name in SLOW else cases:
            if "@" not in case or settings.cases or name in COMPARED:
                for n in (n for n in settings.points if n <= method.most_points):
                    yield from _each("disks", (case,), (name,), settings.repeat, n=n)


def _fills(settings: Settings, _: Path) -> Iterator[Task]:
    for case in QUICK_CASES[:1] if settings.few else KNOWN:
        count = 3 if case == REFERENCE_CASE else 2 if known_kind(case) == "smooth" else 1
        for n in settings.hole_points[:count]:
            yield from _each("fills", (case,), FILLERS, settings.repeat, n=n)


def _each(suite: str, cases: Iterable[str], methods: Iterable[str], repeat: int = 0, **more: Any) -> Iterator[Task]:
    for method in methods:
        package = "spinor_geom" if method in LOOP_METHODS else FILLERS[method].package
        for case in cases:
            yield {"suite": suite, "method": method, "package": package, "case": case, "repeat": repeat, **more}


def _cut_outs(settings: Settings, folder: Path) -> Iterator[Task]:
    """Pieces cut out of known surfaces and scans, filled by what continues a mesh smoothly."""
    cases = QUICK_CUT_OUTS if settings.few else (*CAPS, *WINDOWS, *scan_names(settings.data))
    data = settings.data and str(settings.data)
    named = [name for name in settings.methods if name in FILLERS]
    for task in _each("cut-outs", cases, dict.fromkeys((*SMOOTHEST, *named)), 1, data=data):
        yield {**task, "view": str(folder / VIEWS / task["case"]) if task["case"] in PICTURED else None}


def _meshes(settings: Settings, _: Path) -> Iterator[Task]:
    if settings.data is not None and not settings.few:
        yield from _each("meshes", [str(path) for path in mesh_files(settings.data, settings.cases)], FILLERS)


def _ragged(settings: Settings, _: Path) -> Iterator[Task]:
    cases = (*list(NOISY)[:1], *CUT[:5]) if settings.few else (*NOISY, *CUT)
    yield from _each("ragged", cases, (OURS, REFERENCE), 1)


def _reports(settings: Settings, _: Path) -> Iterator[Task]:
    cases = list(reported_holes())
    yield from _each("reports", cases[:: len(cases) // 8] if settings.few else cases, REPORTED, 1)


def _solves(suite: str, settings: Settings, _: Path) -> Iterator[Task]:
    cases = [c.name for c in solves().values() if c.suite == suite and (c.name in QUICK_SOLVES or not settings.few)]
    return _each(suite, cases, ("spinor",), 0 if suite == "curves" else settings.repeat)


def _batch(settings: Settings, _: Path) -> Iterator[Task]:
    """Many files; in the short run only where it is asked for."""
    cases = () if settings.few and not settings.suites else BATCHES
    return _each("batch", cases, ("spinor",), share=QUICK_SHARE if settings.quick else 1.0)


SUITES: Mapping[str, Callable[[Settings, Path], Iterator[Task]]] = {
    "disks": _disks,
    "fills": _fills,
    "odd": lambda settings, _: _each("odd", odd_holes(), FILLERS),
    "cut-outs": _cut_outs,
    "meshes": _meshes,
    "ragged": _ragged,
    "reports": _reports,
    **{suite: partial(_solves, suite) for suite in SOLVED},
    "batch": _batch,
}
"""All suites by name, in the order of the tables."""


def key(task: Task) -> str:
    """What makes a task another one."""
    return json.dumps({name: value for name, value in task.items() if name != "view"}, sort_keys=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A run that has ended: settings, machine and versions, and the records of all tasks in their order."""

    folder: Path
    description: Mapping[str, Any]
    records: Sequence[Record]


def measure(
    settings: Settings, folder: str | os.PathLike[str], *, on_record: Callable[[Record, int, int], None] | None = None
) -> Run:
    """Measures all that a run is to measure; what an earlier, killed run left in the folder is not measured again.

    `on_record` is called after each task, with the numbers of tasks done and of all.

    Raises:
        OptionError: a suite, a case, a method or the folder of mesh files does not exist, or the run's folder holds one
            on another machine or beside other versions of the peers.
    """
    place = Path(folder)
    tasks = chosen_tasks(settings, place)
    place.mkdir(parents=True, exist_ok=True)
    description = _description(settings, place)
    done = {record["key"]: record for record in read_records(place)}
    todo = [task for task in tasks if key(task) not in done]
    counted = itertools.count(len(tasks) - len(todo) + 1)

    def keep(task: Task, answer: Record) -> None:
        record: Record = finite({"key": key(task), **task, **answer, **stamp()})
        # a line is whole or, where the process dies in it, dropped when it is read
        with open(place / RECORDS, "a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
            file.flush()
            os.fsync(file.fileno())
        done[record["key"]] = record
        if on_record is not None:
            on_record(record, next(counted), len(tasks))

    # a process for each method has only that one's libraries; one for all saves the imports
    for _, group in itertools.groupby(todo, key=lambda task: None if settings.quick else task["method"]):
        run_isolated(group, module=WORKER, time_limit=settings.time_limit, on_record=keep)
    return Run(folder=place, description=description, records=[done[key(task)] for task in tasks])


def run_isolated(
    tasks: Iterable[Task], *, module: str, time_limit: float, on_record: Callable[[Task, Record], None]
) -> None:
    """Runs tasks in a process that is replaced when one crashes or takes too long; what it writes is kept as "said"."""
    process = Process(module)
    try:
        for task in tasks:
            record: Record = {}
            try:
                said = process.run(task, record.update, seconds=time_limit)
            except FaultError as fault:
                record = {"status": "timed out" if fault.kind == "time" else "crashed", "reason": str(fault)}
                said = fault.said
            on_record(task, {**record, "said": said} if said else record)
    finally:
        process.end()


def read_records(folder: Path) -> list[Record]:
    """The records of a run's folder; a last line that was not finished is no record."""
    path = folder / RECORDS
    if not path.exists():
        return []
    text = path.read_text(encoding="utf-8")
    if text and not text.endswith("\n"):
        # what is added must not go on in the middle of that line
        text = text[: text.rfind("\n") + 1]
        path.write_text(text, encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()]


def _description(settings: Settings, folder: Path) -> dict[str, Any]:
    here, path = machine(), folder / DESCRIPTION
    if path.exists():
        before = json.loads(path.read_text(encoding="utf-8"))["machine"]
        # of ours every record has its commit
        here["versions"]["spinor-geom"] = before["versions"]["spinor-geom"]
        if differ := [name for name in ("versions", "cores", "processor") if here[name] != before[name]]:
            raise OptionError(
                f"{folder} holds a run on another machine or of other versions ({', '.join(differ)} differ); "
                "name another folder"
            )
        here = before
    description = {"settings": {**asdict(settings), "data": settings.data and str(settings.data)}, "machine": here}
    write_json(path, description)
    return description
