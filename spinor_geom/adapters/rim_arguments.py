"""Converts arguments that describe closed curves: loops, points, analytic curves, CAD edges, a mesh with a hole."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from spinor_geom.adapters.cad_curves import CadCurve, closed_curves
from spinor_geom.adapters.cad_objects import cad_shapes
from spinor_geom.adapters.open_cascade import is_cad_file, read_shape
from spinor_geom.adapters.registry import to_mesh
from spinor_geom.errors import LoopIndexError, OptionError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.triangle_mesh import require_faces

Rim: TypeAlias = BoundaryLoop | ClosedCurve


def to_rims(what: Any, loop: int | None = None) -> list[Rim]:
    """The closed curves that an argument describes.

    The argument is one of these:

    - a loop, an analytic curve, (m, 3) points of a closed curve, or a sequence of these,
    - a mesh of any supported type or the path of a mesh file: one of its loops,
    - shapes of a CAD library or the path of a CAD file: all wires, or one free boundary of faces.

    `loop` is the index in `boundary_loops(mesh)`, or of the curve of CAD edges, the longest first. It may be None if a
    mesh or CAD faces have only one.

    Raises an OptionError if `loop` is missing for several loops or given for a curve, a LoopIndexError if there is no
    such loop, and the errors of `BoundaryLoop.from_points`, `closed_curves`, `boundary_loops` and `read_shape`.
    """
    shapes = [read_shape(what)] if is_cad_file(what) else cad_shapes(what, function="solve_plateau")
    if shapes is not None:
        return _of_cad(closed_curves(shapes), loop)
    if is_mesh(what):
        return [_loop_of_mesh(what, loop)]
    if loop is not None:
        raise OptionError("loop selects a boundary loop of a mesh, but a curve was given; remove loop=")
    if isinstance(what, (BoundaryLoop, ClosedCurve)):
        return [what]
    if not isinstance(what, np.ndarray) and all(isinstance(one, Rim) or np.ndim(one) == 2 for one in what):
        return [one if isinstance(one, Rim) else BoundaryLoop.from_points(one) for one in what]
    return [BoundaryLoop.from_points(what)]


def is_mesh(what: Any) -> bool:
    """Whether an argument is a mesh, and not one or several curves.

    Two arrays are the vertices and faces of a mesh if the second has integers, else two curves. An object that is a
    sequence of points, such as a polyline of COMPAS, is a curve.
    """
    if isinstance(what, (list, tuple)):
        kind = str(getattr(what[1], "dtype", "")) if len(what) == 2 else ""
        return kind.rpartition(".")[2].startswith(("int", "uint"))
    return not isinstance(what, (BoundaryLoop, ClosedCurve, np.ndarray)) and np.ndim(what) != 2


def _loop_of_mesh(what: Any, loop: int | None) -> BoundaryLoop:
    mesh = to_mesh(what)
    require_faces(mesh)
    loops = find_boundary_loops(mesh)
    if loop is None and len(loops) != 1:
        raise OptionError(f"the mesh has {len(loops)} boundary loops, not one; give one of boundary_loops(mesh)")
    place = 0 if loop is None else loop
    if not 0 <= place < len(loops):
        raise LoopIndexError(index=place, loops=len(loops))
    return loops[place]


def _of_cad(curves: list[CadCurve], loop: int | None) -> list[Rim]:
    """The curve of a number, the longest first, or without one all wires or the only free boundary."""
    if loop is not None:
        if not 0 <= loop < len(curves):
            raise LoopIndexError(index=loop, loops=len(curves))
        return [sorted(curves, key=lambda curve: -curve.length)[loop]]
    if len(curves) > 1 and curves[0].kind == "free boundary":
        raise OptionError(f"the faces have {len(curves)} free boundaries; give the wires of one or more of them")
    return [*curves]
