"""The boundary residual on points that are not the nodes of the fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from spinor_geom.domain.panels import Panels
from spinor_geom.plateau.gauss_newton import Fit
from spinor_geom.plateau.network import Discretisation
from spinor_geom.plateau.problem import PlateauProblem, TensorCurve

# Gauss-Newton steps of a projection, and the last one's length from which on more of them change nothing.
_PROJECTION_STEPS, _STILL = 5, 1e-10
# A piece of Γ so many times longer than the step of the boundary beside it is passed over; points it is seen at.
_PASSED_OVER, _POINTS_PASSED = 1.5, 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Residual:
    """Distance of the surface's boundary from Γ, at unit size.

    Attributes:
        rms: root of the mean squared distance by arc length of the surface's boundary.
        max: largest distance.
        energy: integral of the squared distance over each panel by arc length of ∂Ω, which has length 1 there.
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
    count = len(stage.panels.ends)
    order = max(stage.panels.order + 3, int(np.ceil(3 * points / count)))
    dense = Panels.around(stage.domain, stage.panels.rim_breaks, order)
    problem = PlateauProblem.on_panels(dense, stage.network, stage.problem.curves, stage.pairs, stage.way)
    velocity = problem.velocities(fit.readout)
    r = problem.integrate(velocity).real + fit.constant
    slide = torch.as_tensor(stage.matched(fit, dense), device=r.device)
    # where a boundary runs off it is long
    length = (problem.weights * velocity.real.norm(dim=1))[: problem.nodes]
    squares, passed = [], []
    rims = zip(*(problem.by_rim(part) for part in (r, slide, length)), problem.curves, strict=True)
    for position, parameter, weight, curve in rims:
        parameter = projected(position, parameter, curve, limit=0.5 / len(stage.panels.t))
        error = position - curve.point_and_derivative(parameter)[0]
        over = passed_over(position, parameter, error, curve)
        squares.append(error.square().sum(1))
        passed.append((float(weight.sum()), over))
    square = torch.cat(squares)
    mean = float(length @ square / length.sum())
    mean += sum(share * over.mean_square for share, over in passed) / float(length.sum())
    # closing it moves the boundary by about as much
    mean += float(problem.around_hole(velocity).real.square().sum())
    return Residual(
        rms=mean**0.5,
        max=max(float(square.max().sqrt()), *(over.max for _, over in passed)),
        energy=(problem.arc_weights * square).reshape(count, order).sum(1).cpu().numpy(),
    )


@dataclass(frozen=True, kw_only=True)
class PassedOver:
    """Parts of Γ that a boundary near to it leaves out.

    Attributes:
        mean_square: integral of their squared distance from the boundary over the parameter of Γ, which is about 1.
        max: largest distance.
    """

    mean_square: float
    max: float


def passed_over(
    r: Float[Tensor, "n 3"], slide: Float[Tensor, " n"], error: Float[Tensor, "n 3"], curve: TensorCurve
) -> PassedOver:
    """The parts of Γ that are much longer than the boundary beside them.

    The boundary's points tell how far it is from Γ. Where Γ has a finger that ∂Ω does not resolve the boundary passes
    over that, near to Γ everywhere.

    Args:
        r: closed sequence of points of the boundary.
        slide: the parameters of their nearest points.
        error: r − Γ(slide).
        curve: Γ.
    """
    step, chord = torch.diff(slide, append=slide[:1] + 1), r.roll(-1, 0) - r
    speed = curve.point_and_derivative(slide)[1].norm(dim=-1)
    arc = step * torch.maximum(speed, speed.roll(-1))
    over = (arc > _PASSED_OVER * chord.norm(dim=-1) + error.norm(dim=-1)).nonzero()[:, 0]
    if not len(over):
        return PassedOver(mean_square=0.0, max=0.0)
    part = (torch.arange(_POINTS_PASSED, dtype=step.dtype, device=step.device) + 0.5) / _POINTS_PASSED
    passed, _ = curve.point_and_derivative((slide[over, None] + step[over, None] * part).flatten())
    away = passed.reshape(len(over), -1, 3) - r[over, None]
    beside = chord[over, None]
    along = ((away * beside).sum(-1) / beside.square().sum(-1)).clamp(0, 1)
    missed = (away - along[..., None] * beside).square().sum(-1)
    return PassedOver(mean_square=float(step[over] @ missed.mean(1)), max=float(missed.max().sqrt()))


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
