"""The compiled part, `cpp/`, called through ctypes: arguments are checked, and failures become exceptions."""

import ctypes
import zlib
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from spinor_geom.errors import CompiledPartError, OptionError, OutOfTimeError, SpinorGeomError

_INTEGER, _NUMBER = ctypes.c_int64, ctypes.c_double
_INDICES = np.ctypeslib.ndpointer(np.int64, flags="C_CONTIGUOUS")
_SHORT_INDICES = np.ctypeslib.ndpointer(np.int32, flags="C_CONTIGUOUS")
_NUMBERS = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
_POINTS = np.ctypeslib.ndpointer(np.complex128, flags="C_CONTIGUOUS")
_REGION = (_INTEGER, _POINTS, _INDICES, _NUMBER, _NUMBER, _INTEGER, _POINTS, _NUMBERS, _INTEGER)  # see size_field.hpp

_MATRIX = (_SHORT_INDICES, _SHORT_INDICES, _NUMBERS)  # starts of columns, rows, values
_FORM = (*_MATRIX, _NUMBERS, _NUMBERS, _NUMBER, *_MATRIX)  # of a function on the vertices, see bending.cpp

# the arguments of each function, as in `cpp`
FUNCTIONS: dict[str, tuple[Any, ...]] = {
    "sizes": (*_REGION, _INTEGER, _POINTS, _NUMBERS),
    "refine": (*_REGION, _INTEGER, _POINTS, _NUMBERS, _INTEGER, _NUMBER, _POINTS, _INDICES, _INDICES),
    "near_segments": (_INTEGER, _NUMBERS, _NUMBERS, _NUMBER, _INTEGER, _INTEGER, _NUMBER, _INDICES, _INDICES),
    "near_points": (
        *(_INTEGER, _NUMBERS, _NUMBERS, _INTEGER, _NUMBERS, _NUMBERS),
        *(_INTEGER, _INTEGER, _NUMBER, _INDICES, _INDICES),
    ),
    "group_half_edges": (_INTEGER, _INDICES, _INTEGER, _INDICES, _INDICES, _INDICES),
    "crossing_angles": (_INTEGER, _INDICES, _NUMBERS, _INDICES, _NUMBERS),
    "patch_angles": (_INTEGER, _NUMBERS, _INTEGER, _INDICES, _INTEGER, _INDICES, _NUMBERS, _NUMBERS),
    "components": (_INTEGER, _INDICES, _INTEGER, _INDICES),
    "near_faces": (
        *(_INTEGER, _NUMBERS, _INTEGER, _NUMBERS, _NUMBER),
        *(_INTEGER, _INTEGER, _NUMBER, _INDICES, _INDICES),
    ),
    "sort_by_cells": (_NUMBERS, _INTEGER, _INDICES, _INTEGER, _INDICES, _INDICES, _NUMBERS, _INDICES),
    "faces_in_boxes": (
        *(_NUMBERS, _INTEGER, _INDICES, _INDICES, _INTEGER),
        *(_INDICES, _NUMBERS, _INTEGER, _NUMBERS, _INDICES, _INDICES),
    ),
    "remesh": (
        *(_INTEGER, _NUMBERS, _INDICES, _NUMBER, _NUMBER, _INTEGER, _NUMBERS, _NUMBERS, _INTEGER),  # a RegionOf<Point3>
        *(_INTEGER, _INTEGER, _INDICES, _NUMBER, _INTEGER, _INTEGER, _NUMBER, _NUMBERS, _INDICES, _INDICES),
    ),
    "intrinsic_laplacian": (_INTEGER, _INTEGER, _NUMBERS, _INDICES, *_MATRIX),
    "bending": (_INTEGER, _NUMBERS, _INTEGER, _INDICES, _NUMBERS, _NUMBER, *_MATRIX, _NUMBERS, _NUMBERS, _NUMBERS),
    "bending_stiffness": (_INTEGER, _INTEGER, *_FORM, _INTEGER, *_MATRIX),
    "bending_residual": (_INTEGER, _INTEGER, *_FORM, _NUMBERS, _NUMBERS),
    "minimum_area_splits": (_INTEGER, _NUMBERS, _NUMBER, _NUMBER, _INDICES),
    "flattest_splits": (_INTEGER, _NUMBERS, _NUMBERS, _NUMBERS, _SHORT_INDICES, _INDICES, _NUMBERS),
}

