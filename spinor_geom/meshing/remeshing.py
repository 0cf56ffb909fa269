"""Remeshing of patches in space, without a plane domain: edges are split, collapsed and flipped, vertices moved.

Vertices and edges of the rims are kept. Edges get about the wanted lengths, and angles are increased: edges are flipped
if that increases the smallest angle of their two triangles, and inner vertices move along the surface.

Source: Botsch & Kobbelt, "A remeshing approach to multiresolution modeling", Symposium on Geometry Processing (2004).
"""

from __future__ import annotations

from dataclasses import replace

import igl
import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from spinor_geom.deadline import require_time, seconds_left
from spinor_geom.domain.delaunay import rim_successors, unique_edges
from spinor_geom.domain.sizes import DECAY, EdgeLengths
from spinor_geom.kernel import call, checked
from spinor_geom.mesh.operators import nearest_on_mesh
from spinor_geom.mesh.topology import referenced_vertices
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.triangulate import NEIGHBOURS, most_points, require_few_points

_SMOOTHINGS = 2

Positions = Float[np.ndarray, "n 3"]
Faces = Int[np.ndarray, "f 3"]


def remesh(
    patch: Patch, lengths: EdgeLengths, taken: Int[np.ndarray, "e 2"], *, wanted: Float[np.ndarray, " n"] | None = None
) -> Patch:
    """A patch remeshed with edges of wanted lengths in space, graded towards those of the rims' edges.

    The new positions in Ω are interpolated. Triangles may overlap there.

    Args:
        patch: over one loop or several.
        lengths: of edges, in mesh units.
        taken: pairs of boundary vertices that must not be joined by an inner edge.
        wanted: lengths at the vertices that replace the target length.

    Raises:
        TooManyPointsError: the lengths need too many vertices.
        OutOfTimeError: a time limit has passed.
    """
    old, m = np.asarray(patch.faces), patch.boundary_size
    vertices, faces = _remeshed(patch, patch.vertices, old, m, lengths, taken, smoothings=_SMOOTHINGS, wanted=wanted)
    points = np.concatenate([patch.points[:m], points_at(patch, old, vertices[m:])])
    return replace(patch, vertices=vertices, faces=faces, points=points, is_complete=True)


def remesh_region(
    patch: Patch, region: Bool[np.ndarray, " f"], lengths: EdgeLengths, taken: Int[np.ndarray, "e 2"], enough: float
) -> tuple[Patch, Int[np.ndarray, " f"]]:
    """Remeshes a region of a patch within its outline. Only vertices of poor triangles move.

    Args:
        patch: over one loop or several.
        region: which faces may be replaced.
        lengths: of edges, in mesh units.
        taken: pairs of boundary vertices that must not be joined by an inner edge.
        enough: smallest angle that is not increased further, in radians.

    Returns:
        The patch, and for each old face its new number, −1 if it was in the region.

    Raises:
        TooManyPointsError: the lengths need too many vertices.
        OutOfTimeError: a time limit has passed.
    """
    old = np.asarray(patch.faces)
    inside, outside, count = old[region], old[~region], len(patch.vertices)
    is_fixed = np.zeros(count, dtype=bool)
    is_fixed[: patch.boundary_size] = True
    is_fixed[outside] = True
    used = referenced_vertices(inside, vertices=count)
    ids = np.concatenate([np.flatnonzero(used & is_fixed), np.flatnonzero(used & ~is_fixed)])
    local, fixed = np.full(count, -1), int((used & is_fixed).sum())
    local[ids] = np.arange(len(ids))
    pairs = local[np.concatenate([taken, unique_edges(outside, count)])]
    pairs = pairs[(pairs >= 0).all(axis=1)]
    vertices, faces = _remeshed(patch, patch.vertices[ids], local[inside], fixed, lengths, pairs, enough=enough)
    kept = np.ones(count, dtype=bool)
    kept[ids[fixed:]] = False
    number, new = np.cumsum(kept) - 1, vertices[fixed:]
    numbers = np.concatenate([number[ids[:fixed]], kept.sum() + np.arange(len(new))])
    remeshed = replace(
        patch,
        vertices=np.concatenate([patch.vertices[kept], new]),
        points=np.concatenate([patch.points[kept], points_at(patch, inside, new)]),
        faces=np.concatenate([number[outside], numbers[faces]]),
    )
    return remeshed, np.where(region, -1, np.cumsum(~region) - 1)


def _remeshed(
    patch: Patch,
    vertices: Positions,
    faces: Faces,
    fixed: int,
    lengths: EdgeLengths,
    taken: Int[np.ndarray, "e 2"],
    *,
    enough: float = np.pi,
    smoothings: int = 0,
    wanted: Float[np.ndarray, " n"] | None = None,
) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "g 3"]]:
    """Remeshes some faces of a patch. The first `fixed` vertices are kept, bit for bit.

    Without smoothings only vertices of triangles with angles below `enough` move.
    """
    target = lengths.target if wanted is None else float(wanted.min())
    require_few_points(patch.area, target)
    m, count = patch.boundary_size, len(vertices)
    rim, after = patch.vertices[:m], rim_successors(patch.rims)
    centre = rim.mean(axis=0)
    scale = float(np.linalg.norm(rim - centre, axis=1).max())
    if wanted is not None:
        samples, at_samples = patch.vertices, wanted
    else:
        samples, at_samples = (rim[:0], np.zeros(0)) if np.isinf(target) else (rim[:1], np.full(1, target))
    most = count + most_points(m, patch.area, target)
    positions, made = np.empty((most, 3)), np.empty((2 * most, 3), dtype=np.int64)
    positions[:count], made[: len(faces)] = (vertices - centre) / scale, faces
    counts = np.array([count, len(faces)])
    call(
        "remesh",
        *(m, checked("rim", (rim - centre) / scale, np.float64, m, 3), checked("after", after, np.int64, m)),
        *(lengths.growth, DECAY, len(samples), (samples - centre) / scale, np.log(at_samples / scale), NEIGHBOURS),
        *(fixed, len(taken), checked("taken", taken, np.int64, None, 2, least=0, most=fixed - 1), enough, smoothings),
        *(most, seconds_left(), positions, made, counts),
    )
    require_time()
    new = positions[fixed : counts[0]] * scale + centre
    return np.concatenate([vertices[:fixed], new]), made[: counts[1]].copy()


def points_at(patch: Patch, faces: Faces, positions: Positions) -> Complex[np.ndarray, " k"]:
    """Positions in Ω of the points of some faces of a patch that are nearest to positions in space."""
    _, face, nearest = nearest_on_mesh(positions, patch.vertices, faces)
    corners = faces[face]
    weights = igl.barycentric_coordinates(
        np.ascontiguousarray(nearest), *(np.ascontiguousarray(patch.vertices[corners[:, k]]) for k in range(3))
    )
    return np.asarray(np.einsum("ki,ki->k", np.asarray(weights), patch.points[corners]))
