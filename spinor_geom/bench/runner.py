"""Runs of the benchmark: the chosen tasks one after the other, each record appended to a file before the next task."""

from __future__ import annotations

import difflib
import itertools
import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from spinor_geom.bench.machine import Record, Task, machine, stamp
from spinor_geom.bench.suites import METHODS, SUITES, Settings, suite_tasks
from spinor_geom.errors import OptionError
from spinor_geom.files import finite, write_json
from spinor_geom.isolate import FaultError, Process

RECORDS, DESCRIPTION, VIEWS = "records.jsonl", "run.json", "views"
TASKS = "spinor_geom.bench.tasks"
# cut-outs for which the page shows the removed piece and each filler's patch
PICTURED = ("icosphere-4-0.3", "torus-outside-0.4", "bunny_scan-02", "demosthenes_low_res-03")


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A finished run: its settings and machine, and the records of all tasks in their order."""

    folder: Path
    description: Mapping[str, Any]
    records: Sequence[Record]


def case_name(task: Task) -> str:
    """The name of a task's case; of a mesh file, without its folder."""
    return Path(task["case"]).name if task["suite"] == "meshes" else str(task["case"])


def chosen_tasks(settings: Settings) -> list[Task]:
    """All tasks of a run, sorted by method.

    Raises:
        OptionError: A suite, case, method or folder does not exist, or no task is left.
    """
    if settings.data is not None and not settings.data.is_dir():
        raise OptionError(f"{settings.data}: is not a folder; name one that holds mesh files")
    for kind, names, known in (("suite", settings.suites, tuple(SUITES)), ("method", settings.methods, METHODS)):
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
                f"there is no case {pattern!r} in the suites {', '.join(suites)}, of the mesh files "
                f"in {settings.data or 'no folder'}; there are {near}, … (docs/benchmark.md has the names)"
            )
    chosen = [task for task in found if task["method"] in methods]
    if settings.cases:
        chosen = [task for task in chosen if any(fnmatchcase(case_name(task), p) for p in settings.cases)]
    if not chosen:
        raise OptionError("the chosen methods do not work on the chosen cases; nothing is left to measure")
    return sorted(chosen, key=lambda task: METHODS.index(task["method"]))


def measure(
    settings: Settings, folder: str | os.PathLike[str], *, on_record: Callable[[Record, int, int], None] | None = None
) -> Run:
    """Runs all tasks whose records are not yet in the folder.

    `on_record` is called after each task, with the numbers of finished tasks and of all.

    Raises:
        OptionError: See `chosen_tasks`; or the folder holds a run on another machine or with other versions of peers.
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

    # each method has its own process, so that it has only its own libraries; the short run saves their imports
    for _, group in itertools.groupby(todo, key=lambda task: None if settings.quick else task["method"]):
        run_isolated(group, module=TASKS, time_limit=settings.time_limit, on_record=keep)
    return Run(folder=place, description=description, records=[done[key(task)] for task in tasks])


def key(task: Task) -> str:
    """A text that is equal for equal tasks."""
    return json.dumps({name: value for name, value in task.items() if name != "view"}, sort_keys=True)


def run_isolated(
    tasks: Iterable[Task], *, module: str, time_limit: float, on_record: Callable[[Task, Record], None]
) -> None:
    """Runs tasks in a process that is replaced after a crash or a time-out; "said" is what it printed."""
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
    """The records of a run's folder; an unfinished last line is removed from the file."""
    path = folder / RECORDS
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    if text and not text.endswith("\n"):
        text = text[: text.rfind("\n") + 1]
        path.write_text(text, encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()]


def _description(settings: Settings, folder: Path) -> dict[str, Any]:
    """Writes the settings and the machine, which has to be that of an earlier part of the run."""
    here, path = machine(), folder / DESCRIPTION
    if path.exists():
        before = json.loads(path.read_text(encoding="utf-8"))["machine"]
        # our version may change, because every record has its commit
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
