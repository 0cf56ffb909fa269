"""Shells of spline surfaces as shapes and files of Open CASCADE, the kernel of CadQuery, build123d and FreeCAD."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.cad_edges import outer_parts, parts_of
from spinor_geom.errors import CadFileError, OptionError, require
from spinor_geom.files import atomic_path
from spinor_geom.mesh.rational_splines import NurbsCurve, NurbsPatch

Unit = Literal["mm", "cm", "m", "in"]
_MILLIMETRES: dict[Unit, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
STEP, IGES, BREP = (".step", ".stp"), (".igs", ".iges"), (".brep",)
CAD_SUFFIXES = (*STEP, *IGES, *BREP)
# In Open CASCADE points at most 1e-7 apart are equal, in any unit. Edges must be much longer
_LEAST_EDGE = 1e-4
_DEFLECTION = 1e-3, True, 0.2  # of triangles: distance, which is relative to edges, and angle
_PRODUCT_NAME = "write.step.product.name"
_NETS = "Array2_gp_Pnt", "Array2_double"  # of points and weights


def is_cad_file(what: Any) -> bool:
    """Whether an argument is the path of a CAD file, by its suffix."""
    return isinstance(what, (str, os.PathLike)) and Path(what).suffix.lower() in CAD_SUFFIXES


def require_cad_suffix(path: str | os.PathLike[str]) -> str:
    """The suffix of a CAD file in lower case.

    Raises a CadFileError if it is unknown, and a MissingPackageError if OCP is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in CAD_SUFFIXES:
        known = ", ".join(CAD_SUFFIXES)
        raise CadFileError(
            f"{os.fspath(path)}: '{Path(path).suffix}' is not a CAD format; use one of {known}; "
            "PlateauSolution.save and 'spinor-geom solve' also write meshes, such as .stl"
        )
    require("OCP", extra="cad")
    return suffix


def sewn_shell(patches: Iterable[NurbsPatch], *, unit: Unit = "mm") -> Any:
    """A `TopoDS_Shape` in millimetres, the shell of patches that are sewn along equal sides. `unit` is theirs.

    Raises an OptionError for an unknown unit, a CadFileError if sides are too short for Open CASCADE or the patches do
    not form one shell, and a MissingPackageError if OCP is not installed.
    """
    require("OCP", extra="cad")
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_Sewing
    from OCP.TopAbs import TopAbs_FACE, TopAbs_SHELL

    nets = [(patch, _millimetres(unit) * patch.control_points) for patch in patches]
    _require_long(min(_shortest_side(points) for _, points in nets))
    sewing = BRepBuilderAPI_Sewing(_LEAST_EDGE / 100)
    faces = [BRepBuilderAPI_MakeFace(_spline_surface(patch, points), 1e-7).Face() for patch, points in nets]
    for face in faces:
        sewing.Add(face)
    sewing.Perform()
    sewn = sewing.SewedShape()
    if sewn.ShapeType() == TopAbs_SHELL:
        return sewn
    if sewn.ShapeType() != TopAbs_FACE:
        raise CadFileError("the patches do not form one shell: sides that should be shared differ")
    return _shell_of(sewn)


def plane_shell(rims: Sequence[Sequence[NurbsCurve]], normal: Float[np.ndarray, "3"], *, unit: Unit = "mm") -> Any:
    """A shell of one plane face in millimetres, on the left of closed rims seen from the tip of its normal.

    The first rim encloses the others. Raises as `sewn_shell`.
    """
    require("OCP", extra="cad")
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeWire
    from OCP.gp import gp_Dir, gp_Pln, gp_Pnt

    size = _millimetres(unit)
    scaled = [[replace(curve, control_points=size * curve.control_points) for curve in rim] for rim in rims]
    _require_long(min(_length(curve.control_points) for rim in scaled for curve in rim))
    wires = []
    for rim in scaled:
        wire = BRepBuilderAPI_MakeWire()
        for curve in rim:
            wire.Add(spline_edge(curve))
        wires.append(wire.Wire())
    plane = gp_Pln(gp_Pnt(*scaled[0][0].control_points[0].tolist()), gp_Dir(*normal.tolist()))
    face = BRepBuilderAPI_MakeFace(plane, wires[0])
    for wire in wires[1:]:
        face.Add(wire)
    return _shell_of(face.Face())


