"""Closed curves of wires, edges and faces of CAD models: exact, in loops, with corners and directions; bad input."""

import numpy as np
import pytest
from hypothesis import given
from scipy.special import ellipe

from spinor_geom import gallery
from spinor_geom.adapters import to_rims
from spinor_geom.adapters.open_cascade import write_shape
from spinor_geom.errors import (
    ArgumentTypeError,
    BranchingEdgesError,
    LoopIndexError,
    NoEdgesError,
    OpenWireError,
    OptionError,
)
from spinor_geom.mesh.curve import BoundaryCurve
from tests.strategies import SEEDS
from tests.systems import OnUse

cad = OnUse("build123d")


def seam(points):
    """A closed cubic spline through points of a tennis seam."""
    return cad.Edge.make_spline([tuple(p) for p in gallery.tennis_seam(0.8).sample(points).points], periodic=True)


def polyline(*points):
    ends = zip(points, (*points[1:], points[0]), strict=True)
    return [cad.Edge.make_line(first, last) for first, last in ends]


def distances(points, shape):
    """Distances from a shape, by Open CASCADE."""
    return np.array([shape.distance_to(cad.Vertex(*point)) for point in points.tolist()])


def closed_by_a_line(make):
    """An open edge and the line between its ends."""
    edge = make()
    return cad.Wire([edge, cad.Line(edge @ 1, edge @ 0)])


SHAPES = {  # shape, corners, length if known
    "circle": (lambda: cad.Edge.make_circle(2), 0, 4 * np.pi),
    "ellipse": (lambda: cad.Edge.make_ellipse(3, 1), 0, 12 * ellipe(8 / 9)),
    "rounded rectangle": (lambda: cad.RectangleRounded(4, 2, 0.5), 0, 8 + np.pi),
    "polygon": (lambda: cad.Wire.make_polygon([(0, 0, 0), (1, 0, 0), (1, 1, 1), (0, 1, 0)]), 4, 2 + 2 * np.sqrt(2)),
    "half disk": (lambda: closed_by_a_line(lambda: cad.CenterArc((0, 0), 1, 0, 180)), 2, 2 + np.pi),
    "seam": (lambda: seam(40), 0, None),
    "part of a spline": (lambda: closed_by_a_line(lambda: seam(20).trim(0.1, 0.7)), 2, None),
    "helix": (lambda: closed_by_a_line(lambda: cad.Edge.make_helix(1, 2, 1)), 2, None),
}


@pytest.mark.parametrize(("made", "corners", "length"), SHAPES.values(), ids=SHAPES)
def test_curves_are_on_their_edges_to_rounding(made, corners, length):
    shape = made()
    (rim,) = to_rims(shape)
    assert len(rim.corners) == corners
    curve = BoundaryCurve.from_formula(rim)
    assert curve.length() == pytest.approx(rim.length if length is None else length, rel=1e-12)
    assert rim.length == pytest.approx(curve.length(), rel=1e-12)
    edges = cad.Compound(shape.edges())
    s = np.random.default_rng(0).random(20)
    assert distances(curve.point(s), edges).max() < 1e-13 * rim.length
    on_edges = np.array([tuple(edge @ u) for edge in edges.edges() for u in np.linspace(0, 1, 9)])
    assert np.linalg.norm(curve.point(curve.nearest(on_edges)) - on_edges, axis=1).max() < 1e-13 * rim.length


@given(seed=SEEDS)
def test_edges_in_any_order_and_direction_form_the_loop(seed):
    rng = np.random.default_rng(seed)
    edges = list(cad.RectangleRounded(4, 2, 0.5).edges())
    mixed = [edges[k] if rng.random() < 0.5 else cad.Edge(edges[k].wrapped.Reversed()) for k in rng.permutation(8)]
    (rim,) = to_rims(mixed)
    assert (rim.edges, rim.kind, rim.corners) == (8, "edges", ())
    assert rim.length == pytest.approx(8 + np.pi)
    first = mixed[0]
    np.testing.assert_allclose(rim.point(np.zeros(1))[0], tuple(first @ 0), atol=1e-14)
    tangent = rim.derivative(np.zeros(1))[0] / rim.length
    np.testing.assert_allclose(tangent, tuple(first % 0), atol=1e-9)  # the direction of the first edge


def test_several_wires_are_several_curves_in_their_order():
    wires = [cad.Wire.make_circle(radius).move(cad.Location((0, 0, radius))) for radius in (1, 3, 2)]
    for shape in (wires, cad.Compound(wires)):
        assert [rim.length for rim in to_rims(shape)] == pytest.approx([2 * np.pi, 6 * np.pi, 4 * np.pi])
        (longest,) = to_rims(shape, 0)
        assert longest.length == pytest.approx(6 * np.pi)
    with pytest.raises(LoopIndexError, match="loop 3 does not exist, there are 3"):
        to_rims(wires, 3)


def triangle_with_edges_given_twice():
    first, second, third = polyline((0, 0, 0), (1, 0, 0), (0, 1, 0))
    return [first, second, third, cad.Compound([second, third]), cad.Edge(first.wrapped.Reversed())]


