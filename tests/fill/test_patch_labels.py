"""Patches in the files of filled meshes: OBJ has groups, PLY a property of faces, VTK's formats cell data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyvista
import trimesh

from spinor_geom.adapters import read_mesh
from spinor_geom.adapters.ply import read_records
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.render.shapes import shape_of
from tests.fill.shapes import obj_text, tube


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray, *more: str) -> Path:
    path.write_text(obj_text(vertices, faces, *more))
    return path


def filled_tube(tmp_path: Path, target: Path, *more: str) -> np.ndarray:
    """Writes a filled tube; gives the label that each of its faces should have."""
    filled, report = fill_hole(write_obj(tmp_path / "tube.obj", *tube(), *more), return_report=True)
    filled.write(target)
    wanted = np.full(len(filled.mesh.faces), -1)
    for outcome in report.loops:
        assert outcome.face_range is not None
        wanted[slice(*outcome.face_range)] = outcome.index
    assert np.unique(wanted).tolist() == [-1, 0, 1]
    return wanted


def test_a_new_ply_file_has_the_patch_of_each_face(tmp_path: Path) -> None:
    target = tmp_path / "filled.ply"
    wanted = filled_tube(tmp_path, target)
    np.testing.assert_array_equal(read_records(target.read_bytes()).elements["face"].values["patch"], wanted)
    again = read_mesh(target)
    assert len(again.mesh.faces) == len(wanted)
    # as another reader has it
    other = trimesh.load(target, process=False)
    np.testing.assert_array_equal(other.faces, again.mesh.faces)
    np.testing.assert_array_equal(other.metadata["_ply_raw"]["face"]["data"]["patch"].ravel(), wanted)


@pytest.mark.parametrize("suffix", [".vtp", ".vtk"])
@pytest.mark.parametrize("more", [(), ("l 1 2 3", "l 4 5")])
def test_a_new_vtk_file_has_the_patch_of_each_cell(tmp_path: Path, suffix: str, more: tuple[str, ...]) -> None:
    target = tmp_path / f"filled{suffix}"
    wanted = filled_tube(tmp_path, target, *more)
    labels = np.asarray(pyvista.read(target).cell_data["patch"])
    # lines are cells too, and come before the faces
    np.testing.assert_array_equal(labels, [*[-1] * len(more), *wanted])


@pytest.mark.parametrize("suffix", [".vtp", ".vtk"])
@pytest.mark.parametrize("is_grid", [False, True])
def test_a_vtk_file_that_is_appended_to_gets_the_patches(tmp_path: Path, suffix: str, is_grid: bool) -> None:
    held = pyvista.PolyData.from_regular_faces(*tube())
    if is_grid and suffix == ".vtp":
        pytest.skip("XML polygonal data is no grid")
    (held.cast_to_unstructured_grid() if is_grid else held).save(tmp_path / f"tube{suffix}")
    filled, report = fill_hole(tmp_path / f"tube{suffix}", return_report=True)
    filled.write(tmp_path / f"filled{suffix}")
    labels = np.asarray(pyvista.read(tmp_path / f"filled{suffix}").cell_data["patch"])
    np.testing.assert_array_equal(labels, [*[-1] * 64, *report.extension.face_loops])


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".vtp"])
def test_patches_of_an_earlier_fill_are_known_shown_and_kept(suffix: str, tmp_path: Path) -> None:
    wanted = filled_tube(tmp_path, tmp_path / f"filled{suffix}")
    again = read_mesh(tmp_path / f"filled{suffix}")
    np.testing.assert_array_equal(again.contents.face_loops, wanted)
    np.testing.assert_array_equal(shape_of(again).is_new, wanted >= 0)
    again.write(tmp_path / "converted.ply")
    np.testing.assert_array_equal(read_mesh(tmp_path / "converted.ply").contents.face_loops, wanted)
