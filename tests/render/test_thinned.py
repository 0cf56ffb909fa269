"""Meshes of fewer triangles."""

import numpy as np
import pytest
import trimesh

from spinor_geom.mesh.topology import boundary_edges
from spinor_geom.render.thinned import thinned
from tests.edit.meshes import ball


@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_a_thinned_mesh_has_the_same_shape_and_the_same_rims(shift):
    vertices, faces = ball(shift)
    fine = trimesh.Trimesh(vertices, faces, process=False).subdivide().subdivide().subdivide()
    vertices, faces = np.array(fine.vertices), np.array(fine.faces)
    rims = boundary_edges(faces)
    is_kept = np.zeros(len(vertices), dtype=bool)
    is_kept[rims.ravel()] = True
    with_nan = np.insert(vertices, len(vertices), np.nan, axis=0)
    positions, new, places, kept = thinned(with_nan, faces, np.append(is_kept, True), 0.02)
    assert len(new) < 0.5 * len(faces)
    assert len(kept) == len(new)
    assert trimesh.Trimesh(positions, new, process=False).area == pytest.approx(fine.area, rel=0.01)
    corners = positions[new]
    turns = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (turns * (corners.mean(axis=1) - shift)).sum(axis=1).min() >= 0  # outwards
    np.testing.assert_array_equal(positions[is_kept[places]], vertices[places[is_kept[places]]])
    given = {tuple(edge) for edge in np.sort(rims, axis=1).tolist()}
    left = {tuple(edge) for edge in np.sort(places[boundary_edges(new)], axis=1).tolist()}
    assert given <= left
