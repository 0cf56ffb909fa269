"""The boundary of a surface in training as the paper evaluates it: a quadrature rule on the ray to each point."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.surface.formulas import null_vector, phi
from spinor_geom.surface.weierstrass import weierstrass_phi


class Form(NamedTuple):
    """φ from the two networks' values, and φ′ from values and derivatives."""

    phi: Callable[[Tensor, Tensor], Tensor]
    derivative: Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]


def _spinor_derivative(p: Tensor, q: Tensor, dp: Tensor, dq: Tensor) -> Tensor:
    return null_vector(2 * p * dp, 2 * q * dq, dp * q + p * dq)


def _weierstrass_derivative(f: Tensor, g: Tensor, df: Tensor, dg: Tensor) -> Tensor:
    by_g = torch.stack([-f * g * dg, 1j * f * g * dg, f * dg], dim=-1)
    return weierstrass_phi(df, g) + by_g


FORMS = {
    "spinor": Form(phi, _spinor_derivative),
    "weierstrass-enneper": Form(weierstrass_phi, _weierstrass_derivative),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class RayBoundary:
    """The boundary r(e^{2πis}) of a surface over the unit disk.

    Attributes:
        network: p and q, or f and g.
        constant: c = r(0).
        form: what φ is made of them.
        nodes: of the rule on [0, 1].
        weights: of the rule.
    """

    network: ComplexMLP
    constant: torch.nn.Parameter
    form: Form
    nodes: Float[Tensor, " k"]
    weights: Float[Tensor, " k"]

    def point_and_velocity(self, s: Float[Tensor, " n"]) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
        """R and dr/ds; differentiable by the networks' parameters, not by s."""
        z = torch.polar(torch.ones_like(s), 2 * math.pi * s)
        # the last point is z itself, for the velocity
        along = torch.cat([z[:, None] * self.nodes, z[:, None]], dim=1)
        null = self.form.phi(*self.network.value(along).unbind(-1))
        position = ((null[:, :-1] * self.weights[:, None]).sum(1) * z[:, None]).real
        return self.constant + position, (2j * math.pi * z[:, None] * null[:, -1]).real

    def moved_with(self, s: Float[Tensor, " n"]) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
        """R and dr/ds; differentiable by s, not by the networks' parameters."""
        with torch.no_grad():
            at = s.detach()
            position, velocity = self.point_and_velocity(at)
            z = torch.polar(torch.ones_like(at), 2 * math.pi * at)
            values, slopes = self.network.value(z).unbind(-1), self.network.derivative(z).unbind(-1)
            turned = 2j * math.pi * z[:, None]
            bend = turned**2 * self.form.derivative(*values, *slopes) + 2j * math.pi * turned * self.form.phi(*values)
        step = (s - at)[:, None]
        return position + step * velocity, velocity + step * bend.real
