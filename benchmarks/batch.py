"""Measures batches: loops a second, memory, equal bytes, and what solving small loops side by side brings.

`python benchmarks/batch.py` prints the tables, `--write` replaces those in benchmarks/README.md; `--files N` takes
fewer files than the thousand of the target. Every batch is a process of its own, as on the command line, and is timed
up to the written summary.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from figure_tables import Figure, figure_table, note, replaced_section

from spinor_geom import BoundaryLoop, PlateauSolution, mesh_patch, solve_plateau, solve_plateau_batch
from spinor_geom.bench.machine import machine, told
from spinor_geom.bench.tables import Table
from spinor_geom.files import atomic_path
from spinor_geom.gallery import noisy_loop

README = Path(__file__).parent / "README.md"
BEGIN, END = "<!-- batch: begin (written by batch.py) -->", "<!-- batch: end -->"
FILES, POINTS, NOISE = 1000, 100, 0.05
RATE, SPEED_UP, GROWTH = 6.0, 1.8, 1.1
FEW, MANY = 1000, 10_000
RUN = """
import json, sys, time
import psutil
from spinor_geom import batch
memory = 0
def look(_):
    # while it works: the system's own peak may be the parent's, and the packages of the summary take more than the work
    global memory
    memory = max(memory, psutil.Process().memory_info().rss / 2**20)
if __name__ == "__main__":
    start = time.perf_counter()
    result = batch(**json.loads(sys.argv[1]), on_progress=look)
    seconds = time.perf_counter() - start
    print(json.dumps({"seconds": seconds, "memory": memory, "loops": result.progress.loops,
                      "files": result.progress.files, "failed": result.progress.files_failed}))
