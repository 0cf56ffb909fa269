import struct

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from trimesh.visual.material import PBRMaterial

from spinor_geom.adapters import glb, read_mesh
from spinor_geom.adapters.glb import read_glb
from spinor_geom.adapters.glb_container import GlbContainer
from spinor_geom.adapters.mesh_files import write_triangles
from spinor_geom.mesh.topology import boundary_edges
from spinor_geom.render.fill_scene import skin_of
from tests.adapters.shapes import (
    extension,
    extensions,
    glb_file,
    glb_tree,
    glb_with,
    is_closed,
    lid,
    open_cube,
    reading,
)

parsed, again = reading(read_glb, ".glb")


VERTICES, FACES = open_cube(np.float32)
INDICES = FACES.reshape(-1, 1).astype(np.uint16)
CUBE = {"POSITION": VERTICES, "indices": INDICES}


def pieces(data):
    return glb.scene_pieces(GlbContainer.read(data))


def unwelded():
    """The cube with separate vertices and normals for each side, as for rendering."""
    corners = VERTICES[FACES].reshape(-1, 3)
    sides = np.cross(VERTICES[FACES[:, 1]] - VERTICES[FACES[:, 0]], VERTICES[FACES[:, 2]] - VERTICES[FACES[:, 0]])
    return {"POSITION": corners, "NORMAL": np.repeat(sides, 3, axis=0).astype(np.float32)}


def lid_over(mesh, lift=1 / 3):
    """A lid for the cube wherever its corners are numbered in a mesh: over its open edges."""
    edges = boundary_edges(mesh.faces)
    rim = mesh.vertices[edges[:, 0]]
    up = rim.mean(axis=0) + lift * (rim.mean(axis=0) - mesh.vertices.mean(axis=0))
    faces = np.hstack([edges[:, ::-1], np.full((len(edges), 1), len(mesh.vertices))])
    return extension(
        up, faces, **{name: rows.mean(axis=0, keepdims=True) for name, rows in mesh.vertex_attributes.items()}
    )


@given(
    data=st.data(),
    seed=st.integers(0, 2**32 - 1),
    narrow=st.sampled_from([np.uint8, np.uint16, np.uint32]),
    color=st.sampled_from([np.uint8, np.uint16, np.float32]),
)
def test_round_trip_keeps_every_attribute(tmp_path_factory, data, seed, narrow, color):
    random = np.random.default_rng(seed)
    colors = random.uniform(size=(8, 4)) if color is np.float32 else random.integers(0, np.iinfo(color).max, (8, 4))
    primitive = {
        "POSITION": random.normal(size=(8, 3)).astype(np.float32),
        "NORMAL": random.normal(size=(8, 3)).astype(np.float32),
        "TEXCOORD_0": random.uniform(size=(8, 2)).astype(np.float32),
        "COLOR_0": colors.astype(color),
        "_HEAT": random.normal(size=(8, 1)).astype(np.float32),
        "indices": INDICES.astype(narrow),
    }
    original = glb_file([primitive])
    file = parsed(original)
    assert set(file.mesh.vertex_attributes) == {"normal", "uv", "color", "_HEAT"}
    assert file.mesh.vertices.tobytes() == primitive["POSITION"].astype(float).tobytes()
    assert np.array_equal(file.mesh.vertex_attributes["color"], primitive["COLOR_0"])
    assert np.array_equal(file.mesh.faces, FACES)
    grown = file.extended(data.draw(extensions(file.mesh)))
    folder = tmp_path_factory.mktemp("glb")
    back = again(grown, folder)
    assert back.mesh.vertices[:8].tobytes() == file.mesh.vertices.tobytes()
    assert np.array_equal(back.mesh.vertices[back.mesh.faces], grown.mesh.vertices.astype(np.float32)[grown.mesh.faces])
    assert np.array_equal(back.mesh.faces[:10], FACES)
    for name, values in grown.mesh.vertex_attributes.items():
        own = back.mesh.vertex_attributes[name]
        assert np.array_equal(own[:8], values[:8]), name
        assert np.allclose(own[back.mesh.faces], values[grown.mesh.faces], atol=1e-6), name
    raw = pieces((folder / "again.glb").read_bytes())[0].rows
    assert all(raw[name].tobytes() == rows.tobytes() for name, rows in primitive.items() if name != "indices")


def test_lid_closes_the_cube_in_trimesh_s_eyes_too(tmp_path):
    file = parsed(glb_file([CUBE]))
    closed = again(file.extended(lid()), tmp_path)
    assert is_closed(closed.mesh)
    theirs = trimesh.load_mesh(tmp_path / "again.glb", process=False)
    theirs.merge_vertices()  # the patch has its own copies of the rim's
    assert theirs.is_watertight
    tree = glb_tree((tmp_path / "again.glb").read_bytes())
    own, patch = tree["meshes"][0]["primitives"]
    accessor = tree["accessors"][patch["attributes"]["POSITION"]]
    assert accessor["min"] == [0, 0, 1]
    assert accessor["max"] == [1, 1, pytest.approx(4 / 3)]
    assert {**own, **patch} == patch
    assert tree["accessors"][:2] == glb_tree(glb_file([CUBE]))["accessors"]


