"""Solids: a minimal surface thickened by the same distance to both sides, as a closed mesh."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.mesh_files import write_triangles
from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.errors import OptionError, SurfaceError, require_positive
from spinor_geom.mesh.intersections import self_intersections
from spinor_geom.meshing.embed import Patch, mesh_patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.shown import Shown

SolidEdge = Literal["straight", "rounded"]
_FEWEST = 8  # parts of a rounded edge, a half circle


@dataclass(frozen=True, kw_only=True, eq=False)
class Solid(Shown):
    """A thickened minimal surface: a watertight mesh with faces counter-clockwise seen from outside.

    Attributes:
        vertices: in mesh units. Those of the upper side come first, then those of the lower side.
        faces: the upper side, the lower side, and the edge.
        thickness: distance of the two sides, in mesh units.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    thickness: float

    def __repr__(self) -> str:
        return f"Solid({len(self.faces)} faces, thickness {self.thickness:.6g}, volume {self.volume:.6g})"

    @cached_property
    def volume(self) -> float:
        """Enclosed volume, in cubed mesh units."""
        a, b, c = (self.vertices - self.vertices.mean(axis=0))[self.faces].transpose(1, 0, 2)
        return float((np.cross(a, b) * c).sum() / 6)

    @cached_property
    def intersections(self) -> int:
        """Number of pairs of intersecting faces.

        There are some where the surface intersects itself, or the thickness exceeds twice a radius of curvature of the
        surface, or with rounded edges of its rim.
        """
        return len(self_intersections(self.vertices, self.faces))

    def write(self, path: str | os.PathLike[str]) -> tuple[str, ...]:
        """Writes a mesh file in the format of the suffix of `path`. Returns and raises as `MeshFile.write`."""
        return write_triangles(self.vertices, self.faces, path)


def thickened(
    solution: PlateauSolution, thickness: float, target_edge_length: float | Literal["auto"], edge: SolidEdge
) -> Solid:
    """See `PlateauSolution.solid`."""
    require_thickness(thickness, edge)
    patch = mesh_patch(solution, target_edge_length)
    rim = np.arange(patch.boundary_size), rim_successors(patch.rims)
    return thickened_mesh(patch.vertices, patch.faces, unit_normals(solution, patch), rim, thickness, edge)


def require_thickness(thickness: float, edge: SolidEdge) -> None:
    """Raises an OptionError unless the thickness is positive and the edge one of the kinds."""
    require_positive("thickness", thickness)
    if edge not in get_args(SolidEdge):
        raise OptionError(f"edge must be one of {', '.join(get_args(SolidEdge))}, not {edge!r}")


def unit_normals(solution: PlateauSolution, patch: Patch) -> Float[np.ndarray, "n 3"]:
    """The normals at the vertices of a patch. Raises a SurfaceError at a branch point."""
    normals = np.asarray(solution.array_surface.normal(patch.points))
    if not np.isfinite(normals).all():
        raise SurfaceError("a vertex is a branch point, where the surface has no normal; choose another edge length")
    return normals


def thickened_mesh(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    normals: Float[np.ndarray, "n 3"],
    rims: tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]],
    thickness: float,
    edge: SolidEdge,
) -> Solid:
    """A mesh thickened along normals. `rims` has the vertices of its rims, and for each the place of the next one."""
    half, (around, after), count = thickness / 2, rims, len(vertices)
    rim, upwards = vertices[around], normals[around]
    m = len(rim)
    turns = np.zeros(0)
    if edge == "rounded" and m:
        parts = max(_FEWEST, int(np.ceil(np.pi * half / np.linalg.norm(rim[after] - rim, axis=1).mean())))
        turns = np.pi * np.arange(1, parts) / parts
    before = np.empty_like(after)
    before[after] = np.arange(m)
    outwards = np.cross(rim[after] - rim[before], upwards)
    outwards /= np.maximum(np.linalg.norm(outwards, axis=1), np.finfo(float).tiny)[:, None]
    arcs = [rim + half * (np.cos(turn) * upwards + np.sin(turn) * outwards) for turn in turns]
    rows = [around, *(2 * count + m * k + np.arange(m) for k in range(len(arcs))), count + around]
    walls = [
        np.concatenate([np.stack(corners, axis=1) for corners in ((a[after], a, b), (a[after], b, b[after]))])
        for a, b in pairwise(rows)
    ]
    return Solid(
        vertices=np.concatenate([vertices + half * normals, vertices - half * normals, *arcs]),
        faces=np.concatenate([faces, count + faces[:, ::-1], *walls]),
        thickness=float(thickness),
    )
