"""The extension's operators in Edit Mode, on meshes with holes of all kinds; needs `bpy`."""

from __future__ import annotations

import importlib.util
import re
import runpy
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.adapters.shapes import CUBE_POINTS, CUBE_QUADS
from tests.blender.scenes import bmesh, bpy, empty_file, object_of, positions
from tests.fill.shapes import tube

ROOT = Path(__file__).parents[2]
FILLS = ("fill_minimal", "fill_smooth", "fill_automatic")


@pytest.fixture(scope="module")
def extension() -> Any:
    spec = importlib.util.spec_from_file_location("blender_extension", ROOT / "blender" / "__init__.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(autouse=True)
def _registered(extension: Any) -> Iterator[None]:
    empty_file()
    extension.register()
    yield
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    extension.unregister()


def edited(obj: Any = None) -> Any:
    found = bmesh.from_edit_mesh((obj or bpy.context.object).data)
    for items in (found.verts, found.edges, found.faces):
        items.ensure_lookup_table()
        items.index_update()
    return found


def edit(vertices: np.ndarray, faces: Any, *selected: int) -> Any:
    """An object in Edit Mode with some of its vertices selected."""
    made = object_of(vertices, faces)
    bpy.ops.object.mode_set(mode="EDIT")
    select(*selected)
    return made


def select(*vertices: int) -> None:
    bpy.ops.mesh.select_all(action="DESELECT")
    mesh = edited()
    for index in vertices:
        mesh.verts[index].select = True
    mesh.select_flush_mode()
    bmesh.update_edit_mesh(bpy.context.object.data)
    bpy.ops.ed.undo_push(message="before")


def fill(name: str = "fill_minimal", **options: Any) -> set[str]:
    outcome: set[str] = getattr(bpy.ops.spinor_geom, name)("EXEC_DEFAULT", True, **options)
    return outcome


def open_edges(obj: Any = None) -> int:
    return sum(edge.is_boundary for edge in edited(obj).edges)


@pytest.mark.parametrize("name", FILLS)
def test_all_holes_are_filled_if_nothing_is_selected(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    edit(*tube())
    assert fill(name) == {"FINISHED"}
    mesh = edited()
    assert open_edges() == 0
    assert [face.index for face in mesh.faces if face.select] == list(range(64, len(mesh.faces)))
    assert all(edge.is_contiguous for edge in mesh.edges)
    assert re.search(rf"2 of 2 holes filled \(2 \w+\), {len(mesh.faces) - 64} new faces", capfd.readouterr().out)


# of the tube: vertices 0 to 15 are on one rim, 16 to 31 between, 32 to 47 on the other
@pytest.mark.parametrize(
    ("selected", "left"),
    [
        (range(16), 16),
        ((3, 4), 16),
        ((3,), 16),
        ((3, 35), 0),
        ((3, 4, 35), 16),  # an edge of one rim and a vertex of the other: edges count
        ((3, 4, 18, 19), 16),
        ((16, 17), 32),
        (range(48), 0),
    ],
)
def test_holes_with_a_selected_edge_or_vertex_are_filled(selected: Any, left: int) -> None:
    edit(*tube(), *selected)
    assert fill() == {"FINISHED" if left < 32 else "CANCELLED"}
    assert open_edges() == left


def test_each_fill_is_undone_by_one_step() -> None:
    edit(*tube(), 0, 1)
    counts = [len(edited().faces)]
    fill()
    counts.append(len(edited().faces))
    select(40, 41)
    fill("fill_smooth")
    assert open_edges() == 0
    undone = []
    for _ in range(3):  # the second fill, the selection, the first fill
        bpy.ops.ed.undo()
        assert bpy.context.mode == "EDIT_MESH"
        undone.append(len(edited().faces))
    assert undone == [counts[1], counts[1], counts[0]]
    assert fill() == {"FINISHED"}


def test_the_other_users_of_a_mesh_and_its_shape_keys_get_the_patch() -> None:
    pipe = object_of(*tube())
    twin = bpy.data.objects.new("twin", pipe.data)
    bpy.context.collection.objects.link(twin)
    pipe.shape_key_add(name="Basis")
    up = np.array([0.0, 0.0, 5.0])
    pipe.shape_key_add(name="moved", from_mix=False).data.foreach_set("co", (positions(pipe.data) + up).ravel())
    pipe.active_shape_key_index = 1
    bpy.ops.object.mode_set(mode="EDIT")
    fill()
    z = [vertex.co.z for vertex in edited().verts]
    assert min(z) >= 5 + positions(pipe.data)[:, 2].min() - 1e-5  # it shows the second key
    bpy.ops.object.mode_set(mode="OBJECT")
    basis, moved = (np.array([point.co for point in key.data]) for key in pipe.data.shape_keys.key_blocks)
    np.testing.assert_allclose(moved - basis, np.tile(up, (len(basis), 1)), atol=1e-5)
    np.testing.assert_allclose(positions(pipe.data), basis, atol=1e-6)
    assert len(twin.data.polygons) == len(pipe.data.polygons) > 64
    assert len(bpy.data.meshes) == 1


def test_meshes_that_are_edited_together_are_filled_together(capfd: pytest.CaptureFixture[str]) -> None:
    one, other = object_of(*tube()), object_of(CUBE_POINTS + 5, CUBE_QUADS[:-1])
    one.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    fill()
    assert open_edges(one) == open_edges(other) == 0
    assert "3 of 3 holes" in capfd.readouterr().out


def test_edge_lengths_have_the_units_of_the_world() -> None:
    pipe = object_of(*tube())
    pipe.scale = (10, 10, 10)
    bpy.context.view_layer.update()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    fill(edge_length=2.0)
    inner = [edge.calc_length() for edge in edited().edges if min(v.index for v in edge.verts) >= 48]
    assert np.median(inner) == pytest.approx(0.2, rel=0.3)


def test_buttons_take_the_options_of_the_sidebar_and_scripts_the_defaults(extension: Any) -> None:
    bpy.context.scene.spinor_geom.edge_length = 0.5
    pressed = SimpleNamespace(execute=lambda context: {"FINISHED"})  # without windows Blender does not invoke operators
    assert extension.Fill.invoke(pressed, bpy.context, None) == {"FINISHED"}
    assert (pressed.edge_length, pressed.time_limit) == (0.5, 20.0)
    counts = []
    for options in ({}, {"edge_length": 0.2}, {}):
        edit(*tube())
        fill(**options)
        counts.append(len(edited().faces) - 64)
        bpy.ops.object.mode_set(mode="OBJECT")
    assert counts[0] == counts[2] < counts[1] / 2


def test_hidden_holes_stay_open() -> None:
    edit(*tube())
    mesh = edited()
    for vertex in mesh.verts[:16]:
        vertex.hide_set(True)
    bmesh.update_edit_mesh(bpy.context.object.data)
    fill()
    assert open_edges() == 16
    assert not any(face.hide for face in edited().faces[64:])


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (lambda: edit(CUBE_POINTS, CUBE_QUADS), "Warning: There is no hole in the visible mesh"),
        (lambda: edit(CUBE_POINTS, CUBE_QUADS, 0), "Warning: There is no hole at the selection; deselect all"),
        (lambda: edit(np.zeros((0, 3)), []), "Warning: There is no hole in the visible mesh"),
        (lambda: edit(CUBE_POINTS[:3], [[0, 1, 2]]), "Warning: 0 of 1 holes filled, 0 new faces; loop 0"),
    ],
)
def test_what_has_no_hole_is_told(made: Callable[[], Any], says: str, capfd: pytest.CaptureFixture[str]) -> None:
    made()
    assert fill() == {"CANCELLED"}
    assert says in capfd.readouterr().out


