"""Functions of many complex points, evaluated so many at once that their tables stay small."""

from collections.abc import Callable

import torch
from jaxtyping import Complex
from torch import Tensor

from spinor_geom.errors import DtypeError

# entries of a table computed at once: on the CPU it stays in the cache, elsewhere each call takes long to start
_ENTRIES, _ENTRIES_ON_DEVICES = 1 << 17, 1 << 23


def in_blocks(
    function: Callable[[Tensor], Tensor], z: Complex[Tensor, "*pts"], width: int
) -> Complex[Tensor, "*pts c"]:
    """A function of a row of points, for points of any shape."""
    entries = _ENTRIES if z.device.type == "cpu" else _ENTRIES_ON_DEVICES
    blocks = torch.split(z.reshape(-1), max(1, entries // max(1, width)))
    values = torch.cat([function(block) for block in blocks])
    return values.reshape(*z.shape, values.shape[-1])


def require_complex(**tensors: Tensor) -> None:
    """Raises a DtypeError for the first of some tensors that is not complex, by its name."""
    for name, tensor in tensors.items():
        if not tensor.is_complex():
            raise DtypeError(f"{name} must be complex, got {tensor.dtype}; convert it by .to(torch.complex128)")
