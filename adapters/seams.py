"""Texture and normal seams: places where a renderer's format splits a vertex that the shape has once."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from spinor_geom.mesh.topology import coincident_vertices


def seam_representatives(
    vertices: Float[np.ndarray, "v 3"], appearance: Iterable[Shaped[np.ndarray, "v _"]]
) -> Int[np.ndarray, " v"]:
    """For every vertex the one that stands for its place: itself, or at a seam the lowest index at its position.

    A seam is a position that several vertices have which differ in appearance (texture coordinates, normals). Vertices
    that are equal in everything stay apart: they were put there twice on purpose, or by a format that cannot share
    vertices, and only the user knows which.

    Args:
        vertices: (V, 3) positions; equal means equal as numbers.
        appearance: arrays (V, k) that a renderer's format keeps at each vertex.

    Returns:
        (V,) int64 vertex indices.
    """
    lowest = coincident_vertices(vertices)
    differs = np.zeros(len(vertices), dtype=bool)
    for values in appearance:
        differs |= (values != values[lowest]).any(axis=1)
    at_seam = np.zeros(len(vertices), dtype=bool)
    at_seam[lowest[differs]] = True
    return np.where(at_seam[lowest], lowest, np.arange(len(vertices)))


def close_seams(
    faces: Int[np.ndarray, "f 3"], representatives: Int[np.ndarray, " v"]
) -> tuple[Int[np.ndarray, "g 3"], Bool[np.ndarray, " f"]]:
    """The triangles over the vertices that stand for their places.

    A triangle with three different vertices of which two now are one (the slivers at the poles of a textured globe) has
    no area and is left out.

    Returns:
        The triangles that remain, in their order, and which of the given ones these are, (F,) bool.
    """
    closed = representatives[faces]
    kept = ~(_repeats(closed) & ~_repeats(faces))
    return closed[kept], kept


def _repeats(faces: Int[np.ndarray, "f 3"]) -> Bool[np.ndarray, " f"]:
    """Which triangles name a vertex twice."""
    return np.asarray((faces == np.roll(faces, -1, axis=1)).any(axis=1))
