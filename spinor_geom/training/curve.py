"""Closed curves as training takes them: three functions of a parameter, exact or a spline."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.problem import CurveTensors

# points that the bounding box of a curve is taken from
_POINTS = 1024


class ClosedCurve(Protocol):
    """Γ(s) with period 1: a `BoundaryCurve`, a curve of the gallery, or any object with these three functions."""

    def point(self, s: Float[np.ndarray, "*pts"], /) -> Float[np.ndarray, "*pts 3"]:
        """Γ(s)."""
        ...

    def derivative(self, s: Float[np.ndarray, "*pts"], /) -> Float[np.ndarray, "*pts 3"]:
        """Γ′(s)."""
        ...

    def second_derivative(self, s: Float[np.ndarray, "*pts"], /) -> Float[np.ndarray, "*pts 3"]:
        """Γ″(s)."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveAsTensors:
    """Γ on tensors of any device, evaluated by numpy.

    Attributes:
        curve: Γ.
        scale: by which it is multiplied.
        diagonal: of the bounding box of the scaled curve.
    """

    curve: ClosedCurve
    scale: float
    diagonal: float

    @classmethod
    def of(cls, curve: ClosedCurve) -> CurveAsTensors:
        """The curve itself; its bounding box is that of some points."""
        points = curve.point(np.arange(_POINTS) / _POINTS)
        return cls(curve=curve, scale=1.0, diagonal=float(np.linalg.norm(np.ptp(points, axis=0))))

    def scaled(self, factor: float) -> CurveAsTensors:
        """The curve times a factor."""
        return CurveAsTensors(curve=self.curve, scale=factor * self.scale, diagonal=factor * self.diagonal)

    def point(self, s: Float[Tensor, " n"]) -> Float[Tensor, "n 3"]:
        """Γ(s), without gradients."""
        return self._at(s)[0]

    def point_and_derivative(self, s: Float[Tensor, " n"]) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
        """Γ(s) and Γ′(s); differentiable by s."""
        value, first = self._at(s)
        if not s.requires_grad:
            return value, first
        second = self.scale * torch.as_tensor(self.curve.second_derivative(_parameters(s))).to(s)
        # the value is exact, and the gradient that of the curve: s − s is 0 with derivative 1
        step = (s - s.detach())[..., None]
        return value + step * first, first + step * second

    def local_edge(self, s: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """Mean length of the loop's edge at Γ(s) and its two neighbours; infinite where Γ is through no loop."""
        if not isinstance(self.curve, BoundaryCurve):
            return torch.full_like(s, torch.inf)
        return self.scale * CurveTensors.of(self.curve, s.device).local_edge(s)

    def _at(self, s: Float[Tensor, " n"]) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
        t = _parameters(s)
        value, first = (torch.as_tensor(f(t)).to(s) for f in (self.curve.point, self.curve.derivative))
        return self.scale * value, self.scale * first


def _parameters(s: Float[Tensor, " n"]) -> Float[np.ndarray, " n"]:
    return np.asarray(np.mod(s.detach().cpu().double().numpy(), 1.0))
