"""Frames of membranes in JSON files, in STEP files, and as shapes of CAD libraries."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from spinor_geom.adapters.cad_curves import JoinedSplines, closed_curves
from spinor_geom.adapters.cad_edges import are_plane, edges_of, outer_parts, parts_of
from spinor_geom.adapters.cad_objects import cad_shapes
from spinor_geom.adapters.open_cascade import STEP, named_parts
from spinor_geom.errors import MeshFileError, OptionError, SpinorGeomError
from spinor_geom.files import regular_file
from spinor_geom.membrane.cables import Cable, Edge, Ring, Stay, SymmetryPlane
from spinor_geom.mesh.open_curve import OpenCurve
from spinor_geom.mesh.rational_splines import NurbsCurve

_LARGEST = 1e100  # number: squares and cubes of larger ones overflow
_SAMPLES = 64  # steps along a curved edge of CAD
_FLAT = 1e-6  # largest distance of the points of CAD from their plane of symmetry, relative to their extent

# of each kind: the edge as a function of its points and other keys, the number of points (0 for any), the other keys
_KINDS: dict[str, tuple[Callable[..., Edge], int, tuple[str, ...]]] = {
    "cable": (lambda points, **rest: Cable(start=points[0], end=points[1], **rest), 2, ("tension", "length")),
    "stay": (lambda points, **rest: Stay(start=points[0], end=points[1], **rest), 2, ("tension", "length")),
    "fixed": (lambda points: OpenCurve(points, corners=()), 0, ()),
    "ring": (lambda points, **rest: Ring(points=points, **rest), 0, ("force",)),
    "symmetric": (lambda points: SymmetryPlane(point=points[0], normal=points[1]), 2, ()),
}
# a kind and the digits by which programs number equal names ("cable2", "cable001", "cable.001"), then other words
_NAME = re.compile(
    rf"\s*({'|'.join(_KINDS)}|symmetry)(?![^\W\d_])(?:\d*(?:\.\d{{3}})?(?![^\W_]|\.))?[\s:=_]*(.*?)\s*$",
    re.IGNORECASE | re.DOTALL,
)


def read_frame(path: str | os.PathLike[str]) -> list[Edge]:
    """The edges of a JSON or STEP file, for `solve_membrane`.

    Raises:
        MeshFileError: the file is no frame. It names the edge and the key.
        CadFileError, MissingPackageError: as for `read_shape`.
        OSError: the file cannot be read.
    """
    is_step = Path(path).suffix.lower() in STEP
    try:
        if is_step:
            return _of_parts(named_parts(path))
        content = regular_file(path).read_bytes()
        # an integer of thousands of digits is an error
        return _of_json(json.loads(content, parse_int=float, object_pairs_hook=_each_once))
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MeshFileError(f"{os.fspath(path)}: is no JSON file ({error})", path=path) from error
    except OptionError as error:
        raise MeshFileError(f"{os.fspath(path)}: {error}", path=path) from error


def edges_of_arguments(what: Iterable[Any]) -> list[Edge]:
    """Edges, with shapes of a CAD library as edges of the kinds in their labels."""
    found: list[tuple[tuple[str, ...] | None, Any]] = []
    for one in what:
        shapes = cad_shapes(one, function="solve_membrane")
        names = None if shapes is None else (str(getattr(one, "label", "")),)
        parts = [one] if shapes is None else [part for shape in shapes for part in outer_parts(shape)]
        found += [(names, part) for part in parts]
    return _of_parts(found)


def _of_json(content: Any) -> list[Edge]:
    if not isinstance(content, dict) or content.keys() != {"edges"} or not isinstance(content["edges"], list):
        raise OptionError("must be an object with the only key 'edges', a list")
    found = []
    for number, given in enumerate(content["edges"]):
        with _at(f"edge {number}"):
            kinds = [key for key in _KINDS if isinstance(given, dict) and key in given]
            if len(kinds) != 1:
                raise OptionError(f"must be an object with one of the keys {', '.join(map(repr, _KINDS))}")
            rest = {key: value for key, value in given.items() if key != kinds[0]}
            found.append(_edge(kinds[0], given[kinds[0]], rest))
    return found


def _of_parts(parts: Iterable[tuple[tuple[str, ...] | None, Any]]) -> list[Edge]:
    """The edges that faces and edges of CAD describe, each after its names, and edges, after None. Rings come last."""
    found: list[Edge] = []
    rings: dict[str, tuple[dict[str, Any], list[Any]]] = {}
    for number, (names, part) in enumerate(parts):
        if names is None:
            found.append(part)
            continue
        name = next(filter(_NAME.match, names), "fixed")
        with _at(f"edge {number} ({name!r})"):
            kind, rest = _described(name)
            own = edges_of(parts_of(part, "EDGE"))
            ends = own[0].spline.ends
            is_closed = np.ptp(ends, axis=0).max() <= own[0].tolerance
            if kind == "symmetric":
                if not are_plane(parts_of(part, "FACE")):
                    raise OptionError("the face of a plane of symmetry is curved; draw a plane face")
                found.append(_edge(kind, _plane(np.concatenate([one.spline.control_points for one in own])), rest))
            elif next(parts_of(part, "FACE"), None) is not None:
                raise OptionError("a face is no edge; name it 'symmetric' if it lies in a plane of symmetry")
            elif kind == "ring" or (kind == "fixed" and is_closed):
                rings.setdefault(name, (rest, []))[1].append(part)
            else:
                points = _points(own[0].spline) if kind == "fixed" else ends[[0, 0 if is_closed else 1]]
                found.append(_edge(kind, points.tolist(), rest))
    for name, (rest, edges) in rings.items():
        with _at(f"ring {name!r}"):
            for curve in closed_curves(edges):
                corners = np.array(curve.corners or (0.0,))
                widths = np.diff(np.append(corners, corners[0] + 1))
                s = corners + widths * np.linspace(0, 1, _SAMPLES // len(corners) + 1)[:-1, None]
                found.append(_edge("ring", curve.point(s.T.ravel()).tolist(), rest))
    return found


def _described(name: str) -> tuple[str, dict[str, Any]]:
    """The kind of a name such as "cable 2", "cable length 2.1" or "ring force=-3", and its other keys."""
    match = _NAME.match(name)
    assert match is not None
    kind = match[1].lower().replace("symmetry", "symmetric")
    keys, words = _KINDS[kind][2], re.split(r"[\s:=_]+", match[2]) if match[2] else []
    if len(words) == 1:
        words = [*keys[:1], *words]
    return kind, _each_once((key, _number(value)) for key, value in zip_longest(words[::2], words[1::2]) if keys)


def _each_once(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """A dictionary of keys with values. Raises an OptionError if a key occurs twice."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise OptionError(f"the key {key!r} is given twice; give it once")
        found[key] = value
    return found