_LARGEST = np.finfo(np.float64).max


def load(folder: Path) -> ctypes.CDLL:
    """The compiled part in a folder of the package.

    Raises:
        CompiledPartError: it is missing, or was made from other sources than those beside it.
    """
    file = next((path for suffix in EXTENSION_SUFFIXES if (path := folder / f"_kernel{suffix}").exists()), None)
    if file is None:
        raise CompiledPartError(problem="is missing")
    found = ctypes.CDLL(str(file))
    sources = sorted((folder / "cpp").glob("*.[ch]pp"))  # none in an installed wheel
    digest = zlib.crc32(b"".join(source.read_bytes() for source in sources))  # as in setup.py
    try:
        found.sources_digest.restype = ctypes.c_uint32
        is_stale = bool(sources) and found.sources_digest() != digest
        for name, types in FUNCTIONS.items():
            getattr(found, name).argtypes = types
    except AttributeError:
        is_stale = True
    if is_stale:
        raise CompiledPartError(problem="was made from other sources")
    return found


# at import, so that a broken installation is found before any loop of a mesh is tried
_LIBRARY = load(Path(__file__).parent)


def call(name: str, *arguments: int | float | np.ndarray) -> None:
    """Calls one of `FUNCTIONS`.

    Raises:
        ctypes.ArgumentError: an argument has another type than in `FUNCTIONS`, or an array is not contiguous.
        MemoryError: the function needs more memory than there is, or more points than its indices can number.
        OutOfTimeError: it has no result within its time limit.
        SpinorGeomError: it failed otherwise.
    """
    outcome = getattr(_LIBRARY, name)(*arguments)  # the codes are those of `entry.hpp`
    if outcome == 1:
        raise MemoryError(f"there is not enough memory for {name} of the compiled part")
    if outcome == 2:
        raise OutOfTimeError
    if outcome:
        raise SpinorGeomError(f"{name} of the compiled part failed; check the input for repeated and overlapping parts")


def checked(
    name: str, values: ArrayLike, dtype: DTypeLike, *shape: int | None, least: float = -_LARGEST, most: float = _LARGEST
) -> np.ndarray:
    """Values as a contiguous array, as the compiled part takes it. None in `shape` allows any length.

    Raises:
        OptionError: the shape is another one, the values cannot be converted to the dtype without loss, or a value
            (of complex numbers, a coordinate) is not from `least` to `most`, as NaN never is.
    """
    array = np.asarray(values)
    if not np.can_cast(array.dtype, dtype, "safe"):
        raise OptionError(f"{name} must be of dtype {np.dtype(dtype)}, not {array.dtype}; convert it")
    if array.ndim != len(shape) or any(a not in (b, None) for a, b in zip(shape, array.shape, strict=True)):
        lengths = ", ".join("n" if length is None else str(length) for length in shape)
        raise OptionError(f"{name} must have the shape ({lengths}), not {array.shape}")
    array = np.ascontiguousarray(array, dtype=dtype)
    numbers = array.view(np.float64).reshape(-1) if array.dtype.kind == "c" else array.reshape(-1)
    if numbers.size and not (numbers.min() >= least and numbers.max() <= most):
        first = int(np.argmin((numbers >= least) & (numbers <= most)))
        allowed = "finite" if (least, most) == (-_LARGEST, _LARGEST) else f"from {least:.3g} to {most:.3g}"
        raise OptionError(f"{name} must be {allowed}, but number {first} is {numbers[first]}")
    return array
