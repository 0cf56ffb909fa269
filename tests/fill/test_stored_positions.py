"""What a report says of a patch holds for the positions in the object or file that is returned."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import pyvista
import torch
import trimesh

from spinor_geom.adapters import read_mesh, to_mesh
from spinor_geom.cli.main import main
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.fill_result import FillResult
from spinor_geom.mesh.intersections import self_intersections
from spinor_geom.mesh.operators import face_areas
from tests.adapters.shapes import glb_file, glb_with
from tests.fill.shapes import circle, collar, obj_text

SKEW = np.array([[0.6, -0.8, 0.0, 0.3], [0.8, 0.6, 0.0, -0.1], [0.0, 0.0, 0.7, 5.0], [0.0, 0.0, 0.0, 1.0]])


def wavy(seed: int = 0, noise: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """A collar around a wavy rim, away from the origin, so that rounding changes positions."""
    rim = circle(24, bend=0.4) + np.random.default_rng(seed).normal(scale=noise, size=(24, 3)) + [3.3, -1.7, 0.9]
    return collar(rim, [0.0, 0.0, -0.7])


def ply(folder: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    trimesh.Trimesh(vertices, faces, process=False).export(path := folder / "mesh.ply")
    return path


def glb(folder: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    """Two meshes in nodes with different transforms, positions in integers, of which the second is read last."""
    rows = {"POSITION": np.rint(vertices * 5000).astype(np.int16), "indices": faces.reshape(-1, 1).astype(np.uint16)}
    nodes = [{"mesh": 0, "matrix": SKEW.T.ravel().tolist()}, {"mesh": 0, "scale": [3.0, 3.0, 3.0]}]
    data = glb_file([rows], nodes=nodes, scenes=[{"nodes": [0, 1]}])
    path = folder / "mesh.glb"
    path.write_bytes(glb_with(lambda tree: tree["accessors"][0].update(normalized=True), data))
    return path


SOURCES: dict[str, Callable[[Path, np.ndarray, np.ndarray], Any]] = {
    "float16": lambda _, v, f: (v.astype(np.float16), f),
    "float32": lambda _, v, f: (v.astype(np.float32), f),
    "big-endian": lambda _, v, f: (v.astype(">f4"), f),
    "bfloat16": lambda _, v, f: (torch.tensor(v).bfloat16(), torch.tensor(f)),
    "pyvista": lambda _, v, f: pyvista.PolyData.from_regular_faces(v.astype(np.float32), f),
    "meshio": lambda _, v, f: meshio.Mesh(v.astype(np.float32), [("triangle", f)]),
    "ply": ply,
    "glb": glb,
}


def require_same(result: FillResult, filled: Any) -> None:
    """Fails unless the report is about the positions of a mesh."""
    mesh, first = to_mesh(filled), len(result.original.vertices)
    used = np.unique(result.extension.faces[result.extension.faces >= first])
    assert np.array_equal(mesh.vertices[used], result.extension.vertices[used - first])
    for outcome in result.loops:
        assert outcome.face_range is not None
        assert outcome.mesh_area is not None
        patch = mesh.faces[slice(*outcome.face_range)]
        assert face_areas(mesh.vertices, patch).sum() == pytest.approx(outcome.mesh_area, rel=1e-12)
        assert len(self_intersections(mesh.vertices, patch)) == outcome.self_intersections


@pytest.mark.parametrize("continuity", ["C0", "C1"])
@pytest.mark.parametrize("source", SOURCES)
def test_a_report_is_about_the_positions_of_the_filled_object(source: str, continuity: Any, tmp_path: Path) -> None:
    mesh = SOURCES[source](tmp_path, *wavy())
    filled, result = fill_hole(mesh, return_report=True, continuity=continuity, time_limit=30)
    assert all(outcome.filled for outcome in result.loops)
    if not isinstance(mesh, Path):
        require_same(result, filled)
        return
    filled.write(path := tmp_path / f"filled{mesh.suffix}")
    again = read_mesh(path)
    new = filled.mesh.vertices[len(result.original.vertices) :]
    # a GLB file repeats the vertices of rims
    assert {*map(tuple, new.tolist())} <= {*map(tuple, again.mesh.vertices.tolist())}


@pytest.mark.parametrize("noise", [0.0, 0.08])
@pytest.mark.parametrize("seed", range(4))
def test_crossings_by_rounding_to_half_precision_are_found(seed: int, noise: float) -> None:
    vertices, faces = wavy(seed, noise)
    mesh = (vertices * [1.0, 1.0, 0.01] + [100.0, 50.0, 0.0]).astype(np.float16), faces
    filled, result = fill_hole(mesh, return_report=True, time_limit=30)
    require_same(result, filled)


@pytest.mark.parametrize("suffix", [".stl", ".glb", ".obj"])
def test_a_command_reports_on_the_positions_of_the_written_file(suffix: str, tmp_path: Path) -> None:
    (tmp_path / "mesh.obj").write_text(obj_text(*wavy()))
    output = tmp_path / f"filled{suffix}"
    assert main(["fill", str(tmp_path / "mesh.obj"), "-o", str(output)]) in (0, 1)
    written = {*map(tuple, read_mesh(output).mesh.vertices.tolist())}
    mesh = read_mesh(tmp_path / "mesh.obj").as_stored(suffix)
    filled = fill_hole(mesh)
    assert written == {*map(tuple, filled.mesh.vertices.tolist())}


@pytest.mark.parametrize("suffix", [".stl", ".glb"])
def test_writing_tells_that_it_rounds_what_was_searched_for_intersections(suffix: str, tmp_path: Path) -> None:
    x, y = np.meshgrid(np.linspace(0, 1, 11), np.linspace(0, 1, 11))
    places, cells = np.stack([x, y], axis=-1).reshape(-1, 2), np.arange(110).reshape(10, 11, 1)[:, :10].reshape(-1, 1)
    faces = np.concatenate([cells + np.array(corners) for corners in ([0, 1, 12], [0, 12, 11])])
    faces = faces[(np.abs(places[faces].mean(axis=1) - 0.5) > 0.2).any(axis=1)]
    # two inclined sheets with a hole each, whose distance is about the rounding of their coordinates
    sheets = [np.column_stack([at, 1 + at @ [0.3, 0.2] + gap]) for at, gap in ((places, 0.0), (places + 0.031, 6e-8))]
    (path := tmp_path / "sheets.obj").write_text(obj_text(np.concatenate(sheets), np.concatenate([faces, faces + 121])))
    filled, result = fill_hole(read_mesh(path), [2, 3], return_report=True)
    assert result.intersection_free
    (note,) = (note for note in filled.write(tmp_path / f"filled{suffix}") if "rounded" in note)
    assert f"MeshFile.as_stored('{suffix}')" in note
    filled, result = fill_hole(read_mesh(path).as_stored(suffix), [2, 3], return_report=True)
    assert not result.intersection_free
    assert not any("rounded" in note for note in filled.write(tmp_path / f"filled{suffix}"))