@pytest.mark.parametrize(("vertices", "scale"), [(CUBE_POINTS[:3], 1), (CUBE_POINTS, 0)])
def test_impossible_fills_are_errors(vertices: np.ndarray, scale: float) -> None:
    obj = object_of(vertices, CUBE_QUADS[:5] if scale == 0 else [])
    obj.scale.z = scale
    bpy.context.view_layer.update()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    with pytest.raises(RuntimeError, match=r"Error: object: .*(faces|scale)"):
        fill()


def test_it_is_for_edit_mode_and_leaves_nothing_behind(extension: Any) -> None:
    object_of(*tube())
    with pytest.raises(RuntimeError, match="context is incorrect"):
        fill()
    extension.unregister()
    assert not hasattr(bpy.types, "SPINOR_GEOM_PT_fill")
    assert not hasattr(bpy.types.Scene, "spinor_geom")
    extension.register()


def test_the_zip_is_valid(tmp_path: Path) -> None:
    write = runpy.run_path(str(ROOT / "blender" / "build.py"))["write"]
    wheel = tmp_path / "spinor_geom-0.1.0-cp313-cp313-linux_x86_64.whl"
    wheel.write_bytes(b"")
    archive = write(tmp_path, "linux-x64", [wheel])
    tool = Path(bpy.utils.system_resource("SCRIPTS"), "addons_core", "bl_pkg", "cli", "blender_ext.py")
    done = subprocess.run([sys.executable, tool, "validate", archive], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    with zipfile.ZipFile(archive) as content:
        assert set(content.namelist()) == {"__init__.py", "blender_manifest.toml", "LICENSE", f"wheels/{wheel.name}"}
