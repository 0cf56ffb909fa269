"""Workers of a batch: threads of this process or of a Dask cluster. Each supervises a process that solves."""

from __future__ import annotations

import os
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.settings import Limits
from spinor_geom.batching.store import Store
from spinor_geom.errors import BatchError
from spinor_geom.isolate import Event, FaultError, Process

if TYPE_CHECKING:
    from distributed import Client
    from distributed.deploy import Cluster

ENVIRONMENT = {
    **dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"),
    # Dask sets these for its workers so that malloc returns all memory to the system, which takes a fifth of the time.
    # These are the default values of malloc
    "MALLOC_MMAP_THRESHOLD_": str(32 << 20),
    "MALLOC_TRIM_THRESHOLD_": str(64 << 20),
}
# by thread: the token of the run it last worked for, and its process
_processes: dict[int, tuple[str, Process]] = {}
_ended_runs: set[str] = set()


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Threads that run blocks of a batch."""

    executor: Executor
    count: Callable[[], int]  # how many blocks run at a time, as clusters grow and shrink
    killed: tuple[type[Exception], ...] = ()  # raised by the future of a block whose workers died


@contextmanager
def open_workers(workers: int | None, scheduler: str | Cluster | Client | None, token: str) -> Iterator[Workers]:
    """Workers on this machine or of a cluster. Their processes end with the context."""
    if scheduler is not None:
        with _cluster_workers(scheduler, token) as pool:
            yield pool
        return
    count = workers or (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
    with ThreadPoolExecutor(count) as executor:
        try:
            yield Workers(executor=executor, count=lambda: count)
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
            end_processes(token)


@contextmanager
def _cluster_workers(scheduler: str | Cluster | Client, token: str) -> Iterator[Workers]:
    from distributed import Client, KilledWorker

    with ExitStack() as stack:
        try:
            client: Any = scheduler
            if not isinstance(scheduler, Client):
                client = stack.enter_context(Client(scheduler, timeout="20s", set_as_default=False))
            threads = client.nthreads
            threads()
        except (OSError, ValueError, RuntimeError, TypeError, AttributeError) as error:
            raise BatchError(f"{scheduler}: cannot connect to a Dask scheduler ({error}); check the address") from error
        executor = client.get_executor(pure=False)
        try:
            yield Workers(
                executor=executor, count=lambda: max(1, sum(map(int, threads().values()))), killed=(KilledWorker,)
            )
        finally:
            with suppress(OSError, RuntimeError):  # the cluster may be gone
                executor.shutdown(wait=False)
                client.run(end_processes, token, on_error="ignore")


def run_block(job: dict[str, Any], limits: Limits) -> dict[str, Any]:
    """Runs a job of `solver.work` within the limits. Every source gets a record, even if it ends the process.

    Returns "finished", a summary for each source, and "stop", why the batch cannot continue, or "".
    """
    done: list[dict[str, Any]] = []
    deaths: Counter[str] = Counter()
    blocks = deque([list(job["sources"])])
    process = process_of_thread(job["store"]["token"])

    def on_event(event: Event) -> None:
        if "stop" in event:
            raise BatchError(event["stop"])
        if "finished" in event:
            done.append(event["finished"])

    try:
        while blocks:
            block, fault = blocks.popleft(), None
            try:
                process.run({**job, "sources": block}, on_event, seconds=limits.seconds, memory=limits.memory)
            except FaultError as error:
                if error.kind == "closed":
                    raise BatchError("the batch has ended") from error
                if error.kind == "start":
                    raise BatchError(f"the solving process cannot start: {error}; check the installation") from error
                fault = error
            finished = {one["key"] for one in done}
            waiting = {entry["key"]: entry for entry in block if entry["key"] not in finished}
            # the fault is due to the file that was being read, or the only remaining one
            last = {} if fault is None else fault.last
            faulty = last.get("reading", "") if len(waiting) > 1 else next(iter(waiting), "")
            if fault is None or faulty not in waiting:
                blocks.extend([entry] for entry in waiting.values())  # one by one, to find the faulty file
                continue
            entry = waiting.pop(faulty)
            deaths[faulty] += 1
            if fault.kind == "death" and deaths[faulty] <= limits.retries:
                blocks.append([entry])
            else:  # a file that reached a limit would reach it again
                done.append(Store(**job["store"]).fail(Source(**entry), str(fault)))
            if waiting:
                blocks.appendleft(list(waiting.values()))
    except BatchError as error:
        return {"finished": done, "stop": str(error)}
    return {"finished": done, "stop": ""}


def process_of_thread(token: str) -> Process:
    """The process that solves for this thread. Later blocks and runs use it again."""
    _, process = _processes.get(threading.get_ident(), (token, None))
    process = process or Process("spinor_geom.batching.solver", ENVIRONMENT)
    _processes[threading.get_ident()] = token, process
    if token in _ended_runs:  # the block was submitted just before the end
        process.close()
    return process


def end_processes(token: str) -> None:
    """Ends the processes of all threads that last worked for a run."""
    _ended_runs.add(token)
    for thread, (last, process) in list(_processes.items()):
        if last == token:
            del _processes[thread]
            process.close()
