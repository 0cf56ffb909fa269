"""Boundaries of surfaces in training: by integrals along ∂Ω, or by the paper's quadrature along rays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.linalg import circulant

from spinor_geom.domain.plane_domain import FourierBoundary, PlaneDomain, panel_breaks
from spinor_geom.domain.quadrature import Panels, Rule
from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.mesh.boundary_loop import diagonals
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.network.discretisation import projected
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.surface.weierstrass import weierstrass_phi
from spinor_geom.torch_extra import Tensor, torch

_PANEL_ORDER = 4  # fewest Gauss-Legendre nodes on a panel of an ∂Ω with corners
_CONSTANT_STEPS = 5  # alternations between the constant of r and the nearest points of Γ
_POINTS = 1024  # samples of a curve for its bounding box


def as_boundary_curve(curve: BoundaryCurve | ClosedCurve) -> BoundaryCurve:
    """A curve as piecewise polynomials. Formulas are approximated to rounding."""
    return curve if isinstance(curve, BoundaryCurve) else BoundaryCurve.from_formula(curve)


def diagonal_of(curve: BoundaryCurve) -> float:
    """Diagonal of a curve's bounding box."""
    return float(diagonals(curve.point(np.arange(_POINTS) / _POINTS)))


@dataclass(frozen=True, eq=False)
class BoundaryNodes:
    """Nodes on ∂Ω with increasing parameters t."""

    t: Float[Tensor, " n"]
    z: Complex[Tensor, " n"]
    dz: Complex[Tensor, " n"]  # dz/dt
    weights: Float[Tensor, " n"]  # of the mean over t. Their sum is 1
    integral: Float[Tensor, "n n"]  # from values f at the nodes to ∫ f dt there, up to a constant

    @classmethod
    def on(cls, domain: PlaneDomain, count: int, device: torch.device) -> BoundaryNodes:
        """About `count` nodes: at equal steps of t on an analytic ∂Ω, else on panels."""
        boundary = domain.boundary
        if isinstance(boundary, FourierBoundary):
            count = max(count, len(boundary.coefficients) + 1)
            z, dz, _ = boundary.grid(count)
            t, weights = np.arange(count) / count, np.full(count, 1 / count)
            integral = circulant(_integral_of(np.ones(count, dtype=np.complex128)).real)
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
        velocity: Tensor = (phi(spinors[:, 0], spinors[:, 1]) * self.dz[:, None]).real
        return self.integral @ velocity

    def matched(
        self, spinors: Complex[Tensor, "n 2"], slide: Float[Tensor, " n"], curve: CurveTensors, *, held: bool = False
    ) -> MatchedBoundary:
        """The boundary of the surface with spinors p and q, translated to Γ.

        The search for nearest points of Γ starts at the parameters `slide`. With `held` these parameters are kept.
        """
        position = self.positions(spinors)
        position = position - self.weights @ (position - curve.point_and_derivative(slide)[0])
        for _ in range(0 if held else _CONSTANT_STEPS):
            slide = projected(position, slide, curve, limit=1 / len(self.t))
            position = position - self.weights @ (position - curve.point_and_derivative(slide)[0])
        return MatchedBoundary(position=position, slide=slide, error=position - curve.point_and_derivative(slide)[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedBoundary:
    """The boundary of a surface and the corresponding points of Γ, at the nodes."""

    position: Float[Tensor, "n 3"]  # r
    slide: Float[Tensor, " n"]  # parameters of the corresponding points of Γ
    error: Float[Tensor, "n 3"]  # r − Γ


def move_to(surface: SpinorSurface, z: Complex[Tensor, " n"], position: Float[Tensor, "n 3"]) -> None:
    """Translates a surface in place so that its mean position at points z is the mean of `position`."""
    found = surface.position(z.cpu().numpy())
    with torch.no_grad():
        surface.constant.add_((position - torch.as_tensor(found).to(position)).mean(0))


FORMS = {"spinor": phi, "weierstrass-enneper": weierstrass_phi}  # φ of p and q, or of f and g


class RayBoundary(torch.nn.Module):
    """The boundary r(e^{2πis}) of a surface over the unit disk with r(0) = c, by quadrature along rays."""

    nodes: Tensor
    weights: Tensor

    def __init__(self, network: ComplexMLP, constant: Float[np.ndarray, "3"], form: str, rule: Rule) -> None:
        """A boundary with φ in one of `FORMS` and a rule on [0, 1] for each ray."""
        super().__init__()
        self.network = network
        self.constant = torch.nn.Parameter(torch.tensor(constant))
        self.phi = FORMS[form]
        for name, values in (("nodes", rule.nodes), ("weights", rule.weights)):
            self.register_buffer(name, torch.tensor(values), persistent=False)

    def point_and_velocity(self, s: Float[Tensor, " n"]) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
        """Positions r and derivatives dr/ds, differentiable with respect to the network's parameters."""
        z = _circle(s)
        # the last point is z itself, for the velocity
        null = self._null(torch.cat([z[:, None] * self.nodes, z[:, None]], dim=1))
        position = ((null[:, :-1] * self.weights[:, None]).sum(1) * z[:, None]).real
        return self.constant + position, (2j * math.pi * z[:, None] * null[:, -1]).real

    def differentiable_point_and_velocity(
        self, s: Float[Tensor, " n"]
    ) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
        """Positions r and dr/ds, differentiable with respect to s. The gradient of r is the exact dr/ds."""
        with torch.no_grad():
            position, velocity = self.point_and_velocity(s)
        z = _circle(s)
        live = (2j * math.pi * z[:, None] * self._null(z)).real
        return position + (s - s.detach())[:, None] * velocity, live

    def _null(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 3"]:
        null: Tensor = self.phi(*self.network.value(z).unbind(-1))
        return null


def _circle(s: Float[Tensor, " n"]) -> Complex[Tensor, " n"]:
    return torch.polar(torch.ones_like(s), 2 * math.pi * s)


def _integral_of(spectrum: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, " n"]:
    """∫ f dt at t = j/n from the discrete Fourier transform of samples of f, of mean 0."""
    n = len(spectrum)
    k = np.fft.fftfreq(n, 1 / n)
    inverse = np.zeros(n, dtype=np.complex128)
    np.divide(1, 2j * np.pi * k, out=inverse, where=(k != 0) & (2 * np.abs(k) != n))
    return np.asarray(np.fft.ifft(spectrum * inverse))
