"""What runs in a Dask worker: it keeps a process that solves, watches it, and ends it where a file asks too much."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import monotonic
from typing import Any

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.records import failure, summary
from spinor_geom.batching.store import Store
from spinor_geom.errors import BatchError

# The process has to import torch first, which is not the first file's fault.
START_LIMIT = 600.0
# Seconds between looks at its memory.
LOOK = 0.05
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1")

_own = threading.local()


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What one file may cost.

    Attributes:
        seconds: for reading it, and for each of its loops.
        memory: of the process that solves, in bytes.
        retries: how often a file is tried again after its process died.
    """

    seconds: float
    memory: int
    retries: int


class FaultError(Exception):
    """The process that solves died or was ended.

    Attributes:
        is_final: whether trying again would only cost as much once more.
        key: of the file that was being read, which then is the one that did it; else "".
    """

    def __init__(self, reason: str, *, is_final: bool, key: str = "") -> None:
        super().__init__(reason)
        self.is_final, self.key = is_final, key


def run_block(job: dict[str, Any], limits: dict[str, Any]) -> dict[str, Any]:
    """Does a job for the driver; whatever its sources do to the process that solves, each gets a record.

    Args:
        job: as for `solver.work`.
        limits: the fields of `Limits`.

    Returns:
        "finished": a summary for each source; "stop": why nothing can be written, or "".
    """
    allowed, solver = Limits(**limits), _solver()
    done: list[dict[str, Any]] = []
    deaths: Counter[str] = Counter()
    blocks = deque([list(job["sources"])])
    try:
        while blocks:
            block = blocks.popleft()
            waiting = {entry["key"]: entry for entry in block}

            def finished(one: dict[str, Any], waiting: dict[str, Any] = waiting) -> None:
                waiting.pop(one["key"], None)
                done.append(one)

            try:
                solver.run({**job, "sources": block}, allowed, finished)
            except FaultError as fault:
                guilty = fault.key if len(waiting) > 1 else next(iter(waiting), "")
                if guilty not in waiting:
                    # any of them may have done it
                    blocks.extend([entry] for entry in waiting.values())
                    continue
                entry = waiting.pop(guilty)
                deaths[guilty] += 1
                if fault.is_final or deaths[guilty] > allowed.retries:
                    done.append(_write_fault(job, entry, fault))
                else:
                    blocks.append([entry])
                if waiting:
                    blocks.appendleft(list(waiting.values()))
    except BatchError as error:
        return {"finished": done, "stop": str(error)}
    except OSError as error:
        return {"finished": done, "stop": f"{job['store']['output']}: cannot be written to ({error})"}
    return {"finished": done, "stop": ""}


def _write_fault(job: Mapping[str, Any], entry: dict[str, Any], fault: FaultError) -> dict[str, Any]:
    record = failure(entry["key"], str(fault), status="fault")
    Store(**job["store"]).commit(Source.from_dict(entry), record, {})
    return summary(record)


def _solver() -> Solver:
    """The one of this thread of the worker."""
    if not hasattr(_own, "solver"):
        _own.solver = Solver()
    solver: Solver = _own.solver
    return solver


class Solver:
    """A process that solves, started when it is needed and again after it was ended."""

    def __init__(self) -> None:
        """Starts nothing yet."""
        self._process: subprocess.Popen[str] | None = None
        self._said: Any = None
        self._events: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()

    def run(self, job: dict[str, Any], limits: Limits, finished: Callable[[dict[str, Any]], None]) -> None:
        """Has a job done.

        Args:
            job: as for `solver.work`.
            limits: for each of its files.
            finished: is called with the summary of each.

        Raises:
            FaultError: the process died, or was ended at a limit; some sources may not be finished.
            BatchError: nothing can be written, or the process cannot start.
        """
        process = self._started()
        assert process.stdin is not None
        try:
            process.stdin.write(json.dumps(job) + "\n")
            process.stdin.flush()
        except OSError:
            raise self._death() from None
        reading, stop, alone = "", "", False
        while True:
            try:
                event = self._next(limits.seconds, limits.memory)
            except FaultError as fault:
                fault.key = reading
                raise
            reading = event.get("reading", "")
            if "finished" in event:
                finished(event["finished"])
            # only an idle process can be given another job
            stop, alone = event.get("stop", stop), alone or "alone" in event
            if "idle" in event:
                break
        if stop:
            raise BatchError(stop)
        if alone:
            raise FaultError("a mistake in one of several files", is_final=False)

    def _started(self) -> subprocess.Popen[str]:
        if self._process is not None and self._process.poll() is None:
            return self._process
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        process = subprocess.Popen(
            [sys.executable, "-m", "spinor_geom.batching.solver"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            text=True,
            env={**os.environ, **ONE_THREAD},
            # no module of the folder one happens to be in is taken for one of ours
            cwd=os.path.abspath(os.sep),
        )
        self._process, self._events = process, queue.SimpleQueue()
        threading.Thread(target=_listen, args=(process, self._events), daemon=True).start()
        try:
            self._next(START_LIMIT, 0)
        except FaultError as fault:
            if process.returncode > 0:  # nobody killed it
                raise BatchError(f"the process that solves cannot start: {fault}; see what is installed") from fault
            raise
        return process

    def _next(self, seconds: float, memory: int) -> dict[str, Any]:
        """The next thing that the process says, within a time and an amount of memory (0 for any)."""
        deadline = monotonic() + seconds
        while True:
            try:
                event = self._events.get(timeout=LOOK)
            except queue.Empty:
                used = self._memory() if memory else 0
                if used > memory:
                    self.end()
                    raise FaultError(
                        f"took more than {memory / 2**20:.0f} MiB of memory; raise the limit, or split the file",
                        is_final=True,
                    ) from None
                if monotonic() > deadline:
                    self.end()
                    raise FaultError(f"took longer than {seconds:g} s; raise the limit", is_final=True) from None
                continue
            if event is None:
                raise self._death()
            return event

    def _memory(self) -> int:
        import psutil

        assert self._process is not None
        try:
            return int(psutil.Process(self._process.pid).memory_info().rss)
        except psutil.Error:
            return 0

    def _death(self) -> FaultError:
        assert self._process is not None
        status = self._process.wait()
        self._said.seek(0)
        lines = self._said.read()[-4000:].decode("utf-8", "replace").split("\n")
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        self.end()
        how = f"with status {status}"
        if status < 0:
            with contextlib.suppress(ValueError):
                how = f"by {signal.Signals(-status).name}"
        return FaultError(f"its process died {how}{f': {last[:300]}' if last else ''}", is_final=False)

    def end(self) -> None:
        """Ends the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for stream in (self._process.stdin, self._process.stdout):
                if stream is not None:
                    with contextlib.suppress(OSError):
                        stream.close()
            self._said.close()
        self._process = None


def _listen(process: subprocess.Popen[str], events: queue.SimpleQueue[dict[str, Any] | None]) -> None:
    """Passes on what a process says; None when it says no more."""
    assert process.stdout is not None
    with contextlib.suppress(ValueError, OSError):
        for line in process.stdout:
            events.put(json.loads(line))
    events.put(None)
