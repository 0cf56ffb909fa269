"""Functions of many points, evaluated so many at once that their tables stay small."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Complex
from torch import Tensor

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
