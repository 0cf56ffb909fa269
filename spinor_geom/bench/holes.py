"""Meshes with holes for the hole fillers: a collar around a known rim, odd rims, mesh files."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from spinor_geom.adapters import read_mesh
from spinor_geom.adapters.mesh_files import FORMATS
from spinor_geom.discrete.minimal_surface import discrete_minimal_surface
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.loops import find_boundary_loops
from spinor_geom.mesh.topology import boundary_edges
from spinor_geom.mesh.triangle_mesh import TriangleMesh

# width of a collar per edge of the rim: the height of an equilateral triangle
_COLLAR = math.sqrt(0.75)
# of the squares of odd rims, on a side
_GRID = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class Hole:
    """A mesh with one or more rims to be closed; its other boundaries, which are longer, are to be left open.

    Attributes:
        name: for tables.
        vertices: of the mesh.
        faces: of the mesh.
        rim: ids of the vertices of the rims.
        expected: what a tool should do, in a few words; empty where it is to close the rims.
        facing: whether its two rims face each other, so that a tool that can join rims is to join them.
        area: of the minimal surface over the rims, where it is known.
    """

    name: str
    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    rim: Int[np.ndarray, " r"]
    expected: str = ""
    facing: bool = False
    area: float | None = None

    @cached_property
    def rim_edges(self) -> Int[np.ndarray, "e 2"]:
        """The edges to be closed."""
        edges = boundary_edges(self.faces)
        return edges[np.isin(edges, self.rim).all(axis=1)]

    @cached_property
    def outer_edges(self) -> Int[np.ndarray, "e 2"]:
        """The boundary edges to be left open."""
        edges = boundary_edges(self.faces)
        return edges[~np.isin(edges, self.rim).all(axis=1)]

    @cached_property
    def loops(self) -> list[BoundaryLoop]:
        """All boundary loops, longest first."""
        return find_boundary_loops(TriangleMesh(self.vertices, self.faces))

    @cached_property
    def places(self) -> list[int]:
        """Which of the loops are rims to be closed."""
        return [place for place, loop in enumerate(self.loops) if np.isin(loop.vertex_ids, self.rim).all()]

    @cached_property
    def edge_limit(self) -> int:
        """Number of edges that all rims together, which some tools walk around as one, do not exceed.

        Where another boundary is as short it is one edge shorter than that, which still lets each single rim pass;
        those shorter than a rim cannot be told from it, and are closed with it.
        """
        inner = [len(self.loops[place]) for place in self.places]
        outer = [len(loop) for place, loop in enumerate(self.loops) if place not in self.places]
        return min([sum(inner), *(count - 1 for count in outer if count > max(inner))])

    @cached_property
    def mean_edge(self) -> float:
        """Mean length of the edges to be closed."""
        start, end = self.vertices[self.rim_edges].swapaxes(0, 1)
        return float(np.linalg.norm(end - start, axis=1).mean())


def hole_over(name: str, loop: BoundaryLoop, area: float | None = None) -> Hole:
    """A collar one triangle wide around a loop; its outer boundary has one point more, so that tools can tell them.

    The collar goes on as the discrete minimal surface over the loop ends, so that a filler that continues the mesh
    smoothly is led the right way.
    """
    n = len(loop)
    disk = discrete_minimal_surface(loop)
    a, b, c = (disk.vertices[disk.faces[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    normal = np.zeros((len(disk.vertices), 3))
    for k in range(3):
        np.add.at(normal, disk.faces[:, k], across)
    tangent = np.roll(loop.points, -1, axis=0) - np.roll(loop.points, 1, axis=0)
    outward = np.cross(tangent, normal[:n])
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    outer = loop.points + _COLLAR * loop.mean_edge_length * outward
    return replace(collar(name, loop.points, np.insert(outer, 1, (outer[0] + outer[1]) / 2, axis=0)), area=area)


def collar(name: str, rim: Float[np.ndarray, "n 3"], outer: Float[np.ndarray, "n+1 3"], *, expected: str = "") -> Hole:
    """Triangles between a rim and an outer curve that has one point more, its second."""
    n = len(rim)
    i = np.arange(n)
    after = (i + 1) % n
    across = np.append(n, n + 2 + np.arange(n - 1))
    first = np.stack([i, across, across[after]], axis=1)
    second = np.stack([i, across[after], after], axis=1)
    split = np.array([[0, n, n + 1], [0, n + 1, n + 2]])
    faces = np.concatenate([first[1:], second, split])
    return Hole(name=name, vertices=np.concatenate([rim, outer]), faces=faces, rim=i, expected=expected)


# --- odd rims ---------------------------------------------------------------------------------------------------------


def figure_eight(n: int = 64) -> Hole:
    """A plane curve that crosses itself in the middle of two edges."""
    t = 2 * np.pi * (np.arange(n) + 0.5) / n
    return _upright("figure-eight", np.stack([np.sin(t), np.sin(2 * t) / 2, 0 * t], axis=1), "bounds no embedded disk")


def knot(n: int = 48) -> Hole:
    """A trefoil."""
    t = 2 * np.pi * np.arange(n) / n
    r = 2 + np.cos(3 * t)
    points = np.stack([r * np.cos(2 * t), r * np.sin(2 * t), np.sin(3 * t)], axis=1)
    return _upright("knot", points, "every disk over it crosses itself")


def _upright(name: str, points: Float[np.ndarray, "n 3"], expected: str) -> Hole:
    """A collar that goes down and outwards."""
    outer = points * [1.15, 1.15, 1.0] - [0, 0, 0.25]
    return collar(name, points, np.insert(outer, 1, (outer[0] + outer[1]) / 2, axis=0), expected=expected)


def bow_tie() -> Hole:
    """Two square holes of a plane grid that touch in a vertex."""
    cells = [(x, y) for x in range(3, 6) for y in range(3, 6)] + [(x, y) for x in range(6, 9) for y in range(6, 9)]
    return _pierced("bow-tie", cells, "two patches that share a vertex")


def island() -> Hole:
    """A hole of a plane grid with an island of faces in it."""
    cells = [(x, y) for x in range(3, 9) for y in range(3, 9) if not (x in (5, 6) and y in (5, 6))]
    return _pierced("island", cells, "one patch with a hole for the island")


def slit() -> Hole:
    """A plane grid cut open along a line: a rim of zero width."""
    vertices, faces = _grid()
    line = [_GRID // 2 * (_GRID + 1) + x for x in range(3, 10)]
    copies = {old: len(vertices) + k for k, old in enumerate(line[1:-1])}
    above = vertices[faces].mean(axis=1)[:, 1] > _GRID // 2
    cut = faces.copy()
    cut[above] = np.vectorize(lambda v: copies.get(v, v))(faces[above])
    points = np.concatenate([vertices, vertices[line[1:-1]]])
    rim = np.array([*line, *copies.values()])
    return Hole(name="slit", vertices=points, faces=cut, rim=rim, expected="merge its sides: there is nothing to fill")


def facing_rims(height: float, n: int = 48) -> Hole:
    """Two unit circles at z = ±h with collars that lead away from each other."""
    t = 2 * np.pi * np.arange(n) / n
    circle = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    outer = 1.1 * circle + np.array([0, 0, 0.1])
    lift = np.array([0, 0, height])
    upper = collar("", circle + lift, np.insert(outer, 1, (outer[0] + outer[1]) / 2, axis=0) + lift)
    lower = upper.vertices * [1, 1, -1]
    joined = height < 0.66274
    expected = (
        "the catenoid between them has less area than two disks"
        if height < 0.5277
        else "a catenoid between them is a local minimum, two disks have less area"
        if joined
        else "no minimal annulus between them: two disks"
    )
    return Hole(
        name=f"facing rims at ±{height:g}",
        vertices=np.concatenate([upper.vertices, lower]),
        faces=np.concatenate([upper.faces, upper.faces[:, ::-1] + len(lower)]),
        rim=np.concatenate([upper.rim, upper.rim + len(lower)]),
        expected=expected,
        facing=True,
        area=catenoid_area(height) if joined else None,
    )


def catenoid_area(height: float) -> float:
    """Area of the stable catenoid between unit circles at ±height, by Newton's method for its neck."""
    c = 0.99
    for _ in range(100):
        c -= (c * np.cosh(height / c) - 1) / (np.cosh(height / c) - height / c * np.sinh(height / c))
    return float(2 * np.pi * (height * c + c * c * np.sinh(height / c) * np.cosh(height / c)))


