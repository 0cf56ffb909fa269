"""The holes that people have: rims cut along triangles, scans, noisy collars; MeshLib beside us in the same run."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from figure_tables import Figure, figure_table
from jaxtyping import Float, Int

from spinor_geom import FillResult, boundary_loops, fill_hole, read_mesh
from spinor_geom.adapters.mesh_files import FORMATS
from spinor_geom.bench.tables import Table
from spinor_geom.mesh.boundary_loop import turning_angles

Pair = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]

SHORTEST, LONGEST, RIMS = 13, 120, 60
SHARP = np.radians(130.0)  # nine points in ten turn by less on the milder rims
TOLERANCE = 1e-3
NOISE, POINTS, SECONDS = (0.05, 0.15, 0.3), (100, 250, 600, 1200), (0.15, 0.5, 2.0, 6.0)


@dataclass(frozen=True, kw_only=True)
class Record:
    """One mesh filled by us and by MeshLib; seconds of the fill alone, without reading."""

    name: str
    report: FillResult
    seconds: float
    meshlib: float

    @property
    def residuals(self) -> list[float]:
        """RMS residual per mean edge of each rim that was asked for, infinite where it has no exact surface."""
        return [
            np.inf
            if outcome.solution is None or not outcome.filled
            else outcome.solution.boundary_residual.rms_per_edge
            for outcome in self.report.loops
            if outcome.requested
        ]


def everyday(only: str, folder: Path) -> list[Table]:
    """Rims of all three kinds whose name has `only` in it."""
    filled(next(generated()), "warm-up")
    tables = []
    rims = [filled(pair, name) for name, pair in named_rims() if only in name]
    if rims:
        tables.append(figure_table("Everyday rims, generated", list(of_rims(rims))))
    meshes = [
        filled(pair, path.name)
        for path in sorted(folder.iterdir())
        if path.suffix in FORMATS and only in path.name and (pair := mesh_of(path)) is not None
    ]
    if meshes:
        tables.append(mesh_table(meshes))
    noisy = list(of_noise(only))
    return [*tables, figure_table("Noisy rims: ellipse 2:1", noisy)] if noisy else tables


def filled(pair: Pair, name: str) -> Record:
    """Fills all holes of a mesh with both."""
    start = time.perf_counter()
    _, report = fill_hole(pair, return_report=True)
    seconds = time.perf_counter() - start
    return Record(name=name, report=report, seconds=seconds, meshlib=meshlib_seconds(pair))


def meshlib_seconds(pair: Pair) -> float:
    """Seconds that MeshLib's fillHoleNicely takes for all holes."""
    from meshlib import mrmeshnumpy, mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(pair[1].astype(np.int32), pair[0].astype(np.float32))
    start = time.perf_counter()
    for edge in mesh.topology.findHoleRepresentiveEdges():
        mrmeshpy.fillHoleNicely(mesh, edge, mrmeshpy.FillHoleNicelySettings())
    return time.perf_counter() - start


# --- generated rims ---------------------------------------------------------------------------------------------------


def named_rims() -> Iterator[tuple[str, Pair]]:
    """The first 60 meshes with a single rim of 13 to 120 points."""
    for found, pair in enumerate(generated()):
        if found == RIMS:
            return
        yield f"rim {found}", pair


def generated(seed: int = 0) -> Iterator[Pair]:
    """Caps and windows of icospheres, UV spheres, tori, cylinders and noisy ellipsoids, cut along triangles."""
    random = np.random.default_rng(seed)
    while True:
        for vertices, faces, centre, radius in (
            icosphere(random),
            uv_sphere(random),
            torus(random),
            cylinder(random),
            ellipsoid(random),
        ):
            kept = faces[np.linalg.norm(vertices[faces].mean(axis=1) - centre, axis=1) > radius]
            used, index = np.unique(kept, return_inverse=True)
            pair = vertices[used], index.reshape(kept.shape)
            loops = boundary_loops(pair)
            if len(loops) == 1 and SHORTEST <= len(loops[0]) <= LONGEST:
                yield pair


