"""The process that runs tasks: `python -m spinor_geom.bench.tasks`, started by the runner."""

import gc
import importlib
import statistics
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from spinor_geom.bench.cases import known_case, points_limit
from spinor_geom.bench.cut_outs import CutOut, named_cut_out
from spinor_geom.bench.fillers import FILLERS, LOOP_METHODS
from spinor_geom.bench.frames import FRAME_METHODS, frame_edges, frame_figures
from spinor_geom.bench.holes import Hole, hole_of_file, hole_over
from spinor_geom.bench.machine import Record, Task
from spinor_geom.bench.measured import cut_out_figures, disk_figures, hole_figures, save_views
from spinor_geom.bench.odd_holes import odd_holes
from spinor_geom.bench.promises import LEAST_POINTS
from spinor_geom.bench.ragged import reported_holes
from spinor_geom.bench.runner import METHODS
from spinor_geom.errors import SpinorGeomError
from spinor_geom.isolate import serve

_ENOUGH_SECONDS = 2.0  # in all, after which a call is not repeated


def run(task: Task) -> Record:
    """Runs a task. The record of an exception has the status "missing", "refused" or "failed"."""
    gc.collect()
    gc.freeze()  # later collections skip what is imported and cached by now
    forget_peak_memory()
    measure = _fill if task["method"] in FILLERS else _MEASURES[task["suite"]]
    package = METHODS[task["method"]].package
    try:
        importlib.import_module(package)
        return {"status": "done", **measure(task)}
    except ImportError as error:  # the package is absent, or its installation is broken
        return {"status": "missing", "reason": f"{package} cannot be imported here: {_sentence(error)}"}
    except SpinorGeomError as error:
        return {"status": "refused", "reason": _sentence(error)}
    except Exception as error:  # any exception of another tool is a result
        return {"status": "failed", "reason": f"{type(error).__name__}: {_sentence(error)}"}


def _disk(task: Task) -> Record:
    case = known_case(task["case"])
    loop = case.loop(task["n"])
    timed, (surface, mesh) = _timed(lambda: (partial(LOOP_METHODS[task["method"]].call, loop), _same), task["repeat"])
    figures = disk_figures(surface, mesh, loop, case)
    if task["method"] == "spinor" and task["n"] >= LEAST_POINTS:
        figures["limit_error"] = points_limit(case, task["n"])
    return {**timed, **figures}


def _frame(task: Task) -> Record:
    case = known_case(task["case"])
    edges = frame_edges(case)
    timed, shape = _timed(lambda: (partial(FRAME_METHODS[task["method"]].call, edges), _same), task["repeat"])
    return {**timed, **frame_figures(shape, edges, case)}


_MEASURES: Mapping[str, Callable[[Task], Record]] = {"disks": _disk, "cad": _frame}


def _fill(task: Task) -> Record:
    hole = _HOLES[task["suite"]](task)
    timed, filled = _timed(lambda: FILLERS[task["method"]].call(hole), task["repeat"])
    if task["suite"] == "cut-outs":
        figures = cut_out_figures(filled, _cut_out(task))
        if task["view"]:
            save_views(filled, _cut_out(task), Path(task["view"]), task["method"])
    else:
        figures = hole_figures(filled, hole, known_case(task["case"]) if task["suite"] == "fills" else None)
    return {**timed, **figures, "expected": hole.expected}


def _known_hole(task: Task) -> Hole:
    case = known_case(task["case"])
    return hole_over(task["case"], case.loop(task["n"]), case.area)


def _cut_out(task: Task) -> CutOut:
    return named_cut_out(task["case"], None if task["data"] is None else Path(task["data"]))


_HOLES: Mapping[str, Callable[[Task], Hole]] = {
    "fills": _known_hole,
    "odd": lambda task: odd_holes()[task["case"]],
    "cut-outs": lambda task: _cut_out(task).hole,
    "meshes": lambda task: hole_of_file(task["case"]),
    "reports": lambda task: reported_holes()[task["case"]],
}


def _timed(prepare: Callable[[], tuple[Callable[[], Any], Callable[[Any], Any]]], repeat: int) -> tuple[Record, Any]:
    """Times a call, and up to `repeat` more until they take 2 s together. The first one counts only without others.

    Returns the figures, and the converted result of the last call.
    """
    seconds: list[float] = []
    cpu_seconds: list[float] = []
    while len(seconds) < repeat + 1 and (not seconds or sum(seconds) < _ENOUGH_SECONDS):
        call, convert = prepare()
        start, cpu_start = time.perf_counter(), time.process_time()
        result = call()
        seconds.append(time.perf_counter() - start)
        cpu_seconds.append(time.process_time() - cpu_start)
    counted = seconds[1:] or seconds
    timed = {
        "seconds": statistics.median(counted),
        "seconds_all": counted,
        "cpu_seconds": statistics.median(cpu_seconds[1:] or cpu_seconds),
        "memory_mib": peak_memory(),
    }
    return timed, convert(result)


def _same(result: Any) -> Any:
    return result


def peak_memory() -> float | None:
    """The process's largest resident size since `forget_peak_memory`, in MiB, None if the system does not report it."""
    try:
        with open("/proc/self/status", encoding="ascii") as status:
            return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmHWM"))
    except (OSError, StopIteration):
        return None


def forget_peak_memory() -> None:
    """Resets the peak memory, if the system supports that."""
    try:
        with open("/proc/self/clear_refs", "w", encoding="ascii") as control:
            control.write("5")
    except OSError:
        pass


def _sentence(error: BaseException) -> str:
    return " ".join(str(error).split())


if __name__ == "__main__":
    serve(lambda task, send: send(run(task)))
