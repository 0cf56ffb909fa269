"""Evaluation of functions at many complex points in blocks, and a check of dtypes."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Shaped

from spinor_geom.arrays import Array, Place, is_numpy, is_real, namespace, place_of
from spinor_geom.errors import DtypeError

# temporary entries per block: on the CPU a block fits the cache, on other devices few large blocks save kernel launches
_ENTRIES, _ENTRIES_ON_DEVICES = 1 << 17, 1 << 23


def block_size(place: Place, width: int) -> int:
    """Number of points whose temporary entries, `width` for each, are computed at once."""
    entries = _ENTRIES if place.device is None or place.device.type == "cpu" else _ENTRIES_ON_DEVICES
    return max(1, entries // max(1, width))


def in_blocks(function: Callable[..., Array], *points: Complex[Array, "*pts"], width: int) -> Shaped[Array, "..."]:
    """Evaluates a function of one or more arrays of points, of any shape, block by block.

    `width` is the number of temporary entries that the function needs per point.
    """
    flat, step = [z.reshape(-1) for z in points], block_size(place_of(points[0]), width)
    starts = range(0, max(1, len(flat[0])), step)
    parts = (function(*(z[start : start + step] for z in flat)) for start in starts)
    if len(starts) == 1:
        values = next(parts)
    elif is_numpy(flat[0]):  # without a list of parts, which are large together
        first = next(parts)
        values = np.empty((len(flat[0]), *first.shape[1:]), dtype=first.dtype)
        values[:step] = first
        for start, part in zip(starts[1:], parts, strict=True):
            values[start : start + step] = part
    else:
        values = namespace(flat[0]).concat(list(parts))
    return values.reshape(*points[0].shape, *values.shape[1:])


def require_complex(**arrays: Array) -> None:
    """Raises DtypeError for the first array that is not complex."""
    for name, array in arrays.items():
        if is_real(array):
            raise DtypeError(f"{name} must be complex, got {array.dtype}; convert it to complex128")
