"""A run and its folder: every record is on the disk before the next task starts."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from spinor_geom.bench.machine import Record, Task, machine, stamp
from spinor_geom.bench.suites import Settings, chosen_tasks
from spinor_geom.errors import OptionError
from spinor_geom.files import finite, write_json
from spinor_geom.isolate import FaultError, Process

RECORDS, DESCRIPTION = "records.jsonl", "run.json"
WORKER = "spinor_geom.bench.worker"


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

    Args:
        settings: what to measure.
        folder: of the run; made if it is not there.
        on_record: called after each task, with the numbers of tasks done and of all.

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
    """Runs tasks one after the other in a process that is replaced when one crashes or takes too many seconds.

    The process runs the module as a program, which tells one answer to each task; what it writes besides is kept beside
    the answer, as "said".
    """
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
    told = {**asdict(settings), "data": None if settings.data is None else str(settings.data)}
    here, path = machine(), folder / DESCRIPTION
    if path.exists():
        before = json.loads(path.read_text(encoding="utf-8"))["machine"]
        # of ours every record has its commit
        own = {"versions": {**here["versions"], "spinor-geom": before["versions"]["spinor-geom"]}}
        differ = [name for name in ("versions", "cores", "processor") if {**here, **own}[name] != before[name]]
        if differ:
            raise OptionError(
                f"{folder} holds a run on another machine or of other versions ({', '.join(differ)} differ); "
                "name another folder"
            )
        here = before
    description = {"settings": told, "machine": here}
    write_json(path, description)
    return description
