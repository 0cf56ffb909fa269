"""Batches of many loops and files: loops a second, memory of driver and workers, and equal bytes."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from spinor_geom.batching.engine import BatchProgress, batch
from spinor_geom.bench.cut_outs import CUT, ragged_hole
from spinor_geom.gallery import evenly_sampled, harmonics, noisy_loop
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.solve import solve_plateau, solve_plateau_batch

POINTS, NOISE = 100, 0.05
FILES, FEW_INPUTS = 3000, 300  # of each batch, and refused ones for the memory of the driver
SOLVED, SOLVED_ON_CUDA = 64, 2048  # loops that are solved only, as one batch
REPEATS = 4  # of which the first one is slower
LOOKS_APART = 20  # files between two looks at the workers' memory


def smooth_loop(seed: int) -> BoundaryLoop:
    """Points by arc length of a random curve of three harmonics around an ellipse of up to 2:1."""
    random = np.random.default_rng(seed)
    coefficients = np.zeros((4, 3), dtype=np.complex128)
    coefficients[1] = random.uniform(1, 2), -1j, 0
    for k in (2, 3):
        cosine, sine = random.uniform(-0.15, 0.15, size=(2, 3)) / k
        coefficients[k] = cosine - 1j * sine
    return evenly_sampled(harmonics(coefficients), POINTS)


def smooth(seed: int, noise: float = 0.0) -> str:
    """A smooth loop, or one with noise, as OBJ."""
    loop = smooth_loop(seed)
    points = noisy_loop(loop, noise, seed=seed).points if noise else loop.points
    return _points(points) + "l " + " ".join(map(str, [*range(1, len(points) + 1), 1])) + "\n"


def cut(seed: int) -> str:
    """A mesh whose rim is cut along triangles, one of sixty, turned at random."""
    hole = ragged_hole(CUT[seed % len(CUT)])
    turned = hole.vertices @ Rotation.random(random_state=seed).as_matrix().T
    return _points(turned) + "".join(f"f {a} {b} {c}\n" for a, b, c in (hole.faces + 1).tolist())


def _points(points: Float[np.ndarray, "n 3"]) -> str:
    return "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())


def write_files(folder: Path, count: int, text: Callable[[int], str]) -> Path:
    """OBJ files of one loop each."""
    folder.mkdir()
    for seed in range(count):
        (folder / f"loop{seed:05}.obj").write_text(text(seed))
    return folder


def _watched(inputs: Path, count: int, **options: Any) -> dict[str, Any]:
    """A batch up to the written summary, and the most memory of this process and of the largest one below it."""
    import psutil

    driver, peak, largest = psutil.Process(), 0.0, 0.0

    def look(now: BatchProgress) -> None:
        # while it works: the packages of the summary take more than the work
        nonlocal peak, largest
        peak = max(peak, driver.memory_info().rss / 2**20)
        if now.files % LOOKS_APART == 1:
            for child in driver.children(recursive=True):
                with suppress(psutil.NoSuchProcess):  # it has ended
                    largest = max(largest, child.memory_info().rss / 2**20)

    start = perf_counter()
    done = batch(str(inputs), inputs.parent / "out", **options, on_progress=look).progress
    seconds = perf_counter() - start
    figures = {"files": count, "seconds": seconds, "rate": done.loops / seconds, "files_failed": done.files_failed}
    return {**figures, "worker_mib": largest, "driver_mib": peak}


def _rate(work: Path, text: Callable[[int], str], files: int, **options: Any) -> dict[str, Any]:
    figures = _watched(write_files(work / "in", files, text), files, **options)
    return {name: value for name, value in figures.items() if name != "driver_mib"}


def _solved(count: int, solve: Callable[[list[BoundaryLoop]], object]) -> dict[str, Any]:
    """Smooth loops a second that are solved, the fastest of a few times."""
    loops = [smooth_loop(seed) for seed in range(max(1, count))]
    seconds = []
    for _ in range(REPEATS):
        # what a loop has found of itself stays with it
        anew = [BoundaryLoop.from_points(loop.points, corners=()) for loop in loops]
        start = perf_counter()
        solve(anew)
        seconds.append(perf_counter() - start)
    return {"files": len(loops), "seconds": min(seconds), "rate": len(loops) / min(seconds)}


def _memory(work: Path, inputs: int) -> dict[str, Any]:
    """Of inputs that are refused quickly, the memory of the driver."""
    manifest = work / "nowhere.csv"
    manifest.write_text("path\n" + "nowhere.obj\n" * inputs)
    figures = _watched(manifest, inputs)
    return {name: figures[name] for name in ("files", "seconds", "driver_mib")}


def _cluster(work: Path, files: int) -> dict[str, Any]:
    """Whether a cluster of four processes on loopback leaves the bytes of an embedded run."""
    from distributed import LocalCluster

    inputs = str(write_files(work / "in", files, smooth))
    batch(inputs, work / "embedded")
    start = perf_counter()
    with LocalCluster(n_workers=4, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0") as cluster:
        batch(inputs, work / "cluster", scheduler=cluster.scheduler_address)
    ours, theirs = _left_in(work / "embedded"), _left_in(work / "cluster")
    return {"files": files, "seconds": perf_counter() - start, "equal": bool(ours) and ours == theirs}


def _left_in(output: Path) -> dict[Path, bytes]:
    """All files of results but the records, which hold seconds."""
    found = (path for path in output.glob("files/**/*") if path.is_file() and path.suffix != ".json")
    return {path.relative_to(output): path.read_bytes() for path in found}


def _together(device: str) -> Callable[[list[BoundaryLoop]], object]:
    return lambda loops: list(solve_plateau_batch(loops, device=device))


BATCHES: dict[str, Callable[[Path, float], dict[str, Any]]] = {
    "smooth loops": lambda work, share: _rate(work, smooth, round(FILES * share)),
    "smooth loops, one worker": lambda work, share: _rate(work, smooth, round(FILES / 4 * share), workers=1),
    "loops with 5% noise": lambda work, share: _rate(work, partial(smooth, noise=NOISE), round(FILES / 10 * share)),
    "rims cut along triangles": lambda work, share: _rate(work, cut, round(FILES / 10 * share)),
    "solved only, 64 at once": lambda _, share: _solved(round(SOLVED * share), _together("cpu")),
    "solved only, one by one": lambda _, share: _solved(
        round(SOLVED * share), lambda loops: [solve_plateau(loop) for loop in loops]
    ),
    "cluster of 4 processes": lambda work, share: _cluster(work, round(FILES / 10 * share)),
    "few inputs": lambda work, share: _memory(work, round(FEW_INPUTS * share)),
    "ten times as many inputs": lambda work, share: _memory(work, round(10 * FEW_INPUTS * share)),
}
"""What is measured, given a folder to work in and the share of the files that are taken."""
if torch.cuda.is_available():
    BATCHES["solved only, on CUDA"] = lambda _, share: _solved(round(SOLVED_ON_CUDA * share), _together("cuda"))
