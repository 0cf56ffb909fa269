"""How a mesh bends: mean curvature with its sign, and angles across edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csc_array

from spinor_geom.mesh.operators import face_areas, mollified_laplacian, vertex_normals
from spinor_geom.mesh.topology import HalfEdges

# Circumcentric areas are negative at some obtuse corners: the least share of the third of the faces' areas that counts.
_LEAST_SHARE = 0.3
_TINY = np.finfo(np.float64).tiny ** 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Bending:
    """The mean curvature of a mesh and what it is made of.

    With these areas H is 1/R at the inner vertices of any mesh whose vertices lie on a sphere, up to the error of the
    normals: at x of the unit sphere (x − y)·x = |x − y|²/2, so along x the gradient of the area is twice the area.

    Attributes:
        laplacian: the cotangent Laplacian L.
        areas: of the vertices, circumcentric, in squared mesh units; at least 0.3 of a third of their faces'.
        normals: unit normals at the vertices, outer ones of a mesh whose faces look outwards.
        curvature: H = n·Lx/(2A), positive where a mesh with outer normals is convex; without meaning on a boundary.
    """

    laplacian: csc_array
    areas: Float[np.ndarray, " n"]
    normals: Float[np.ndarray, "n 3"]
    curvature: Float[np.ndarray, " n"]

    @classmethod
    def of(cls, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Bending:
        """That of a mesh, unused vertices having none."""
        n, flat = len(vertices), faces.ravel()
        laplacian = mollified_laplacian(vertices, faces)
        laplacian.resize((n, n))  # the last vertices may be unused
        # about the origin: the areas are differences of squares
        x = vertices - vertices.mean(axis=0)
        gradient = laplacian @ x
        along = np.einsum("ik,ik->i", x, gradient)
        circumcentric = (2 * along - laplacian @ np.einsum("ik,ik->i", x, x)) / 4
        third = np.bincount(flat, np.repeat(face_areas(vertices, faces) / 3, 3), minlength=n)
        areas = np.maximum(circumcentric, np.maximum(_LEAST_SHARE * third, _TINY))
        normals = vertex_normals(vertices, faces)
        curvature = np.einsum("ik,ik->i", gradient, normals) / (2 * areas)
        return cls(laplacian=laplacian, areas=areas, normals=normals, curvature=curvature)


def face_normals(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Unit normals of faces; 0 for one without area."""
    corner = vertices[faces]
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return np.asarray(cross / np.maximum(np.linalg.norm(cross, axis=1), np.finfo(np.float64).tiny)[:, None])


def crossing_angles(half_edges: HalfEdges, normals: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, " h"]:
    """For each half-edge the angle between the normals of its face and its twin's, in radians; 0 where it has none."""
    here, there = np.arange(len(half_edges.origin)) // 3, half_edges.twin // 3
    sine = np.linalg.norm(np.cross(normals[here], normals[there]), axis=1)
    angle = np.arctan2(sine, np.einsum("hk,hk->h", normals[here], normals[there]))
    return np.asarray(np.where(half_edges.twin < 0, 0.0, angle))


def unclosed_vertices(half_edges: HalfEdges, count: int) -> Bool[np.ndarray, " n"]:
    """Which of so many vertices touch an edge without exactly two faces, one in each direction."""
    twin = half_edges.twin
    wrong = (twin < 0) | (half_edges.origin == half_edges.origin[twin])
    unclosed = np.zeros(count, dtype=bool)
    unclosed[half_edges.origin[wrong]] = True
    unclosed[half_edges.target[wrong]] = True
    return unclosed
