"""Measurements of shapes by Open CASCADE itself."""

import numpy as np


def area_of(shape):
    """In squared millimetres."""
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(shape, properties, 1e-12)
    return float(properties.Mass())


def is_valid(shape):
    from OCP.BRepCheck import BRepCheck_Analyzer

    return bool(BRepCheck_Analyzer(shape).IsValid())


def count(shape, kind):
    """Number of faces, shells, wires or edges; shared edges count once for each face."""
    from OCP import TopAbs
    from OCP.TopExp import TopExp_Explorer

    explorer, found = TopExp_Explorer(shape, getattr(TopAbs, f"TopAbs_{kind.upper()}")), 0
    while explorer.More():
        found += 1
        explorer.Next()
    return found


def free_wires(shape):
    """Numbers of closed and open wires of free edges, and of the edges of the closed ones."""
    from OCP.ShapeAnalysis import ShapeAnalysis_FreeBounds

    bounds = ShapeAnalysis_FreeBounds(shape)
    closed, opened = bounds.GetClosedWires(), bounds.GetOpenWires()
    return count(closed, "wire"), 0 if opened.IsNull() else count(opened, "wire"), count(closed, "edge")


def distances(shape, points):
    """Distances of points from a shape."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeVertex
    from OCP.BRepExtrema import BRepExtrema_DistShapeShape
    from OCP.gp import gp_Pnt

    vertices = [BRepBuilderAPI_MakeVertex(gp_Pnt(*point)).Vertex() for point in points.tolist()]
    return np.array([BRepExtrema_DistShapeShape(vertex, shape).Value() for vertex in vertices])


def free_boundary(shape):
    """The wires of free edges."""
    from OCP.ShapeAnalysis import ShapeAnalysis_FreeBounds

    return ShapeAnalysis_FreeBounds(shape).GetClosedWires()