def _number(text: str | None) -> float | str | None:
    try:
        return float(text or "")
    except ValueError:
        return text


def _points(spline: NurbsCurve) -> Float[np.ndarray, "m 3"]:
    """Points of a fixed edge, the ends of a straight one. Raises an OptionError if it has a corner."""
    if len(spline.control_points) == 2:
        return spline.ends
    curve = JoinedSplines.of([spline])
    if curve.are_corners[1:].any():
        raise OptionError("has a corner; divide it there into several edges")
    return np.concatenate([curve.point(np.arange(_SAMPLES) / _SAMPLES), spline.ends[1:]])


def _plane(points: Float[np.ndarray, "n 3"]) -> list[list[float]]:
    """A point and the normal of the plane of points. Raises an OptionError if they do not lie in just one."""
    middle = points.mean(axis=0)
    _, extents, axes = np.linalg.svd(points - middle, full_matrices=False)
    if extents[1] <= _FLAT * extents[0] or extents[2] > _FLAT * extents[0]:
        raise OptionError("does not determine its plane of symmetry; draw a plane face or a plane curved edge")
    return [middle.tolist(), axes[2].tolist()]


def _edge(kind: str, rows: Any, rest: dict[str, Any]) -> Edge:
    """An edge of a kind. Raises an OptionError that names the key that is wrong."""
    make, count, keys = _KINDS[kind]
    for key, value in rest.items():
        if key not in keys:
            raise OptionError(f"the key {key!r} is unknown beside {kind!r}")
        if not _is_number(value):
            raise OptionError(f"{key!r} must be a number, got {value!r}")
    is_list = isinstance(rows, list) and (len(rows) == count if count else len(rows) >= 2)
    if not is_list or not all(isinstance(row, list) and len(row) == 3 and all(map(_is_number, row)) for row in rows):
        what = "a point and a normal" if kind == "symmetric" else "two points" if count else "two points or more"
        raise OptionError(f"{kind!r} must be {what}, each a list of three numbers of at most {_LARGEST:g}")
    return make(np.array(rows, dtype=np.float64), **rest)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST


@contextmanager
def _at(place: str) -> Iterator[None]:
    """Errors name the place."""
    try:
        yield
    except SpinorGeomError as error:
        raise OptionError(f"{place}: {error}") from error
