"""The boundary of a surface in training: nodes on ∂Ω with an integral along it, or the paper's rule on each ray."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Complex, Float
from scipy.linalg import circulant
from torch import Tensor

from spinor_geom.domain.plane_domain import FourierBoundary, PlaneDomain, panel_breaks
from spinor_geom.domain.quadrature import Panels, Rule
from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.plateau.network import projected
from spinor_geom.plateau.omega import integral_of
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.surface.weierstrass import weierstrass_phi

_PANEL_ORDER = 4  # fewest Gauss-Legendre nodes on a panel of an ∂Ω with corners: they are many, and short at these
_CONSTANT_STEPS = 5  # rounds in which the constant of r and the nearest points of Γ are found from each other
_POINTS = 1024  # points that the bounding box of a curve is taken from


def as_boundary_curve(curve: BoundaryCurve | ClosedCurve) -> BoundaryCurve:
    """A curve as polynomials, to rounding error where it is given by formulas."""
    return curve if isinstance(curve, BoundaryCurve) else BoundaryCurve.from_formula(curve)


def diagonal_of(curve: BoundaryCurve) -> float:
    """Diagonal of the curve's bounding box, in units of space."""
    return float(np.linalg.norm(np.ptp(curve.point(np.arange(_POINTS) / _POINTS), axis=0)))


@dataclass(frozen=True, eq=False)
class BoundaryNodes:
    """Nodes on ∂Ω, their parameters t increasing, with dz/dt."""

    t: Float[Tensor, " n"]
    z: Complex[Tensor, " n"]
    dz: Complex[Tensor, " n"]
    weights: Float[Tensor, " n"]  # of the mean over t; their sum is 1
    integral: Float[Tensor, "n n"]  # of values at the nodes: ∫ f dt, up to a constant

    @classmethod
    def on(cls, domain: PlaneDomain, count: int, device: torch.device) -> BoundaryNodes:
        """About `count` nodes: at equal steps of t on an analytic ∂Ω, else on panels between its vertices."""
        boundary = domain.boundary
        if isinstance(boundary, FourierBoundary):
            count = max(count, len(boundary.coefficients) + 1)
            z, dz, _ = boundary.grid(count)
            t, weights = np.arange(count) / count, np.full(count, 1 / count)
            integral = circulant(integral_of(np.ones(count, dtype=np.complex128)).real)
        else:
            breaks = panel_breaks(boundary)
            panels = Panels.on(boundary, breaks, max(_PANEL_ORDER, count // (len(breaks) - 1)))
            t, z, dz, weights = panels.t, panels.z, panels.dz, panels.weights
            integral = np.kron(np.diag(np.diff(breaks)), panels.cumulative)
            panel = np.repeat(np.arange(len(breaks) - 1), panels.order)
            integral += (panel[:, None] > panel) * weights
        return cls(*(torch.tensor(some, device=device) for some in (t, z, dz, weights, integral)))

    def positions(self, spinors: Complex[Tensor, "n 2"]) -> Float[Tensor, "n 3"]:
        """Positions of the nodes, up to a constant, from p and q there."""
        velocity = (phi(spinors[:, 0], spinors[:, 1]) * self.dz[:, None]).real
        # the real part of the integral of a real kernel is that of the real part
        return self.integral @ velocity

    def placed(
        self, spinors: Complex[Tensor, "n 2"], slide: Float[Tensor, " n"], curve: CurveTensors, *, held: bool = False
    ) -> Placed:
        """The boundary of the surface of p and q, as near to Γ as a constant brings it, from the slide on or held."""
        position = self.positions(spinors)
        position = position - self.weights @ (position - curve.point_and_derivative(slide)[0])
        for _ in range(0 if held else _CONSTANT_STEPS):
            slide = projected(position, slide, curve, limit=1 / len(self.t))
            position = position - self.weights @ (position - curve.point_and_derivative(slide)[0])
        return Placed(position=position, slide=slide, error=position - curve.point_and_derivative(slide)[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class Placed:
    """The boundary of a surface next to Γ: r at the nodes, parameters of the points of Γ near them, and r − Γ."""

    position: Float[Tensor, "n 3"]
    slide: Float[Tensor, " n"]
    error: Float[Tensor, "n 3"]


def move_to(surface: SpinorSurface, z: Complex[Tensor, " n"], position: Float[Tensor, "n 3"]) -> None:
    """Sets a surface's constant so that it has given positions at some points, in the mean."""
    found = surface.position(z.cpu().numpy())
    with torch.no_grad():
        surface.constant.add_((position - torch.as_tensor(found).to(position)).mean(0))


FORMS = {"spinor": phi, "weierstrass-enneper": weierstrass_phi}  # φ of two networks: of p and q, or of f and g


class RayBoundary(torch.nn.Module):
    """The boundary r(e^{2πis}) of a surface over the unit disk with r(0) = c, of p and q or of f and g."""

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
        """Positions r and dr/ds at given s, differentiable by the networks' parameters."""
        z = _circle(s)
        # the last point is z itself, for the velocity
        null = self._null(torch.cat([z[:, None] * self.nodes, z[:, None]], dim=1))
        position = ((null[:, :-1] * self.weights[:, None]).sum(1) * z[:, None]).real
        return self.constant + position, (2j * math.pi * z[:, None] * null[:, -1]).real

    def moved_with(self, s: Float[Tensor, " n"]) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
        """Values r and dr/ds, differentiable by s; the derivative of r is dr/ds itself, not that of its quadrature."""
        with torch.no_grad():
            position, velocity = self.point_and_velocity(s)
        z = _circle(s)
        live = (2j * math.pi * z[:, None] * self._null(z)).real
        return position + (s - s.detach())[:, None] * velocity, live

    def _null(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 3"]:
        return self.phi(*self.network.value(z).unbind(-1))


def _circle(s: Float[Tensor, " n"]) -> Complex[Tensor, " n"]:
    return torch.polar(torch.ones_like(s), 2 * math.pi * s)
