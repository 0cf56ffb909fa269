"""Times fills in two checkouts side by side and lists what became slower beyond noise.

`python benchmarks/guard.py BASE [HEAD]` takes the folders of two checkouts; HEAD is this one by default. One process of
each, and with `--peer` one of MeshLib, fills the same meshes in turn. The figures are CPU seconds of one thread and
their ratios within each turn, so that other load hardly matters. The exit status is 1 if something became slower.

With `--stages` it prints the CPU time of the stages of a fill in both checkouts instead.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from fnmatch import fnmatchcase
from functools import reduce
from importlib import import_module
from pathlib import Path
from typing import IO, Any

import numpy as np

PEER = "meshlib-nicely"
TURNS = 7  # if nothing changed, all seven ratios are over 1 in one of 128 cases
# where the function of each stage is called: module, names of the owner and the function
STAGES: Mapping[str, tuple[str, ...]] = {
    "loops, choice of holes": ("fill.fill_hole", "Filling"),
    "first disks": ("plateau.solve", "first_disks"),
    "mesh": ("fill.exact_patches", "mesh_patches"),
    "intersections": ("fill.filling", "fill_loop"),
    "stitch, report": ("fill.filling", "Filling", "result"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a table with one row per case; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", type=Path, metavar="BASE", help="folder of the checkout to compare with")
    parser.add_argument("head", type=Path, nargs="?", metavar="HEAD", default=Path(__file__).parents[1])
    parser.add_argument("--case", default="*", metavar="PATTERN", help="only the cases whose names match")
    parser.add_argument("--turns", type=int, default=TURNS, metavar="N", help="measurements of each case")
    parser.add_argument("--peer", action="store_true", help=f"{PEER} as well")
    parser.add_argument("--stages", action="store_true", help="the stages of a fill instead")
    options = parser.parse_args(arguments)
    some = {name: make for name, make in CASES.items() if fnmatchcase(name, options.case)}
    if options.stages:
        return print_stages(some, options.base, options.head)
    print("| case | base, ms | head, ms | head / base | head / MeshLib |\n| --- | --- | --- | --- | --- |")
    slower = []
    with ExitStack() as stack, tempfile.TemporaryDirectory() as folder:
        workers = [stack.enter_context(Worker(path)) for path in (options.base, options.head)]
        if options.peer:
            workers.append(stack.enter_context(Worker(options.head, PEER)))
        for name, row, is_slower in measured(some, workers, Path(folder), options.turns):
            print(row, flush=True)
            slower += [name] if is_slower else []
    print(f"\nslower: {', '.join(slower) or 'nothing'}")
    return int(bool(slower))


def print_stages(cases: Mapping[str, "Case"], base: Path, head: Path) -> int:
    """Prints the milliseconds per mesh of each stage, in base and head; returns 0."""
    names = ["total", "solve", *STAGES]
    print(f"| case | {' | '.join(names)} |\n| --- |{' --- |' * len(names)}")
    with ExitStack() as stack, tempfile.TemporaryDirectory() as folder:
        workers = [stack.enter_context(Worker(path)) for path in (base, head)]
        for name, make in cases.items():
            files = saved(name, make, Path(folder))
            for worker in workers:  # the first fill imports modules
                worker.seconds(files[:1])
            both = [worker.stages(files) for worker in workers]
            cells = (" → ".join(f"{1e3 * each[stage] / len(files):.1f}" for each in both) for stage in names)
            print(f"| {name} | {' | '.join(cells)} |", flush=True)
    return 0


def saved(name: str, make: "Case", folder: Path) -> list[Path]:
    """The files of the meshes of a case."""
    files = []
    for k, (vertices, faces, rim) in enumerate(make()):
        files.append(folder / f"{name} {k}.npz")
        np.savez(files[-1], vertices=vertices, faces=faces, rim=rim)
    return files


def measured(
    cases: Mapping[str, "Case"], workers: Sequence["Worker"], folder: Path, turns: int
) -> Iterator[tuple[str, str, bool]]:
    """The name of each case, its row of the table, and whether it was slower in all turns."""
    for name, make in cases.items():
        files = saved(name, make, folder)
        for worker in workers:  # the first fill imports modules
            worker.seconds(files[:1])
        # every second turn in reverse
        seconds = np.array(
            [[worker.seconds(files) for worker in workers[:: 1 - 2 * (turn % 2)]] for turn in range(turns)]
        )
        seconds[1::2] = seconds[1::2, ::-1]
        base, head, *peer = 1e3 * np.median(seconds, axis=0) / len(files)
        ratio = seconds[:, 1] / seconds[:, 0]
        beside = f"{np.median(seconds[:, 1] / seconds[:, 2]):.2f}" if peer else ""
        spread = f"{np.median(ratio):.2f} ({ratio.min():.2f} to {ratio.max():.2f})"
        yield name, f"| {name} | {base:.1f} | {head:.1f} | {spread} | {beside} |", bool(ratio.min() > 1)


class Worker:
    """A process that fills meshes with the package of a checkout, or with another filler."""

    def __init__(self, checkout: Path, filler: str = "spinor-fill") -> None:
        self._filler = filler
        self._environment = {**os.environ, "PYTHONPATH": str(checkout.resolve()), "OMP_NUM_THREADS": "1"}

    def __enter__(self) -> "Worker":
        command = [sys.executable, __file__, "--serve"]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "env": self._environment}
        self._process = subprocess.Popen(command, text=True, **pipes)
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def seconds(self, files: Sequence[Path]) -> float:
        """CPU seconds in which the holes of all files were filled."""
        return float(self._answer(self._filler, files)["total"])

    def stages(self, files: Sequence[Path]) -> dict[str, float]:
        """CPU seconds of each stage, of the rest, "solve", and in total."""
        return self._answer("stages", files)

    def _answer(self, request: str, files: Sequence[Path]) -> dict[str, float]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps([request, *map(str, files)]), file=self._process.stdin, flush=True)
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError("a worker stopped; its message is above")
        return dict(json.loads(answer))


def serve(requests: IO[str], answers: IO[str]) -> None:
    """Answers requests, one a line: a filler, or "stages", and files of meshes."""
    from spinor_geom.bench.fillers import FILLERS
    from spinor_geom.bench.holes import Hole

    stages: dict[str, float] = {}
    for line in requests:
        request, *files = json.loads(line)
        if request == "stages" and not stages:
            stages = watched_stages()
        stages.update(dict.fromkeys(stages, 0.0))
        total = 0.0
        for file in files:
            filler = FILLERS["spinor-fill" if request == "stages" else request]
            fill, _ = filler.prepare(Hole(name=file, **np.load(file)))
            start = time.process_time()
            fill()
            total += time.process_time() - start
        rest = total - sum(stages.values())
        print(json.dumps({"total": total, **stages, "solve": rest}), file=answers, flush=True)


def watched_stages() -> dict[str, float]:
    """CPU seconds of each stage, to which every later call of its function adds."""
    seconds = dict.fromkeys(STAGES, 0.0)

    def watch(stage: str, owner: Any, name: str) -> None:
        call = getattr(owner, name)

        def watched(*arguments: Any, **options: Any) -> Any:
            start = time.process_time()
            try:
                return call(*arguments, **options)
            finally:
                seconds[stage] += time.process_time() - start

        setattr(owner, name, watched)

    # methods first: in their modules the names of their classes are replaced later
    for stage, (module, *owners, name) in sorted(STAGES.items(), key=lambda item: -len(item[1])):
        watch(stage, reduce(getattr, owners, import_module(f"spinor_geom.{module}")), name)
    return seconds


# vertices, faces, and the vertices of the rims to fill
Mesh = tuple[np.ndarray, np.ndarray, np.ndarray]
Case = Callable[[], list[Mesh]]


def ragged(names: Sequence[str]) -> list[Mesh]:
    """Cases of the suite "ragged"."""
    from spinor_geom.bench.ragged import ragged_hole

    holes = [ragged_hole(name) for name in names]
    return [(hole.vertices, hole.faces, hole.rim) for hole in holes]


def caps() -> list[Mesh]:
    """Rims of 24 to 80 points cut along triangles."""
    from spinor_geom.bench.ragged import CUT

    return [mesh for mesh in ragged(CUT) if 24 <= len(mesh[2]) <= 80][::4]


def caps_together(count: int = 20) -> list[Mesh]:
    """Rims of 24 to 76 points cut along triangles, side by side in one mesh."""
    from spinor_geom.bench.ragged import CUT

    meshes = [mesh for mesh in ragged(CUT) if 24 <= len(mesh[2]) <= 76][:count]
    starts = np.cumsum([0, *(len(mesh[0]) for mesh in meshes)])
    apart = [mesh[0] + [10.0 * k, 0.0, 0.0] for k, mesh in enumerate(meshes)]
    faces, rims = (np.concatenate([mesh[k] + n for mesh, n in zip(meshes, starts, strict=False)]) for k in (1, 2))
    return [(np.concatenate(apart), faces, rims)]


def smooth(points: int) -> list[Mesh]:
    """A strip down from a wavy ellipse."""
    from spinor_geom.bench.holes import collar

    t = 2 * np.pi * np.arange(points) / points
    rim = np.column_stack([2 * np.cos(t), np.sin(t), 0.3 * np.sin(2 * t)])
    hole = collar("", rim, np.column_stack([2.6 * np.cos(t), 1.6 * np.sin(t), np.full(points, -0.8)]))
    return [(hole.vertices, hole.faces, hole.rim)]


def sphere(subdivisions: int, holes: int) -> list[Mesh]:
    """A bumpy sphere with many holes of different sizes."""
    import trimesh
    from scipy.spatial import cKDTree

    from spinor_geom.bench.holes import all_rims, cut_hole

    ball, rng = trimesh.creation.icosphere(subdivisions), np.random.default_rng(0)
    places, edge = ball.triangles_center, ball.edges_unique_length.mean()
    z, turn = 1 - (2 * np.arange(holes) + 1) / holes, np.pi * (3 - 5**0.5) * np.arange(holes)
    centres = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    distance, nearest = cKDTree(centres).query(places)
    removed = distance < edge * np.exp(rng.uniform(np.log(2.7), np.log(14), holes))[nearest]
    points = ball.vertices * (1 + 0.05 * np.sin(5 * ball.vertices[:, :1]) * np.cos(4 * ball.vertices[:, 1:2]))
    points = points + 0.1 * edge * rng.standard_normal(points.shape)
    cut = cut_hole("", points, ball.faces, removed)
    hole = all_rims("", cut.vertices, cut.faces)
    return [(hole.vertices, hole.faces, hole.rim)]


CASES: Mapping[str, Case] = {
    "caps of 24 to 80 points": caps,
    "20 caps in one mesh": caps_together,
    **{f"smooth rim of {n:,} points": (lambda n=n: smooth(n)) for n in (64, 256, 1000)},
    **{f"noisy rim of {n:,} points": (lambda n=n: ragged([f"noise-15%-{n}"])) for n in (250, 600, 1200)},
    "60 holes in 80,000 faces": lambda: sphere(6, 60),
    "295 holes in 1,200,000 faces": lambda: sphere(8, 295),
}

if __name__ == "__main__":
    if sys.argv[1:] == ["--serve"]:
        serve(sys.stdin, sys.stdout)
    else:
        sys.exit(main())
