"""Dirichlet's form of harmonic functions on the flat cylinder [0, m] × S¹, on equal steps of the angle of both rims."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def multipliers(modulus: Float[Tensor, "*m"], n: int) -> tuple[Float[Tensor, "*m f"], Float[Tensor, "*m f"]]:
    """The Dirichlet-to-Neumann map Λ(m) of cylinders of any moduli on n equal steps of both rims.

    Both rims run with the cylinder on their left, as the boundary of an annulus does: the angle of the first one is
    2πt, that of the second −2πt. For the frequency k a rim's own part is |k| coth |k|m, the other's −|k| / sinh |k|m
    (for k = 0: ±1/m).

    Returns:
        Multipliers of a rim's own values and of the conjugate spectrum of the other rim, frequencies 0 … n/2.
    """
    m = modulus[..., None]
    k = torch.arange(n // 2 + 1, dtype=m.dtype, device=m.device)
    k[0] = 1
    # coth and 1/sinh of km without overflow
    e, rest = torch.exp(-k * m), -torch.expm1(-2 * k * m)
    own, other = k * (1 + e * e) / rest, -2 * k * e / rest
    own[..., 0], other[..., 0] = 1 / modulus, -1 / modulus
    return own, other
