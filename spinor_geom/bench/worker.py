"""The process that runs tasks: `python -m spinor_geom.bench.worker`, spoken to by the runner."""

import gc
import importlib
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from spinor_geom.adapters import read_mesh
from spinor_geom.bench.cases import known_case, points_limit
from spinor_geom.bench.claims import LEAST_POINTS
from spinor_geom.bench.cut_outs import named_cut_out, ragged_hole
from spinor_geom.bench.fillers import FILLERS, LOOP_METHODS
from spinor_geom.bench.holes import all_rims, hole_over, odd_holes
from spinor_geom.bench.machine import Record, Task
from spinor_geom.bench.measure import cut_out_figures, disk_figures, hole_figures, save_views
from spinor_geom.bench.solves import solve_figures, solves
from spinor_geom.errors import SpinorGeomError
from spinor_geom.isolate import serve
from spinor_geom.mesh.boundary_loop import turning_angles
from spinor_geom.plateau.solve import solve_plateau

_ENOUGH_SECONDS = 5.0  # repeats end when they have taken this long together


def run(task: Task) -> Record:
    """Runs a task and measures what it left; nothing that goes wrong in a tool ends the process by itself."""
    gc.collect()
    gc.freeze()  # what is imported and cached by now need not be looked through before the next task
    forget_peak_memory()
    package = task["package"]
    alone = {"disks": _span, "batch": _batch}
    work = _fill if task["method"] in FILLERS else alone.get(task["suite"], _solve)
    try:
        importlib.import_module(package)
        return {"status": "done", **work(task)}
    except ImportError as error:  # there is none, or what is broken is the installation, and not the tool
        return {"status": "missing", "reason": f"{package} cannot be imported here: {_sentence(error)}"}
    except SpinorGeomError as error:
        return {"status": "refused", "reason": _sentence(error)}
    except Exception as error:  # another project's exception: its row says so
        return {"status": "failed", "reason": f"{type(error).__name__}: {_sentence(error)}"}


def _batch(task: Task) -> Record:
    from spinor_geom.bench.batches import BATCHES

    with tempfile.TemporaryDirectory() as folder:
        return BATCHES[task["case"]](Path(folder), task["share"])


def _solve(task: Task) -> Record:
    case = solves()[task["case"]]
    subject: Any = case.subject()
    timed, answer, _ = _timed(lambda: (lambda: solve_plateau(subject, **case.options), None), task["repeat"])
    return {**timed, **solve_figures(case, answer)}


def _span(task: Task) -> Record:
    case = known_case(task["case"])
    loop, method = case.loop(task["n"]), LOOP_METHODS[task["method"]]
    timed, (answer, patch), _ = _timed(lambda: (lambda: method.span(loop), None), task["repeat"])
    figures = disk_figures(answer, patch, loop, case)
    if task["method"] == "spinor" and case.kind == "smooth" and task["n"] >= LEAST_POINTS:
        figures["limit_error"] = points_limit(case, task["n"])
    return {**timed, **figures}


def _fill(task: Task) -> Record:
    name, case, cut_out = task["case"], None, None
    if task["suite"] == "cut-outs":
        cut_out = named_cut_out(name, None if task["data"] is None else Path(task["data"]))
        hole = cut_out.hole
    elif task["suite"] == "fills":
        case = known_case(name)
        hole = hole_over(name, case.loop(task["n"]), case.area)
    elif task["suite"] == "meshes":
        mesh = read_mesh(name).mesh
        hole = all_rims(Path(name).name, mesh.vertices, mesh.faces)
    else:
        hole = odd_holes()[name] if task["suite"] == "odd" else ragged_hole(name)
    timed, answer, finish = _timed(lambda: FILLERS[task["method"]].prepare(hole), task["repeat"])
    filled = finish(answer)
    if cut_out is not None:
        figures = cut_out_figures(filled, cut_out)
        if task["view"]:
            save_views(filled, cut_out, Path(task["view"]), task["method"])
    else:
        figures = hole_figures(filled, hole, case)
    if task["suite"] == "ragged":
        figures["sharpness"] = float(np.degrees(np.quantile(turning_angles(hole.loops[hole.places[0]].points), 0.9)))
    return {**timed, **figures, "expected": hole.expected}


def _timed(prepare: Callable[[], tuple[Callable[[], Any], Any]], repeat: int) -> tuple[Record, Any, Any]:
    """The median seconds of the calls after one that is not counted, if any; the last answer, and what goes on."""
    seconds: list[float] = []
    while len(seconds) < repeat + 1 and (len(seconds) < 1 or sum(seconds) < _ENOUGH_SECONDS):
        work, beside = prepare()
        start = time.perf_counter()
        answer = work()
        seconds.append(time.perf_counter() - start)
    counted = seconds[1:] or seconds
    timed = {"seconds": statistics.median(counted), "seconds_all": counted, "memory_mib": peak_memory()}
    return timed, answer, beside


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


def _sentence(error: BaseException) -> str:
    return " ".join(str(error).split())


if __name__ == "__main__":
    serve(lambda task, tell: tell(run(task)))
