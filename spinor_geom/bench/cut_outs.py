"""Pieces cut out of known surfaces and of scans, which a filler should put back; ragged rims, as people have them."""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.distance import pdist

from spinor_geom.adapters import read_mesh
from spinor_geom.bench.cases import Hole, collar, lattice
from spinor_geom.errors import OptionError
from spinor_geom.measures import distances_to_mesh
from spinor_geom.mesh.topology import boundary_edges, is_disk

Kind = Literal["flat", "dome", "curved", "long", "ring", "tube", "scan"]
_Points: TypeAlias = Float[np.ndarray, "k 3"]
_Values: TypeAlias = Float[np.ndarray, " k"]
Distances: TypeAlias = Callable[[_Points], _Values]
Choice: TypeAlias = Callable[[_Points], Bool[np.ndarray, " k"]]
_Mesh: TypeAlias = tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"]]

HEIGHTS = (0.85, 0.7, 0.3, 0.0)  # above which the caps of unit spheres are removed
JITTER = 0.2  # moves of vertices, in mean edges
TUBE, TORUS, TORUS_TUBE = 0.5, 1.0, 0.4  # radii
_SPHERES = ("icosphere-3", "icosphere-4", "uv-sphere", "jittered-sphere")
SCANS = ("bunny_scan.ply", "spot_cut.obj", "max_face.obj", "mountain.obj", "demosthenes_low_res.obj")
PER_SCAN = 12
FEWEST, MOST = 20, 150  # points of a scan's rim
_SMALLEST, _LARGEST = 3.0, 24.0  # radii of the disks grown on scans, in mean edges: rims of about 20 and 150 points
_SEED = 17
_TRIES = 1000


@dataclass(frozen=True, kw_only=True, eq=False)
class CutOut:
    """A mesh with a hole, and what was in it."""

    kind: Kind
    hole: Hole  # the rest of the mesh
    vertices: Float[np.ndarray, "n 3"]  # of the whole mesh, a surface's own points
    faces: Int[np.ndarray, "f 3"]  # the removed ones
    places: Int[np.ndarray, " v"]  # of each vertex of the hole's mesh, among those of the whole
    exact: Distances | None = None  # from the surface; without, the removed faces are all that is known

    @cached_property
    def diameter(self) -> float:
        """Largest distance of two points of the rims."""
        return float(pdist(self.hole.vertices[self.hole.rim]).max())

    def distances(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
        """Distances of points from what was removed: from the exact surface where it is known."""
        return distances_to_mesh(points, self.vertices, self.faces) if self.exact is None else self.exact(points)


def cut(name: str, kind: Kind, mesh: _Mesh, removed: Bool[np.ndarray, " f"], exact: Distances | None = None) -> CutOut:
    """Takes faces out of a mesh; vertices that no other face uses go with them."""
    vertices, faces = mesh
    used, rest = np.unique(faces[~removed], return_inverse=True)
    rim = np.flatnonzero(np.isin(used, faces[removed]))
    hole = Hole(name=name, vertices=vertices[used], faces=rest.reshape(-1, 3), rim=rim, facing=kind in ("ring", "tube"))
    return CutOut(kind=kind, hole=hole, vertices=vertices, faces=faces[removed], places=used, exact=exact)


def _sphere(ball: str) -> _Mesh:
    if ball == "uv-sphere":
        made = trimesh.creation.uv_sphere(count=[32, 32])
    else:
        made = trimesh.creation.icosphere(3 if ball == "icosphere-3" else 4)
    vertices = np.array(made.vertices)
    if ball == "jittered-sphere":
        vertices += _jitter(vertices.shape, made.edges_unique_length.mean())
        vertices /= np.linalg.norm(vertices, axis=1)[:, None]
    return vertices, np.array(made.faces)


def _plane() -> _Mesh:
    (x, y), faces = lattice(40, 40)
    return np.stack([x, y, 0 * x], axis=1) + [1, 1, 0] * _jitter((len(x), 3), 1.0), faces


def _cylinder(around: int = 48, up: int = 32) -> _Mesh:
    (x, y), faces = lattice(around, up, wrap_x=True)
    angle = 2 * np.pi * x / around
    return np.stack([TUBE * np.cos(angle), TUBE * np.sin(angle), 2 * y / up - 1], axis=1), faces


def _torus() -> _Mesh:
    (x, y), faces = lattice(72, 30, wrap_x=True, wrap_y=True)
    angle, around = 2 * np.pi * x / 72, 2 * np.pi * y / 30
    radius = TORUS + TORUS_TUBE * np.cos(around)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), TORUS_TUBE * np.sin(around)], axis=1), faces


def _jitter(shape: tuple[int, ...], edge: float) -> Float[np.ndarray, "n 3"]:
    return JITTER * edge * np.random.default_rng(_SEED).uniform(-1, 1, shape)


def _axis_distance(points: _Points) -> _Values:
    return np.asarray(np.hypot(points[:, 0], points[:, 1]))


