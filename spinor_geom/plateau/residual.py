"""The boundary residual on points that are not the nodes of the fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from spinor_geom.domain.panels import Panels
from spinor_geom.plateau.gauss_newton import Fit
from spinor_geom.plateau.network import Discretisation, interpolate_matching
from spinor_geom.plateau.problem import PlateauProblem, TensorCurve

# Gauss-Newton steps of a projection, and the last one's length from which on more of them change nothing.
_PROJECTION_STEPS, _STILL = 5, 1e-10


@dataclass(frozen=True, kw_only=True, eq=False)
class Residual:
    """Distance of the surface's boundary from Γ, at unit size.

    Attributes:
        rms: root of the mean squared distance by arc length of ∂Ω.
        max: largest distance.
        energy: share of each panel in rms².
    """

    rms: float
    max: float
    energy: Float[np.ndarray, " panels"]


def independent_residual(stage: Discretisation, fit: Fit, *, points: int) -> Residual:
    """Distance to Γ on panels of another order, that share no node with those of the fit.

    Each point is projected on Γ near its matched parameter, not on the nearest part of Γ: a boundary that lies on the
    wrong part of the curve is not excused.

    Args:
        stage: the discretisation.
        fit: its fit.
        points: number of loop points; at least three samples are taken for each.
    """
    count = len(stage.panels.breaks) - 1
    order = max(stage.panels.order + 3, int(np.ceil(3 * points / count)))
    dense = Panels.on(stage.domain.boundary, stage.panels.breaks, order)
    problem = PlateauProblem.on_panels(dense, stage.network, stage.problem.curve, stage.pairs)
    r = problem.positions(fit.readout) + fit.constant
    slide = torch.as_tensor(interpolate_matching(stage.matching(fit), dense.t), device=r.device)
    slide = projected(r, slide, problem.curve, limit=0.5 / len(stage.panels.t))
    square = (r - problem.curve.point_and_derivative(slide)[0]).square().sum(1)
    energy = (problem.arc_weights * square).reshape(count, order).sum(1)
    return Residual(rms=float(energy.sum().sqrt()), max=float(square.max().sqrt()), energy=energy.cpu().numpy())


def projected(
    r: Float[Tensor, "n 3"], slide: Float[Tensor, " n"], curve: TensorCurve, *, limit: float
) -> Float[Tensor, " n"]:
    """Parameters of the points of Γ nearest to given points, by Gauss-Newton steps of at most `limit` from a start."""
    for _ in range(_PROJECTION_STEPS):
        point, tangent = curve.point_and_derivative(slide)
        move = ((r - point) * tangent).sum(1) / tangent.square().sum(1)
        slide = slide + move.clamp(-limit, limit)
        if float(move.abs().max()) < _STILL:
            break
    return slide
