from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from trimesh.visual import ColorVisuals, TextureVisuals

from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import MeshShapeError, VertexIndexError
from spinor_geom.mesh.topology import boundary_edges
from tests.adapters.shapes import extensions, is_closed, lid, lid_for, meshes, nothing, open_cube


def plain(vertices: np.ndarray, faces: np.ndarray, **options: object) -> trimesh.Trimesh:
    return trimesh.Trimesh(vertices, faces, process=False, **options)


def textured_tube(columns: int = 8) -> trimesh.Trimesh:
    """A tube open at both ends whose texture is cut along one line: the seam's vertices are there twice."""
    u = np.linspace(0, 1, columns + 1)
    angle = 2 * np.pi * (np.arange(columns + 1) % columns) / columns
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = np.concatenate([np.column_stack([ring, np.full(columns + 1, float(z))]) for z in (0, 1)])
    uv = np.concatenate([np.column_stack([u, np.full(columns + 1, float(z))]) for z in (0, 1)])
    a = np.arange(columns)
    b = a + columns + 1
    faces = np.concatenate([np.stack([a, a + 1, b + 1], axis=1), np.stack([a, b + 1, b], axis=1)])
    return plain(vertices, faces, visual=TextureVisuals(uv=uv))


@given(data=st.data(), mesh=meshes(), color=st.sampled_from(["none", "vertex", "face", "texture"]))
def test_prefix_is_unchanged(data: st.DataObject, mesh: tuple, color: str) -> None:
    vertices, faces = mesh
    random = np.random.default_rng(len(vertices))
    visual = {
        "none": None,
        "vertex": ColorVisuals(vertex_colors=random.integers(0, 256, (len(vertices), 4), dtype=np.uint8)),
        "face": ColorVisuals(face_colors=random.integers(0, 256, (len(faces), 4), dtype=np.uint8)),
        "texture": TextureVisuals(uv=random.uniform(size=(len(vertices), 2))),
    }[color]
    old = plain(
        vertices,
        faces,
        visual=visual,
        vertex_attributes={
            "label": np.arange(len(vertices), dtype=np.int16),
            "flow": random.normal(size=(len(vertices), 2, 2)),
        },
        face_attributes={"part": np.arange(len(faces))},
        metadata={"name": ["a"]},
    )
    read = to_mesh(old)
    extension = data.draw(extensions(read))
    new = extend(old, extension)
    n, f = len(vertices), len(faces)
    assert type(new) is trimesh.Trimesh
    assert np.asarray(new.vertices[:n]).tobytes() == vertices.tobytes()
    assert np.array_equal(new.vertices[n:], extension.vertices)
    assert np.array_equal(new.faces, np.concatenate([faces, extension.faces]))
    assert np.array_equal(new.vertex_attributes["label"][:n], np.arange(n))
    assert new.vertex_attributes["label"].dtype == np.int16
    assert np.array_equal(new.vertex_attributes["flow"][:n], old.vertex_attributes["flow"])
    assert new.vertex_attributes["flow"].shape == (n + len(extension.vertices), 2, 2)
    assert np.array_equal(new.face_attributes["part"][:f], np.arange(f))
    assert len(new.face_attributes["part"]) == len(new.faces)
    assert new.visual.kind == old.visual.kind
    if color == "vertex":
        assert np.array_equal(new.visual.vertex_colors[:n], visual.vertex_colors)
        assert np.array_equal(new.visual.vertex_colors[n:], extension.vertex_attributes["color"])
    if color == "face":
        assert np.array_equal(new.visual.face_colors[:f], visual.face_colors)
        assert len(new.visual.face_colors) == len(new.faces)
    if color == "texture":
        assert np.array_equal(new.visual.uv[:n], visual.uv)
    new.metadata["name"].append("b")
    assert old.metadata == {"name": ["a"]}
    assert len(old.vertices) == n
    assert len(old.faces) == f


def test_lid_closes_the_cube_in_trimesh_s_own_eyes() -> None:
    cube = plain(*open_cube())
    closed = extend(cube, lid())
    assert not cube.is_watertight
    assert closed.is_watertight
    assert closed.is_winding_consistent
    assert closed.volume == pytest.approx(1 + 1 / 9)


