"""Pieces cut out of known surfaces and of scans, which a filler should restore."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
from spinor_geom.bench.holes import Hole, cut_hole, lattice, plane_square, sphere
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
TUBE, TORUS, TORUS_TUBE = 0.5, 1.0, 0.4  # radii
_SPHERES = {
    "icosphere-3": "icosphere-3",
    "icosphere-4": "icosphere-4",
    "uv-sphere": "uv-sphere-32",
    "jittered-sphere": "icosphere-4",
}
SCANS = ("bunny_scan.ply", "spot_cut.obj", "max_face.obj", "mountain.obj", "demosthenes_low_res.obj")
PER_SCAN = 12
_FEWEST, _MOST = 20, 150  # points of a scan's rim
_SMALLEST, _LARGEST = 3.0, 24.0  # radii of the disks in scans, in mean edges: rims of about 20 and 150 points
_SEED = 17
_TRIES = 1000


@dataclass(frozen=True, kw_only=True, eq=False)
class CutOut:
    """A mesh with a hole, and the piece that was removed."""

    kind: Kind
    hole: Hole
    vertices: Float[np.ndarray, "n 3"]  # of the whole mesh
    faces: Int[np.ndarray, "f 3"]  # of the removed piece
    kept: Int[np.ndarray, " v"]  # ids in the whole mesh of the vertices of the hole's mesh
    exact: Distances | None = None  # from the known surface, or None for scans

    @cached_property
    def diameter(self) -> float:
        """Largest distance of two points of the rims."""
        return float(pdist(self.hole.vertices[self.hole.rim]).max())

    def distances(self, points: _Points) -> _Values:
        """Distances of points from the known surface, or from the removed piece of a scan."""
        return distances_to_mesh(points, self.vertices, self.faces) if self.exact is None else self.exact(points)


def cut(name: str, kind: Kind, mesh: _Mesh, removed: Bool[np.ndarray, " f"], exact: Distances | None = None) -> CutOut:
    """Removes faces of a mesh."""
    vertices, faces = mesh
    hole = cut_hole(name, vertices, faces, removed, facing=kind in ("ring", "tube"))
    kept = np.unique(faces[~removed])
    return CutOut(kind=kind, hole=hole, vertices=vertices, faces=faces[removed], kept=kept, exact=exact)


def _sphere(name: str) -> _Mesh:
    mesh = sphere(_SPHERES[name])
    vertices = np.array(mesh.vertices)
    if name == "jittered-sphere":
        vertices += _jitter(vertices.shape, mesh.edges_unique_length.mean())
        vertices /= np.linalg.norm(vertices, axis=1)[:, None]
    return vertices, np.array(mesh.faces)


def _plane() -> _Mesh:
    points, faces = plane_square(40)
    return points + [1, 1, 0] * _jitter(points.shape, 1.0), faces


def cylinder(around: int = 48, up: int = 32) -> _Mesh:
    """An open cylinder of radius `TUBE` and height 2."""
    (x, y), faces = lattice(around, up, wrap_x=True)
    angle = 2 * np.pi * x / around
    return np.stack([TUBE * np.cos(angle), TUBE * np.sin(angle), 2 * y / up - 1], axis=1), faces


def _torus() -> _Mesh:
    (x, y), faces = lattice(72, 30, wrap_x=True, wrap_y=True)
    angle, around = 2 * np.pi * x / 72, 2 * np.pi * y / 30
    radius = TORUS + TORUS_TUBE * np.cos(around)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), TORUS_TUBE * np.sin(around)], axis=1), faces


def _jitter(shape: tuple[int, ...], edge: float) -> Float[np.ndarray, "n 3"]:
    """Random displacements of up to 20 % of an edge in every coordinate."""
    return 0.2 * edge * np.random.default_rng(_SEED).uniform(-1, 1, shape)


def _axis_distance(points: _Points) -> _Values:
    return np.asarray(np.hypot(points[:, 0], points[:, 1]))


def _angle(points: _Points) -> _Values:
    """Angle around the z axis."""
    return np.asarray(np.arctan2(points[:, 1], points[:, 0]))


def _above(height: float) -> Choice:
    return lambda points: points[:, 2] > height


def _near(x: float, y: float, z: float, radius: float) -> Choice:
    return lambda points: np.linalg.norm(points - [x, y, z], axis=1) < radius


SURFACES: Mapping[str, tuple[Callable[[], _Mesh], Distances]] = {
    **{name: (partial(_sphere, name), lambda points: np.abs(np.linalg.norm(points, axis=1) - 1)) for name in _SPHERES},
    "plane": (_plane, lambda points: np.abs(points[:, 2])),
    "cylinder": (cylinder, lambda points: np.abs(_axis_distance(points) - TUBE)),
    "torus": (_torus, lambda points: np.abs(np.hypot(_axis_distance(points) - TORUS, points[:, 2]) - TORUS_TUBE)),
}
"""Meshes of known surfaces, and distances of points from the surfaces."""

CAPS: Mapping[str, tuple[Kind, str, Choice]] = {
    f"{name}-{height:g}": ("dome", name, _above(height)) for name in _SPHERES for height in HEIGHTS
}
"""Caps of unit spheres: kind, surface, and which centroids belong to removed faces."""

WINDOWS: Mapping[str, tuple[Kind, str, Choice]] = {
    "plane-window": ("flat", "plane", _near(20, 20, 0, 10)),
    **{f"cylinder-{radius:g}": ("curved", "cylinder", _near(TUBE, 0, 0, radius)) for radius in (0.2, 0.35, 0.5)},
    **{f"torus-outside-{radius:g}": ("curved", "torus", _near(1.4, 0, 0, radius)) for radius in (0.25, 0.4)},
    **{f"torus-inside-{radius:g}": ("curved", "torus", _near(0.6, 0, 0, radius)) for radius in (0.25, 0.4)},
    **{f"torus-top-{radius:g}": ("curved", "torus", _near(1, 0, 0.4, radius)) for radius in (0.25, 0.4)},
    "cylinder-slot": ("long", "cylinder", lambda points: (abs(_angle(points)) < 0.3) & (abs(points[:, 2]) < 0.8)),
    "torus-slot": (
        "long",
        "torus",
        lambda points: (abs(_angle(points)) < 1) & (abs(points[:, 2]) < 0.15) & (_axis_distance(points) > TORUS),
    ),
    "sphere-ring": ("ring", "icosphere-4", lambda points: (points[:, 2] > 0.3) & (points[:, 2] < 0.8)),
    # the rims of the wide band bound no connected minimal surface
    "cylinder-band": ("tube", "cylinder", lambda points: abs(points[:, 2]) < 0.2),
    "cylinder-band-wide": ("tube", "cylinder", lambda points: abs(points[:, 2]) < 0.4),
    "torus-band": ("tube", "torus", lambda points: abs(_angle(points)) < 0.2),
}
"""Windows, slots and bands of planes, cylinders, tori and a sphere."""


def scan_names(folder: Path | None) -> tuple[str, ...]:
    """Names of the disks cut out of the scans in a folder."""
    here = [] if folder is None else [name for name in SCANS if (folder / name).is_file()]
    return tuple(f"{Path(name).stem}-{k:02d}" for name in here for k in range(PER_SCAN))


def _scan_disk(name: str, folder: Path) -> CutOut:
    """Removes the faces within a random edge distance of a random vertex. Draws again until they form a disk."""
    stem, _, number = name.rpartition("-")
    scan = next(file for file in SCANS if Path(file).stem == stem)
    mesh, graph, edge = _read_scan(folder / scan)
    faces = mesh[1]
    border = np.unique(boundary_edges(faces))
    rng = np.random.default_rng([_SEED, int(number)])
    for _ in range(_TRIES):
        start = int(rng.choice(np.unique(faces)))
        radius = edge * float(np.exp(rng.uniform(np.log(_SMALLEST), np.log(_LARGEST))))
        distance = np.asarray(dijkstra(graph, directed=False, indices=np.array(start), limit=radius))
        removed = np.asarray(np.isfinite(distance[faces]).all(axis=1))
        if is_disk(faces[removed]) and not np.isin(faces[removed], border).any():
            found = cut(name, "scan", mesh, removed)
            rims = [found.hole.loops[k] for k in found.hole.rim_indices]
            if len(rims) == 1 and _FEWEST <= len(rims[0]) == len(found.hole.rim) <= _MOST:
                return found
    raise OptionError(f"{scan}: no disk with a rim of {_FEWEST} to {_MOST} points was found in {_TRIES} tries")


@lru_cache(maxsize=1)
def _read_scan(path: Path) -> tuple[_Mesh, csr_array, float]:
    """A mesh, the graph of its edges with their lengths, and the mean length."""
    mesh = read_mesh(path).mesh
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    lengths = surface.edges_unique_length
    graph = coo_array((lengths, surface.edges_unique.T), shape=(len(mesh.vertices),) * 2)
    return (mesh.vertices, mesh.faces), graph.tocsr(), float(lengths.mean())


@lru_cache(maxsize=128)  # every filler is run on all of them
def named_cut_out(name: str, folder: Path | None = None) -> CutOut:
    """A cut-out by name. Those of scans need the folder of the mesh files."""
    if name in CAPS or name in WINDOWS:
        kind, surface, chosen = {**CAPS, **WINDOWS}[name]
        make, exact = SURFACES[surface]
        vertices, faces = make()
        return cut(name, kind, (vertices, faces), chosen(vertices[faces].mean(axis=1)), exact)
    if folder is None or name not in scan_names(folder):
        raise OptionError(f"there is no cut-out {name!r}; scans are read from the folder of mesh files")
    return _scan_disk(name, folder)
