"""Texture and normal seams: places where a renderer's format splits a vertex that the shape has once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from spinor_geom.adapters.polygons import Polygons
from spinor_geom.mesh.sheets import repeats_a_vertex
from spinor_geom.mesh.topology import boundary_edges, coincident_vertices
from spinor_geom.mesh.triangle_mesh import TriangleMesh


def seam_representatives(
    vertices: Float[np.ndarray, "v 3"], polygons: Polygons, appearance: Iterable[Shaped[np.ndarray, "v _"]]
) -> Int[np.ndarray, " v"]:
    """For every vertex the one that stands for its place: itself, or along a seam the lowest of those joined there.

    A seam is a pair of boundary edges that lie on each other in opposite directions, with no third one there, and whose
    ends are shared or lie where vertices of one position differ in appearance (texture coordinates, normals). So pieces
    that merely touch stay apart, and so do vertices that are equal in everything: they were put there twice on purpose,
    or by a format that cannot share vertices, and only the user knows which.

    Args:
        vertices: (V, 3) positions; equal means equal as numbers.
        polygons: the faces.
        appearance: arrays (V, k) that a renderer's format keeps at each vertex.

    Returns:
        (V,) int64 vertex indices.
    """
    place = coincident_vertices(vertices)
    differs = np.zeros(len(vertices), dtype=bool)
    for values in appearance:
        differs |= (values != values[place]).any(axis=1)
    if not differs.any():
        return np.arange(len(vertices))
    may_be_joined = np.zeros(len(vertices), dtype=bool)
    may_be_joined[place[differs]] = True
    edges = boundary_edges(polygons.triangulated(vertices)[0])
    first, second = _edge_pairs(place[edges])
    joined = np.stack([edges[first], edges[second, ::-1]], axis=2)
    is_seam = ((joined[:, :, 0] == joined[:, :, 1]) | may_be_joined[place[joined[:, :, 0]]]).all(axis=1)
    links = joined[is_seam].reshape(-1, 2)
    graph = coo_array((np.ones(len(links), dtype=bool), links.T), shape=(len(vertices), len(vertices)))
    _, labels = connected_components(graph, directed=False)
    _, lowest = np.unique(labels, return_index=True)
    return np.asarray(lowest[labels], dtype=np.int64)


def _edge_pairs(edges: Int[np.ndarray, "b 2"]) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """Where in a list of directed edges an edge and its reverse stand, if no third one has the same two ends."""
    low, high = edges.min(axis=1), edges.max(axis=1)
    order = np.lexsort((high, low))
    starts = np.flatnonzero(np.diff(low[order], prepend=-1) | np.diff(high[order], prepend=-1))
    pairs = starts[np.diff(np.append(starts, len(edges))) == 2]
    first, second = order[pairs], order[pairs + 1]
    opposite = (edges[first, 0] == edges[second, 1]) & (edges[first, 0] != edges[first, 1])
    return first[opposite], second[opposite]


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
    kept = ~repeats_a_vertex(closed) | repeats_a_vertex(faces)
    return closed[kept], kept


def appearance_of(attributes: Mapping[str, Float[np.ndarray, "v _"]]) -> list[Float[np.ndarray, "v _"]]:
    """Those of a mesh's attributes that a renderer keeps at each vertex."""
    return [attributes[name] for name in ("uv", "normal", "color") if name in attributes]


def without_seams(mesh: TriangleMesh) -> TriangleMesh:
    """A mesh closed along the edges where texture coordinates, normals or colours differ."""
    polygons = Polygons.of_triangles(mesh.faces)
    appearance = appearance_of(mesh.vertex_attributes)
    closed, _ = close_seams(mesh.faces, seam_representatives(mesh.vertices, polygons, appearance))
    return TriangleMesh(mesh.vertices, closed, vertex_attributes=mesh.vertex_attributes, labels=mesh.labels)
