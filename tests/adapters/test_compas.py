"""Meshes and polylines of COMPAS."""

from dataclasses import replace

import numpy as np
import pytest

from spinor_geom import Cable, fill_hole, solve_membrane, solve_plateau
from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import OptionError, VertexIndexError
from tests.adapters.shapes import CUBE_POINTS, CUBE_QUADS, lid
from tests.fill.shapes import circle

geometry, datastructures = pytest.importorskip("compas.geometry"), pytest.importorskip("compas.datastructures")


def open_cube():
    """Five quads, with a vertex removed before, so that keys are no indices, and an attribute of a vertex."""
    mesh = datastructures.Mesh()
    mesh.delete_vertex(mesh.add_vertex())
    keys = [mesh.add_vertex(x=x, y=y, z=z) for x, y, z in CUBE_POINTS.tolist()]
    for quad in CUBE_QUADS[:5].tolist():
        mesh.add_face([keys[corner] for corner in quad])
    mesh.vertex_attribute(keys[3], "label", "corner")
    return mesh


def test_a_mesh_is_filled_and_stays():
    mesh = open_cube()
    filled, report = fill_hole(mesh, return_report=True)
    assert report.watertight
    assert isinstance(filled, datastructures.Mesh)
    assert len(list(filled.vertices_on_boundary())) == 0
    assert mesh.number_of_faces() == 5
    assert [len(filled.face_vertices(face)) for face in list(filled.faces())[:5]] == [4] * 5
    assert list(filled.vertices_where({"label": "corner"})) == list(mesh.vertices_where({"label": "corner"}))
    np.testing.assert_array_equal(to_mesh(filled).vertices[:8], to_mesh(mesh).vertices)


def test_faces_of_missing_vertices_and_merging_are_refused():
    with pytest.raises(VertexIndexError):
        extend(open_cube(), replace(lid(), faces=np.full_like(lid().faces, 99)))
    with pytest.raises(OptionError, match="cannot merge"):
        fill_hole(open_cube(), merge=True)


def test_polylines_and_polygons_are_curves():
    points = circle(48, bend=0.3).tolist()
    expected = solve_plateau(np.array(points)).area
    for curve in (geometry.Polygon(points), geometry.Polyline([*points, points[0]])):
        assert solve_plateau(curve).area == expected
    rings = [[[x, y, z] for x, y, _ in points] for z in (0, 0.5)]
    assert solve_plateau(list(map(geometry.Polyline, rings))).area == solve_plateau(list(map(np.array, rings))).area


def test_lines_and_polylines_are_fixed_edges():
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    sides = [geometry.Line(*corners[1:3]), geometry.Polyline(corners[2:4]), geometry.Line(corners[3], corners[0])]
    membrane = solve_membrane([Cable(start=geometry.Point(0, 0, 0), end=corners[1], tension=1.5), *sides])
    assert membrane.cables[0].length == pytest.approx(3 * np.arcsin(1 / 3), abs=1e-9)
