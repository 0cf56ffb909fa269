"""The boundary residual on points that are not the nodes of the fit."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from spinor_geom.domain.panels import Panels
from spinor_geom.plateau.gauss_newton import Fit
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.network import Discretisation
from spinor_geom.plateau.problem import PlateauProblem, TensorCurve

# Gauss-Newton steps from a matched point of Γ to the nearest one: two or three are taken where they are not far apart.
_PROJECTIONS = 5


def independent_residual(
    stage: Discretisation, fit: Fit, *, points: int
) -> tuple[Misfit, Float[np.ndarray, " panels"]]:
    """Distance to Γ on panels of another order, that share no node with those of the fit.

    Each point is projected on Γ near its matched parameter, not on the nearest part of Γ: a boundary that lies on the
    wrong part of the curve is not excused.

    Returns:
        The misfit of all rims, and the integral of the squared distance over each panel by arc length of ∂Ω, which has
        length 1 there.
    """
    count = len(stage.panels.ends)
    order = max(stage.panels.order + 3, int(np.ceil(3 * points / count)))
    dense = Panels.around(stage.domain, stage.panels.rim_breaks, order)
    problem = PlateauProblem.on_panels(stage.domain, dense, stage.network, stage.problem.curves, stage.pairs)
    velocity = problem.velocities(fit.readout)
    r = problem.integrate(velocity).real + fit.constant
    slide = torch.as_tensor(stage.matched(fit, dense), device=r.device)
    squares, rims = [], []
    for position, parameter, curve in zip(problem.by_rim(r), problem.by_rim(slide), problem.curves, strict=True):
        parameter = projected(position, parameter, curve, limit=0.5 / len(stage.panels.t))
        squares.append((position - curve.point_and_derivative(parameter)[0]).square().sum(1))
        rims.append(Misfit.of(position, parameter, curve))
    misfit = Misfit.together(rims)
    # closing it moves the boundary by about as much
    gap = float(problem.around_hole(velocity).real.norm())
    energy = (problem.arc_weights * torch.cat(squares)).reshape(count, order).sum(1)
    return misfit.and_astray(gap), energy.cpu().numpy()


def projected(
    r: Float[Tensor, "n 3"], slide: Float[Tensor, " n"], curve: TensorCurve, *, limit: float
) -> Float[Tensor, " n"]:
    """Parameters of the points of Γ nearest to given points, by Gauss-Newton steps of at most `limit` from a start."""
    for _ in range(_PROJECTIONS):
        point, tangent = curve.point_and_derivative(slide)
        move = ((r - point) * tangent).sum(1) / tangent.square().sum(1)
        slide = slide + move.clamp(-limit, limit)
        if float(move.abs().max()) < torch.finfo(move.dtype).eps ** 0.5:  # nothing is left of the next step
            break
    return slide
