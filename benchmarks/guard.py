"""Times fills in two checkouts side by side and lists what became slower beyond noise.

`python benchmarks/guard.py BASE [HEAD]` takes the folders of two checkouts; HEAD is this one by default. One process of
each fills the same meshes in turn. The figures are CPU seconds of one thread and their ratios within each turn, so that
other load hardly matters. The exit status is 1 if something became slower.

With `--peer` MeshLib fills them too, with its defaults, and again with as many triangles in each hole as HEAD's patch
has. With `--data FOLDER` the cases are the mesh files of a folder.
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
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from spinor_geom.bench.holes import Hole

OURS, PEER, EQUAL = "spinor-fill", "meshlib-nicely", "equal"
COLUMNS = ("case", "base, ms", "head, ms", "head / base")
PEER_COLUMNS = ("triangles", "MeshLib's", "head / MeshLib", "with equal numbers of triangles")
TURNS = 7  # if nothing changed, all seven ratios are over 1 in one of 128 cases


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a table with one row per case; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", type=Path, metavar="BASE", help="folder of the checkout to compare with")
    parser.add_argument("head", type=Path, nargs="?", metavar="HEAD", default=Path(__file__).parents[1])
    parser.add_argument("--case", default="*", metavar="PATTERN", help="only the cases whose names match")
    parser.add_argument("--turns", type=int, default=TURNS, metavar="N", help="measurements of each case")
    parser.add_argument("--peer", action="store_true", help=f"{PEER} as well")
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="mesh files to fill, instead of the cases")
    options = parser.parse_args(arguments)
    cases = CASES if options.data is None else whole_meshes(options.data)
    some = {name: make for name, make in cases.items() if fnmatchcase(name, options.case)}
    columns = [*COLUMNS, *(PEER_COLUMNS if options.peer else ())]
    print(f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")
    slower, ratios = [], []
    with ExitStack() as stack, tempfile.TemporaryDirectory() as folder:
        workers = [stack.enter_context(Worker(path)) for path in (options.base, options.head)]
        if options.peer:
            workers += [stack.enter_context(Worker(options.head, name)) for name in (PEER, EQUAL)]
        for name, row, is_slower, ratio in measured(some, workers, Path(folder), options.turns):
            print(row, flush=True)
            slower += [name] if is_slower else []
            ratios.append(ratio)
    if options.peer:
        least, median, most = np.quantile(np.array(ratios), [0, 0.5, 1], axis=0)[:, 0]
        print(f"\nhead / MeshLib: {median:.2f} in the median, {least:.2f} to {most:.2f}")
    print(f"\nslower: {', '.join(slower) or 'nothing'}")
    return int(bool(slower))


def saved(name: str, make: "Case", folder: Path) -> list[Path]:
    """The files of the meshes of a case."""
    files = []
    for k, hole in enumerate(make()):
        files.append(folder / f"{name} {k}.npz")
        length = {} if hole.edge_length is None else {"edge_length": hole.edge_length}
        np.savez(files[-1], vertices=hole.vertices, faces=hole.faces, rim=hole.rim, **length)
    return files


def measured(
    cases: Mapping[str, "Case"], workers: Sequence["Worker"], folder: Path, turns: int
) -> Iterator[tuple[str, str, bool, list[float]]]:
    """The name of each case, its row of the table, whether it was slower in all turns, and ratios to MeshLib."""
    for name, make in cases.items():
        files = saved(name, make, folder)
        if len(workers) > 2:
            # MeshLib's second process takes the numbers of triangles from the files
            for file, counts in zip(files, workers[1].triangles(files), strict=True):
                np.savez(file, **dict(np.load(file)), triangles=counts)
        counts = [worker.count(files) for worker in workers]  # the first fill imports modules
        # every second turn in reverse
        seconds = np.array(
            [[worker.seconds(files) for worker in workers[:: 1 - 2 * (turn % 2)]] for turn in range(turns)]
        )
        seconds[1::2] = seconds[1::2, ::-1]
        base, head = 1e3 * np.median(seconds, axis=0)[:2] / len(files)
        ratio = seconds[:, 1] / seconds[:, 0]
        cells = [name, f"{base:.1f}", f"{head:.1f}", f"{np.median(ratio):.2f} ({ratio.min():.2f} to {ratio.max():.2f})"]
        beside = np.median(seconds[:, 1:2] / seconds[:, 2:], axis=0).tolist()
        if beside:
            cells += [f"{count / len(files):.0f}" for count in counts[1:3]]
            cells += [
                f"{beside[0]:.2f}",
                f"{beside[1]:.2f}" if counts[1] else "",
            ]  # if we fill nothing, nor does MeshLib
        yield name, f"| {' | '.join(cells)} |", bool(ratio.min() > 1), beside


class Worker:
    """A process that fills meshes with the package of a checkout, or with another filler."""

    def __init__(self, checkout: Path, filler: str = OURS) -> None:
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

    def count(self, files: Sequence[Path]) -> int:
        """Number of new triangles in all files together."""
        return int(self._answer(self._filler, files)["triangles"])

    def triangles(self, files: Sequence[Path]) -> list[list[int]]:
        """For each file the number of new triangles in the hole at each vertex of its rims; of our fills."""
        return list(self._answer("triangles", files)["by_hole"])

    def _answer(self, request: str, files: Sequence[Path]) -> dict[str, Any]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps([request, *map(str, files)]), file=self._process.stdin, flush=True)
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError("a worker stopped; its message is above")
        return dict(json.loads(answer))


def serve(requests: IO[str], answers: IO[str]) -> None:
    """Answers requests, one a line: a filler, "equal" or "triangles", and files of meshes."""
    for line in requests:
        request, *files = json.loads(line)
        total, triangles, by_hole = 0.0, 0, []
        for file in files:
            fill, faces_of = prepared(request, file)
            start = time.process_time()
            result = fill()
            total += time.process_time() - start
            triangles += faces_of(result)
            if request == "triangles":
                by_hole.append(triangles_at(np.load(file)["rim"], result[1]))
        print(json.dumps({"total": total, "triangles": triangles, "by_hole": by_hole}), file=answers, flush=True)


def prepared(request: str, file: str) -> tuple[Callable[[], Any], Callable[[Any], int]]:
    """The call that fills the holes of a file, and a function that counts the new triangles in its result."""
    from spinor_geom.bench.fillers import FILLERS
    from spinor_geom.bench.holes import Hole
    from spinor_geom.fill.fill_hole import fill_hole

    mesh = dict(np.load(file))
    counts, length, before = mesh.pop("triangles", None), mesh.pop("edge_length", None), len(mesh["faces"])
    hole = Hole(name=file, **mesh)
    if request in (PEER, EQUAL):
        fill, convert = FILLERS[PEER].call(replace(hole, triangles=counts if request == EQUAL else None))
        return fill, lambda result: len(convert(result).faces) - before
    options: dict[str, Any] = {"return_report": True}
    if len(hole.rim_indices) < len(hole.loops):
        options["loop"] = hole.rim_indices
    if length is not None:
        options["target_edge_length"] = float(length)
    return partial(fill_hole, (hole.vertices, hole.faces), **options), lambda result: len(result[0][1]) - before


def triangles_at(rim: np.ndarray, report: Any) -> list[int]:
    """The number of new triangles in the hole at each vertex of the rims."""
    counts = dict.fromkeys(rim.tolist(), 0)
    for outcome in report.loops:
        counts.update(dict.fromkeys(outcome.loop.vertex_ids.tolist(), outcome.faces_added if outcome.filled else 0))
    return [counts[vertex] for vertex in rim.tolist()]


Case = Callable[[], list["Hole"]]


def ragged(names: Sequence[str]) -> list["Hole"]:
    """Cases of the suite "ragged"."""
    from spinor_geom.bench.ragged import ragged_hole

    return [ragged_hole(name) for name in names]


def caps(most: int = 80) -> list["Hole"]:
    """Rims of 24 to 80 points cut along triangles."""
    from spinor_geom.bench.ragged import CUT

    return [hole for hole in ragged(CUT) if 24 <= len(hole.rim) <= most]


def caps_together() -> list["Hole"]:
    """Rims of 24 to 76 points cut along triangles, side by side in one mesh."""
    from spinor_geom.bench.holes import all_rims

    holes = caps(76)[:20]
    starts = np.cumsum([0, *(len(hole.vertices) for hole in holes)])
    vertices = [hole.vertices + np.array([10.0 * k, 0.0, 0.0]) for k, hole in enumerate(holes)]
    faces = [hole.faces + start for hole, start in zip(holes, starts, strict=False)]
    rims = [hole.rim + start for hole, start in zip(holes, starts, strict=False)]
    return [replace(all_rims("", np.concatenate(vertices), np.concatenate(faces)), rim=np.concatenate(rims))]


def smooth(points: int, edges: float | None = None) -> list["Hole"]:
    """A strip down from a wavy ellipse; the patch has edges of that many mean edges of the rim."""
    from spinor_geom.bench.ragged import wavy_rim

    hole = wavy_rim("", points)
    return [replace(hole, edge_length=edges and edges * hole.mean_edge)]


def sphere(subdivisions: int, holes: int) -> list["Hole"]:
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
    return [all_rims("", cut.vertices, cut.faces)]


def whole_meshes(folder: Path) -> Mapping[str, Case]:
    """The mesh files of a folder that have boundary edges; all of their holes are filled."""
    from spinor_geom.bench.holes import hole_of_file, mesh_files

    return {file.name: (lambda file=file: [hole_of_file(file)]) for file in mesh_files(folder)}


CASES: Mapping[str, Case] = {
    "caps of 24 to 80 points": lambda: caps()[::4],
    "20 caps in one mesh": caps_together,
    **{f"smooth rim of {n:,} points": partial(smooth, n) for n in (64, 256, 1000)},
    # with about as many triangles as MeshLib's defaults; beside 1,000 points short edges need more
    **{f"smooth rim of {n:,} points, edges × {x}": partial(smooth, n, x) for n, x in ((64, 0.5), (256, 3), (1000, 8))},
    **{f"noisy rim of {n:,} points": (lambda n=n: ragged([f"noise-15%-{n}"])) for n in (250, 600, 1200)},
    "60 holes in 80,000 faces": lambda: sphere(6, 60),
    "295 holes in 1,200,000 faces": lambda: sphere(8, 295),
}

if __name__ == "__main__":
    if sys.argv[1:] == ["--serve"]:
        serve(sys.stdin, sys.stdout)
    else:
        sys.exit(main())
