"""Objects of all types: what they hold stays, holes are filled, vertices merged; what is no mesh is refused."""

from copy import deepcopy

import meshio
import numpy as np
import pytest
import pyvista
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import MeshShapeError, NonFiniteVertexError, VertexIndexError
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from tests.adapters.objects import OBJECTS
from tests.adapters.shapes import CUBE_POINTS, CUBE_QUADS, extensions, is_closed, lid, lid_for, meshes, open_cube
from tests.fill.shapes import tube

FACE = np.array([[0, 1, 2]])


def require_prefix(before, after, rows):
    """The same arrays with the same first rows, and so many rows in all."""
    assert after.keys() == before.keys()
    for name, values in before.items():
        assert after[name].dtype.kind == values.dtype.kind, name
        assert after[name].dtype == values.dtype or values.dtype.kind == "U", name
        np.testing.assert_array_equal(after[name][: len(values)], values, name)
        assert len(after[name]) == rows, name


@pytest.mark.parametrize("kind", OBJECTS)
@given(data=st.data(), mesh=meshes())
def test_all_that_an_object_holds_stays(kind, data, mesh):
    made, held, _ = OBJECTS[kind]
    old = made(*mesh)
    (vertices, faces, other), read = deepcopy(held(old)), to_mesh(old)
    extension = data.draw(extensions(read))
    new = extend(old, extension)
    assert type(new) is type(old)
    n, f = len(mesh[0]), len(mesh[1])
    new_vertices, new_faces, new_other = held(new)
    require_prefix(vertices, new_vertices, n + len(extension.vertices))
    require_prefix(faces, new_faces, f + len(extension.faces))
    assert new_other == other
    np.testing.assert_array_equal(new_vertices["vertices"][n:], extension.vertices.astype(vertices["vertices"].dtype))
    np.testing.assert_array_equal(new_faces["faces"][f:], extension.faces)
    again = to_mesh(new)
    assert again.labels == read.labels
    for name, values in extension.vertex_attributes.items():
        np.testing.assert_allclose(again.vertex_attributes[name][n:], values, rtol=1e-6, err_msg=name)
    require_prefix(vertices, held(old)[0], n)
    require_prefix(faces, held(old)[1], f)


@pytest.mark.parametrize("kind", OBJECTS)
def test_a_lid_closes_the_cube_and_needs_all_attributes(kind):
    made, _, closed = OBJECTS[kind]
    cube = made(*open_cube())
    assert not closed(cube)
    whole = extend(cube, lid_for(to_mesh(cube)))
    assert closed(whole)
    assert is_closed(to_mesh(whole))
    if to_mesh(cube).vertex_attributes:
        with pytest.raises(MeshShapeError):
            extend(cube, lid())


@pytest.mark.parametrize("kind", OBJECTS)
@pytest.mark.parametrize(("error", "merge"), [(None, False), (1e-9, True), (1e-4, 2e-4)])
def test_vertices_are_merged_and_holes_filled(kind, error, merge):
    made, held, _ = OBJECTS[kind]
    vertices, faces = tube()
    kept = np.arange(48)
    if error is not None:
        # corners of their own for each face, which differ by an error; of each place the first one stays
        kept = np.unique(faces, return_index=True)[1]
        order = np.argsort(kept)
        kept, faces = kept[order], np.argsort(order)[faces]
        corners = vertices[order][faces].reshape(-1, 3)
        corners += np.random.default_rng(5).uniform(-1, 1, size=corners.shape) * error / 4
        given = made(corners, np.arange(len(corners)).reshape(-1, 3))
    else:
        given = made(vertices, faces)
    own, _, other = deepcopy(held(given))
    filled, report = fill_hole(given, merge=merge, return_report=True)
    assert type(filled) is type(given)
    assert len(report.loops) == 2
    assert report.watertight
    assert boundary_loops(filled) == []
    new, new_faces, new_other = held(filled)
    require_prefix({name: values[kept] for name, values in own.items()}, new, len(new["vertices"]))
    np.testing.assert_array_equal(new_faces["faces"][:64], faces)
    assert new_other == other
    if "label" in own:
        assert set(new["label"].ravel()) <= set(own["label"].ravel())
    require_prefix(own, held(given)[0], len(own["vertices"]))


def broken_poly_data():
    broken = pyvista.PolyData(CUBE_POINTS[:3], faces=[3, 0, 1, 2])
    broken.points = CUBE_POINTS[:2]
    return broken


@pytest.mark.parametrize(
    ("mesh", "error", "advice"),
    [
        ((np.zeros((4, 2)), FACE), MeshShapeError, None),
        ((np.zeros((4, 3)), FACE * 1.0), MeshShapeError, None),
        ((np.zeros((4, 3)), np.array([[0, 1, 2, 3]])), MeshShapeError, None),
        ((np.zeros((4, 3)), FACE + 2), VertexIndexError, None),
        ((np.zeros((4, 3)), FACE - 1), VertexIndexError, None),
        ((np.array([[0.0, 0.0, np.nan]] * 3), FACE), NonFiniteVertexError, None),
        (trimesh.Trimesh(CUBE_POINTS[:5], CUBE_QUADS[:, :3], process=False), VertexIndexError, None),
        (meshio.Mesh(CUBE_POINTS, [("tetra", [[0, 1, 2, 4]])]), MeshShapeError, "extract its surface"),
        (meshio.Mesh(CUBE_POINTS[:, :2], [("quad", CUBE_QUADS)]), MeshShapeError, "append a third coordinate"),
        (meshio.Mesh(CUBE_POINTS[:3], [("triangle", [[0, 1, 3]])]), VertexIndexError, None),
        (
            pyvista.ImageData(dimensions=(2, 2, 2)).cast_to_unstructured_grid(),
            MeshShapeError,
            r"grid.extract_surface\(\)",
        ),
        (pyvista.Sphere().strip(), MeshShapeError, r"mesh.triangulate\(\)"),
        (broken_poly_data(), VertexIndexError, None),
    ],
)
def test_what_is_no_mesh_of_triangles_is_refused(mesh, error, advice):
    with pytest.raises(error, match=advice):
        to_mesh(mesh)


def test_tensors_and_sets_that_are_no_mesh_are_refused():
    import pymeshlab
    import torch

    faces = torch.tensor(FACE)
    for pair in ((torch.zeros((4, 2)), faces), (torch.zeros((4, 3)), faces * 1.0)):
        with pytest.raises(MeshShapeError):
            to_mesh(pair)
    with pytest.raises(MeshShapeError, match="holds no mesh"):
        to_mesh(pymeshlab.MeshSet(verbose=False))