@pytest.mark.parametrize(
    ("made", "edges"),
    [
        # an edge given twice counts once
        (triangle_with_edges_given_twice, 3),
        # one that is shorter than its tolerance is left out
        (lambda: polyline((0, 0, 0), (1, 0, 0), (1 + 5e-7, 0, 0), (1, 1, 0)), 3),
        # edges without faces come before faces
        (lambda: cad.Compound([cad.Box(1, 1, 1), cad.Wire.make_circle(3)]), 1),
    ],
)
def test_edges_that_count(made, edges):
    (rim,) = to_rims(made())
    assert (rim.kind, rim.edges) == ("edges", edges)


def test_small_gaps_are_closed_and_reported():
    """Ends 1e-6 apart, half of the limit of 1e-6 of the size: each moves by half of it, and straight sides stay so."""
    edges = polyline((0, 0, 0), (2, 0, 0), (2, 2, 0))
    edges[1] = cad.Edge.make_line((2, 0, 1e-6), (2, 2, 0))
    (rim,) = to_rims(edges)
    assert rim.gap == pytest.approx(1e-6)
    np.testing.assert_allclose(rim.point(np.array(rim.corners))[1], [2, 0, 5e-7], atol=1e-15)
    assert BoundaryCurve.from_formula(rim).length() == pytest.approx(4 + 2 * np.sqrt(2))


def test_faces_give_their_free_boundary_directed_as_a_hole():
    """A box without its top: a patch over the hole has the normal of the top."""
    faces = cad.Box(1, 2, 3).faces().sort_by(cad.Axis.Z)
    for open_box in (cad.Shell(faces[:-1]), list(faces[:-1])):
        (rim,) = to_rims(open_box)
        assert (rim.kind, rim.edges, len(rim.corners)) == ("free boundary", 4, 4)
        points = rim.point(np.array(rim.corners))
        np.testing.assert_allclose(points[:, 2], 1.5)
        assert np.cross(points[1] - points[0], points[2] - points[1])[2] > 0


def test_one_of_several_free_boundaries_is_chosen_by_its_number():
    tube = cad.Shell([face for face in cad.Cone(2, 1, 2).faces() if face.geom_type == cad.GeomType.CONE])
    with pytest.raises(OptionError, match="2 free boundaries"):
        to_rims(tube)
    assert [to_rims(tube, number)[0].length for number in (0, 1)] == pytest.approx([4 * np.pi, 2 * np.pi])


BAD = {
    "open": (
        lambda: polyline((0, 0, 0), (1, 0, 0), (1, 1, 0))[:2],
        OpenWireError,
        r"\(0.0, 0.0, 0.0\).*are 1.41 apart",
    ),
    "gap": (
        lambda: [*polyline((0, 0, 0), (1, 0, 0), (1, 1, 0))[:2], cad.Edge.make_line((1, 1, 0), (0, 0.01, 0))],
        OpenWireError,
        "are 0.01 apart",
    ),
    "branching": (
        lambda: [*polyline((0, 0, 0), (1, 0, 0), (1, 1, 0)), cad.Edge.make_line((1, 1, 0), (2, 2, 0))],
        BranchingEdgesError,
        r"3 ends of edges meet at \(1.0, 1.0, 0.0\)",
    ),
    "closed": (lambda: cad.Box(1, 1, 1), NoEdgesError, "without a free boundary"),
    "vertex": (lambda: cad.Vertex(1, 2, 3), NoEdgesError, "no edges and no faces"),
    "nothing": (lambda: cad.Compound([]), NoEdgesError, "no edges and no faces"),
    "mixed list": (lambda: [cad.Edge.make_circle(1), 3], ArgumentTypeError, "not a list with a int"),
    "no shape": (lambda: cad.Plane.XY, ArgumentTypeError, "not Plane"),
}


@pytest.mark.parametrize(("made", "error", "message"), BAD.values(), ids=BAD)
def test_bad_input_is_one_sentence(made, error, message):
    with pytest.raises(error, match=message) as caught:
        to_rims(made())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".step", ".igs", ".brep"])
def test_files_give_the_edges_that_were_written(suffix, tmp_path):
    write_shape(cad.Compound([seam(40), cad.Wire.make_circle(5)]).wrapped, tmp_path / f"frame{suffix}")
    rims = to_rims(tmp_path / f"frame{suffix}")
    assert sorted(rim.edges for rim in rims) == [1, 1]
    (written,) = to_rims(seam(40))
    # a spline in an IGES file is rounded
    assert min(rim.length for rim in rims) == pytest.approx(written.length, rel=1e-9 if suffix == ".igs" else 1e-12)


def test_step_files_in_metres_are_read_in_millimetres(tmp_path):
    write_shape(cad.Wire.make_circle(1).wrapped, tmp_path / "mm.step")
    text = (tmp_path / "mm.step").read_text()
    assert ".MILLI.,.METRE." in text
    (tmp_path / "m.step").write_text(text.replace(".MILLI.,.METRE.", "$,.METRE."))
    (rim,) = to_rims(str(tmp_path / "m.step"))
    assert rim.length == pytest.approx(2000 * np.pi, rel=1e-12)