def _shell_of(face: Any) -> Any:
    from OCP.BRep import BRep_Builder
    from OCP.TopoDS import TopoDS_Shell

    shell, builder = TopoDS_Shell(), BRep_Builder()
    builder.MakeShell(shell)
    builder.Add(shell, face)
    return shell


def _millimetres(unit: Unit) -> float:
    if unit not in _MILLIMETRES:
        raise OptionError(f"unit must be one of {', '.join(get_args(Unit))}, not {unit!r}")
    return _MILLIMETRES[unit]


def _require_long(shortest: float) -> None:
    if not shortest > _LEAST_EDGE:
        raise CadFileError(
            f"a side of {shortest:.1e} mm is too short for CAD, where sides must be longer than {_LEAST_EDGE:.0e} mm; "
            "scale the curve, or give its unit"
        )


def spline_edge(spline: NurbsCurve) -> Any:
    """A `TopoDS_Edge` of a spline in millimetres."""
    require("OCP", extra="cad")
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
    from OCP.Geom import Geom_BSplineCurve
    from OCP.gp import gp_Pnt

    poles = _array_type("Array1_gp_Pnt")(1, len(spline.control_points))
    for i, point in enumerate(spline.control_points.tolist(), 1):
        poles.SetValue(i, gp_Pnt(*point))
    values, counts = np.unique(spline.knots, return_counts=True)
    weights, knots = _array("Array1_double", spline.weights), _array("Array1_double", values)
    curve = Geom_BSplineCurve(poles, weights, knots, _array("Array1_int", counts), spline.degree)
    return BRepBuilderAPI_MakeEdge(curve).Edge()


def write_shape(shape: Any, path: str | os.PathLike[str], *, name: str = "minimal surface") -> None:
    """Writes a `TopoDS_Shape` in millimetres to a STEP, IGES or BREP file, completely or not at all.

    The suffix selects the format. `name` is that of the part in a STEP file. Raises a CadFileError for an unknown
    suffix or a shape that cannot be translated, a MissingPackageError without OCP, and an OSError.
    """
    suffix = require_cad_suffix(path)
    from OCP.BRepTools import BRepTools
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.IGESControl import IGESControl_Writer
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

    with atomic_path(path) as temporary, _product_name(name), _silent():
        target = str(temporary)
        if suffix in STEP:
            step = STEPControl_Writer()
            done = step.Transfer(shape, STEPControl_AsIs) == IFSelect_RetDone and step.Write(target) == IFSelect_RetDone
        elif suffix in IGES:
            iges = IGESControl_Writer("MM", 1)  # 1: shells and faces as such, not as loose trimmed surfaces
            done = iges.AddShape(shape) and iges.Write(target)
        else:
            done = BRepTools.Write_s(shape, target)
        if not done:
            raise CadFileError(f"{os.fspath(path)}: Open CASCADE cannot write the shape")


def read_shape(path: str | os.PathLike[str]) -> Any:
    """The shape of a STEP, IGES or BREP file, a `TopoDS_Shape` in millimetres.

    Raises a CadFileError for an unknown suffix, a missing or malformed file, or one without shapes, and a
    MissingPackageError without OCP.
    """
    suffix = _require_cad_file(path)
    from OCP.BRep import BRep_Builder
    from OCP.BRepTools import BRepTools
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.IGESControl import IGESControl_Reader
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopoDS import TopoDS_Shape

    with _silent():
        if suffix in BREP:
            shape = TopoDS_Shape()
            done = BRepTools.Read_s(shape, os.fspath(path), BRep_Builder())
        else:
            reader = STEPControl_Reader() if suffix in STEP else IGESControl_Reader()
            done = reader.ReadFile(os.fspath(path)) == IFSelect_RetDone
            if done:
                reader.TransferRoots()
                shape = reader.OneShape()
    if not done or shape.IsNull():
        raise _unreadable(path)
    return shape


