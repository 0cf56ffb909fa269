import numpy as np
import pytest
import trimesh

from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import MeshShapeError, VertexIndexError
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from tests.adapters.shapes import extension, lid, lid_for, nothing
from tests.fill.shapes import tube

# scaled, turned, moved; and mirrored
PLACED = trimesh.transformations.concatenate_matrices(
    trimesh.transformations.translation_matrix([5, 0, 0]),
    trimesh.transformations.rotation_matrix(0.7, [1, 2, 3]),
    np.diag([2.0, 3.0, 2.0, 1.0]),
)
MIRRORED = np.diag([-1.0, 1.0, 1.0, 1.0]) @ trimesh.transformations.translation_matrix([0, 9, 0])


def part(**options):
    return trimesh.Trimesh(*tube(), process=False, **options)


@pytest.fixture
def scene():
    scene = trimesh.Scene()
    colors = np.full((48, 4), 255, dtype=np.uint8)
    colors[:, 0] = 40
    scene.add_geometry(part(vertex_colors=colors, metadata={"name": "red"}), geom_name="red", transform=PLACED)
    scene.add_geometry(part(vertex_attributes={"heat": np.arange(48.0)}), geom_name="hot", transform=MIRRORED)
    scene.add_geometry(trimesh.PointCloud(np.eye(3)), geom_name="points")
    scene.metadata["place"] = "here"
    return scene


def test_every_geometry_has_its_scene_coordinates(scene):
    mesh = to_mesh(scene)
    vertices, faces = tube()
    for k, transform in enumerate((PLACED, MIRRORED)):
        expected = trimesh.transform_points(vertices, transform)
        np.testing.assert_allclose(mesh.vertices[48 * k : 48 * (k + 1)], expected, atol=1e-12)
    assert np.array_equal(mesh.faces[:64], faces)
    # as trimesh joins them: normals outwards in both
    together = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert trimesh.Scene.to_mesh(scene).volume == pytest.approx(together.volume)
    assert set(mesh.vertex_attributes) == {"color", "heat"}
    assert mesh.vertex_attributes["heat"][:48].max() == 0


def test_each_geometry_is_filled_and_all_else_stays(scene):
    filled, report = fill_hole(scene, return_report=True)
    assert type(filled) is trimesh.Scene
    assert report.watertight
    assert boundary_loops(filled) == []
    assert list(filled.geometry) == list(scene.geometry)
    assert filled.graph.to_flattened() == scene.graph.to_flattened()
    assert filled.metadata["place"] == "here"
    for name in ("red", "hot"):
        old, new = scene.geometry[name], filled.geometry[name]
        assert len(old.faces) == 64
        assert new.is_watertight
        assert new.is_winding_consistent
        assert new.volume > 1  # outwards, in its own coordinates
        assert new.vertices[:48].tobytes() == old.vertices.tobytes()
        assert np.array_equal(new.faces[:64], old.faces)
    assert set(filled.geometry["red"].visual.vertex_colors[:, 0]) == {40}
    assert filled.geometry["red"].metadata["name"] == "red"
    assert filled.geometry["hot"].vertex_attributes["heat"].min() > -1e-9
    assert "heat" not in filled.geometry["red"].vertex_attributes
    # the patches' rims are the tubes' own: the new points lie between their ends
    np.testing.assert_allclose(filled.geometry["hot"].bounds, scene.geometry["hot"].bounds, atol=1e-6)


def test_a_geometry_shown_twice_is_filled_once():
    scene = trimesh.Scene()
    scene.add_geometry(part(), geom_name="one", node_name="first", transform=PLACED)
    scene.graph.update("second", matrix=MIRRORED, geometry="one")
    assert len(to_mesh(scene).faces) == 64
    filled = fill_hole(scene)
    assert set(filled.graph.nodes_geometry) == {"first", "second"}
    assert filled.geometry["one"].is_watertight


def test_normals_are_unit_and_turn_with_their_geometry():
    scene = trimesh.Scene()
    geometry = part()
    outwards = geometry.vertex_normals.copy()
    scene.add_geometry(geometry, geom_name="one", transform=PLACED)
    normals = to_mesh(scene).vertex_attributes["normal"]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
    placed = trimesh.Trimesh(*tube(), process=False, vertex_normals=outwards)
    placed.apply_transform(PLACED)
    np.testing.assert_allclose(normals, placed.vertex_normals, atol=1e-6)
    filled = fill_hole(scene)
    np.testing.assert_allclose(np.linalg.norm(filled.geometry["one"].vertex_normals, axis=1), 1)
    assert filled.geometry["one"].vertex_normals[48:, 2].max() > 0.9
    np.testing.assert_allclose(filled.geometry["one"].vertex_normals[:48], outwards)


def test_attributes_of_one_name_and_another_kind_are_distinguished():
    scene = trimesh.Scene()
    for name, values in (("a", np.arange(48)), ("b", np.zeros((48, 2))), ("c", np.ones(48, dtype=int))):
        scene.add_geometry(part(vertex_attributes={"heat": values}), geom_name=name)
    mesh = to_mesh(scene)
    assert set(mesh.vertex_attributes) == {"heat", "b heat"}
    assert mesh.labels == {"heat"}
    grown = extend(scene, lid_for(mesh))
    assert grown.geometry["a"].vertex_attributes["heat"].shape == (49,)
    assert grown.geometry["b"].vertex_attributes["heat"].shape == (48, 2)


def test_faces_that_join_two_geometries_are_refused(scene):
    with pytest.raises(MeshShapeError, match=r"'red' and 'hot' of the scene; give scene.to_mesh\(\)"):
        extend(scene, extension([], [0, 1, 60]))
    with pytest.raises(VertexIndexError):
        extend(scene, extension([], [0, 1, 99]))
    with pytest.raises(MeshShapeError, match="'color'"):
        extend(scene, lid())


def test_a_scene_without_meshes_has_no_faces():
    points = trimesh.Scene([trimesh.PointCloud(np.eye(3))])
    assert len(to_mesh(points).faces) == 0
    assert list(extend(points, nothing()).geometry) == list(points.geometry)
