"""A cable at the free edge of a film that is not plane: its curvature is constant."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.polynomial import Legendre

import spinor_geom


@pytest.mark.slow
def test_cable_of_a_skew_frame_has_constant_curvature():
    tension, count, terms = 1.5, 24, 7
    slopes = [Legendre.basis(k, domain=[0, 1]) for k in range(1, terms + 1)]
    x = (1 - np.cos(np.pi * np.arange(count) / count)) / 2
    nodes, weights = np.polynomial.legendre.leggauss(30)
    nodes, weights = (nodes + 1) / 2, torch.tensor(weights / 2)
    heights, rises, bends = (
        torch.tensor(np.stack([one(at) for one in functions], axis=1))
        for functions, at in (
            ([slope.integ(lbnd=0) for slope in slopes], x),
            (slopes, nodes),
            ([slope.deriv() for slope in slopes], nodes),
        )
    )
    sides = torch.tensor([[1, 0, 0], [1, 1, 0.5], [0, 1, 0]], dtype=torch.float64)
    shape = torch.zeros(terms, 2, dtype=torch.float64, requires_grad=True)
    stiffness = tension / (2 * torch.arange(1, terms + 1) + 1)[:, None]
    for _ in range(6):
        frame = torch.cat([torch.cat([torch.tensor(x)[:, None], heights @ shape], dim=1), sides])
        film = spinor_geom.minimal_area(frame, corners=[0, count, count + 1, count + 2], tolerance=1e-5)
        length = weights @ (1 + (rises @ shape).square().sum(dim=1)).sqrt()
        (gradient,) = torch.autograd.grad(film + tension * length, shape)
        with torch.no_grad():
            shape -= gradient / stiffness
    with torch.no_grad():
        first = torch.nn.functional.pad(rises @ shape, (1, 0), value=1.0)
        second = torch.nn.functional.pad(bends @ shape, (1, 0))
        curvature = torch.linalg.cross(first, second).norm(dim=1) / first.norm(dim=1) ** 3
        error = (weights @ (tension * curvature - 1) ** 2).sqrt()
    assert shape[:, 1].abs().max() > 0.01  # it is not plane
    # polynomials of degree 8, near the corners
    assert error < 5e-4