Cut = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"], Float[np.ndarray, "3"], float]


def icosphere(random: np.random.Generator) -> Cut:
    """A unit sphere of 320 to 5,120 equal triangles."""
    return _cut(trimesh.creation.icosphere(int(random.integers(2, 5))), random, 0.25, 0.9)


def uv_sphere(random: np.random.Generator) -> Cut:
    """A unit sphere by latitude and longitude: slivers at its poles."""
    count = int(random.integers(20, 45))
    return _cut(trimesh.creation.uv_sphere(count=[count, count]), random, 0.25, 0.6)


def torus(random: np.random.Generator) -> Cut:
    """A torus of radii 1 and 0.4."""
    return _cut(trimesh.creation.torus(1.0, 0.4, major_sections=48, minor_sections=24), random, 0.15, 0.45)


def cylinder(random: np.random.Generator) -> Cut:
    """The side of a cylinder of radius 0.5, divided into a grid."""
    angle, height = np.meshgrid(2 * np.pi * np.arange(40) / 40, np.linspace(-1, 1, 26))
    vertices = np.column_stack([0.5 * np.cos(angle.ravel()), 0.5 * np.sin(angle.ravel()), height.ravel()])
    row, column = (part.ravel() for part in np.meshgrid(np.arange(25), np.arange(40), indexing="ij"))
    a, b = 40 * row + column, 40 * row + (column + 1) % 40
    ring, after = np.arange(40), (np.arange(40) + 1) % 40
    bottom = np.column_stack([np.full(40, len(vertices)), after, ring])
    top = np.column_stack([np.full(40, len(vertices) + 1), 1000 + ring, 1000 + after])
    faces = np.vstack([np.column_stack([a, b, b + 40]), np.column_stack([a, b + 40, a + 40]), bottom, top])
    turn = random.uniform(0, 2 * np.pi)
    centre = np.array([0.5 * np.cos(turn), 0.5 * np.sin(turn), random.uniform(-0.4, 0.4)])
    return np.vstack([vertices, [[0, 0, -1], [0, 0, 1]]]), faces, centre, random.uniform(0.15, 0.4)


def ellipsoid(random: np.random.Generator) -> Cut:
    """An ellipsoid whose vertices are off by 15 % of an edge in every coordinate."""
    ball = trimesh.creation.icosphere(int(random.integers(2, 5)))
    ball.vertices = ball.vertices * [1.0, random.uniform(0.4, 0.9), random.uniform(0.4, 0.9)]
    ball.vertices = ball.vertices + 0.15 * ball.edges_unique_length.mean() * random.standard_normal(ball.vertices.shape)
    return _cut(ball, random, 0.2, 0.6)


def _cut(mesh: trimesh.Trimesh, random: np.random.Generator, least: float, most: float) -> Cut:
    vertices = np.asarray(mesh.vertices)
    centre = vertices[int(random.integers(len(vertices)))]
    return vertices, np.asarray(mesh.faces), centre, random.uniform(least, most)


def of_rims(records: list[Record]) -> Iterator[Figure]:
    """What is promised of the generated rims."""
    outcomes = [record.report.loops[0] for record in records]
    met = np.array([record.residuals[0] <= TOLERANCE for record in records])
    sharp = np.array([np.quantile(turning_angles(outcome.loop.points), 0.9) >= SHARP for outcome in outcomes])
    seconds = np.array([record.seconds for record in records])
    ratio = seconds / [record.meshlib for record in records]
    yield Figure.at_least("all", "share closed", float(np.mean([outcome.filled for outcome in outcomes])), 1.0)
    yield Figure.at_least(f"{np.sum(~sharp)} milder", "share within 1e-3", float(met[~sharp].mean()), 0.95)
    yield Figure.at_least(f"{np.sum(sharp)} sharper", "share within 1e-3", float(met[sharp].mean()), 0.6)
    yield Figure.at_most("all", "seconds, median", float(np.median(seconds)), 0.15)
    yield Figure.at_most("all", "seconds, most", float(seconds.max()), 1.0)
    yield Figure(case="all", name="seconds in MeshLib's, median", measured=f"{np.median(ratio):.1f}")
    crossing = sum(outcome.intersections > 0 for outcome in outcomes)
    yield Figure.at_most("all", "patches that cross something", float(crossing), 0.0)
    yield Figure(case="all", name="discrete", measured=str(sum(outcome.kind == "discrete" for outcome in outcomes)))


