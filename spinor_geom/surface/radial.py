"""The paper's evaluation of a surface: one quadrature rule along the straight ray from a centre of Ω to each point.

The rule is the surface's own; the paper's is `SpinorSurface(model, domain, quadrature="trapezoid", order=100)`.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.surface import curvature
from spinor_geom.surface.spinor_surface import SpinorSurface

# nodes of the rule that are held at once where they carry derivatives of two orders
_NODES = 1 << 17


def radial_position(
    surface: SpinorSurface, z: Complex[np.ndarray, "*pts"], *, center: complex = 0.0
) -> Float[np.ndarray, "*pts 3"]:
    """Positions r(center) + Re ∫ φ dζ, the integral by the surface's rule on each whole ray; shape (*pts, 3).

    Unlike `SpinorSurface.position`, whose rule works on short pieces of a path, it shows the rule's error: with n
    intervals O(n⁻²) for "trapezoid" and O(n⁻⁴) for "simpson".

    Args:
        surface: its `quadrature` and `order` are the rule.
        z: points that the centre sees in Ω.
        center: where the rays start; r has no error there.

    Source: Sun & Chern (2026), neural representation of minimal surfaces.
    """
    z = np.asarray(z, dtype=np.complex128)
    start = surface.position(np.array(complex(center)))
    return np.asarray(start + surface.integrate(np.full_like(z, center), z))


def radial_mean_curvature(
    surface: SpinorSurface, z: Complex[np.ndarray, "*pts"], *, center: complex = 0.0
) -> Float[np.ndarray, "*pts"]:
    """H of the surface that `radial_position` draws, in 1/length, by automatic differentiation; shape (*pts).

    p and q are exactly holomorphic, so the rule is all that keeps it from 0. NaN at branch points.

    Args:
        surface: as for `radial_position`.
        z: points that the centre sees in Ω.
        center: where the rays start.

    Source: Sun & Chern (2026), mean curvature against quadrature steps.
    """
    flat = torch.from_numpy(np.array(z, dtype=np.complex128).reshape(-1)).to(surface.spinor_map.device)

    def position(x: Float[Tensor, " n"], y: Float[Tensor, " n"]) -> Float[Tensor, "n 3"]:
        end = torch.complex(x, y)
        return surface.integrate(torch.full_like(end, center), end)

    with torch.no_grad():
        blocks = torch.split(flat, max(1, _NODES // (surface.order + 1)))
        mean = torch.cat([curvature.fundamental_forms(position, some.real, some.imag).mean for some in blocks])
    return np.asarray(mean.cpu().numpy()).reshape(np.shape(z))
