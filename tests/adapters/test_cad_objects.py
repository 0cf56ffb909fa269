"""Objects of OCP, build123d and CadQuery are recognised as closed curves, without an import of these libraries."""

import numpy as np
import pytest

from spinor_geom.adapters import to_rims
from spinor_geom.adapters.cad_edges import parts_of
from spinor_geom.adapters.cad_objects import cad_object, cad_shapes


def test_other_objects_are_no_cad_shapes():
    for what in (np.eye(3), [np.eye(3), np.eye(3)], "mesh.obj", (np.eye(3), np.array([[0, 1, 2]])), [], None):
        assert cad_shapes(what, function="solve_plateau") is None


def build123d_objects():
    import build123d as cad

    with cad.BuildLine() as line:
        cad.CenterArc((0, 0), 1, 0, 360)
    with cad.BuildSketch() as sketch:
        cad.Circle(1)
    return {
        "edge": cad.Edge.make_circle(1),
        "wire": cad.Wire.make_circle(1),
        "list of edges": cad.Wire.make_circle(1).edges(),
        "curve": cad.Curve() + cad.CenterArc((0, 0), 1, 0, 360),
        "sketch": cad.Circle(1),
        "line builder": line,
        "sketch builder": sketch,
        "shape of OCP": cad.Wire.make_circle(1).wrapped,
        "faces": cad.Circle(1).faces(),
    }


def cadquery_objects():
    import cadquery as cad

    wire = cad.Wire.makeCircle(1, cad.Vector(), cad.Vector(0, 0, 1))
    return {
        "edge": wire.Edges()[0],
        "wire": wire,
        "list of edges": wire.Edges(),
        "workplane": cad.Workplane().circle(1),
        "workplane with a chain of edges": cad.Workplane().moveTo(1, 0).threePointArc((0, 1), (-1, 0)).close().wires(),
        "sketch": cad.Sketch().circle(1),
        "face": cad.Face.makeFromWires(wire),
        "shape of OCP": wire.wrapped,
    }


@pytest.mark.parametrize(("library", "objects"), [("build123d", build123d_objects), ("cadquery", cadquery_objects)])
def test_objects_of_a_library_give_their_curve(library, objects):
    pytest.importorskip(library)
    for name, what in objects().items():
        (rim,) = to_rims(what)
        length = np.pi + 2 if "chain" in name else 2 * np.pi
        assert rim.length == pytest.approx(length, rel=1e-12), name


@pytest.mark.parametrize("library", ["build123d", "cadquery"])
def test_shapes_become_objects_of_a_library(library):
    module = pytest.importorskip(library)
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox

    (shell,) = parts_of(BRepPrimAPI_MakeBox(1, 2, 3).Shape(), "SHELL")
    assert isinstance(cad_object(shell, library), module.Shell)
