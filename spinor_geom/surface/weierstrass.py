"""The Weierstrass-Enneper form, r = c + Re ∫ (½f(1 − g²), ½i f(1 + g²), f g) dζ: the paper's baseline.

For any holomorphic f and g, r is minimal. However, the Gauss map g has a pole where the normal is e₃, and at a zero of
odd order of f, r has a branch point that is not removable.
"""

from typing import cast

import numpy as np
from jaxtyping import Complex, Float, Inexact

from spinor_geom.arrays import Array, namespace, to_numpy
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.quadrature import rule
from spinor_geom.holomorphic.blocks import in_blocks
from spinor_geom.holomorphic.model import HolomorphicModel
from spinor_geom.holomorphic.zeros import find_zeros
from spinor_geom.surface.branch import BranchPoint, with_invariants
from spinor_geom.surface.module import as_module
from spinor_geom.torch_extra import torch

_ORDER = 32  # quadrature nodes on each ray


def weierstrass_phi(f: Complex[Array, "*pts"], g: Complex[Array, "*pts"]) -> Complex[Array, "*pts 3"]:
    """The null curve's derivative φ = (½f(1 − g²), ½i f(1 + g²), f g)."""
    return namespace(f).stack([f * (1 - g * g) / 2, 0.5j * f * (1 + g * g), f * g], axis=-1)


class WeierstrassSurface(torch.nn.Module):
    """A minimal surface from f and g, the two outputs of a holomorphic model, with r(0) = constant.

    Positions are integrated along rays from 0, which have to lie in the domain.

    Source: Sun & Chern (2026), comparison with the Weierstrass-Enneper parametrisation.
    """

    constant: torch.Tensor

    def __init__(self, model: HolomorphicModel, domain: PlaneDomain, constant: Float[Array, "3"]) -> None:
        super().__init__()
        self.model = as_module(model)
        self.domain = domain
        self.constant = torch.nn.Parameter(torch.tensor(to_numpy(constant)))

    def position(self, z: Inexact[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        """Positions r(z), shape (*pts, 3)."""
        nodes, weights = (torch.tensor(a).to(self.constant.device) for a in rule("gauss", _ORDER))

        def displacement(end: Complex[Array, " n"]) -> Float[Array, "n 3"]:
            phi = weierstrass_phi(*self._data(end[:, None] * nodes).unbind(-1))
            return ((phi * weights[:, None]).sum(1) * end[:, None]).real

        points = torch.tensor(z, dtype=torch.complex128, device=self.constant.device)
        r = self.constant.detach() + in_blocks(displacement, points, width=_ORDER)
        return np.asarray(r.cpu().numpy())

    def branch_points(self) -> tuple[BranchPoint, ...]:
        """Zeros of f in Ω. Those of odd order are not removable."""
        zeros = find_zeros(lambda z: self._at(z)[:, 0], self.domain)
        return with_invariants(zeros, lambda z: weierstrass_phi(*self._at(z).T), self.domain)

    def _at(self, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n 2"]:
        return to_numpy(self._data(torch.tensor(z, device=self.constant.device)))

    def _data(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        with torch.no_grad():
            return cast(HolomorphicModel, self.model).value(z)
