"""Meshes and objects of Blender; needs `bpy`."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import spinor_geom
from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import MeshShapeError, NoFacesError, UnknownMeshTypeError, VertexIndexError
from tests.adapters.shapes import CUBE_POINTS, CUBE_QUADS, extensions, is_closed, lid, lid_for, meshes
from tests.blender.scenes import FIELDS, bmesh, bpy, empty_file, held, mesh_of, object_of, positions
from tests.fill.shapes import tube

pytestmark = pytest.mark.usefixtures("_empty")
OPEN = CUBE_QUADS[:-1]


@pytest.fixture
def _empty():
    empty_file()


def rich_cube():
    """An open cube of quads with attributes of all types at vertices, edges, faces and corners, and all else."""
    cube = object_of(CUBE_POINTS, OPEN)
    mesh = cube.data
    for domain in ("POINT", "EDGE", "FACE", "CORNER"):
        for kind in (*FIELDS, "STRING"):
            mesh.attributes.new(f"{kind} {domain}", kind, domain)
    random = np.random.default_rng(0)
    for name in [attribute.name for attribute in mesh.attributes]:
        attribute = mesh.attributes[name]  # those taken before are no longer valid
        if " " not in name:
            continue
        if attribute.data_type == "STRING":
            for number, item in enumerate(attribute.data):
                item.value = f"s{number}".encode()
        else:
            field, width = FIELDS[attribute.data_type]
            values = random.uniform(0, 1, len(attribute.data) * width)
            whole = attribute.data_type.startswith(("INT", "BOOL"))
            attribute.data.foreach_set(field, (values * 2).astype(int) if whole else values)
    mesh.uv_layers.new(name="map").data.foreach_set("uv", random.uniform(size=2 * len(mesh.loops)))
    cube.shape_key_add(name="Basis")
    for name in ("first", "second"):
        mesh.materials.append(bpy.data.materials.new(name))
        cube.vertex_groups.new(name=name).add(range(0, 8, 2), 0.25, "REPLACE")
        cube.shape_key_add(name=name).data[3].co.z += 3
    mesh.polygons.foreach_set("material_index", [0, 1, 1, 1, 0])
    mesh.edges[0].use_seam = mesh.edges[2].use_edge_sharp = True
    mesh.normals_split_custom_set(random.normal(size=(len(mesh.loops), 3)).tolist())
    return cube


def require_prefix(before, after):
    assert after.keys() == before.keys()
    for name, values in before.items():
        np.testing.assert_array_equal(after[name][: len(values)], values, name)


def test_all_that_a_mesh_holds_stays():
    cube = rich_cube()
    before = held(cube.data)
    for given_mesh in (cube.data, cube):
        closed = extend(given_mesh, lid_for(to_mesh(given_mesh)))
        assert type(closed) is type(given_mesh)
        assert is_closed(to_mesh(closed))
        mesh = getattr(closed, "data", closed)
        assert not mesh.validate()
        require_prefix(before, held(mesh))
        assert [material.name for material in mesh.materials] == ["first", "second"]
        assert len(mesh.polygons) == 9
    assert [group.name for group in closed.vertex_groups] == ["first", "second"]
    require_prefix(before, held(cube.data))
    assert (len(bpy.data.meshes), len(bpy.data.shape_keys)) == (3, 3)


def test_new_vertices_and_faces_have_what_is_beside_them():
    cube = object_of(CUBE_POINTS, OPEN)
    mesh = cube.data
    uv = mesh.uv_layers.new(name="map").data
    for corner, loop in zip(uv, mesh.loops, strict=True):
        corner.uv = CUBE_POINTS[loop.vertex_index, :2]
    mesh.attributes.new("number", "INT", "POINT").data.foreach_set("value", np.arange(8))
    mesh.color_attributes.new("paint", "BYTE_COLOR", "CORNER").data.foreach_set("color_srgb", [0.2] * 80)
    cube.vertex_groups.new(name="top").add([1, 3], 1.0, "REPLACE")
    cube.shape_key_add(name="Basis")
    cube.shape_key_add(name="high").data[1].co.z += 4
    mesh.polygons.foreach_set("material_index", [0, 1, 1, 1, 0])
    mesh.shade_smooth()
    before = to_mesh(cube)
    expected = {"attribute map", "attribute paint", "vertex group 0", "shape key Basis", "shape key high"}
    assert set(before.vertex_attributes) == expected
    closed = extend(cube, lid_for(before)).data
    corners = [corner for face in list(closed.polygons)[5:] for corner in face.loop_indices]
    for corner in corners:
        place = closed.vertices[closed.loops[corner].vertex_index].co
        assert np.allclose(closed.uv_layers["map"].data[corner].uv, place.xy)
    assert np.allclose(closed.color_attributes["paint"].data[-1].color_srgb, 0.2, atol=0.003)
    assert [(group.group, group.weight) for group in closed.vertices[8].groups] == [(0, 0.25)]
    high = closed.shape_keys.key_blocks["high"].data
    assert high[8].co.z - closed.vertices[8].co.z == pytest.approx(0.5)
    assert closed.attributes["number"].data[8].value in (1, 3, 5, 7)
    assert {face.material_index for face in list(closed.polygons)[5:]} == {1}
    assert closed.polygons[8].use_smooth


@given(data=st.data(), shape=meshes())
def test_any_extension_of_any_mesh(data, shape):
    mesh = mesh_of(*shape)
    before = held(mesh)
    extension = data.draw(extensions(to_mesh(mesh)))
    sets = [frozenset(face) for face in [*shape[1].tolist(), *extension.faces.tolist()]]
    if any(face in sets[: len(shape[1]) + at] for at, face in enumerate(sets[len(shape[1]) :])):
        count = len(bpy.data.meshes)
        with pytest.raises(MeshShapeError, match="same vertices"):
            extend(mesh, extension)
        assert len(bpy.data.meshes) == count
        return
    made = extend(mesh, extension)
    require_prefix(before, held(made))
    again = to_mesh(made)
    np.testing.assert_array_equal(again.faces, np.concatenate([shape[1], extension.faces]))
    np.testing.assert_allclose(again.vertices[len(shape[0]) :], extension.vertices, rtol=1e-6)


@pytest.mark.parametrize("continuity", ["film", "smooth"])
def test_fills_have_the_type_of_what_is_given(continuity):
    pipe = object_of(*tube())
    for mesh in (pipe, pipe.data):
        filled, report = spinor_geom.fill_hole(mesh, continuity=continuity, return_report=True)
        assert type(filled) is type(mesh)
        assert report.watertight
        assert is_closed(to_mesh(filled))
        assert spinor_geom.boundary_loops(filled) == []
    assert len(pipe.data.polygons) == 64


@pytest.mark.parametrize("scale", [(1, 1, 1), (3, 0.5, 1), (-2, 1, 0.7)])
def test_objects_are_filled_in_the_world(scale):
    vertices, faces = tube()
    vertices = vertices + np.random.default_rng(1).normal(scale=0.02, size=vertices.shape)  # no two loops are equal
    pipe = object_of(vertices, faces)
    pipe.scale, pipe.rotation_euler, pipe.location = scale, (0.3, -1.0, 2.0), (7, 0, -4)
    bpy.context.view_layer.update()
    matrix = np.array(pipe.matrix_world, dtype=np.float64)

    def in_world(mesh):
        return positions(mesh) @ matrix[:3, :3].T + matrix[:3, 3]

    world = to_mesh(pipe)
    np.testing.assert_allclose(world.vertices, in_world(pipe.data), atol=1e-12)
    expected = spinor_geom.fill_hole(world)
    filled = spinor_geom.fill_hole(pipe)
    np.testing.assert_allclose(in_world(filled.data), expected.vertices, atol=1e-5)  # Blender has single precision
    assert filled.matrix_world == pipe.matrix_world


@pytest.mark.parametrize("by", ["object", "mesh"])
def test_what_is_being_edited_is_filled_as_it_is_shown(by):
    cube = object_of(CUBE_POINTS, CUBE_QUADS)
    cube.shape_key_add(name="Basis")
    cube.shape_key_add(name="key")
    cube.data.attributes.new("heat", "FLOAT", "POINT")
    bpy.ops.object.mode_set(mode="EDIT")
    edited = bmesh.from_edit_mesh(cube.data)
    edited.faces.ensure_lookup_table()
    edited.faces.remove(edited.faces[5])
    filled = spinor_geom.fill_hole(cube if by == "object" else cube.data, target_edge_length=0.5)
    mesh = filled.data if by == "object" else filled
    assert is_closed(to_mesh(filled))
    assert len(mesh.polygons) > 6
    assert cube.mode == "EDIT"
    assert len(bmesh.from_edit_mesh(cube.data).faces) == 5
    assert (len(bpy.data.meshes), len(bpy.data.shape_keys)) == (2, 2)


def test_objects_of_a_library_are_filled_as_copies_of_the_file(tmp_path):
    object_of(*tube())
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    empty_file()
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (found, wanted):
        wanted.objects = found.objects
    (pipe,) = bpy.data.objects
    assert pipe.library is not None
    filled = spinor_geom.fill_hole(pipe)
    assert filled.library is filled.data.library is None
    assert is_closed(to_mesh(filled))


def flat_object():
    pipe = object_of(*tube())
    pipe.scale = (1, 1, 0)
    bpy.context.view_layer.update()
    return pipe


@pytest.mark.parametrize(
    ("made", "error", "says"),
    [
        (lambda: bpy.data.objects.new("Eye", bpy.data.cameras.new("c")), MeshShapeError, "'Eye' has the type CAMERA"),
        (lambda: bpy.data.objects.new("None", None), MeshShapeError, "has the type EMPTY"),
        (flat_object, MeshShapeError, "no extent along an axis"),
        (lambda: mesh_of([[0, 0, 0]], []), NoFacesError, None),
        (lambda: bpy.data.curves.new("c", "CURVE"), UnknownMeshTypeError, "give one of"),
    ],
)
def test_what_is_no_mesh_is_refused(made, error, says):
    with pytest.raises(error, match=says):
        spinor_geom.fill_hole(made())


def test_an_extension_has_all_attributes_and_existing_vertices():
    cube = rich_cube()
    with pytest.raises(MeshShapeError, match="attribute"):
        extend(cube, lid())
    with pytest.raises(VertexIndexError):
        extend(mesh_of(CUBE_POINTS[:6], [[0, 1, 2]]), lid())
    assert len(bpy.data.meshes) == 2