def _pierced(name: str, cells: list[tuple[int, int]], expected: str, side: int = _GRID) -> Hole:
    vertices, faces = _grid(side)
    gone = np.zeros(2 * side**2, dtype=bool)
    for x, y in cells:
        gone[2 * (y * side + x) : 2 * (y * side + x) + 2] = True
    faces = faces[~gone]
    used, faces = np.unique(faces, return_inverse=True)
    vertices = vertices[used]
    edges = boundary_edges(faces.reshape(-1, 3))
    inside = ((vertices[:, :2] > 0.5) & (vertices[:, :2] < side - 0.5)).all(axis=1)
    rim = np.unique(edges)
    return Hole(name=name, vertices=vertices, faces=faces.reshape(-1, 3), rim=rim[inside[rim]], expected=expected)


def _grid(side: int = _GRID) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"]]:
    line = np.arange(side + 1, dtype=np.float64)
    x, y = np.meshgrid(line, line)
    vertices = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    low = (np.arange(side) + (side + 1) * np.arange(side)[:, None]).ravel()
    up = low + side + 1
    pairs = np.stack([np.stack([low, low + 1, up + 1], axis=1), np.stack([low, up + 1, up], axis=1)], axis=1)
    return vertices, pairs.reshape(-1, 3)


# --- cases of other projects' tests, rebuilt from what they say -------------------------------------------------------


