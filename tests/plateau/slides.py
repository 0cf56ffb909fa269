"""Curves and domains for tests of Douglas's slide and of what is made from it, on the CPU."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from spinor_geom.domain import FourierBoundary
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.problem import CurveTensors

CPU = torch.device("cpu")
DISK = DirichletForm.of_disk(64)
# r = 1 + 0.8 cos 2θ + 0.05 sin θ: a waist of a fifth of the width
PEANUT = FourierBoundary(np.array([0, 0, 0, 0.4, 0.025j, 1, -0.025j, 0.4, 0]), 64)


def ellipse(ratio: float, count: int = 64) -> FourierBoundary:
    """The ellipse with half-axes `ratio` and 1 by its own angle."""
    return FourierBoundary(np.array([(ratio - 1) / 2, 0, (ratio + 1) / 2]), count)


def form_of(boundary: FourierBoundary, n: int) -> DirichletForm:
    """Λ of any domain."""
    return DirichletForm.of(boundary, n, CPU)


def even(n: int) -> Float[Tensor, " n"]:
    """n equal steps."""
    return torch.arange(n, dtype=torch.float64) / n


def tensors(loop: BoundaryLoop) -> CurveTensors:
    """Γ of a loop."""
    return CurveTensors.of(BoundaryCurve.from_loop(loop), CPU)


def increments(slide: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Steps of a slide around the circle."""
    return torch.diff(slide, append=slide[:1] + 1)