def _require_cad_file(path: str | os.PathLike[str]) -> str:
    """The suffix of an existing CAD file. Raises as `read_shape`."""
    suffix = require_cad_suffix(path)
    if not Path(path).is_file():
        raise CadFileError(f"{os.fspath(path)}: there is no such file; check the name")
    return suffix


def _unreadable(path: str | os.PathLike[str]) -> CadFileError:
    return CadFileError(f"{os.fspath(path)}: has no shape that Open CASCADE can read; check the file")


def named_parts(path: str | os.PathLike[str]) -> list[tuple[tuple[str, ...], Any]]:
    """The `outer_parts` of the shapes of a STEP file in millimetres, each after its names.

    These are its own name, then those of the parts and assemblies that contain it, the innermost first. Raises as
    `read_shape`.
    """
    _require_cad_file(path)
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDocStd import TDocStd_Document
    from OCP.TopLoc import TopLoc_Location
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    document, reader = TDocStd_Document(TCollection_ExtendedString("XmlXCAF")), STEPCAFControl_Reader()
    with _silent():
        done = reader.ReadFile(os.fspath(path)) == IFSelect_RetDone and reader.Transfer(document)
    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    roots = [label for label in _children(tool.Label()) if tool.IsFree_s(label)]
    if not done or not roots:
        raise _unreadable(path)
    transfer = reader.ChangeReader().WS().TransferReader()
    # not lazily: labels end with their document
    return [part for label in roots for part in _parts_of_label(label, transfer, (), TopLoc_Location())]


