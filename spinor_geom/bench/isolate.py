"""Tasks in a process of their own: a crash or a hang is one task's, and the memory is its own."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Mapping
from typing import IO, Any

# characters of what a library wrote that a record keeps
_SAID = 600
_START = (
    "import json, runpy, sys; sys.path[:] = json.loads(sys.argv[1]); runpy.run_module(sys.argv[2], run_name='__main__')"
)

Task = Mapping[str, Any]
Record = dict[str, Any]


def run_isolated(
    tasks: Iterable[Task],
    *,
    module: str,
    time_limit: float,
    on_record: Callable[[Task, Record], None],
) -> None:
    """Runs tasks one after the other in a process that is replaced when it crashes or hangs.

    The process runs the module as a program; it reads a task a line from its standard input, as JSON, and answers with
    a line of JSON on its standard output; see `serve`. What else it writes is kept beside the answer, as "said".

    Args:
        tasks: JSON-ready.
        module: of the process.
        time_limit: of each task, in seconds; the first of a process has the imports in it.
        on_record: called with each task and its answer. A task that crashed has the status "crashed" and the exit
            status or signal as its reason, one that took too long "timed out".
    """
    worker: _Worker | None = None
    try:
        for task in tasks:
            if worker is None:
                worker = _Worker(module)
            record = worker.answer(task, time_limit)
            if record["status"] in ("crashed", "timed out"):
                worker.close()
                worker = None
            on_record(task, record)
    finally:
        if worker is not None:
            worker.close()


class _Worker:
    """One process, with a thread that reads its answers."""

    def __init__(self, module: str) -> None:
        # a file, not a pipe: nobody has to empty it; it lives as long as the process
        self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115
        # packages are looked for where this process looks, not in the folder it happens to run in
        command = [sys.executable, "-c", _START, json.dumps(sys.path), module]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log)
        self._answers: queue.Queue[bytes] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def answer(self, task: Task, time_limit: float) -> Record:
        """The answer to a task, or how it ended without one."""
        start = self._log.seek(0, os.SEEK_END)
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(task).encode() + b"\n")
            self._process.stdin.flush()
            line = self._answers.get(timeout=time_limit)
        except queue.Empty:
            return self._with_log(start, {"status": "timed out", "reason": f"more than {time_limit:g} s"})
        except BrokenPipeError:
            line = b""
        if not line:
            status = self._process.wait()
            told = f"signal {-status}" if status < 0 else f"exit status {status}"
            return self._with_log(start, {"status": "crashed", "reason": told})
        record: Record = json.loads(line)
        return self._with_log(start, record)

    def close(self) -> None:
        """Ends the process."""
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._log):
            if stream is not None:
                stream.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        try:
            for line in self._process.stdout:
                self._answers.put(line)
        except ValueError:  # closed while it was read
            return
        self._answers.put(b"")

    def _with_log(self, start: int, record: Record) -> Record:
        self._log.seek(start)
        said = self._log.read().decode(errors="replace").strip()
        if said:
            record["said"] = said[-_SAID:]
        return record


def serve(run: Callable[[Task], Record]) -> None:
    """The loop of a process of `run_isolated`; whatever the tasks write to standard output goes to standard error.

    Args:
        run: answers a task, JSON-ready.
    """
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    for line in sys.stdin.buffer:
        record = run(json.loads(line))
        sys.stdout.flush()
        answers.write(json.dumps(record).encode() + b"\n")
        answers.flush()


def peak_memory() -> float | None:
    """The process's largest resident size since `forget_peak_memory`, in MiB; None on systems that do not tell."""
    try:
        with open("/proc/self/status", encoding="ascii") as status:
            return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmHWM"))
    except (OSError, StopIteration):
        pass
    try:
        import resource
    except ImportError:
        return None
    # macOS tells bytes; without a way to forget, the peak is the process's
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


def forget_peak_memory() -> None:
    """Starts the search for the largest resident size anew, where the system can do that."""
    try:
        with open("/proc/self/clear_refs", "w", encoding="ascii") as control:
            control.write("5")
    except OSError:
        pass