def _turn(points: _Points) -> _Values:
    return np.asarray(np.arctan2(points[:, 1], points[:, 0]))


def _above(height: float) -> Choice:
    return lambda points: points[:, 2] > height


def _near(x: float, y: float, z: float, radius: float) -> Choice:
    return lambda points: np.linalg.norm(points - [x, y, z], axis=1) < radius


SURFACES: Mapping[str, tuple[Callable[[], _Mesh], Distances]] = {
    **{ball: (partial(_sphere, ball), lambda points: np.abs(np.linalg.norm(points, axis=1) - 1)) for ball in _SPHERES},
    "plane": (_plane, lambda points: np.abs(points[:, 2])),
    "cylinder": (_cylinder, lambda points: np.abs(_axis_distance(points) - TUBE)),
    "torus": (_torus, lambda points: np.abs(np.hypot(_axis_distance(points) - TORUS, points[:, 2]) - TORUS_TUBE)),
}
"""Meshes of known surfaces, and the distance of points from each."""

CAPS: Mapping[str, tuple[Kind, str, Choice]] = {
    f"{ball}-{height:g}": ("dome", ball, _above(height)) for ball in _SPHERES for height in HEIGHTS
}
"""Caps of unit spheres: kind, surface, and which faces are cut out, by their middles."""

WINDOWS: Mapping[str, tuple[Kind, str, Choice]] = {
    "plane-window": ("flat", "plane", _near(20, 20, 0, 10)),
    **{f"cylinder-{radius:g}": ("curved", "cylinder", _near(TUBE, 0, 0, radius)) for radius in (0.2, 0.35, 0.5)},
    **{f"torus-outside-{radius:g}": ("curved", "torus", _near(1.4, 0, 0, radius)) for radius in (0.25, 0.4)},
    **{f"torus-inside-{radius:g}": ("curved", "torus", _near(0.6, 0, 0, radius)) for radius in (0.25, 0.4)},
    **{f"torus-top-{radius:g}": ("curved", "torus", _near(1, 0, 0.4, radius)) for radius in (0.25, 0.4)},
    "cylinder-slot": ("long", "cylinder", lambda points: (abs(_turn(points)) < 0.3) & (abs(points[:, 2]) < 0.8)),
    "torus-slot": (
        "long",
        "torus",
        lambda points: (abs(_turn(points)) < 1) & (abs(points[:, 2]) < 0.15) & (_axis_distance(points) > TORUS),
    ),
    "sphere-ring": ("ring", "icosphere-4", lambda points: (points[:, 2] > 0.3) & (points[:, 2] < 0.8)),
    # no minimal surface joins the rims of the wide one
    "cylinder-band": ("tube", "cylinder", lambda points: abs(points[:, 2]) < 0.2),
    "cylinder-band-wide": ("tube", "cylinder", lambda points: abs(points[:, 2]) < 0.4),
    "torus-band": ("tube", "torus", lambda points: abs(_turn(points)) < 0.2),
}
"""Windows, slots and bands of planes, cylinders, tori and a sphere."""


def scan_names(folder: Path | None) -> tuple[str, ...]:
    """Names of the disks cut out of the scans that a folder holds."""
    here = [] if folder is None else [name for name in SCANS if (folder / name).is_file()]
    return tuple(f"{Path(name).stem}-{place:02d}" for name in here for place in range(PER_SCAN))


def scan_disk(name: str, folder: Path) -> CutOut:
    """The faces within a random distance along edges from a random vertex, both drawn until they make a disk."""
    stem, _, place = name.rpartition("-")
    scan = next(file for file in SCANS if Path(file).stem == stem)
    mesh, graph, edge = _read_scan(folder / scan)
    faces = mesh[1]
    border = np.unique(boundary_edges(faces))
    random = np.random.default_rng([_SEED, int(place)])
    for _ in range(_TRIES):
        seed = int(random.choice(np.unique(faces)))
        radius = edge * float(np.exp(random.uniform(np.log(_SMALLEST), np.log(_LARGEST))))
        distance = np.asarray(dijkstra(graph, directed=False, indices=np.array(seed), limit=radius))
        removed = np.asarray(np.isfinite(distance[faces]).all(axis=1))
        if is_disk(faces[removed]) and not np.isin(faces[removed], border).any():
            found = cut(name, "scan", mesh, removed)
            loops = [found.hole.loops[k] for k in found.hole.places]
            if len(loops) == 1 and FEWEST <= len(loops[0]) == len(found.hole.rim) <= MOST:
                return found
    raise OptionError(f"{scan}: no disk with a rim of {FEWEST} to {MOST} points was found in {_TRIES} tries")


@lru_cache(maxsize=1)
def _read_scan(path: Path) -> tuple[_Mesh, csr_array, float]:
    """A mesh, its edges with their lengths, and their mean."""
    mesh = read_mesh(path).mesh
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    lengths = surface.edges_unique_length
    graph = coo_array((lengths, surface.edges_unique.T), shape=(len(mesh.vertices),) * 2)
    return (mesh.vertices, mesh.faces), graph.tocsr(), float(lengths.mean())