@pytest.mark.parametrize("transform", [{}, {"scale": [1, 3, 0.1], "translation": [1, 2, 0.3]}])
def test_rim_vertices_of_another_material_are_copied_bit_by_bit(tmp_path, transform):
    random = np.random.default_rng(8)
    normals = random.normal(size=(8, 3)).astype(np.float32)
    halves = []
    for part in (slice(0, 2), slice(2, 10)):
        used, local = np.unique(FACES[part], return_inverse=True)
        halves.append({"POSITION": VERTICES[used], "indices": local.reshape(-1, 1).astype(np.uint16)})
    halves[0]["NORMAL"] = normals[np.unique(FACES[:2])]
    halves[1]["NORMAL"] = normals
    file = parsed(glb_file(halves, nodes=[{"mesh": 0, **transform}]))
    rim = np.unique(boundary_edges(file.mesh.faces))
    assert (rim < 4).sum() == 2
    assert (rim >= 4).sum() == 2
    closed = again(file.extended(lid_over(file.mesh)), tmp_path)
    assert is_closed(closed.mesh)
    patch = pieces((tmp_path / "again.glb").read_bytes())[2]
    rows = {tuple(row) for row in normals.tolist()}
    assert all(tuple(row) in rows for row in patch.rows["NORMAL"][:-1].tolist())


def test_transformed_nodes_are_read_in_scene_coordinates_and_written_in_their_own(tmp_path):
    angle = np.pi / 6
    turned = {"rotation": [0, 0, np.sin(angle), np.cos(angle)], "translation": [10, 0, 0]}
    nodes = [{"children": [1], **turned}, {"mesh": 0, "scale": [2, 2, 2]}]
    file = parsed(glb_file([{**unwelded()}], nodes=nodes))
    turn = np.array([[0.5, -np.sqrt(0.75), 0], [np.sqrt(0.75), 0.5, 0], [0, 0, 1]])
    assert np.allclose(file.mesh.vertices, 2 * unwelded()["POSITION"] @ turn.T + [10, 0, 0], atol=1e-14)
    assert np.allclose(file.mesh.vertex_attributes["normal"], unwelded()["NORMAL"] @ turn.T, atol=1e-14)
    cover = lid_over(file.mesh)
    closed = again(file.extended(cover), tmp_path)
    assert is_closed(closed.mesh)
    assert np.array_equal(closed.mesh.vertices[:30], file.mesh.vertices)
    assert np.allclose(closed.mesh.vertices[-1:], cover.vertices, atol=1e-6)
    scene = trimesh.load_scene(tmp_path / "again.glb", process=False)
    assert np.allclose(scene.to_mesh().bounds, [closed.mesh.vertices.min(axis=0), closed.mesh.vertices.max(axis=0)])


def test_instances_are_read_once_each_and_only_the_filled_one_grows(tmp_path):
    column_major = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1]
    nodes = [{"mesh": 0}, {"mesh": 0, "matrix": column_major}]
    file = parsed(glb_file([CUBE], nodes=nodes, scenes=[{"nodes": [0, 1]}]))
    assert np.array_equal(file.mesh.vertices[8:], VERTICES + np.array([3, 0, 0]))
    second = extension([3.5, 0.5, 1.5], [[9, 13, 16], [13, 15, 16], [15, 11, 16], [11, 9, 16]])
    back = again(file.extended(second), tmp_path)
    assert len(boundary_edges(back.mesh.faces)) == 4
    assert len(glb_tree((tmp_path / "again.glb").read_bytes())["meshes"]) == 2
    both = back.extended(extension(lid().vertices, np.where(lid().faces == 8, len(back.mesh.vertices), lid().faces)))
    assert is_closed(again(both, tmp_path).mesh)


def test_quantized_positions_are_rounded_to_their_grid(tmp_path):
    data = glb_file([{"POSITION": VERTICES.astype(np.int16) * 300, "indices": INDICES}])
    file = parsed(glb_with(lambda tree: tree["accessors"][0].update(normalized=True), data))
    assert np.allclose(file.mesh.vertices, VERTICES * 300 / 32767)
    cover = lid_over(file.mesh)
    back = again(file.extended(cover), tmp_path)
    assert np.array_equal(back.mesh.vertices[:8], file.mesh.vertices)
    assert np.abs(back.mesh.vertices[-1:] - cover.vertices).max() <= 0.5 / 32767


