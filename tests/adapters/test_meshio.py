from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import MeshShapeError, VertexIndexError
from spinor_geom.fill.fill_hole import fill_hole
from tests.adapters.shapes import CUBE_POINTS, CUBE_QUADS, extensions, is_closed, lid, meshes
from tests.fill.shapes import tube


@settings(max_examples=30)
@given(data=st.data(), mesh=meshes(), real=st.sampled_from([np.float32, np.float64]))
def test_prefix_is_unchanged(data: st.DataObject, mesh: tuple, real: type) -> None:
    vertices, faces = mesh
    n, f = len(vertices), len(faces)
    random = np.random.default_rng(n)
    old = meshio.Mesh(
        vertices.astype(real),
        [("line", [[0, 1]]), ("triangle", faces)],
        point_data={
            "label": np.arange(n, dtype=np.int16),
            "stress": random.normal(size=(n, 2, 2)),
            "word": np.array(list("abcdefghijkl"[:n])),
        },
        cell_data={"part": [np.array([9]), np.arange(f)]},
        field_data={"skin": np.array([1, 2])},
        point_sets={"left": [0, 1]},
        cell_sets={"front": [[], [0]]},
    )
    extension = data.draw(extensions(to_mesh(old)))
    new = extend(old, extension)
    assert type(new) is meshio.Mesh
    assert new.points.dtype == real
    assert new.points[:n].tobytes() == old.points.tobytes()
    assert [block.type for block in new.cells] == ["line", "triangle", "triangle"]
    assert np.array_equal(np.concatenate([block.data for block in new.cells[1:]]), [*faces, *extension.faces])
    for name, values in old.point_data.items():
        assert np.array_equal(new.point_data[name][:n], values)
        assert new.point_data[name].dtype == np.asarray(values).dtype
        assert len(new.point_data[name]) == n + len(extension.vertices)
    assert np.array_equal(np.concatenate(new.cell_data["part"]), [9, *range(f), *[0] * len(extension.faces)])
    assert list(new.field_data["skin"]) == [1, 2]
    assert list(new.point_sets["left"]) == [0, 1]
    assert [list(block) for block in new.cell_sets["front"]] == [[], [0], []]
    assert (len(old.points), len(old.cells)) == (n, 2)


def test_quads_and_polygons_stay_and_are_closed_by_a_lid() -> None:
    cube = meshio.Mesh(CUBE_POINTS, [("quad", CUBE_QUADS[:3]), ("polygon", CUBE_QUADS[3:5])])
    assert len(to_mesh(cube).faces) == 10
    closed = extend(cube, lid())
    assert np.array_equal(closed.cells[0].data, CUBE_QUADS[:3])
    assert closed.cells[1].type == "polygon"
    assert is_closed(to_mesh(closed))


@pytest.mark.parametrize("suffix", ["vtu", "vtk", "ply"])
def test_files_of_meshio_s_formats_are_filled_and_written_back(tmp_path: Path, suffix: str) -> None:
    vertices, faces = tube()
    path = tmp_path / f"tube.{suffix}"
    meshio.Mesh(vertices, [("triangle", faces)], point_data={"height": vertices[:, 2]}).write(path)
    filled, report = fill_hole(meshio.read(path), return_report=True)
    assert isinstance(filled, meshio.Mesh)
    assert report.watertight
    filled.write(tmp_path / f"filled.{suffix}")
    again = to_mesh(meshio.read(tmp_path / f"filled.{suffix}"))
    assert is_closed(again)
    np.testing.assert_allclose(again.vertices[:48], vertices)
    np.testing.assert_allclose(again.vertex_attributes["height"][:48, 0], vertices[:, 2])


def test_data_without_a_surface_in_space_are_refused_with_advice() -> None:
    with pytest.raises(MeshShapeError, match=r"not faces \(tetra\); extract its surface"):
        to_mesh(meshio.Mesh(CUBE_POINTS, [("tetra", [[0, 1, 2, 4]])]))
    with pytest.raises(MeshShapeError, match="append a third coordinate"):
        to_mesh(meshio.Mesh(CUBE_POINTS[:, :2], [("quad", CUBE_QUADS)]))
    with pytest.raises(VertexIndexError):
        to_mesh(meshio.Mesh(CUBE_POINTS[:3], [("triangle", [[0, 1, 3]])]))
    with pytest.raises(MeshShapeError, match="'height'"):
        extend(meshio.Mesh(CUBE_POINTS, [("quad", CUBE_QUADS)], point_data={"height": np.zeros(8)}), lid())