@lru_cache(maxsize=128)  # one tool after the other asks for all
def named_cut_out(name: str, folder: Path | None = None) -> CutOut:
    """The cut-out of a name; those of scans need the folder of the mesh files."""
    if name in CAPS or name in WINDOWS:
        kind, surface, chosen = {**CAPS, **WINDOWS}[name]
        make, exact = SURFACES[surface]
        vertices, faces = make()
        return cut(name, kind, (vertices, faces), chosen(vertices[faces].mean(axis=1)), exact)
    if folder is None or name not in scan_names(folder):
        raise OptionError(f"there is no cut-out {name!r} here; scans are read from the folder of mesh files")
    return scan_disk(name, folder)


SHORTEST, LONGEST = 13, 120
CUT = tuple(f"cut-{place:02}" for place in range(60))
"""Names of the first 60 rims of so many points that are cut out of generated meshes."""

NOISY: Mapping[str, tuple[float, int]] = {
    f"noise-{noise:.0%}-{points}": (noise, points) for noise in (0.05, 0.15, 0.3) for points in (100, 250, 600, 1200)
}
"""Noise in mean edges and points of rims with noise."""


def ragged_hole(name: str) -> Hole:
    """The rim of a name: inside a strip that goes down from a noisy ellipse, or cut."""
    if name not in NOISY:
        return replace(_cut_holes()[CUT.index(name)], name=name)
    noise, points = NOISY[name]
    t = 2 * np.pi * np.arange(points) / points
    rim = np.column_stack([2 * np.cos(t), np.sin(t), 0.3 * np.sin(2 * t)])
    edge = np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1).mean()
    inner = rim + noise * edge * np.random.default_rng(points).standard_normal(rim.shape)
    return collar(name, inner, np.column_stack([2.6 * np.cos(t), 1.6 * np.sin(t), np.full(points, -0.8)]))


@lru_cache(maxsize=1)
def _cut_holes() -> list[Hole]:
    """Caps and windows of icospheres, UV spheres, tori, cylinders and noisy ellipsoids, each with a single rim."""
    random, found = np.random.default_rng(0), list[Hole]()
    for make, least, most in itertools.cycle(_MESHES):
        mesh = make(random)
        if make is _can:  # a point of its side
            turn = random.uniform(0, 2 * np.pi)
            centre = np.array([TUBE * np.cos(turn), TUBE * np.sin(turn), random.uniform(-0.4, 0.4)])
        else:
            centre = mesh.vertices[int(random.integers(len(mesh.vertices)))]
        removed = np.linalg.norm(mesh.triangles_center - centre, axis=1) <= random.uniform(least, most)
        hole = cut("", "curved", (np.array(mesh.vertices), np.array(mesh.faces)), removed).hole
        if len(hole.loops) == 1 and SHORTEST <= len(hole.loops[0]) <= LONGEST:
            found.append(hole)
        if len(found) == len(CUT):
            break
    return found


def _can(_: np.random.Generator) -> trimesh.Trimesh:
    """A closed cylinder, its side divided into a grid."""
    vertices, side = _cylinder(40, 25)
    ring, after = np.arange(40), (np.arange(40) + 1) % 40
    bottom = np.column_stack([np.full(40, len(vertices)), after, ring])
    top = np.column_stack([np.full(40, len(vertices) + 1), 1000 + ring, 1000 + after])
    ends = [[0, 0, -1], [0, 0, 1]]
    return trimesh.Trimesh(np.vstack([vertices, ends]), np.vstack([side, bottom, top]), process=False)


def _ellipsoid(random: np.random.Generator) -> trimesh.Trimesh:
    """An ellipsoid whose vertices are off by 15 % of an edge in every coordinate."""
    ball: trimesh.Trimesh = trimesh.creation.icosphere(int(random.integers(2, 5)))
    ball.vertices = ball.vertices * [1.0, random.uniform(0.4, 0.9), random.uniform(0.4, 0.9)]
    ball.vertices = ball.vertices + 0.15 * ball.edges_unique_length.mean() * random.standard_normal(ball.vertices.shape)
    return ball


# what is cut, and the radii of the balls that cut it
_MESHES: tuple[tuple[Callable[[np.random.Generator], trimesh.Trimesh], float, float], ...] = (
    (lambda random: trimesh.creation.icosphere(int(random.integers(2, 5))), 0.25, 0.9),
    (lambda random: trimesh.creation.uv_sphere(count=[int(random.integers(20, 45))] * 2), 0.25, 0.6),
    (lambda _: trimesh.creation.torus(1.0, 0.4, major_sections=48, minor_sections=24), 0.15, 0.45),
    (_can, 0.15, 0.4),
    (_ellipsoid, 0.2, 0.6),
)
