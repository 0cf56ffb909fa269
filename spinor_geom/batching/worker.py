"""What a worker does, a thread here or on a Dask cluster: it has a process that solves, and ends it at the limits."""

import threading
from collections import Counter, deque
from typing import Any

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.options import Limits
from spinor_geom.batching.store import Store
from spinor_geom.errors import BatchError
from spinor_geom.isolate import Event, FaultError, Process

SOLVER = "spinor_geom.batching.solver"
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1")
# Bytes that the C library keeps instead of asking the system for them anew. Dask sets these variables such that its
# workers give back all of them, which takes a fifth of the time; these are the values that the library comes to itself.
KEPT = {"MALLOC_MMAP_THRESHOLD_": str(32 << 20), "MALLOC_TRIM_THRESHOLD_": str(64 << 20)}
# the process of each thread, and the run that it last worked for; runs that have ended
_solvers: dict[int, tuple[str, Process]] = {}
_ended: set[str] = set()


def run_block(job: dict[str, Any], limits: Limits) -> dict[str, Any]:
    """Does a job, as for `solver.work`; whatever its sources do to the process that solves, each gets a record.

    Returns:
        "finished": a summary for each source; "stop": why nothing can be written, or "".
    """
    done: list[dict[str, Any]] = []
    deaths: Counter[str] = Counter()
    blocks = deque([list(job["sources"])])
    process = solver(job["store"]["token"])

    def on_event(event: Event) -> None:
        if "stop" in event:
            raise BatchError(event["stop"])
        if "finished" in event:
            done.append(event["finished"])

    times = {"seconds": limits.seconds, "whole_seconds": limits.whole_seconds}
    try:
        while blocks:
            block, fault = blocks.popleft(), None
            try:
                process.run({**job, "sources": block}, on_event, memory=limits.memory, **times)
            except FaultError as error:
                if error.kind == "closed":
                    raise BatchError("the batch has ended") from error
                if error.kind == "start":
                    raise BatchError(f"the process that solves cannot start: {error}; see what is installed") from error
                fault = error
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
                done.append(Store(**job["store"]).fail(Source(**entry), str(fault)))
            else:
                blocks.append([entry])
            if waiting:
                blocks.appendleft(list(waiting.values()))
    except BatchError as error:
        return {"finished": done, "stop": str(error)}
    return {"finished": done, "stop": ""}


def solver(token: str) -> Process:
    """The process that solves for this thread, which now works for the run of a token."""
    _, process = _solvers.get(threading.get_ident(), (token, None))
    process = process or Process(SOLVER, {**ONE_THREAD, **KEPT})
    _solvers[threading.get_ident()] = token, process
    if token in _ended:  # a block that was handed out just before
        process.close()
    return process


def end_solvers(token: str) -> None:
    """Ends the processes of all threads that last worked for a run."""
    _ended.add(token)
    for thread, (last, process) in list(_solvers.items()):
        if last == token:
            del _solvers[thread]
            process.close()
