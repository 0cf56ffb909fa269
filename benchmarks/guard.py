"""Times fills with the packages of two checkouts side by side and lists what became slower beyond noise.

`python benchmarks/guard.py BASE [HEAD]` takes the folders of two checkouts. HEAD is this one by default. One process of
each fills the same meshes in turn. The figures are CPU seconds of one thread and their ratios within each turn, so that
other load hardly matters. The exit status is 1 if something became slower. With `--data FOLDER` the cases are the mesh
files of a folder.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from spinor_geom.bench.holes import Hole

TURNS = 7  # if nothing changed, all seven ratios are over 1 in one of 128 cases


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a table with one row per case. Returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", type=Path, metavar="BASE", help="folder of the checkout to compare with")
    parser.add_argument("head", type=Path, nargs="?", metavar="HEAD", default=Path(__file__).parents[1])
    parser.add_argument("--case", default="*", metavar="PATTERN", help="only the cases whose names match")
    parser.add_argument("--turns", type=int, default=TURNS, metavar="N", help="measurements of each case")
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="mesh files to fill, instead of the cases")
    options = parser.parse_args(arguments)
    cases = CASES if options.data is None else whole_meshes(options.data)
    print("| case | base, ms | head, ms | head / base |\n| --- | --- | --- | --- |")
    slower = []
    with ExitStack() as stack, tempfile.TemporaryDirectory() as folder:
        base, head = (stack.enter_context(filler(path)) for path in (options.base, options.head))
        for name in (name for name in cases if fnmatchcase(name, options.case)):
            files = []
            for k, mesh in enumerate(cases[name]()):
                files.append(str(Path(folder, f"{name} {k}.npz")))
                np.savez(files[-1], **mesh)
            row, is_slower = measured(files, base, head, options.turns)
            print(f"| {name} | {row} |", flush=True)
            slower += [name] if is_slower else []
    print(f"\nslower: {', '.join(slower) or 'nothing'}")
    return int(bool(slower))


Fill = Callable[[Sequence[str]], float]  # the CPU seconds in which the holes of all files were filled


def measured(files: Sequence[str], base: Fill, head: Fill, turns: int) -> tuple[str, bool]:
    """The figures of a case, and whether it was slower in all turns."""
    base(files), head(files)  # the first fill imports modules
    # every second turn in reverse
    pairs = [(base(files), head(files)) if turn % 2 else (head(files), base(files))[::-1] for turn in range(turns)]
    old, new = np.array(pairs).T
    ratio, (before, after) = new / old, 1e3 * np.median(pairs, axis=0) / len(files)
    row = f"{before:.1f} | {after:.1f} | {np.median(ratio):.2f} ({ratio.min():.2f} to {ratio.max():.2f})"
    return row, bool(ratio.min() > 1)


@contextmanager
def filler(checkout: Path) -> Iterator[Fill]:
    """A process that fills meshes with the package of a checkout."""
    environment = {**os.environ, "PYTHONPATH": str(checkout.resolve()), "OMP_NUM_THREADS": "1"}
    command, pipe = [sys.executable, __file__, "--serve"], subprocess.PIPE
    with subprocess.Popen(command, text=True, stdin=pipe, stdout=pipe, env=environment) as process:

        def seconds(files: Sequence[str]) -> float:
            assert process.stdin is not None
            assert process.stdout is not None
            print(json.dumps(files), file=process.stdin, flush=True)
            return float(process.stdout.readline() or sys.exit("a process stopped; its message is above"))

        yield seconds


def serve() -> None:
    """Fills the meshes of files, a list of names on each line of standard input, and prints the CPU seconds."""
    from spinor_geom.fill.fill_hole import fill_hole

    for line in sys.stdin:
        total = 0.0
        for file in json.loads(line):
            arrays = dict(np.load(file))
            mesh = arrays.pop("vertices"), arrays.pop("faces")
            options: Any = {name: array.tolist() for name, array in arrays.items()}
            start = time.process_time()
            fill_hole(mesh, **options, return_report=True)
            total += time.process_time() - start
        print(total, flush=True)


Case = Callable[[], list[dict[str, Any]]]  # vertices, faces and options of `fill_hole`


def inputs(hole: "Hole", **options: Any) -> dict[str, Any]:
    """The mesh of a hole, and its rims, unless all loops are rims."""
    some = {"loop": hole.rim_indices} if len(hole.rim_indices) < len(hole.loops) else {}
    return {"vertices": hole.vertices, "faces": hole.faces, **some, **options}


def ragged(select: Callable[[int], bool], *names: str) -> list[dict[str, Any]]:
    """Cases of the suite "ragged" with certain numbers of points. Those cut along triangles if none is named."""
    from spinor_geom.bench.ragged import CUT, ragged_hole

    return [inputs(hole) for hole in map(ragged_hole, names or CUT) if select(len(hole.rim))]


def smooth(points: int, edges: float | None = None) -> list[dict[str, Any]]:
    """A strip down from a wavy ellipse. The patch has edges of that many mean edges of the rim."""
    from spinor_geom.bench.ragged import wavy_rim

    hole = wavy_rim("", points)
    return [inputs(hole, **({"target_edge_length": edges * hole.mean_edge} if edges else {}))]


def sphere(subdivisions: int, holes: int) -> list[dict[str, Any]]:
    """A bumpy sphere with many holes of different sizes."""
    import trimesh
    from scipy.spatial import cKDTree

    ball, rng = trimesh.creation.icosphere(subdivisions), np.random.default_rng(0)
    places, edge = ball.triangles_center, ball.edges_unique_length.mean()
    z, turn = 1 - (2 * np.arange(holes) + 1) / holes, np.pi * (3 - 5**0.5) * np.arange(holes)
    centres = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    distance, nearest = cKDTree(centres).query(places)
    kept = distance >= edge * np.exp(rng.uniform(np.log(2.7), np.log(14), holes))[nearest]
    points = ball.vertices * (1 + 0.05 * np.sin(5 * ball.vertices[:, :1]) * np.cos(4 * ball.vertices[:, 1:2]))
    points = points + 0.1 * edge * rng.standard_normal(points.shape)
    used, faces = np.unique(ball.faces[kept], return_inverse=True)
    return [{"vertices": points[used], "faces": faces.reshape(-1, 3)}]


def whole_meshes(folder: Path) -> Mapping[str, Case]:
    """The mesh files of a folder that have boundary edges. All of their holes are filled."""
    from spinor_geom.bench.holes import hole_of_file, mesh_files

    return {file.name: (lambda file=file: [inputs(hole_of_file(file))]) for file in mesh_files(folder)}


CASES: Mapping[str, Case] = {
    "caps of 24 to 80 points": lambda: ragged(lambda points: 24 <= points <= 80)[::4],
    **{f"smooth rim of {n:,} points": partial(smooth, n) for n in (64, 256, 1000)},
    **{f"smooth rim of {n:,} points, edges × {x}": partial(smooth, n, x) for n, x in ((64, 0.5), (256, 3), (1000, 8))},
    **{f"noisy rim of {n:,} points": partial(ragged, bool, f"noise-15%-{n}") for n in (250, 600, 1200)},
    "60 holes in 80,000 faces": lambda: sphere(6, 60),
    "295 holes in 1,200,000 faces": lambda: sphere(8, 295),
}

if __name__ == "__main__":
    sys.exit(serve() if sys.argv[1:] == ["--serve"] else main())
