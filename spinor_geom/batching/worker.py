"""What runs in a Dask worker: it keeps a process that solves, watches it, and ends it where a file asks too much."""

import threading
from collections import Counter, deque
from typing import Any

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.options import Limits, fault_reason
from spinor_geom.batching.records import failure
from spinor_geom.batching.store import Store
from spinor_geom.errors import BatchError
from spinor_geom.isolate import Event, FaultError, Process

SOLVER = "spinor_geom.batching.solver"
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1")
# Bytes that the C library keeps instead of asking the system for them anew: Dask has its workers give back all of them,
# and a fifth of the time went into that. These are the values that the library would come to by itself.
KEPT = {"MALLOC_MMAP_THRESHOLD_": str(32 << 20), "MALLOC_TRIM_THRESHOLD_": str(64 << 20)}
_own = threading.local()


def run_block(job: dict[str, Any], limits: Limits) -> dict[str, Any]:
    """Does a job, as for `solver.work`; whatever its sources do to the process that solves, each gets a record.

    Returns:
        "finished": a summary for each source; "stop": why nothing can be written, or "".
    """
    done: list[dict[str, Any]] = []
    deaths: Counter[str] = Counter()
    blocks = deque([list(job["sources"])])
    try:
        while blocks:
            block = blocks.popleft()
            fault = _attempt({**job, "sources": block}, limits, done)
            finished = {one["key"] for one in done}
            waiting = {entry["key"]: entry for entry in block if entry["key"] not in finished}
            # the file that was being read did it, or the only one
            last = {} if fault is None else fault.last
            guilty = last.get("reading", "") if len(waiting) > 1 else next(iter(waiting), "")
            if fault is None or guilty not in waiting:
                # any of them may have done it, or made it give up; none are left where all went well
                blocks.extend([entry] for entry in waiting.values())
                continue
            entry = waiting.pop(guilty)
            deaths[guilty] += 1
            # what a limit ended would only cost as much once more
            if fault.kind != "death" or deaths[guilty] > limits.retries:
                record = failure(guilty, fault_reason(fault), status="fault")
                done.append(Store(**job["store"]).commit(Source.from_dict(entry), record, {}))
            else:
                blocks.append([entry])
            if waiting:
                blocks.appendleft(list(waiting.values()))
    except BatchError as error:
        return {"finished": done, "stop": str(error)}
    return {"finished": done, "stop": ""}


def _attempt(job: dict[str, Any], limits: Limits, done: list[dict[str, Any]]) -> FaultError | None:
    """Has the process that solves do a job: what it finishes joins what is done, and what ended it is returned."""
    stop = ""

    def heard(event: Event) -> None:
        nonlocal stop
        stop = event.get("stop", stop)
        if "finished" in event:
            done.append(event["finished"])

    try:
        solver().run(job, heard, seconds=limits.seconds, whole_seconds=limits.whole_seconds, memory=limits.memory)
    except FaultError as fault:
        if fault.kind == "start":
            raise BatchError(f"the process that solves cannot start: {fault}; see what is installed") from fault
        return fault
    if stop:
        raise BatchError(stop)
    return None


def solver() -> Process:
    """The process that solves for this thread of the worker."""
    if not hasattr(_own, "solver"):
        _own.solver = Process(SOLVER, {**ONE_THREAD, **KEPT})
    process: Process = _own.solver
    return process
