"""3MF packages: their parts, builds, components and units."""

import zipfile

import numpy as np
import pytest
import trimesh

from spinor_geom.adapters import read_mesh
from spinor_geom.adapters.contents import METRES
from spinor_geom.errors import MeshFileError
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.mesh.topology import boundary_edges
from tests.adapters.shapes import is_closed
from tests.fill.shapes import tube

TUBE = tube()
ROOT = "3D/3dmodel.model"
MOVED, TURNED = "1 0 0 0 1 0 0 0 1 5 0 0", "0 1 0 -1 0 0 0 0 1 0 0 7"


def mesh_text(number, points=TUBE[0], faces=TUBE[1]):
    rows = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in points.tolist())
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces.tolist())
    whole = f"<mesh><vertices>{rows}</vertices><triangles>{triangles}</triangles></mesh>"
    return f'<object id="{number}" type="model">{whole}</object>'


def components(number, *parts):
    inner = "".join(f"<component {part}/>" for part in parts)
    return f'<object id="{number}"><components>{inner}</components></object>'


def model(resources, *items):
    build = "".join(f"<item {item}/>" for item in items)
    return f'<model unit="millimeter"><resources>{resources}</resources><build>{build}</build></model>'


def packed(path, parts, method=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, text in parts.items():
            archive.writestr(name, text)
    return path


def test_a_3mf_file_is_filled_part_by_part(tmp_path):
    scene = trimesh.Scene()
    for x in (0.0, 5.0):
        place = trimesh.transformations.translation_matrix([x, 0, 0])
        scene.add_geometry(trimesh.Trimesh(*tube(), process=False), geom_name=f"at {x}", transform=place)
    scene.export(tmp_path / "two.3mf")
    filled, report = fill_hole(tmp_path / "two.3mf", return_report=True)
    assert report.watertight
    assert len(report.loops) == 4
    filled.write(tmp_path / "filled.3mf")
    again = trimesh.load_scene(tmp_path / "filled.3mf", process=False)
    assert len(again.geometry) == 2
    assert all(part.is_watertight for part in again.geometry.values())
    assert all(np.array_equal(part.vertices[:48], tube()[0]) for part in again.geometry.values())
    filled.write(tmp_path / "filled.ply")
    read_mesh(tmp_path / "filled.ply").write(tmp_path / "joined.3mf")
    assert is_closed(read_mesh(tmp_path / "joined.3mf").mesh)
    whole = (tmp_path / "two.3mf").read_bytes()
    for data in (b"hello", whole[: len(whole) // 2]):
        (tmp_path / "damaged.3mf").write_bytes(data)
        with pytest.raises(MeshFileError, match=r"damaged.3mf: is not a ZIP archive"):
            read_mesh(tmp_path / "damaged.3mf")


@pytest.mark.parametrize("size", [1 << 20, 1 << 25])
def test_a_3mf_file_that_unpacks_to_far_more_than_it_is_is_refused(tmp_path, size):
    trimesh.creation.box().export(tmp_path / "bomb.3mf")
    with zipfile.ZipFile(tmp_path / "bomb.3mf", "a", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("3D/beside.bin", bytes(size))
    if size < 1 << 24:  # which costs no harm
        assert len(read_mesh(tmp_path / "bomb.3mf").mesh.faces) == 12
        return
    with pytest.raises(MeshFileError, match=r"bomb.3mf: unpacks to over 200 times its size"):
        read_mesh(tmp_path / "bomb.3mf")


@pytest.mark.parametrize(("unit", "metres"), list(METRES.items()))
def test_3mf_keeps_its_unit_and_glb_is_in_metres(tmp_path, unit, metres):
    package = model(mesh_text(1), 'objectid="1"').replace("millimeter", unit)
    file = read_mesh(packed(tmp_path / "tube.3mf", {ROOT: package}))
    assert file.contents.unit == unit
    for number, one in enumerate((file, fill_hole(file), file.merged())):
        one.write(tmp_path / f"{number}.3mf")
        again = read_mesh(tmp_path / f"{number}.3mf")
        assert again.contents.unit == unit
        np.testing.assert_array_equal(again.mesh.vertices[:48], file.mesh.vertices)
    file.write(tmp_path / "tube.glb")
    # 32-bit numbers
    np.testing.assert_allclose(read_mesh(tmp_path / "tube.glb").mesh.vertices, file.mesh.vertices * metres, rtol=1e-6)
    read_mesh(tmp_path / "tube.glb").write(tmp_path / "back.3mf")
    assert read_mesh(tmp_path / "back.3mf").contents.unit == "meter"
    file.write(tmp_path / "tube.obj")
    np.testing.assert_array_equal(read_mesh(tmp_path / "tube.obj").mesh.vertices, file.mesh.vertices)


A, B = "3D/Objects/a.model", "3D/Objects/b.model"
MOVED_PART = f'objectid="1" p:path="/{A}" transform="{MOVED}"'
RELS = '<Relationships><Relationship Target="/3D/other.model" Id="a" Type="http://x/2013/01/3dmodel"/></Relationships>'


@pytest.mark.parametrize(
    ("parts", "x", "count"),
    [
        # an item, with and without a leading slash, and relative to the part
        ({ROOT: model("", f'objectid="1" p:path="/{A}" transform="{MOVED}"'), A: model(mesh_text(1))}, 5, 1),
        ({ROOT: model("", f'objectid="1" p:path="{A}" transform="{MOVED}"'), A: model(mesh_text(1))}, 5, 1),
        ({ROOT: model("", f'objectid="1" p:path="Objects/a.model" transform="{MOVED}"'), A: model(mesh_text(1))}, 5, 1),
        (
            {ROOT: model("", f'objectid="1" p:path="/3d/OBJECTS/A.model" transform="{MOVED}"'), A: model(mesh_text(1))},
            5,
            1,
        ),
        # the prefix is the file's choice, and a part's own build does not count
        (
            {
                ROOT: model("", f'objectid="1" q:path="/{A}" transform="{MOVED}"'),
                A: model(mesh_text(1), 'objectid="1"'),
            },
            5,
            1,
        ),
        # built twice, and never
        ({ROOT: model(mesh_text(1), 'objectid="1"', f'objectid="1" transform="{MOVED}"')}, 0, 2),
        ({ROOT: model(mesh_text(1), 'objectid="9"')}, 0, 1),
        # equal ids in two parts
        ({ROOT: model(mesh_text(1), 'objectid="1"', MOVED_PART), A: model(mesh_text(1))}, 0, 2),
        # components: the component's transform comes before the item's
        ({ROOT: model(components(2, MOVED_PART), f'objectid="2" transform="{MOVED}"'), A: model(mesh_text(1))}, 10, 1),
        # a part whose components refer to another part
        (
            {
                ROOT: model(components(4, f'objectid="9" p:path="/{B}" transform="{MOVED}"'), 'objectid="4"'),
                B: model(components(9, MOVED_PART, f'objectid="3" transform="{TURNED}"') + mesh_text(3)),
                A: model(mesh_text(1)),
            },
            10,
            2,
        ),
        # the relationships of the package name another root
        ({"_rels/.rels": RELS, "3D/other.model": model(mesh_text(1), f'objectid="1" transform="{MOVED}"')}, 5, 1),
        # slices have vertices, too
        ({ROOT: model(mesh_text(1) + "<s:slicestack><s:vertex x='1' y='2'/></s:slicestack>", 'objectid="1"')}, 0, 1),
    ],
)
def test_parts_components_and_their_transforms(tmp_path, parts, x, count):
    filled, report = fill_hole(packed(tmp_path / "parts.3mf", parts), return_report=True)
    assert len(report.loops) == 2 * count
    np.testing.assert_allclose(report.original.vertices[:48], TUBE[0] + [x, 0, 0], atol=1e-12)
    filled.write(tmp_path / "filled.3mf")
    again = read_mesh(tmp_path / "filled.3mf").mesh
    assert is_closed(again)
    assert len(again.faces) == len(report.original.faces) + len(report.extension.faces)
    other = trimesh.load_scene(tmp_path / "filled.3mf", process=False).to_mesh()
    assert np.array_equal(np.sort(other.bounds), np.sort([again.vertices.min(axis=0), again.vertices.max(axis=0)]))


def test_a_bridge_between_two_meshes_is_written_with_copies_of_the_other_rim(tmp_path):
    pair = model(mesh_text(1), 'objectid="1"', 'objectid="1" transform="1 0 0 0 1 0 0 0 1 0 0 1.4"')
    path = packed(tmp_path / "pair.3mf", {ROOT: pair})
    loops = fill_hole(path, [], return_report=True)[1].loops
    heights = [outcome.loop.centroid[2] for outcome in loops]
    inner = np.argsort(heights)[1:3].tolist()
    filled, report = fill_hole(path, bridge=inner, return_report=True)
    assert report.closed
    filled.write(tmp_path / "filled.3mf")
    again = read_mesh(tmp_path / "filled.3mf")
    assert len(boundary_edges(again.merged(1e-9).mesh.faces)) == 2 * 16


@pytest.mark.parametrize(
    ("parts", "problem"),
    [
        ({ROOT: model("", 'objectid="1" p:path="/3D/none.model"')}, r"object 1 of 3d/none.model does not exist"),
        ({ROOT: model(components(2, 'objectid="2"'), 'objectid="2"')}, r"3d/3dmodel.model, object 2: .* levels deep"),
        ({ROOT: "<model><resources>"}, r"3d/3dmodel.model: is not valid XML"),
        ({ROOT: '<!DOCTYPE m [<!ENTITY a "b">]><model/>'}, "document type definition"),
        ({ROOT: model(mesh_text(1, faces=TUBE[1] + 40), 'objectid="1"')}, r"object 1: triangle \d+ has the vertices"),
        ({ROOT: model(mesh_text(1).replace(' y="', ' u="'))}, r"line 1: an element lacks the attribute 'y'"),
        ({ROOT: model(mesh_text(1).replace('v1="0"', 'v1="0_0"'))}, r"'0_0' is not a number"),
        ({ROOT: model(mesh_text(1), 'objectid="1" transform="1 0 0"')}, "has not 12 numbers"),
        ({ROOT: model(mesh_text(1), 'objectid="1" transform="0 0 0 0 0 0 0 0 0 0 0 0"')}, "its transform is singular"),
        ({"readme.txt": "hello"}, "has no model part"),
        ({ROOT: '<?xml version="1.0" encoding="triangle-8"?><model/>'}, "3dmodel.model: is not valid XML"),
        ({ROOT: '<?xml version="1.0" encoding="utf-7"?><model/>'}, "3dmodel.model: is not valid XML"),
    ],
)
def test_a_broken_package_is_an_error_with_part_and_place(tmp_path, parts, problem):
    with pytest.raises(MeshFileError, match=rf"broken\.3mf.*{problem}"):
        read_mesh(packed(tmp_path / "broken.3mf", parts))


def test_damaged_bytes_inside_a_package_are_an_error(tmp_path):
    path = packed(tmp_path / "broken.3mf", {ROOT: model(mesh_text(1), 'objectid="1"')})
    data = bytearray(path.read_bytes())
    data[200:260] = bytes(60)
    path.write_bytes(data)
    with pytest.raises(MeshFileError, match=r"broken\.3mf.*cannot be unpacked"):
        read_mesh(path)
    packed(path, {ROOT: model(mesh_text(1))}, zipfile.ZIP_LZMA)
    with pytest.raises(MeshFileError, match="another method than Deflate"):
        read_mesh(path)


def test_a_reference_to_an_object_that_is_missing_is_told(tmp_path):
    path = packed(tmp_path / "part.3mf", {ROOT: model(mesh_text(1), 'objectid="1"', 'objectid="7"')})
    _, report = fill_hole(path, return_report=True)
    assert report.notes[0] == "object 7 of 3d/3dmodel.model does not exist, and is left out"


def test_a_mesh_at_many_positions_is_written_once(tmp_path):
    items = [f'objectid="1" transform="1 0 0 0 1 0 0 0 1 {5 * x} 0 0"' for x in range(40)]
    path = packed(tmp_path / "many.3mf", {ROOT: model(mesh_text(1), *items)})
    assert len(read_mesh(path).mesh.vertices) == 40 * 48
    filled = fill_hole(path, 0)
    filled.write(tmp_path / "filled.3mf")
    with zipfile.ZipFile(tmp_path / "filled.3mf") as archive:
        text = archive.read(ROOT)
    assert (text.count(b"<object"), text.count(b"<item")) == (2, 40)
    assert len(boundary_edges(read_mesh(tmp_path / "filled.3mf").mesh.faces)) == 79 * 16
    fill_hole(path, []).write(tmp_path / "same.3mf")
    assert (tmp_path / "same.3mf").read_bytes() == path.read_bytes()
