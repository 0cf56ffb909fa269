"""Shapes of Open CASCADE from objects of CadQuery, build123d and OCP, which are recognised by name, and back."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any, Literal

from spinor_geom.errors import ArgumentTypeError, MissingLibraryError

_LIBRARIES = {"OCP", "cadquery", "build123d"}
_CONTENTS = ("line", "sketch", "part")  # of build123d's builders


def cad_shapes(what: Any, *, function: str) -> list[Any] | None:
    """The `TopoDS_Shape`s of an object of a CAD library, or of a list of such objects, or None for anything else.

    Objects are shapes of OCP, CadQuery and build123d, `Workplane` and `Sketch` of CadQuery, and builders of build123d.
    Raises an ArgumentTypeError, which names the called function, if the object has no shape, or a list also has objects
    of other types.
    """
    if isinstance(what, (list, tuple)):
        are_cad = [_is_cad(one) for one in what]
        if not any(are_cad):
            return None
        if not all(are_cad):
            found = f"a list with a {type(what[are_cad.index(False)]).__name__}"
            raise ArgumentTypeError(function=function, takes="lists of CAD wires and edges only", found=found)
        return [shape for one in what for shape in _shapes_of(one, function)]
    return _shapes_of(what, function) if _is_cad(what) else None


def cad_object(shape: Any, library: Literal["build123d", "cadquery"]) -> Any:
    """A `TopoDS_Shape` as an object of a CAD library, such as its `Shell`. Raises a MissingLibraryError without it."""
    if importlib.util.find_spec(library) is None:
        raise MissingLibraryError(package=library)
    return importlib.import_module(library).Shape.cast(shape)


def _is_cad(what: Any) -> bool:
    return any(cls.__module__.partition(".")[0] in _LIBRARIES for cls in type(what).__mro__)


def _shapes_of(what: Any, function: str) -> list[Any]:
    if any(cls.__name__ == "TopoDS_Shape" for cls in type(what).__mro__):
        return [what]
    if hasattr(what, "wrapped"):
        inner = [what.wrapped]
    elif hasattr(what, "vals"):
        inner = [getattr(value, "wrapped", value) for value in what.vals()]
    else:
        inner = [content.wrapped for name in _CONTENTS if (content := getattr(what, name, None)) is not None]
    shapes = [one for one in inner if any(cls.__name__ == "TopoDS_Shape" for cls in type(one).__mro__)]
    if not shapes:
        raise ArgumentTypeError(
            function=function, takes="wires, edges and shells of a CAD library", found=type(what).__name__
        )
    return shapes