def _parts_of_label(
    label: Any, transfer: Any, names: tuple[str, ...], place: Any
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The `named_parts` of a shape of a document, moved to a place."""
    from OCP.StepRepr import StepRepr_RepresentationItem
    from OCP.TDF import TDF_Label
    from OCP.XCAFDoc import XCAFDoc_ShapeTool as Tool

    names = (*_names(label), *names)
    if Tool.IsReference_s(label):
        referred = TDF_Label()
        Tool.GetReferredShape_s(label, referred)
        yield from _parts_of_label(referred, transfer, names, place.Multiplied(Tool.GetLocation_s(label)))
        return
    for component in filter(Tool.IsComponent_s, _children(label)):
        yield from _parts_of_label(component, transfer, names, place)
    if not Tool.IsAssembly_s(label):
        for part in outer_parts(Tool.GetShape_s(label)):
            entity = transfer.EntityFromShapeResult(part, 1)
            name = entity.Name() if isinstance(entity, StepRepr_RepresentationItem) else None
            own = () if name is None else (name.ToCString(),)  # $ is no name
            yield (*own, *names), part.Moved(place)


def _names(label: Any) -> tuple[str, ...]:
    """The name of a label, if it has one."""
    from OCP.TDataStd import TDataStd_Name

    name = TDataStd_Name()
    return (name.Get().ToExtString(),) if label.FindAttribute(TDataStd_Name.GetID_s(), name) else ()


def _children(label: Any) -> Iterator[Any]:
    from OCP.TDF import TDF_ChildIterator

    children = TDF_ChildIterator(label)
    while children.More():
        yield children.Value()
        children.Next()


def triangulated(shape: Any) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Triangles of the faces of a shape, in millimetres. Each face has vertices of its own.

    They deviate from the faces by at most a thousandth of the edges of these, and by 0.2 radian. Raises a CadFileError
    for a shape without faces.
    """
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.TopAbs import TopAbs_REVERSED
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    BRepMesh_IncrementalMesh(shape, *_DEFLECTION)
    vertices: list[tuple[float, float, float]] = []
    faces: list[list[int]] = []
    for found in parts_of(shape, "FACE"):
        face, place, start = TopoDS.Face(found), TopLoc_Location(), len(vertices)
        part = BRep_Tool.Triangulation_s(face, place)
        nodes, count = (part.NbNodes(), part.NbTriangles()) if part else (0, 0)
        points = (part.Node(number + 1).Transformed(place.Transformation()) for number in range(nodes))
        vertices += [(point.X(), point.Y(), point.Z()) for point in points]
        order = -1 if face.Orientation() == TopAbs_REVERSED else 1
        corners = (part.Triangle(number + 1).Get()[::order] for number in range(count))
        faces += [[start + corner - 1 for corner in three] for three in corners]
    if not faces:
        raise CadFileError("the CAD file has no faces to draw; 'spinor-geom solve' spans its edges by a surface")
    return np.array(vertices), np.array(faces)


@contextmanager
def _product_name(name: str) -> Iterator[None]:
    """Sets the name of the part in STEP files, a global parameter of Open CASCADE, while the context is open."""
    from OCP.Interface import Interface_Static
    from OCP.STEPControl import STEPControl_Controller

    STEPControl_Controller.Init_s()  # defines the parameter
    before = Interface_Static.CVal_s(_PRODUCT_NAME)
    Interface_Static.SetCVal_s(_PRODUCT_NAME, name)
    try:
        yield
    finally:
        Interface_Static.SetCVal_s(_PRODUCT_NAME, before)


@contextmanager
def _silent() -> Iterator[None]:
    """Keeps Open CASCADE from printing while the context is open."""
    from OCP.Message import Message

    messenger = Message.DefaultMessenger_s()
    printers = list(messenger.Printers())
    for printer in printers:
        messenger.RemovePrinter(printer)
    try:
        yield
    finally:
        for printer in printers:
            messenger.AddPrinter(printer)


def _shortest_side(points: Float[np.ndarray, "n m 3"]) -> float:
    """Length of the shortest control polygon of a side that does not lie in a point."""
    sides = (points[0], points[-1], points[:, 0], points[:, -1])
    return min(length for length in map(_length, sides) if length > 0)


def _length(points: Float[np.ndarray, "n 3"]) -> float:
    """Length of a polygon."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _spline_surface(patch: NurbsPatch, points: Float[np.ndarray, "n m 3"]) -> Any:
    """A `Geom_BSplineSurface`."""
    from OCP.Geom import Geom_BSplineSurface
    from OCP.gp import gp_Pnt

    poles, weights = (_array_type(name)(1, points.shape[0], 1, points.shape[1]) for name in _NETS)
    for i, j in np.ndindex(points.shape[:2]):
        poles.SetValue(i + 1, j + 1, gp_Pnt(*points[i, j].tolist()))
        weights.SetValue(i + 1, j + 1, float(patch.weights[i, j]))
    values, counts = zip(*(np.unique(knots, return_counts=True) for knots in patch.knots), strict=True)
    knots = [_array("Array1_double", each) for each in values]
    multiplicities = [_array("Array1_int", each) for each in counts]
    return Geom_BSplineSurface(poles, weights, *knots, *multiplicities, *patch.degrees)


def _array(name: str, values: np.ndarray) -> Any:
    array = _array_type(name)(1, len(values))
    for i, value in enumerate(values.tolist(), 1):
        array.SetValue(i, value)
    return array


def _array_type(name: str) -> Any:
    """A class of `OCP.collections`, or of the modules that had it before Open CASCADE 8."""
    try:
        return getattr(importlib.import_module("OCP.collections"), name)
    except ModuleNotFoundError:
        module, old = {
            "Array1_gp_Pnt": ("TColgp", "TColgp_Array1OfPnt"),
            "Array2_gp_Pnt": ("TColgp", "TColgp_Array2OfPnt"),
            "Array2_double": ("TColStd", "TColStd_Array2OfReal"),
            "Array1_double": ("TColStd", "TColStd_Array1OfReal"),
            "Array1_int": ("TColStd", "TColStd_Array1OfInteger"),
        }[name]
        return getattr(importlib.import_module(f"OCP.{module}"), old)
