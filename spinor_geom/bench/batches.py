"""Batches of many loops and files: loops per second, memory of the processes, and equality of results."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from spinor_geom.batching.engine import BatchProgress, batch
from spinor_geom.bench.ragged import CUT, ragged_hole
from spinor_geom.errors import OptionError
from spinor_geom.gallery import evenly_sampled, harmonics, noisy_loop
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.options import usable_place
from spinor_geom.plateau.solve import solve_plateau, solve_plateau_batch

_FILES, _REFUSED = 3000, 300  # files of each batch; invalid inputs, with which the driver's memory is measured
_REPEATS = 4  # the first one is slower
_CHECK_EVERY = 20  # files between two checks of the workers' memory


def smooth_loop(seed: int) -> BoundaryLoop:
    """100 points by arc length of a random curve of three harmonics around an ellipse of up to 2:1."""
    rng = np.random.default_rng(seed)
    coefficients = np.zeros((4, 3), dtype=np.complex128)
    coefficients[1] = rng.uniform(1, 2), -1j, 0
    for k in (2, 3):
        cosine, sine = rng.uniform(-0.15, 0.15, size=(2, 3)) / k
        coefficients[k] = cosine - 1j * sine
    return evenly_sampled(harmonics(coefficients), 100)


def smooth(seed: int, noise: float = 0.0) -> str:
    """A smooth loop, or one with noise, as OBJ."""
    loop = smooth_loop(seed)
    points = noisy_loop(loop, noise, seed=seed).points if noise else loop.points
    return _points(points) + "l " + " ".join(map(str, [*range(1, len(points) + 1), 1])) + "\n"


def cut(seed: int) -> str:
    """A mesh with a rim that is cut along triangles, turned at random, as OBJ."""
    hole = ragged_hole(CUT[seed % len(CUT)])
    turned = hole.vertices @ Rotation.random(random_state=seed).as_matrix().T
    return _points(turned) + "".join(f"f {a} {b} {c}\n" for a, b, c in (hole.faces + 1).tolist())


def _points(points: Float[np.ndarray, "n 3"]) -> str:
    return "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())


def write_files(folder: Path, count: int, text: Callable[[int], str]) -> Path:
    """Writes OBJ files of one loop each."""
    folder.mkdir()
    for seed in range(count):
        (folder / f"loop{seed:05}.obj").write_text(text(seed))
    return folder


def _watched(inputs: Path, count: int, **options: Any) -> dict[str, Any]:
    """Runs a batch; its figures include the peak memory of this process and of its largest child process."""
    import psutil

    driver, peak, largest = psutil.Process(), 0.0, 0.0

    def record_memory(now: BatchProgress) -> None:
        # during the work only: the packages that the summary imports take more memory
        nonlocal peak, largest
        peak = max(peak, driver.memory_info().rss / 2**20)
        if now.files % _CHECK_EVERY == 1:
            for child in driver.children(recursive=True):
                with suppress(psutil.NoSuchProcess):  # it has ended
                    largest = max(largest, child.memory_info().rss / 2**20)

    start = perf_counter()
    done = batch(str(inputs), inputs.parent / "out", **options, on_progress=record_memory).progress
    seconds = perf_counter() - start
    figures = {"files": count, "seconds": seconds, "rate": done.loops / seconds, "files_failed": done.files_failed}
    return {**figures, "worker_mib": largest, "driver_mib": peak}


def _rate(text: Callable[[int], str], files: float, work: Path, share: float, **options: Any) -> dict[str, Any]:
    """Batch rate over files, in loops per second."""
    count = round(files * share)
    figures = _watched(write_files(work / "in", count, text), count, **options)
    del figures["driver_mib"]
    return figures


def _solved(solve: Callable[[list[BoundaryLoop]], object], count: int, _: Path, share: float) -> dict[str, Any]:
    """Solve rate of smooth loops in memory, in loops per second; the best of a few runs."""
    loops = [smooth_loop(seed) for seed in range(max(1, round(count * share)))]
    seconds = []
    for _repeat in range(_REPEATS):
        # loops cache computed properties
        fresh = [BoundaryLoop.from_points(loop.points, corners=()) for loop in loops]
        start = perf_counter()
        solve(fresh)
        seconds.append(perf_counter() - start)
    return {"files": len(loops), "seconds": min(seconds), "rate": len(loops) / min(seconds)}


def _memory(inputs: int, work: Path, share: float) -> dict[str, Any]:
    """The driver's memory for invalid inputs, which take almost no time."""
    count = round(inputs * share)
    manifest = work / "nowhere.csv"
    manifest.write_text("path\n" + "nowhere.obj\n" * count)
    figures = _watched(manifest, count)
    return {name: figures[name] for name in ("files", "seconds", "driver_mib")}


def _cluster(work: Path, share: float) -> dict[str, Any]:
    """Whether a cluster of four processes writes the same files as a batch without a cluster."""
    from distributed import LocalCluster

    count = round(_FILES / 10 * share)
    inputs = str(write_files(work / "in", count, smooth))
    batch(inputs, work / "embedded")
    start = perf_counter()
    with LocalCluster(n_workers=4, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0") as cluster:
        batch(inputs, work / "cluster", scheduler=cluster.scheduler_address)
    seconds, results = perf_counter() - start, _results(work / "embedded")
    return {"files": count, "seconds": seconds, "equal": bool(results) and results == _results(work / "cluster")}


def _results(output: Path) -> dict[Path, bytes]:
    """All result files except the records, which contain seconds."""
    found = (path for path in output.glob("files/**/*") if path.is_file() and path.suffix != ".json")
    return {path.relative_to(output): path.read_bytes() for path in found}


def _together(device: str | None) -> Callable[[list[BoundaryLoop]], object]:
    return lambda loops: list(solve_plateau_batch(loops, device=device))


BATCHES: dict[str, Callable[[Path, float], dict[str, Any]]] = {
    "smooth loops": partial(_rate, smooth, _FILES),
    "smooth loops, one worker": partial(_rate, smooth, _FILES / 4, workers=1),
    "loops with 5% noise": partial(_rate, partial(smooth, noise=0.05), _FILES / 10),
    "rims cut along triangles": partial(_rate, cut, _FILES / 10),
    "solved only, 64 at once": partial(_solved, _together(None), 64),
    "solved only, one by one": partial(_solved, lambda loops: [solve_plateau(loop) for loop in loops], 64),
    "cluster of 4 processes": _cluster,
    "few inputs": partial(_memory, _REFUSED),
    "ten times as many inputs": partial(_memory, 10 * _REFUSED),
}
"""Batches by name: functions of a working folder and the share of the files to use."""
with suppress(OptionError):  # there is no such device
    usable_place("cuda")
    BATCHES["solved only, on CUDA"] = partial(_solved, _together("cuda"), 2048)