def test_joints_are_those_of_the_nearest_vertex_and_animations_stay(tmp_path):
    joints = np.arange(32, dtype=np.uint8).reshape(8, 4)
    data = glb_file([{**CUBE, "JOINTS_0": joints, "WEIGHTS_0": np.full((8, 4), 0.25, dtype=np.float32)}])
    animations = [{"samplers": [{"input": 0, "output": 0}], "channels": []}]
    file = parsed(glb_with(lambda tree: tree.update(animations=animations), data))
    assert dict(file.mesh.vertex_attributes) == {}
    cover = extension([0.9, 0.9, 1.5], lid().faces)
    back = again(file.extended(cover), tmp_path)
    written = (tmp_path / "again.glb").read_bytes()
    assert pieces(written)[1].rows["JOINTS_0"][-1].tolist() == joints[7].tolist()
    tree = glb_tree(written)
    assert tree["animations"] == animations
    assert tree["accessors"][0]["count"] == 8
    assert is_closed(back.mesh)


def test_foreign_buffers_stay(tmp_path):
    data = glb_file([CUBE])

    def add_foreign(tree):
        tree["buffers"].append({"uri": "secret.bin", "byteLength": 4})
        tree["bufferViews"].append({"buffer": 1, "byteLength": 4})
        tree["images"] = [{"uri": "http://example.org/x.png"}, {"bufferView": 2, "mimeType": "image/png"}]
        tree["extras"] = {"bufferView": 77}

    foreign = parsed(glb_with(add_foreign, data))
    foreign.extended(lid()).write(tmp_path / "b.glb")
    tree = glb_tree((tmp_path / "b.glb").read_bytes())
    assert tree["buffers"][1] == {"uri": "secret.bin", "byteLength": 4}
    assert tree["bufferViews"][tree["images"][1]["bufferView"]]["buffer"] == 1
    assert tree["extras"] == {"bufferView": 77}
    assert is_closed(read_mesh(tmp_path / "b.glb").mesh)


def test_primitives_without_triangles_are_passed_over(tmp_path):
    file = parsed(glb_file([{"POSITION": VERTICES, "indices": INDICES[:0]}, CUBE]))
    assert len(file.mesh.vertices) == 8
    assert is_closed(again(file.extended(lid()), tmp_path).mesh)


def test_rim_of_another_node_and_loose_patches_are_written_in_scene_coordinates(tmp_path):
    nodes = [{"mesh": 0}, {"mesh": 1, "translation": [0, 0, 2]}]
    data = glb_file([CUBE, {**CUBE, "NORMAL": VERTICES}])

    def part(tree):
        first, second = tree["meshes"][0]["primitives"]
        tree["meshes"] = [{"primitives": [first]}, {"primitives": [second]}]
        tree["scenes"] = [{"nodes": [0, 1]}]
        tree["nodes"] = nodes

    file = parsed(glb_with(part, data))
    bridge = extension([[9, 9, 9], [9, 8, 9], [8, 9, 9]], [[1, 5, 8], [16, 17, 18]])
    back = again(file.extended(bridge), tmp_path)
    corners = back.mesh.vertices[back.mesh.faces]
    for wanted in (file.mesh.vertices[[1, 5, 8]], bridge.vertices):
        assert (corners == wanted).all(axis=(1, 2)).sum() == 1


GOOD = glb_file([CUBE])


def test_unknown_chunks_are_kept(tmp_path):
    chunk = struct.pack("<I4s", 8, b"XTRA") + b"whatever"
    data = GOOD[:8] + struct.pack("<I", len(GOOD) + len(chunk)) + GOOD[12:] + chunk
    assert is_closed(again(parsed(data).extended(lid()), tmp_path).mesh)
    assert (tmp_path / "again.glb").read_bytes().endswith(chunk)


def test_colours_of_vertices_and_materials_are_linear(tmp_path):
    """As glTF defines them. The value 0.5 of sRGB is 0.2140 of the light."""
    ball = trimesh.creation.icosphere(subdivisions=1)
    ball.visual = trimesh.visual.TextureVisuals(material=PBRMaterial(baseColorFactor=[0.5, 1.0, 0.0, 1.0]))
    ball.export(tmp_path / "factor.glb")
    skin = skin_of(read_mesh(tmp_path / "factor.glb"), read_mesh(tmp_path / "factor.glb").mesh)["skin"]
    np.testing.assert_allclose(skin, np.tile([0.7354, 1.0, 0.0], (len(ball.vertices), 1)), atol=2e-3)
    half = np.full((len(ball.vertices), 3), 0.5)
    write_triangles(ball.vertices, ball.faces, tmp_path / "half.glb", {"color": half})
    file = read_mesh(tmp_path / "half.glb")
    np.testing.assert_allclose(file.mesh.vertex_attributes["color"], 0.2140, atol=1e-4)
    np.testing.assert_allclose(skin_of(file, file.mesh)["skin"], half, atol=1e-6)
    file.write(tmp_path / "half.obj")
    np.testing.assert_allclose(read_mesh(tmp_path / "half.obj").mesh.vertex_attributes["color"], half, atol=1e-6)
