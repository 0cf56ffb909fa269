"""Tasks in a process of their own: a crash or a hang is one task's, and the memory is its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias

from spinor_geom.isolate import FaultError, Process

Task: TypeAlias = Mapping[str, Any]
Record: TypeAlias = dict[str, Any]


def run_isolated(
    tasks: Iterable[Task],
    *,
    module: str,
    time_limit: float,
    on_record: Callable[[Task, Record], None],
) -> None:
    """Runs tasks one after the other in a process that is replaced when it crashes or hangs.

    The process runs the module as a program, which tells one answer to each task. What it writes besides is kept beside
    the answer, as "said".

    Args:
        tasks: JSON-ready.
        module: of the process.
        time_limit: of each task, in seconds.
        on_record: called with each task and its answer. A task that crashed has the status "crashed", one
            that took too long "timed out".
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


def peak_memory() -> float | None:
    """The process's largest resident size since `forget_peak_memory`, in MiB; None where the system does not tell."""
    try:
        with open("/proc/self/status", encoding="ascii") as status:
            return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmHWM"))
    except (OSError, StopIteration):
        return None


def forget_peak_memory() -> None:
    """Starts the search for the largest resident size anew, where the system can do that."""
    try:
        with open("/proc/self/clear_refs", "w", encoding="ascii") as control:
            control.write("5")
    except OSError:
        pass
