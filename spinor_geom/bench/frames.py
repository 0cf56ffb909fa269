"""Frames of CAD edges with known areas, and methods that span them: ours, and Open CASCADE's own filling."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline

from spinor_geom.adapters import to_rims
from spinor_geom.adapters.cad_edges import parts_of, used_once
from spinor_geom.adapters.open_cascade import read_shape, spline_edge, write_shape
from spinor_geom.bench.cases import Case
from spinor_geom.bench.fillers import Tool
from spinor_geom.bench.machine import Record
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.mesh.rational_splines import NurbsCurve
from spinor_geom.plateau.solve import solve_plateau

FRAMES = ("enneper-0.8", "tennis-seam", "twisted-circle", "schwarz-d-quad", "schwarz-d-hexagon", "plane-l")
"""Known cases whose rims are exactly splines: trigonometric polynomials of degree 3, and polygons."""
CAD = "spinor-cad"  # our method
_DEGREE, _ARCS = 3, 4  # of the trigonometric polynomials, and the edges of each
_RIM_SAMPLES = 100  # of each edge
_AREA_ERROR = 1e-12  # relative, of Open CASCADE's quadrature


def _solved(edges: Sequence[Any]) -> Any:
    (rim,) = to_rims(list(edges))
    return solve_plateau(rim, tolerance=1e-6).to_nurbs().shell()


def _filled(options: Mapping[str, float], edges: Sequence[Any]) -> Any:
    from OCP.BRepOffsetAPI import BRepOffsetAPI_MakeFilling
    from OCP.GeomAbs import GeomAbs_C0

    filling = BRepOffsetAPI_MakeFilling(**options)
    for edge in edges:
        filling.Add(edge, GeomAbs_C0)
    filling.Build()
    return filling.Shape()


_FINE = {"Degree": 5, "NbPtsOnCur": 40, "NbIter": 5, "MaxDeg": 14, "MaxSegments": 30, "Tol3d": 1e-6}
FRAME_METHODS: Mapping[str, Tool[Callable[[Sequence[Any]], Any]]] = {
    CAD: Tool("spinor_geom", "solve_plateau(edges, tolerance=1e-6), to_nurbs with its defaults", _solved),
    "occ-filling": Tool("OCP", "BRepOffsetAPI_MakeFilling with its defaults", partial(_filled, {})),
    "occ-filling-fine": Tool(
        "OCP", f"the same with {', '.join(f'{k}={v:g}' for k, v in _FINE.items())}", partial(_filled, _FINE)
    ),
}


def frame_edges(case: Case) -> list[Any]:
    """The rim of a known case as `TopoDS_Edge`s, exactly."""
    loop = case.loop(64)
    if not loop.corners.any():
        return [spline_edge(arc) for arc in trigonometric_arcs(loop.points)]
    corners = loop.points[loop.corners]
    line = np.array([0.0, 0.0, 1.0, 1.0])
    sides = pairwise([*corners, corners[0]])
    return [spline_edge(NurbsCurve(control_points=np.array(ends), weights=np.ones(2), knots=line)) for ends in sides]


def trigonometric_arcs(points: Float[np.ndarray, "n 3"]) -> list[NurbsCurve]:
    """The trigonometric polynomial of degree 3 through points at equal steps, as rational Bézier curves of degree 6.

    With t = t₀ + 2 atan u, the products of (1 + u²)³ and the curve are polynomials of degree 6 in u.
    """
    series = np.fft.rfft(points, axis=0)[: _DEGREE + 1] / len(points)
    series[1:] *= 2
    half = np.tan(np.pi / _ARCS / 2)
    degree, share = 2 * _DEGREE, np.linspace(0, 1, 2 * _DEGREE + 1)
    knots, u = np.repeat([0.0, 1.0], degree + 1), half * (2 * share - 1)
    bernstein = BSpline(knots, np.eye(degree + 1), degree)(share)
    weights = np.linalg.solve(bernstein, (1 + u**2) ** _DEGREE)
    arcs = []
    for middle in 2 * np.pi * (np.arange(_ARCS) + 0.5) / _ARCS:
        waves = np.exp(1j * np.arange(_DEGREE + 1) * (middle + 2 * np.arctan(u))[:, None])
        values = (1 + u**2)[:, None] ** _DEGREE * (waves @ series).real
        points = np.linalg.solve(bernstein, values) / weights[:, None]
        arcs.append(NurbsCurve(control_points=points, weights=weights, knots=knots))
    return arcs


def frame_figures(shape: Any, edges: Sequence[Any], case: Case) -> Record:
    """The figures of a shape that spans edges after it was written to a STEP file and read again."""
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "shape.step"
        write_shape(shape, path)
        size, shape = path.stat().st_size, read_shape(path)
    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(shape, properties, _AREA_ERROR)
    (rim,) = to_rims(list(edges))
    assert isinstance(rim, ClosedCurve)
    curve = BoundaryCurve.from_formula(rim)
    points = rim_points(shape)
    away = np.linalg.norm(curve.point(curve.nearest(points)) - points, axis=1)
    return {
        "area": properties.Mass(),
        "area_error": abs(properties.Mass() / case.area - 1),
        "rim_distance": float(away.max()) / case.diameter,
        "faces": sum(1 for _ in parts_of(shape, "FACE")),
        "file_kib": round(size / 1024),
        "valid": bool(BRepCheck_Analyzer(shape).IsValid()),
    }


def rim_points(shape: Any) -> Float[np.ndarray, "n 3"]:
    """Points of the surfaces of a shape on the edges that only one face has."""
    from OCP.BRep import BRep_Tool
    from OCP.TopoDS import TopoDS

    found = []
    for face, edge in used_once(shape):
        face, edge = TopoDS.Face(face), TopoDS.Edge(edge)
        surface, (first, last) = BRep_Tool.Surface_s(face), BRep_Tool.Range_s(edge, face)
        # the edge's own curve may be the given one, from which the surface deviates
        curve = BRep_Tool.CurveOnSurface_s(edge, face, first, last)
        places = [curve.Value(t) for t in np.linspace(first, last, _RIM_SAMPLES).tolist()]
        found += [surface.Value(place.X(), place.Y()) for place in places]
    return np.array([[point.X(), point.Y(), point.Z()] for point in found])