# --- real meshes ------------------------------------------------------------------------------------------------------


def mesh_of(path: Path) -> Pair | None:
    """The triangles of a mesh file; None for one without faces."""
    mesh = read_mesh(path).mesh
    return (np.asarray(mesh.vertices), np.asarray(mesh.faces)) if len(mesh.faces) else None


def mesh_table(records: list[Record]) -> Table:
    """A row a mesh."""
    rows = []
    for record in records:
        loops = record.report.loops
        kinds = [outcome.kind for outcome in loops]
        slowest = max(outcome.timings.get("total", 0.0) for outcome in loops)
        within = np.sum(np.array(record.residuals) <= TOLERANCE)
        rows.append(
            (
                record.name,
                str(len(loops)),
                str(kinds.count("minimal")),
                str(kinds.count("discrete")),
                str(sum(outcome.is_border for outcome in loops)),
                str(sum(outcome.requested and not outcome.filled for outcome in loops)),
                str(within),
                str(sum(outcome.intersections > 0 for outcome in loops)),
                f"{record.seconds:.2f}",
                f"{slowest:.2f}",
                f"{record.meshlib:.3f}",
                f"{record.seconds / record.meshlib:.1f}",
            )
        )
    columns = ("mesh", "rims", "minimal", "discrete", "borders", "open", "within 1e-3", "crossing")
    return Table(
        title="Real meshes, defaults",
        columns=(*columns, "s", "slowest rim, s", "MeshLib, s", "ratio"),
        rows=tuple(rows),
        note="Borders of sheets are left open, and seams count among the open ones; MeshLib closes both.",
    )


# --- noisy rims -------------------------------------------------------------------------------------------------------


def of_noise(only: str) -> Iterator[Figure]:
    """Collars around an ellipse whose points are off by shares of an edge, in every coordinate."""
    for noise in NOISE:
        for points, limit in zip(POINTS, SECONDS, strict=True):
            name = f"{noise:.0%} noise, {points} points"
            if only not in name:
                continue
            record = filled(collar(points, noise), name)
            allowed = 1e-2 if noise > 0.2 else TOLERANCE
            yield Figure.at_most(name, "RMS residual per edge", min(record.residuals), allowed)
            yield Figure.at_most(name, "seconds", record.seconds, limit)


def collar(points: int, noise: float) -> Pair:
    """A strip outside a noisy ellipse: its inner rim is the hole, its outer one is closed by a cone below."""
    random = np.random.default_rng(points)
    t = 2 * np.pi * np.arange(points) / points
    rim = np.column_stack([2 * np.cos(t), np.sin(t), 0.3 * np.sin(2 * t)])
    edge = np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1).mean()
    inner = rim + noise * edge * random.standard_normal(rim.shape)
    outer = np.column_stack([2.6 * np.cos(t), 1.6 * np.sin(t), np.full(points, -0.8)])
    i, j = np.arange(points), (np.arange(points) + 1) % points
    faces = np.vstack(
        [
            np.column_stack([i, i + points, j]),
            np.column_stack([j, i + points, j + points]),
            np.column_stack([i + points, np.full(points, 2 * points), j + points]),
        ]
    )
    return np.vstack([inner, outer, [[0, 0, -3]]]), faces
