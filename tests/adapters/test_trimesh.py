import numpy as np
import trimesh
from trimesh.visual import TextureVisuals

from spinor_geom.adapters import extend, to_mesh
from spinor_geom.mesh.topology import boundary_edges
from tests.adapters.shapes import extension, is_closed, lid, lid_for, nothing, open_cube


def plain(vertices, faces, **options):
    return trimesh.Trimesh(vertices, faces, process=False, **options)


def textured_tube(columns=8):
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


def test_colors_are_in_their_own_scale_and_rounded():
    colors = np.full((8, 4), 255, dtype=np.uint8)
    colors[0, 0] = 0
    cube = plain(*open_cube(), vertex_colors=colors)
    mesh = to_mesh(cube)
    assert mesh.vertex_attributes["color"].max() == 255
    closed = extend(cube, lid(color=np.array([[0.4, 254.6, -3.0, 300.0]])))
    assert closed.visual.vertex_colors[8].tolist() == [0, 255, 0, 255]
    assert closed.visual.vertex_colors.dtype == np.uint8


def test_texture_seam_is_no_boundary():
    tube = textured_tube()
    mesh = to_mesh(tube)
    assert len(mesh.vertices) == len(tube.vertices)
    assert len(boundary_edges(np.asarray(tube.faces))) == 8 + 8 + 2
    assert len(boundary_edges(mesh.faces)) == 8 + 8
    ring = np.arange(8)
    faces = np.stack([np.roll(ring, -1), ring, np.full(8, 18)], axis=1)
    bottom = extension([0, 0, -1], faces, uv=np.array([[0.5, -1.0]]))
    grown = extend(tube, bottom)
    assert np.array_equal(grown.visual.uv[:18], tube.visual.uv)
    assert grown.visual.uv[18].tolist() == [0.5, -1.0]
    assert len(boundary_edges(to_mesh(grown).faces)) == 8


def test_stored_normals_are_carried_and_rounded_trip():
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


def test_truth_values_and_face_materials_are_carried():
    visual = TextureVisuals(uv=np.zeros((8, 2)), face_materials=np.array([0] * 7 + [1] * 3))
    cube = plain(*open_cube(), visual=visual, vertex_attributes={"rim": np.array([True] * 5 + [False] * 3)})
    closed = extend(cube, lid_for(to_mesh(cube)))
    assert closed.vertex_attributes["rim"].tolist() == [True] * 5 + [False] * 3 + [True]
    assert closed.visual.face_materials.tolist() == [0] * 7 + [1] * 3 + [0] * 4


def test_attributes_that_clash_or_are_no_numbers():
    words, wave = np.array(list("abcdefgh")), np.ones(8) * 1j
    cube = plain(*open_cube(), vertex_attributes={"color": np.arange(8.0), "word": words, "wave": wave})
    mesh = to_mesh(cube)
    assert set(mesh.vertex_attributes) == {"attribute color"}
    closed = extend(cube, lid_for(mesh))
    assert closed.vertex_attributes["color"][8] == 3.5
    assert closed.vertex_attributes["word"].tolist() == [*"abcdefgh", ""]
    assert closed.vertex_attributes["wave"][8] == 0


def test_primitive_becomes_a_plain_trimesh():
    box = trimesh.creation.box()
    assert is_closed(to_mesh(box))
    assert type(extend(trimesh.primitives.Box(), nothing())) is trimesh.Trimesh
