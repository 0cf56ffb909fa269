"""The paper's losses between two closed curves, as means over samples of [0, 1]."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def distance_loss(x: Float[Tensor, "n 3"], y: Float[Tensor, "n 3"]) -> Float[Tensor, ""]:
    """∫ |x − y|² dt by the mean over samples, in squared units of space.

    Source: Sun & Chern (2026), L_distance.
    """
    return (x - y).square().sum(-1).mean()


def tangent_loss(v: Float[Tensor, "n 3"], w: Float[Tensor, "n 3"]) -> Float[Tensor, ""]:
    """∫ 1 − v·w/(|v||w|) dt by the mean over samples of two curves' velocities: from 0 to 2, without a unit.

    Source: Sun & Chern (2026), L_tangent.
    """
    return (1 - torch.nn.functional.cosine_similarity(v, w, dim=-1)).mean()


def boundary_loss(
    x: Float[Tensor, "n 3"],
    v: Float[Tensor, "n 3"],
    y: Float[Tensor, "n 3"],
    w: Float[Tensor, "n 3"],
    *,
    tangent_weight: float,
) -> Float[Tensor, ""]:
    """L = L_distance + λ L_tangent.

    Args:
        x: points of the one curve.
        v: its velocities there.
        y: points of the other.
        w: its velocities.
        tangent_weight: λ.
    """
    distance = distance_loss(x, y)
    return distance + tangent_weight * tangent_loss(v, w) if tangent_weight else distance
