"""Worker processes with limits of time and memory: a crash, a hang or a memory leak affects one job only.

The processes exchange lines of JSON: jobs on the worker's standard input, events on its standard output. A worker exits
when its input ends, so it does not outlive the process that started it.
"""

import contextlib
import json
import math
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from time import monotonic
from typing import IO, Any, Literal, TypeAlias

Event: TypeAlias = dict[str, Any]
Send: TypeAlias = Callable[[Event], None]
Kind: TypeAlias = Literal["start", "death", "time", "memory", "closed"]

START_LIMIT = 600.0  # seconds for the imports of a process
CHECK_INTERVAL = 0.05  # seconds between checks of the limits
KEPT_OUTPUT = 4000  # bytes of the output of a job
# the exit status of a process on Windows is the code of the exception that ended it
EXCEPTIONS = {0xC0000005: "an access violation", 0xC00000FD: "a stack overflow", 0xC0000409: "an abort"}
# `python -c` would import from the current folder, so its module path is replaced before anything is imported. Later
# versions import modules before they run this line. They have an option that leaves the folder out.
START = "import sys; module, *sys.path = sys.argv[1:]; import runpy; runpy.run_module(module, run_name='__main__')"
OPTIONS = ["-I"] if sys.flags.isolated else ["-P"] if sys.version_info >= (3, 11) else []


class FaultError(Exception):
    """A process ended before its job was done.

    Attributes:
        kind: "start": it exited before it could take a job; "death": it died; "time" or "memory": it reached a limit;
            "closed": `Process.close` was called.
        last: its last event.
        output: the end of its standard output and error during the job.
        crash: the signal or, on Windows, the exception that ended it, if any.
    """

    def __init__(self, reason: str, *, kind: Kind, last: Event, output: str, crash: str = "") -> None:
        super().__init__(reason)
        self.kind, self.last, self.output, self.crash = kind, last, output, crash

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(FaultError, str(self), kind=self.kind, last=self.last, output=self.output, crash=self.crash), ()


