"""Frames of membranes in JSON files."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from spinor_geom.errors import MeshFileError, OptionError, SpinorGeomError
from spinor_geom.membrane.cables import Cable, Ring, Stay, SymmetryPlane
from spinor_geom.membrane.frame import Edge
from spinor_geom.mesh.open_curve import OpenCurve

_LARGEST = 1e100  # number: squares and cubes of larger ones overflow

# of each kind: the edge as a function of its points and other keys, the number of points (0 for any), the other keys
_KINDS: dict[str, tuple[Callable[..., Edge], int, set[str]]] = {
    "cable": (lambda points, **rest: Cable(start=points[0], end=points[1], **rest), 2, {"tension", "length"}),
    "stay": (lambda points, **rest: Stay(start=points[0], end=points[1], **rest), 2, {"tension", "length"}),
    "fixed": (lambda points: OpenCurve(points, corners=()), 0, set()),
    "ring": (lambda points, **rest: Ring(points=points, **rest), 0, {"force"}),
    "symmetric": (lambda points: SymmetryPlane(point=points[0], normal=points[1]), 2, set()),
}


def read_frame(path: str | os.PathLike[str]) -> list[Edge]:
    """The edges of a JSON file, for `solve_membrane`.

    Raises a MeshFileError that names the edge and the key if the file is no frame, and an OSError if it cannot be read.
    """
    name = os.fspath(path)
    try:
        content = json.loads(Path(path).read_bytes())
    except (ValueError, RecursionError) as error:
        raise MeshFileError(f"{name}: is no JSON file ({error})", path=path) from error
    if not isinstance(content, dict) or content.keys() != {"edges"} or not isinstance(content["edges"], list):
        raise MeshFileError(f"{name}: must be an object with the only key 'edges', a list", path=path)
    return [_edge(given, f"{name}: edge {number}", path) for number, given in enumerate(content["edges"])]


def _edge(given: Any, place: str, path: str | os.PathLike[str]) -> Edge:
    """An edge. Raises a MeshFileError that names the key that is wrong."""
    try:
        return _parsed(given)
    except SpinorGeomError as error:
        raise MeshFileError(f"{place}: {error}", path=path) from error


def _parsed(given: Any) -> Edge:
    kinds = [key for key in _KINDS if isinstance(given, dict) and key in given]
    if len(kinds) != 1:
        raise OptionError(f"must be an object with one of the keys {', '.join(map(repr, _KINDS))}")
    (kind,) = kinds
    make, count, keys = _KINDS[kind]
    rest = {key: value for key, value in given.items() if key != kind}
    for key, value in rest.items():
        if key not in keys:
            raise OptionError(f"the key {key!r} is unknown beside {kind!r}")
        if not _is_number(value):
            raise OptionError(f"{key!r} must be a number, got {value!r}")
    rows = given[kind]
    is_list = isinstance(rows, list) and (len(rows) == count if count else len(rows) >= 2)
    if not is_list or not all(isinstance(row, list) and len(row) == 3 and all(map(_is_number, row)) for row in rows):
        what = "a point and a normal" if kind == "symmetric" else "two points" if count else "two points or more"
        raise OptionError(f"{kind!r} must be {what}, each a list of three numbers of at most {_LARGEST:g}")
    return make(np.array(rows, dtype=np.float64), **rest)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST
