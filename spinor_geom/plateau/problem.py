"""Plateau's problem as tensors: the border between numpy geometry and torch functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from spinor_geom.domain.panels import Panels
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.corners import CornerPairs
from spinor_geom.surface.formulas import phi


class TensorCurve(Protocol):
    """A closed curve in space with period 1, on tensors."""

    def point_and_derivative(self, s: Float[Tensor, " n"], /) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
        """Γ(s) and Γ'(s)."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveTensors:
    """Γ as tensors, or several curves as a batch, the shorter ones filled up.

    Attributes:
        breaks: (*batch, M + 1); 2 after the last break of a shorter curve.
        coefficients: (d + 1, *batch, M, 3), highest power first; 0 above the degree of a curve of a lower one.
        slopes: the same for Γ′ where it comes from a formula of one curve.
    """

    breaks: Float[Tensor, "*batch m1"]
    coefficients: Float[Tensor, "d1 *batch m 3"]
    slopes: Float[Tensor, "d1 *batch m 3"] | None = None

    @classmethod
    def of(cls, curve: BoundaryCurve, device: torch.device) -> CurveTensors:
        """The curve on a device."""
        return cls(
            breaks=torch.tensor(curve.breaks, device=device),
            coefficients=torch.tensor(curve.coefficients, device=device),
            slopes=None if curve.slopes is None else torch.tensor(curve.slopes, device=device),
        )

    @classmethod
    def batch(cls, curves: Sequence[CurveTensors]) -> CurveTensors:
        """Several curves, each without a batch, as one batch; one alone keeps its own Γ′."""
        if len(curves) == 1:
            (curve,) = curves
            slopes = None if curve.slopes is None else curve.slopes[:, None]
            return cls(breaks=curve.breaks[None], coefficients=curve.coefficients[:, None], slopes=slopes)
        most = max(len(curve.breaks) for curve in curves)
        highest = max(len(curve.coefficients) for curve in curves)
        breaks = [torch.nn.functional.pad(curve.breaks, (0, most - len(curve.breaks)), value=2.0) for curve in curves]
        coefficients = [
            torch.nn.functional.pad(
                curve.coefficients, (0, 0, 0, most - len(curve.breaks), highest - len(curve.coefficients), 0)
            )
            for curve in curves
        ]
        return cls(breaks=torch.stack(breaks), coefficients=torch.stack(coefficients, dim=1))

    def at(self, which: Int[Tensor, " k"]) -> CurveTensors:
        """Some curves of a batch."""
        slopes = None if self.slopes is None else self.slopes[:, which]
        return CurveTensors(breaks=self.breaks[which], coefficients=self.coefficients[:, which], slopes=slopes)

    @cached_property
    def _last_piece(self) -> Int[Tensor, "*batch 1"]:
        return (self.breaks <= 1).sum(-1, keepdim=True) - 2

    @cached_property
    def _first_piece(self) -> Int[Tensor, "*batch 1"]:
        """Number of each curve's first piece among the pieces of all."""
        shape = self.breaks.shape[:-1]
        number = torch.arange(shape.numel(), device=self.breaks.device) * (self.breaks.shape[-1] - 1)
        return number.reshape(*shape, 1)

    @cached_property
    def _starts(self) -> Float[Tensor, " k"]:
        return self.breaks[..., :-1].flatten()

    def point_and_derivatives(
        self, s: Float[Tensor, "*pts"]
    ) -> tuple[Float[Tensor, "*pts 3"], Float[Tensor, "*pts 3"], Float[Tensor, "*pts 3"]]:
        """Γ(s), Γ'(s) and Γ''(s); s is taken modulo 1, of shape (*batch, n) for a batch."""
        s = torch.remainder(s, 1.0)
        piece = torch.minimum((torch.searchsorted(self.breaks, s, right=True) - 1).clamp(min=0), self._last_piece)
        piece = piece + self._first_piece
        h = (s - self._starts[piece])[..., None]
        value, first, second = _horner(self.coefficients, piece, h)
        if self.slopes is None:
            return value, first, second
        first, second, _ = _horner(self.slopes, piece, h)
        return value, first, second

    def point_and_derivative(self, s: Float[Tensor, "*pts"]) -> tuple[Float[Tensor, "*pts 3"], Float[Tensor, "*pts 3"]]:
        """Γ(s) and Γ'(s); s is taken modulo 1."""
        point, first, _ = self.point_and_derivatives(s)
        return point, first


def _horner(
    coefficients: Float[Tensor, "d1 *batch m 3"], piece: Int[Tensor, "*pts"], h: Float[Tensor, "*pts 1"]
) -> tuple[Float[Tensor, "*pts 3"], Float[Tensor, "*pts 3"], Float[Tensor, "*pts 3"]]:
    """Value, first and second derivative of polynomials at h."""
    local = coefficients.reshape(len(coefficients), -1, 3)[:, piece]
    value = local[0]
    first = second = torch.zeros_like(value)
    for coefficient in local[1:]:
        second = second * h + first
        first = first * h + value
        value = value * h + coefficient
    return value, first, 2 * second


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateauProblem:
    """Γ, the nodes on ∂Ω, and the features of the model there.

    Attributes:
        curve: Γ.
        features: (nodes, n), the model's hidden layer at the nodes.
        dz: (nodes,), dz/dt.
        weights: (nodes,), quadrature weights in t.
        widths: (panels,), lengths of the panels in t.
        cumulative: (order, order), integration matrix of a panel of length 1.
        slide_bounds: (nodes, 2), lowest and highest curve parameter of each node.
        fields: (nodes, k), fields along which Ω may move to change its moduli.
    """

    curve: CurveTensors
    features: Complex[Tensor, "nodes n"]
    dz: Complex[Tensor, " nodes"]
    weights: Float[Tensor, " nodes"]
    widths: Float[Tensor, " panels"]
    cumulative: Float[Tensor, "order order"]
    slide_bounds: Float[Tensor, "nodes 2"]
    fields: Complex[Tensor, "nodes k"]

    @classmethod
    def on_panels(
        cls, panels: Panels, network: CauchyNetwork, curve: CurveTensors, pairs: CornerPairs
    ) -> PlateauProblem:
        """The problem with the nodes of given panels, on a domain that does not move."""
        device = network.poles.device
        z = torch.tensor(panels.z, device=device)
        with torch.no_grad():
            features = network.features(z)
        return cls(
            curve=curve,
            features=features,
            dz=torch.tensor(panels.dz, device=device),
            weights=torch.tensor(panels.weights, device=device),
            widths=torch.tensor(np.diff(panels.breaks), device=device),
            cumulative=torch.tensor(panels.cumulative, device=device),
            slide_bounds=torch.tensor(pairs.slide_bounds(panels.t), device=device),
            fields=torch.zeros(len(z), 0, dtype=z.dtype, device=device),
        )

    @property
    def arc_weights(self) -> Float[Tensor, " nodes"]:
        """Weights of the mean by arc length of ∂Ω; their sum is 1."""
        weights = self.weights * self.dz.abs()
        return weights / weights.sum()

    def integrate(self, f: Complex[Tensor, "nodes k"]) -> Complex[Tensor, "nodes k"]:
        """∫ f dt from the start of the first panel to each node."""
        panels, order = len(self.widths), len(self.cumulative)
        by_panel = f.reshape(panels, order, -1)
        local = (self.cumulative.to(f.dtype) @ by_panel) * self.widths[:, None, None]
        total = (self.weights.reshape(panels, 1, order).to(f.dtype) @ by_panel)[:, 0].cumsum(0)
        start = torch.cat([torch.zeros_like(total[:1]), total[:-1]])
        return (local + start[:, None]).reshape(f.shape)

    def positions(self, readout: Complex[Tensor, "n 2"]) -> Float[Tensor, "nodes 3"]:
        """Positions r at the nodes, up to a constant: the real part of ∫ φ dz along ∂Ω."""
        return self.integrate(self.velocities(readout)).real

    def velocities(self, readout: Complex[Tensor, "n 2"]) -> Complex[Tensor, "nodes 3"]:
        """φ dz/dt at the nodes; its real part is dr/dt."""
        return self.null_curve(readout) * self.dz[:, None]

    def null_curve(self, readout: Complex[Tensor, "n 2"]) -> Complex[Tensor, "nodes 3"]:
        """φ at the nodes."""
        p, q = (self.features @ readout).unbind(-1)
        return phi(p, q)

    def moved(self, readout: Complex[Tensor, "n 2"]) -> Float[Tensor, "nodes 3 k"]:
        """Change of r at the nodes when they move along each field: Re(φ v)."""
        return (self.null_curve(readout)[:, :, None] * self.fields[:, None, :]).real