class Process:
    """A process that runs a module whose main program calls `serve`. It starts on first use and after a fault."""

    def __init__(self, module: str, environment: Mapping[str, str] | None = None) -> None:
        """The module to run. `environment` is added to the environment variables of this process."""
        self._module, self._environment = module, {**(environment or {})}
        self._process: subprocess.Popen[str] | None = None
        self._in_use, self._closed = threading.Lock(), False

    def run(self, job: Mapping[str, Any], on_event: Send, *, seconds: float, memory: float = math.inf) -> str:
        """Runs a job and returns the end of its standard output and error.

        Args:
            job: values that JSON can store.
            on_event: is called with each event of the process.
            seconds: largest time between two events.
            memory: limit of resident memory, in bytes. Needs psutil: Python cannot read it on Windows and macOS.

        Raises:
            FaultError: the process died or reached a limit.
        """
        with self._in_use:
            self._last: Event = {}
            try:
                process = self._started()
                self._begin = self._log.seek(0, os.SEEK_END)
                assert process.stdin is not None
                try:
                    process.stdin.write(json.dumps(job) + "\n")
                    process.stdin.flush()
                except OSError:
                    raise self._death() from None
                while "idle" not in (event := self._next(seconds, memory)):
                    self._last = event
                    on_event(event)
                return self._output()
            except BaseException:
                self.end()  # it may still be running the job
                raise

    def end(self) -> None:
        """Kills the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for stream in (self._process.stdin, self._process.stdout, self._log):
                with contextlib.suppress(OSError):
                    if stream is not None:
                        stream.close()
        self._process = None

    def close(self) -> None:
        """Kills the process and prevents a restart, from any thread. A running job raises a FaultError."""
        self._closed = True
        with self._in_use:
            self.end()

    def _started(self) -> subprocess.Popen[str]:
        if self._process is not None and self._process.poll() is None:
            return self._process
        self.end()
        # a file, because a full pipe would block the process
        self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        self._begin, self._next_check = 0, 0.0
        self._process = subprocess.Popen(
            [sys.executable, *OPTIONS, "-c", START, self._module, *module_path()],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            env={**os.environ, **self._environment},
        )
        self._events: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
        threading.Thread(target=_listen, args=(self._process, self._events), daemon=True).start()
        try:
            # in a virtual environment on Windows, the process of `Popen` is a launcher of the one that works
            self._pid = self._next(START_LIMIT, math.inf)["ready"]
        except FaultError as fault:
            if fault.kind == "death" and not fault.crash:
                fault.kind = "start"
            raise
        return self._process

    def _next(self, seconds: float, memory: float) -> Event:
        """The next event of the process, within the limits."""
        deadline = monotonic() + seconds
        while True:
            if self._closed:
                raise self._fault("was closed", "closed")
            now = monotonic()
            if now >= self._next_check:  # not after every event
                self._next_check = now + CHECK_INTERVAL
                if memory < math.inf and self._memory() > memory:
                    what = f"used more than {memory / 2**20:.0f} MiB of memory; raise the limit, or split the file"
                    raise self._fault(what, "memory")
                if now > deadline:
                    raise self._fault(f"took longer than {seconds:g} s; raise the limit", "time")
            with contextlib.suppress(queue.Empty):
                event = self._events.get(timeout=CHECK_INTERVAL)
                if event is None:
                    raise self._death()
                return event

    def _memory(self) -> int:
        import psutil

        try:
            return int(psutil.Process(self._pid).memory_info().rss)
        except psutil.Error:  # it has exited
            return 0

    def _death(self) -> FaultError:
        assert self._process is not None
        status = self._process.wait()
        crash = crash_of(status)
        how = f"by {crash}" if crash else f"with status {status}"
        line = next((line.strip() for line in reversed(self._output().split("\n")) if line.strip()), "")
        return self._fault(f"died {how}{f': {line[:300]}' if line else ''}", "death", crash)

    def _fault(self, what: str, kind: Kind, crash: str = "") -> FaultError:
        return FaultError(f"its process {what}", kind=kind, last=self._last, output=self._output(), crash=crash)

    def _output(self) -> str:
        self._log.seek(max(self._begin, self._log.seek(0, os.SEEK_END) - KEPT_OUTPUT))
        return self._log.read().decode("utf-8", "replace").strip()


def module_path() -> list[str]:
    """The folders that processes import modules from: those of this process, without the current folder.

    It may hold anything, such as downloaded meshes. It is kept only if this package was imported from it, or the
    environment variable PYTHONPATH names it by an absolute path.
    """
    named = set(filter(os.path.isabs, os.environ.get("PYTHONPATH", "").split(os.pathsep)))

    def is_current(folder: str | os.PathLike[str]) -> bool:
        return os.path.isdir(folder) and os.path.samefile(folder, os.curdir)

    if is_current(Path(__file__).parents[1]):
        return sys.path
    return [entry for entry in sys.path if entry in named or not is_current(entry or os.curdir)]


def crash_of(status: int) -> str:
    """The signal or, on Windows, the exception of an exit status, or "" if the process exited by itself.

    On POSIX systems the status is minus the signal's number. On Windows it is the exception's code, from 0xC0000000 up,
    and processes that others terminated have an ordinary status.
    """
    if status >= 0xC0000000:
        return EXCEPTIONS.get(status, f"exception 0x{status:08X}")
    try:
        return signal.Signals(-status).name if status < 0 else ""
    except ValueError:  # a real-time signal
        return f"signal {-status}"


def _listen(process: subprocess.Popen[str], events: queue.SimpleQueue[Event | None]) -> None:
    """Puts the events of a process into the queue, and None after the last."""
    assert process.stdout is not None
    with contextlib.suppress(ValueError, OSError):
        for line in process.stdout:
            events.put(json.loads(line))
    events.put(None)


def serve(work: Callable[[Any, Send], None]) -> None:
    """The main loop of a process: calls `work` with each job and a function that sends events to `Process.run`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that started it handles interrupts
    channel = os.fdopen(os.dup(1), "w", encoding="ascii")
    os.dup2(2, 1)  # what libraries print goes to standard error
    jobs: queue.SimpleQueue[str] = queue.SimpleQueue()

    def listen() -> None:
        for line in sys.stdin:
            jobs.put(line)
        os._exit(0)

    def send(event: Event) -> None:
        channel.write(json.dumps(event) + "\n")
        channel.flush()

    threading.Thread(target=listen, daemon=True).start()
    send({"ready": os.getpid()})
    while True:
        work(json.loads(jobs.get()), send)
        sys.stdout.flush()
        send({"idle": True})
