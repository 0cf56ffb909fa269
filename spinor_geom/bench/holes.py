"""Meshes with holes to close, and functions that build them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from spinor_geom.adapters import read_mesh
from spinor_geom.adapters.mesh_files import FORMATS
from spinor_geom.discrete.minimal_surface import discrete_minimal_surface
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.operators import vertex_normals
from spinor_geom.mesh.topology import boundary_edges
from spinor_geom.mesh.triangle_mesh import TriangleMesh

_COLLAR = math.sqrt(0.75)  # width of a collar per edge of the rim: the height of an equilateral triangle


@dataclass(frozen=True, kw_only=True, eq=False)
class Hole:
    """A mesh with boundary loops to close, its rims. Its other, longer boundary loops must stay open."""

    name: str
    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    rim: Int[np.ndarray, " r"]  # vertex ids of all rims
    expected: str = ""  # the correct result, if it is not one patch for each rim
    facing: bool = False  # two rims that one patch should join, if the tool can do that
    area: float | None = None  # of the minimal surface over the rims, if known

    @cached_property
    def edges(self) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "o 2"]]:
        """The boundary edges of the rims, and those that stay open."""
        edges = boundary_edges(self.faces)
        of_rim = np.isin(edges, self.rim).all(axis=1)
        return edges[of_rim], edges[~of_rim]

    @cached_property
    def loops(self) -> list[BoundaryLoop]:
        """All boundary loops, longest first."""
        return find_boundary_loops(TriangleMesh(self.vertices, self.faces))

    @cached_property
    def rim_indices(self) -> list[int]:
        """Indices of the rims in `loops`."""
        return [k for k, loop in enumerate(self.loops) if np.isin(loop.vertex_ids, self.rim).all()]

    @cached_property
    def edge_limit(self) -> int:
        """Largest number of edges of a boundary loop that a tool should close.

        It is the number of edges of all rims together, because some tools traverse rims that touch as one loop. It is
        smaller where a tool would otherwise close outer boundaries.
        """
        inner = [len(self.loops[k]) for k in self.rim_indices]
        outer = [len(loop) for k, loop in enumerate(self.loops) if k not in self.rim_indices]
        return min([sum(inner), *(count - 1 for count in outer if count > max(inner))])

    @cached_property
    def mean_edge(self) -> float:
        """Mean length of the rims' edges."""
        start, end = self.vertices[self.edges[0]].swapaxes(0, 1)
        return float(np.linalg.norm(end - start, axis=1).mean())


def hole_over(name: str, loop: BoundaryLoop, area: float | None = None) -> Hole:
    """A collar one triangle wide around a loop, tangent to the discrete minimal surface over it."""
    disk = discrete_minimal_surface(loop)
    tangent = np.roll(loop.points, -1, axis=0) - np.roll(loop.points, 1, axis=0)
    outward = np.cross(tangent, vertex_normals(disk.vertices, disk.faces)[: len(loop)])
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    outer = loop.points + _COLLAR * loop.mean_edge_length * outward
    return replace(collar(name, loop.points, outer), area=area)


def collar(name: str, rim: Float[np.ndarray, "n 3"], outer: Float[np.ndarray, "n 3"], *, expected: str = "") -> Hole:
    """A triangle strip between a rim and an outer curve.

    The outer curve has one more edge, because some tools distinguish loops by their number of edges.
    """
    n = len(rim)
    outer = np.insert(outer, 1, (outer[0] + outer[1]) / 2, axis=0)
    i = np.arange(n)
    after = (i + 1) % n
    across = np.append(n, n + 2 + np.arange(n - 1))
    first = np.stack([i, across, across[after]], axis=1)
    second = np.stack([i, across[after], after], axis=1)
    split = np.array([[0, n, n + 1], [0, n + 1, n + 2]])
    faces = np.concatenate([first[1:], second, split])
    return Hole(name=name, vertices=np.concatenate([rim, outer]), faces=faces, rim=i, expected=expected)


def lattice(
    nx: int, ny: int, *, wrap_x: bool = False, wrap_y: bool = False
) -> tuple[Float[np.ndarray, "2 n"], Int[np.ndarray, "f 3"]]:
    """A grid of nx × ny unit cells, two triangles each. A wrapped direction is periodic."""
    width, depth = nx + (not wrap_x), ny + (not wrap_y)
    points = np.stack(np.meshgrid(np.arange(width), np.arange(depth))).reshape(2, -1).astype(np.float64)
    i, j = (part.ravel() for part in np.meshgrid(np.arange(nx), np.arange(ny)))
    right, up = (i + 1) % width, (j + 1) % depth
    a, b, c, d = i + width * j, right + width * j, right + width * up, i + width * up
    return points, np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)


def plane_square(side: int) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"]]:
    """A flat square of side × side unit cells."""
    (x, y), faces = lattice(side, side)
    return np.stack([x, y, 0 * x], axis=1), faces


def sphere(name: str) -> trimesh.Trimesh:
    """The unit sphere "icosphere-SUBDIVISIONS" or "uv-sphere-COUNT"."""
    kind, _, count = name.rpartition("-")
    if kind == "icosphere":
        return trimesh.creation.icosphere(int(count))  # type: ignore[no-any-return]
    return trimesh.creation.uv_sphere(count=[int(count)] * 2)


def all_rims(name: str, vertices: ArrayLike, faces: ArrayLike, expected: str = "") -> Hole:
    """A mesh all of whose boundary loops are rims."""
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    rim = np.unique(boundary_edges(triangles))
    return Hole(name=name, vertices=points, faces=triangles, rim=rim, expected=expected)


def cut_hole(
    name: str,
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    removed: Bool[np.ndarray, " f"],
    **known: Any,
) -> Hole:
    """The mesh without the removed faces and the vertices that only they use. Its rims bound the removed faces."""
    used, rest = np.unique(faces[~removed], return_inverse=True)
    rim = np.flatnonzero(np.isin(used, faces[removed]))
    return Hole(name=name, vertices=vertices[used], faces=rest.reshape(-1, 3), rim=rim, **known)


def hole_of_file(path: str | Path) -> Hole:
    """The mesh of a file. All of its boundary loops are rims."""
    mesh = read_mesh(path).mesh
    return all_rims(Path(path).name, mesh.vertices, mesh.faces)


def mesh_files(folder: Path, patterns: Sequence[str] = ()) -> list[Path]:
    """The mesh files of a folder that have boundary edges, only those whose names match a pattern if there are any."""
    found = []
    for path in sorted(folder.iterdir()):
        named = not patterns or any(fnmatchcase(path.name, pattern) for pattern in patterns)
        if named and path.suffix.lower() in FORMATS:
            faces = read_mesh(path).mesh.faces
            if len(faces) and len(boundary_edges(faces)):
                found.append(path)
    return found