"""


def smooth_loop(seed: int, points: int = POINTS) -> BoundaryLoop:
    """A random curve of three harmonics around an ellipse of up to 2:1."""
    random = np.random.default_rng(seed)
    t = 2 * np.pi * np.arange(points) / points
    curve = np.stack([random.uniform(1, 2) * np.cos(t), np.sin(t), np.zeros(points)], axis=1)
    for k in (2, 3):
        cosine, sine = random.uniform(-0.15, 0.15, size=(2, 3)) / k
        curve += np.cos(k * t)[:, None] * cosine + np.sin(k * t)[:, None] * sine
    return BoundaryLoop.from_points(curve)


def rough_loop(seed: int) -> BoundaryLoop:
    """The same with noise."""
    return noisy_loop(smooth_loop(seed), NOISE, seed=seed)


def write_files(folder: Path, count: int, loop: Callable[[int], BoundaryLoop]) -> Path:
    """OBJ files of one closed curve each."""
    folder.mkdir()
    for seed in range(count):
        points = loop(seed).points
        text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
        numbers = " ".join(map(str, [*range(1, len(points) + 1), 1]))
        (folder / f"loop{seed:05}.obj").write_text(f"{text}l {numbers}\n")
    return folder


def batch_run(inputs: Path, output: Path, **options: Any) -> dict[str, float]:
    """Seconds, megabytes of the driver, and counts of one batch."""
    arguments = json.dumps({"inputs": str(inputs), "output": str(output), **options})
    command = [sys.executable, "-c", RUN, arguments]
    # not from the clone, whose source would hide the installed package
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=output.parent)
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


def meshes(output: Path) -> dict[str, str]:
    """Checksums of all files of results but the records, which hold seconds."""
    return {
        str(path.relative_to(output)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in output.glob("files/**/*")
        if path.is_file() and path.suffix != ".json"
    }


def rates(work: Path, files: int) -> tuple[list[Figure], Path]:
    """Loops a second with default settings and with one worker; gives the folder of results of the former too."""
    figures = []
    for name, loop, promised in (("smooth", smooth_loop, True), (f"{NOISE:.0%} noise", rough_loop, False)):
        count = files if promised else max(files // 10, 1)
        inputs = write_files(work / name.replace(" ", "_"), count, loop)
        runs = {}
        for workers in (None, 1):
            note(f"{count} files, {name}, {workers or 'default'} workers")
            runs[workers] = batch_run(inputs, work / f"{inputs.name}-{workers}", workers=workers)
        case = f"{count} files, {POINTS} vertices, {name}"
        rate, alone = (runs[workers]["loops"] / runs[workers]["seconds"] for workers in (None, 1))
        if promised:
            figures.append(Figure.at_least(case, "loops/s, default settings", rate, RATE))
            figures.append(Figure.at_least(case, "times the rate of one worker", rate / alone, SPEED_UP))
        else:
            figures.append(Figure(case=case, name="loops/s, default settings", measured=f"{rate:.2f}"))
        failed = int(runs[None]["failed"])
        figures.append(Figure(case=case, name="files not wholly done", measured=str(failed)))
    return figures, work / "smooth-None"


def cluster_figure(work: Path, embedded: Path) -> Figure:
    """Whether a cluster of four processes on loopback leaves the bytes of an embedded run."""
    from distributed import LocalCluster

    note("a cluster of four workers")
    with LocalCluster(n_workers=4, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0") as cluster:
        batch_run(work / "smooth", work / "cluster", scheduler=cluster.scheduler_address)
    ours, theirs = meshes(embedded), meshes(work / "cluster")
    equal = sum(theirs.get(name) == checksum for name, checksum in ours.items())
    return Figure(
        case="cluster of 4 processes on loopback",
        name="files equal to the embedded run's",
        measured=f"{equal} of {len(ours)}",
        target="all",
        met=bool(ours) and ours == theirs,
    )


def memory_figures(work: Path, share: float) -> list[Figure]:
    """Peak memory of the driver for few and for ten times as many inputs, which are refused quickly."""
    figures = []
    peaks = []
    for count in (round(FEW * share), round(MANY * share)):
        note(f"memory with {count} inputs")
        manifest = work / f"{count}.csv"
        manifest.write_text("path\n" + "nowhere.obj\n" * count)
        peaks.append(batch_run(manifest, work / f"memory{count}")["memory"])
        figures.append(
            Figure(case=f"{count} inputs", name="peak memory of the driver, MiB", measured=f"{peaks[-1]:.0f}")
        )
    figures.append(Figure.at_most("ten times as many inputs", "times the memory", peaks[1] / peaks[0], GROWTH))
    return figures


def side_by_side(count: int = 48) -> Table:
    """Seconds a loop alone and side by side, both with meshing, one after the other in one process."""
    rows = []
    for points in (12, 24, 48, 100):
        loops = [smooth_loop(seed, points) for seed in range(count)]
        list(solve_plateau_batch(loops[:4]))
        start = perf_counter()
        alone = [solve_plateau(loop) for loop in loops]
        middle = perf_counter()
        together = list(solve_plateau_batch(loops))
        end = perf_counter()
        for solution in alone:
            mesh_patch(solution)
        meshed = perf_counter() - end
        areas = [other.area if isinstance(other, PlateauSolution) else None for other in together]
        equal = sum(one.area == area for one, area in zip(alone, areas, strict=True))
        seconds = [f"{1000 * part / count:.0f}" for part in (middle - start, end - middle, meshed)]
        rows.append((str(points), *seconds, f"{equal} of {count}"))
    return Table(
        title="Loops side by side",
        columns=("vertices", "alone, ms", "side by side, ms", "meshing, ms", "areas equal to the last bit"),
        rows=tuple(rows),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures; returns the exit status, 0 also where a target is missed."""
    parser = argparse.ArgumentParser(description="Measures batches.")
    parser.add_argument("--files", type=int, default=FILES, help="files of each batch (default: %(default)s)")
    parser.add_argument("--write", action="store_true", help="replace the tables in benchmarks/README.md")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        figures, embedded = rates(work, options.files)
        figures.append(cluster_figure(work, embedded))
        figures += memory_figures(work, options.files / FILES)
    section = "\n\n".join([told(machine()), str(figure_table("Batches", figures)), str(side_by_side())])
    if options.write:
        text = replaced_section(README.read_text(encoding="utf-8"), section, begin=BEGIN, end=END)
        with atomic_path(README) as path:
            path.write_text(text, encoding="utf-8")
    else:
        sys.stdout.write(section + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