def test_colors_are_in_their_own_scale_and_rounded() -> None:
    colors = np.full((8, 4), 255, dtype=np.uint8)
    colors[0, 0] = 0
    cube = plain(*open_cube(), vertex_colors=colors)
    mesh = to_mesh(cube)
    assert mesh.vertex_attributes["color"].max() == 255
    closed = extend(cube, lid(color=np.array([[0.4, 254.6, -3.0, 300.0]])))
    assert closed.visual.vertex_colors[8].tolist() == [0, 255, 0, 255]
    assert closed.visual.vertex_colors.dtype == np.uint8


def test_texture_seam_is_no_boundary() -> None:
    tube = textured_tube()
    mesh = to_mesh(tube)
    assert len(mesh.vertices) == len(tube.vertices)
    assert len(boundary_edges(np.asarray(tube.faces))) == 8 + 8 + 2
    assert len(boundary_edges(mesh.faces)) == 8 + 8
    ring = np.arange(8)
    bottom = type(lid())(
        vertices=np.array([[0.0, 0.0, -1.0]]),
        faces=np.stack([np.roll(ring, -1), ring, np.full(8, 18)], axis=1),
        face_loops=np.zeros(8, dtype=np.int64),
        vertex_attributes={"uv": np.array([[0.5, -1.0]])},
    )
    grown = extend(tube, bottom)
    assert np.array_equal(grown.visual.uv[:18], tube.visual.uv)
    assert grown.visual.uv[18].tolist() == [0.5, -1.0]
    assert len(boundary_edges(to_mesh(grown).faces)) == 8


def test_coincident_vertices_without_texture_stay_apart() -> None:
    tube = textured_tube()
    bare = plain(tube.vertices, tube.faces)
    assert np.array_equal(to_mesh(bare).faces, tube.faces)


def test_stored_normals_are_carried_and_rounded_trip() -> None:
    cube = plain(*open_cube())
    cube.vertex_normals = (np.asarray(cube.vertices) - 0.5) / np.sqrt(0.75)
    mesh = to_mesh(cube)
    assert "normal" in mesh.vertex_attributes
    up = lid_for(mesh)
    up.vertex_attributes["normal"].flags.writeable = False
    closed = extend(cube, up)
    assert np.array_equal(closed.vertex_normals[:8], cube.vertex_normals)
    without = extend(cube, lid())
    assert "vertex_normals" not in without._cache


def test_truth_values_and_face_materials_are_carried() -> None:
    visual = TextureVisuals(uv=np.zeros((8, 2)), face_materials=np.array([0] * 7 + [1] * 3))
    cube = plain(*open_cube(), visual=visual, vertex_attributes={"rim": np.array([True] * 5 + [False] * 3)})
    closed = extend(cube, lid_for(to_mesh(cube)))
    assert closed.vertex_attributes["rim"].tolist() == [True] * 5 + [False] * 3 + [True]
    assert closed.visual.face_materials.tolist() == [0] * 7 + [1] * 3 + [0] * 4


def test_attributes_that_clash_or_are_no_numbers() -> None:
    cube = plain(
        *open_cube(),
        vertex_attributes={"color": np.arange(8.0), "word": np.array(list("abcdefgh")), "wave": np.ones(8) * 1j},
    )
    mesh = to_mesh(cube)
    assert set(mesh.vertex_attributes) == {"attribute color"}
    closed = extend(cube, lid_for(mesh))
    assert closed.vertex_attributes["color"][8] == 3.5
    assert closed.vertex_attributes["word"].tolist() == [*"abcdefgh", ""]
    assert closed.vertex_attributes["wave"][8] == 0


def test_texture_with_colors_keeps_them() -> None:
    visual = TextureVisuals(uv=np.zeros((8, 2)))
    visual.vertex_attributes["color"] = np.full((8, 4), 7, dtype=np.uint8)
    cube = plain(*open_cube(), visual=visual)
    closed = extend(cube, lid_for(to_mesh(cube)))
    assert np.array_equal(closed.visual.vertex_attributes["color"], np.full((9, 4), 7))


def test_primitive_becomes_a_plain_trimesh() -> None:
    box = trimesh.creation.box()
    assert is_closed(to_mesh(box))
    assert type(extend(trimesh.primitives.Box(), nothing())) is trimesh.Trimesh


def test_bad_meshes_and_extensions_give_typed_errors() -> None:
    vertices, faces = open_cube()
    with pytest.raises(VertexIndexError):
        to_mesh(plain(vertices[:5], faces))
    with pytest.raises(MeshShapeError, match="'color'"):
        extend(plain(vertices, faces, vertex_colors=np.zeros((8, 4), dtype=np.uint8)), lid())
