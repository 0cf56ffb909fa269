"""Frames of STEP files and of CAD shapes: names are kinds, and bad parts are named."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spinor_geom import Cable, OpenCurve, Ring, Stay, SymmetryPlane, solve_membrane
from spinor_geom.errors import ArgumentTypeError, CadFileError, MeshFileError, OptionError
from spinor_geom.membrane.frame_file import edges_of_arguments, read_frame
from tests.systems import OnUse

cad = OnUse("build123d")


def line(label: str, *ends: tuple[float, float, float]) -> Any:
    made = cad.Edge.make_line(*(ends or ((0, 0, 0), (1, 0, 0))))
    made.label = label
    return made


def labelled(shape: Any, label: str) -> Any:
    shape.label = label
    return shape


def half_a_square() -> list[Any]:
    plane = labelled(cad.Face.make_rect(1, 2, cad.Plane((0.2, 0.2, 3), x_dir=(1, 1, 0), z_dir=(1, -1, 0))), "Symmetry")
    sides = line("cable 1.5", (0, 0, 3), (1, 0, 3)), line("cable tension=1.5", (1, 1, 3), (1, 0, 3))
    return [*sides, plane]


@pytest.mark.parametrize("grouped", [False, True])
def test_names_in_a_step_file_are_kinds_of_edges(grouped: bool, tmp_path: Path) -> None:
    parts = half_a_square()
    if grouped:
        # names of assemblies, which are moved, are those of their parts
        sides = [line("Line", *(tuple(end) for end in (side @ 0, side @ 1))) for side in parts[:2]]
        group = cad.Compound(label="cable 1.5", children=[side.moved(cad.Location((0, 0, -3))) for side in sides])
        parts = [group.moved(cad.Location((0, 0, 3))), parts[2]]
    cad.export_step(cad.Compound(label="frame", children=parts), tmp_path / "frame.step")
    edges = read_frame(tmp_path / "frame.step")
    plane = next(one for one in edges if isinstance(one, SymmetryPlane))
    np.testing.assert_allclose(np.abs(plane.normal), [0.5**0.5, 0.5**0.5, 0], atol=1e-12)
    membrane = solve_membrane(edges)
    half = np.arcsin(1 / 3)
    assert [one.length for one in membrane.cables] == pytest.approx([3 * half] * 4, abs=1e-8)
    np.testing.assert_allclose(membrane.supports[:, 2], 3)


def test_labels_of_cad_shapes_are_kinds_of_edges() -> None:
    membrane = solve_membrane(half_a_square())
    assert [one.tension for one in membrane.cables] == [1.5] * 4


@pytest.mark.parametrize(
    ("label", "kind", "given"),
    [
        ("cable 2", Cable, {"tension": 2.0}),
        (" CABLE: length = 2.5", Cable, {"length": 2.5}),
        ("cable_tension_3", Cable, {"tension": 3.0}),
        ("stay 1.8e0", Stay, {"tension": 1.8}),
        ("stay001 length 0.5", Stay, {"length": 0.5}),
        ("stay.001 length 0.5", Stay, {"length": 0.5}),
        ("cable2.001 3", Cable, {"tension": 3.0}),
        ("cable2.5", Cable, {"tension": 2.5}),
        ("cable .001", Cable, {"tension": 0.001}),
        ("fixed side on the left", OpenCurve, {}),
        ("cablé ∞", OpenCurve, {}),
        ("", OpenCurve, {}),
    ],
)
def test_labels_have_kinds_and_numbers(label: str, kind: type, given: dict[str, float]) -> None:
    (edge,) = edges_of_arguments([line(label)])
    assert type(edge) is kind
    for key, value in given.items():
        assert getattr(edge, key) == value


def test_closed_edges_are_rings_and_curved_ones_are_sampled() -> None:
    rings = [cad.Edge.make_circle(1), labelled(cad.Wire.make_polygon([(2, 2), (3, 2), (3, 3), (2, 3)]), "ring -0.5")]
    circle, square = edges_of_arguments(rings)
    assert isinstance(circle, Ring)
    assert isinstance(square, Ring)
    np.testing.assert_allclose(np.linalg.norm(circle.points, axis=1), 1, atol=1e-12)
    assert circle.force is None
    assert square.force == -0.5
    assert {(2.0, 2.0, 0.0), (3.0, 3.0, 0.0)} <= set(map(tuple, np.round(square.points, 12).tolist()))
    (arc,) = edges_of_arguments([cad.Edge.make_circle(1, start_angle=10, end_angle=170)])
    assert isinstance(arc, OpenCurve)
    np.testing.assert_allclose(np.linalg.norm(arc.points, axis=1), 1, atol=1e-12)


def test_shapes_given_one_by_one_are_parts_of_one_frame() -> None:
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
    (ring,) = edges_of_arguments([line("ring", corners[k - 1], corners[k]) for k in range(3)])
    assert isinstance(ring, Ring)
    for shape in (cad.Plane.XY, [line("ring"), 3]):
        with pytest.raises(ArgumentTypeError, match=r"^solve_membrane takes"):
            solve_membrane([shape])
    with pytest.raises(OptionError, match=r"edge 1 \('cable two'\)"):
        edges_of_arguments([np.array(corners), line("cable two")])


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (lambda: line("cable"), r"edge 0 \('cable'\): a cable has a tension or a length"),
        (lambda: line("cable.001"), r"\('cable.001'\): a cable has a tension or a length"),
        (lambda: line("cable 2.001.001"), "'tension' must be a number, got '2.001.001'"),
        (lambda: line("cable2kN"), "'tension' must be a number, got '2kN'"),
        (lambda: line("cable -1"), r"\('cable -1'\): tension must be"),
        (lambda: line("cable two"), "'tension' must be a number, got 'two'"),
        (lambda: line("cable nan"), "'tension' must be a number"),
        (lambda: line("cable 2 kN"), "the key '2' is unknown beside 'cable'"),
        (lambda: line("cable length 2 m"), "the key 'm' is unknown"),
        (lambda: line("cable tension 2 tension 3"), "the key 'tension' is given twice"),
        (lambda: labelled(cad.Sphere(1).faces()[0], "symmetric"), "face of a plane of symmetry is curved"),
        (lambda: line("cable length 0.5"), "too short"),
        (lambda: line("ring 3"), r"ring 'ring 3': the edges are open"),
        (lambda: line("symmetric"), "does not determine its plane"),
        (lambda: labelled(cad.Edge.make_helix(1, 1, 1), "symmetric"), "does not determine its plane"),
        (lambda: cad.Face.make_rect(1, 2), r"edge 0 \('fixed'\): a face is no edge"),
        (lambda: labelled(cad.Edge.make_circle(1), "cable 2"), "both ends of a cable"),
    ],
)
def test_bad_parts_are_refused_by_name(shape: Callable[[], Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=message):
        solve_membrane([shape()])
    cad.export_step(shape(), tmp_path / "frame.step")
    with pytest.raises(MeshFileError, match=message):
        read_frame(tmp_path / "frame.step")


def test_a_step_file_without_shapes_is_not_taken_for_json(tmp_path: Path) -> None:
    (tmp_path / "frame.step").write_text("")
    with pytest.raises(CadFileError, match=r"frame.step: has no shape that Open CASCADE can read"):
        read_frame(tmp_path / "frame.step")


def test_curves_of_a_step_file_have_names_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "frame.step"
    cad.export_step(cad.Wire.make_polygon([(0, 0, 0), (1, 0, 0), (1, 1, 0)], close=True), path)
    path.write_text(path.read_text().replace("TRIMMED_CURVE(''", "TRIMMED_CURVE('cable 2'", 2))
    assert [type(edge) for edge in read_frame(path)] == [Cable, Cable, OpenCurve]
    path.write_text(path.read_text().replace("TRIMMED_CURVE(''", "TRIMMED_CURVE($"))
    assert [type(edge) for edge in read_frame(path)] == [Cable, Cable, OpenCurve]


def test_ends_that_nearly_meet_are_joined() -> None:
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 1e-7)]
    sides = [line("cable 1.5", square[0], (1, 0, 1e-7)), *(line("", square[k], square[(k + 1) % 4]) for k in (1, 2, 3))]
    assert solve_membrane(sides).cables[0].length == pytest.approx(3 * np.arcsin(1 / 3), abs=1e-6)