def open_cone(n: int = 8) -> Hole:
    """PMP: a cone of radius 1 and height 1.5 without its base."""
    t = 2 * np.pi * np.arange(n) / n
    vertices = np.concatenate([np.stack([np.cos(t), np.sin(t), 0 * t], axis=1), [[0, 0, 1.5]]])
    i = np.arange(n)
    faces = np.stack([i, (i + 1) % n, np.full(n, n)], axis=1)
    return all_rims("open-cone", vertices, faces, "one flat patch")


def torus_window() -> Hole:
    """MeshLib: a coarse torus less one triangle."""
    ring = trimesh.creation.torus(2.0, 1.0, major_sections=10, minor_sections=10)
    return all_rims("torus-window", ring.vertices, ring.faces[1:], "one triangle")


def prism() -> Hole:
    """MeshLib: a prism less three triangles: rims of three and four edges with two common vertices."""
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]]
    faces = [[0, 2, 1], [3, 4, 5], [0, 1, 3], [2, 5, 4], [2, 3, 5]]
    return all_rims("prism", points, faces, "two patches of one and two triangles")


def facing_triangles() -> Hole:
    """MeshLib: two triangles at distance 1, to be joined by a prism's sides."""
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]]
    hole = all_rims("facing-triangles", points, [[0, 2, 1], [3, 4, 5]], "the three sides of a prism, or refused")
    return replace(hole, facing=True)


def holey_cube() -> Hole:
    """Trimesh: a cube less its first and last triangle."""
    box = trimesh.creation.box()
    return all_rims("holey-cube", box.vertices, box.faces[1:-1], "one triangle in each of two sides")


def quad_hole() -> Hole:
    """CGAL: a closed mesh less two neighbouring triangles."""
    ball = trimesh.creation.icosphere(2)
    beside = (np.isin(ball.faces, ball.faces[0]).sum(axis=1) == 2).nonzero()[0][0]
    kept = np.delete(ball.faces, [0, beside], axis=0)
    return all_rims("quad-hole", ball.vertices, kept, "two triangles")


