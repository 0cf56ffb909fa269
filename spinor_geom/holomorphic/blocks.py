"""Evaluation of functions at many complex points in blocks, and a check of dtypes."""

from collections.abc import Callable

import torch
from jaxtyping import Complex, Shaped
from torch import Tensor

from spinor_geom.errors import DtypeError

# entries of the table of a block: on the CPU it fits the cache, on other devices the start of a kernel takes longest
_ENTRIES, _ENTRIES_ON_DEVICES = 1 << 17, 1 << 23


def in_blocks(function: Callable[..., Tensor], *points: Complex[Tensor, "*pts"], width: int) -> Shaped[Tensor, "..."]:
    """Values of a function of n points, or pairs of points, at points of any shape.

    The function makes tables with `width` entries a point.
    """
    entries = _ENTRIES if points[0].device.type == "cpu" else _ENTRIES_ON_DEVICES
    blocks = (torch.split(z.reshape(-1), max(1, entries // max(1, width))) for z in points)
    values = torch.cat([function(*block) for block in zip(*blocks, strict=True)])
    return values.reshape(*points[0].shape, *values.shape[1:])


def require_complex(**tensors: Tensor) -> None:
    """Raises a DtypeError that names the first tensor that is not complex."""
    for name, tensor in tensors.items():
        if not tensor.is_complex():
            raise DtypeError(f"{name} must be complex, got {tensor.dtype}; convert it by .to(torch.complex128)")
