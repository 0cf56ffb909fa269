"""The boundary of a surface in training as the paper evaluates it: a quadrature rule on the ray to each point."""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.domain.quadrature import Rule
from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.weierstrass import weierstrass_phi

# φ of two networks' values, by what they are: p and q, or f and g
FORMS = {"spinor": phi, "weierstrass-enneper": weierstrass_phi}


class RayBoundary(torch.nn.Module):
    """The boundary r(e^{2πis}) of a surface over the unit disk.

    Attributes:
        network: p and q, or f and g.
        constant: c = r(0).
    """

    nodes: Tensor
    weights: Tensor

    def __init__(self, network: ComplexMLP, constant: Float[np.ndarray, "3"], form: str, rule: Rule) -> None:
        """A boundary with φ made by a form of `FORMS`, and a rule on [0, 1] for each ray."""
        super().__init__()
        self.network = network
        self.constant = torch.nn.Parameter(torch.tensor(constant))
        self.phi = FORMS[form]
        for name, values in (("nodes", rule.nodes), ("weights", rule.weights)):
            self.register_buffer(name, torch.tensor(values), persistent=False)

    def point_and_velocity(self, s: Float[Tensor, " n"]) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
        """R and dr/ds at given s, differentiable by the networks' parameters."""
        z = _circle(s)
        # the last point is z itself, for the velocity
        null = self._null(torch.cat([z[:, None] * self.nodes, z[:, None]], dim=1))
        position = ((null[:, :-1] * self.weights[:, None]).sum(1) * z[:, None]).real
        return self.constant + position, (2j * math.pi * z[:, None] * null[:, -1]).real

    def moved_with(self, s: Float[Tensor, " n"]) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
        """R and dr/ds, differentiable by s; the derivative of r is dr/ds itself, not that of its quadrature."""
        with torch.no_grad():
            position, velocity = self.point_and_velocity(s)
        z = _circle(s)
        live = (2j * math.pi * z[:, None] * self._null(z)).real
        return position + (s - s.detach())[:, None] * velocity, live

    def _null(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 3"]:
        return self.phi(*self.network.value(z).unbind(-1))


def _circle(s: Float[Tensor, " n"]) -> Complex[Tensor, " n"]:
    return torch.polar(torch.ones_like(s), 2 * math.pi * s)