def squiggle() -> Hole:
    """A plane hole that winds to and fro, as those of CGAL's and trimesh's plane tests."""
    side = 2 * _GRID
    rows = [(x, y) for y in (4, 8, 12) for x in range(6, 18)]
    turns = [(x, y) for x, low in ((17, 5), (6, 9)) for y in range(low, low + 3)]
    return _pierced("squiggle", rows + turns, "one flat patch", side)


def fin() -> Hole:
    """CGAL: a hole with a non-manifold rim: a triangle stands on an edge of the mesh that ends in the rim."""
    hole = _pierced(
        "fin", [(x, y) for x in range(3, 9) for y in range(3, 9)], "closed, or refused with the edge's name"
    )
    inner = hole.faces[np.isin(hole.faces, hole.rim).sum(axis=1) == 1][0]
    on = inner[np.isin(inner, hole.rim)][0], inner[~np.isin(inner, hole.rim)][0]
    top = hole.vertices[list(on)].mean(axis=0) + np.array([0, 0, 1])
    fin_face = [[*on, len(hole.vertices)]]
    return replace(hole, vertices=np.vstack([hole.vertices, top]), faces=np.concatenate([hole.faces, fin_face]))


def all_rims(name: str, vertices: ArrayLike, faces: ArrayLike, expected: str = "") -> Hole:
    """A mesh all of whose boundaries are to be closed."""
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    rim = np.unique(boundary_edges(triangles))
    return Hole(name=name, vertices=points, faces=triangles, rim=rim, expected=expected)


PEER_TESTS: Mapping[str, Callable[[], Hole]] = {
    "open-cone": open_cone,
    "torus-window": torus_window,
    "prism": prism,
    "facing-triangles": facing_triangles,
    "holey-cube": holey_cube,
    "quad-hole": quad_hole,
    "squiggle": squiggle,
    "fin": fin,
    "bow-tie": bow_tie,
}
"""Holes that the test suites of PMP, MeshLib, trimesh and CGAL fill."""

ODD: Mapping[str, Callable[[], Hole]] = {
    "figure-eight": figure_eight,
    "knot": knot,
    "island": island,
    "slit": slit,
    "facing-0.5": lambda: facing_rims(0.5),
    "facing-0.6": lambda: facing_rims(0.6),
    "facing-0.7": lambda: facing_rims(0.7),
    **PEER_TESTS,
}
"""Rims that are no ordinary holes."""


# --- noisy rims -------------------------------------------------------------------------------------------------------


def _noisy_collar(noise: float, points: int) -> Hole:
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
    return all_rims(f"noise-{noise:.0%}-{points}", np.vstack([inner, outer, [[0, 0, -3]]]), faces)


NOISY: Mapping[str, tuple[float, int]] = {
    f"noise-{noise:.0%}-{points}": (noise, points) for noise in (0.05, 0.15, 0.3) for points in (100, 250, 600, 1200)
}
"""Noise in mean edges and points of rims with noise."""


def named_hole(name: str) -> Hole:
    """The odd or noisy rim of a name."""
    return _noisy_collar(*NOISY[name]) if name in NOISY else ODD[name]()


# --- mesh files -------------------------------------------------------------------------------------------------------


def mesh_files(folder: Path, names: Sequence[str] = ()) -> list[Path]:
    """The mesh files of a folder that have faces and holes, or those of them whose names match one that is given."""
    found = []
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in FORMATS and (not names or any(fnmatchcase(path.name, name) for name in names)):
            mesh = read_mesh(path).mesh
            if len(mesh.faces) and len(boundary_edges(mesh.faces)):
                found.append(path)
    return found


def file_hole(path: Path) -> Hole:
    """A mesh file whose every boundary loop is to be closed."""
    mesh = read_mesh(path).mesh
    return all_rims(path.name, mesh.vertices, mesh.faces)
