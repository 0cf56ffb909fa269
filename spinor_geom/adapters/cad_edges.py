"""The edges of shapes of Open CASCADE that bound a surface, as rational B-splines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from spinor_geom.errors import NoEdgesError
from spinor_geom.mesh.rational_splines import NurbsCurve

EdgeKind: TypeAlias = Literal["edges", "free boundary"]
_SEWING = 1e-6  # Open CASCADE's default: largest distance between edges of two faces that are joined, in model units


@dataclass(frozen=True, kw_only=True, eq=False)
class CadEdge:
    """An edge of a CAD model."""

    spline: NurbsCurve  # its curve, exactly, from its first vertex to its last one
    tolerance: float  # the largest of its vertices, in units of the model


def free_edges(shapes: Sequence[Any]) -> tuple[EdgeKind, list[CadEdge]]:
    """The edges of `TopoDS_Shape`s that belong to no face, all of one degree, or else the free boundary of the faces.

    Edges of a free boundary have the direction of the boundary of a patch that continues the faces. Raises a
    NoEdgesError if there are none.
    """
    kind: EdgeKind = "edges"
    loose = {hash(edge): edge for shape in shapes for edge in parts_of(shape, "EDGE", outside="FACE")}
    found = [*loose.values()]
    if not found:
        kind, found = "free boundary", _free_boundary(shapes)
    if not found:
        has_faces = any(True for shape in shapes for _ in parts_of(shape, "FACE"))
        raise NoEdgesError(
            what="faces without a free boundary: they enclose a solid" if has_faces else "no edges and no faces"
        )
    return kind, edges_of(found)


def parts_of(shape: Any, kind: str, outside: str = "SHAPE") -> Iterator[Any]:
    """The parts of a shape of a kind such as "EDGE", without those in parts of another kind."""
    from OCP import TopAbs
    from OCP.TopExp import TopExp_Explorer

    explorer = TopExp_Explorer(shape, getattr(TopAbs, f"TopAbs_{kind}"), getattr(TopAbs, f"TopAbs_{outside}"))
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


def outer_parts(shape: Any) -> list[Any]:
    """The faces of a shape, then its edges that belong to no face, each once."""
    parts = (*parts_of(shape, "FACE"), *parts_of(shape, "EDGE", outside="FACE"))
    return [*{hash(part): part for part in parts}.values()]


def are_plane(faces: Iterable[Any]) -> bool:
    """Whether each of some faces is plane, within the distance at which edges are joined."""
    from OCP.BRep import BRep_Tool
    from OCP.GeomLib import GeomLib_IsPlanarSurface
    from OCP.TopoDS import TopoDS

    return all(GeomLib_IsPlanarSurface(BRep_Tool.Surface_s(TopoDS.Face(face)), _SEWING).IsPlanar() for face in faces)


def _free_boundary(shapes: Iterable[Any]) -> list[Any]:
    """The edges that belong to one face only, after equal edges of different faces were identified."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Sewing

    sewing = BRepBuilderAPI_Sewing(_SEWING)
    for shape in shapes:
        sewing.Add(shape)
    sewing.Perform()
    return [edge.Reversed() for _, edge in used_once(sewing.SewedShape())]


def used_once(shape: Any) -> list[tuple[Any, Any]]:
    """Pairs of a face and an edge that occurs only once in the faces of a shape."""
    uses = [(face, edge) for face in parts_of(shape, "FACE") for edge in parts_of(face, "EDGE")]
    count = Counter(hash(edge) for _, edge in uses)  # a hash is that of the edge in both directions
    return [(face, edge) for face, edge in uses if count[hash(edge)] == 1]


def edges_of(edges: Iterable[Any]) -> list[CadEdge]:
    """Edges of shapes as splines of the highest degree of all, without degenerate ones, as at the apex of a cone."""
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_REVERSED
    from OCP.TopoDS import TopoDS

    made = []
    for shape in edges:
        edge = TopoDS.Edge(shape)
        if not BRep_Tool.Degenerated_s(edge):
            tolerance = max(BRep_Tool.Tolerance_s(TopoDS.Vertex(end)) for end in parts_of(edge, "VERTEX"))
            made.append((_spline_of(edge), edge.Orientation() == TopAbs_REVERSED, tolerance))
    degree = max((curve.Degree() for curve, _, _ in made), default=0)
    found = []
    for curve, is_reversed, tolerance in made:
        curve.IncreaseDegree(degree)
        spline = _as_arrays(curve)
        found.append(CadEdge(spline=spline.reversed() if is_reversed else spline, tolerance=tolerance))
    return found


def _spline_of(edge: Any) -> Any:
    """The curve of an edge as a `Geom_BSplineCurve` of its own."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepLib import BRepLib
    from OCP.Geom import Geom_TrimmedCurve
    from OCP.GeomConvert import GeomConvert

    BRepLib.BuildCurve3d_s(edge)  # of an edge that has only a curve in the parameters of a face
    first, last = BRep_Tool.Range_s(edge)
    curve = BRep_Tool.Curve_s(edge, first, last)
    spline = GeomConvert.CurveToBSplineCurve_s(Geom_TrimmedCurve(curve, first, last))
    if spline.IsPeriodic():
        spline.SetNotPeriodic()
    return spline


def _as_arrays(curve: Any) -> NurbsCurve:
    knots = np.array([curve.Knot(i) for i in range(1, curve.NbKnots() + 1)])
    repeats = [curve.Multiplicity(i) for i in range(1, curve.NbKnots() + 1)]
    poles = [curve.Pole(i) for i in range(1, curve.NbPoles() + 1)]
    return NurbsCurve(
        knots=np.repeat((knots - knots[0]) / (knots[-1] - knots[0]), repeats),
        control_points=np.array([[pole.X(), pole.Y(), pole.Z()] for pole in poles]),
        weights=np.array([curve.Weight(i) for i in range(1, curve.NbPoles() + 1)]),
    )
