"""Evaluation of functions at many complex points in blocks, and a check of dtypes."""

from collections.abc import Callable

import torch
from jaxtyping import Complex, Shaped
from torch import Tensor

from spinor_geom.errors import DtypeError

# temporary entries per block: on the CPU a block fits the cache, on other devices few large blocks save kernel launches
_ENTRIES, _ENTRIES_ON_DEVICES = 1 << 17, 1 << 23


def in_blocks(function: Callable[..., Tensor], *points: Complex[Tensor, "*pts"], width: int) -> Shaped[Tensor, "..."]:
    """Evaluates a function of one or more arrays of points, of any shape, block by block.

    `width` is the number of temporary entries that the function needs per point.
    """
    entries = _ENTRIES if points[0].device.type == "cpu" else _ENTRIES_ON_DEVICES
    blocks = (torch.split(z.reshape(-1), max(1, entries // max(1, width))) for z in points)
    values = torch.cat([function(*block) for block in zip(*blocks, strict=True)])
    return values.reshape(*points[0].shape, *values.shape[1:])


def require_complex(**tensors: Tensor) -> None:
    """Raises DtypeError for the first tensor that is not complex."""
    for name, tensor in tensors.items():
        if not tensor.is_complex():
            raise DtypeError(f"{name} must be complex, got {tensor.dtype}; convert it by .to(torch.complex128)")
