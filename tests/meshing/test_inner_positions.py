"""Positions of a patch's inner points, by quadrature along its edges where the surface has no closed ones."""

import numpy as np
import pytest
import torch

from spinor_geom.domain import FourierBoundary, PlaneDomain
from spinor_geom.domain.triangulation import triangulate_polygon
from spinor_geom.holomorphic import interpolant
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.meshing import embed
from spinor_geom.meshing.embed import inner_positions
from spinor_geom.surface import SpinorSurface

BOUNDARY = FourierBoundary(np.array([0.1j, 0.6, 0.2, 1.5, 0.1]), 64)


@pytest.fixture(scope="module")
def surface():
    z, dz, _ = (torch.from_numpy(row) for row in BOUNDARY.grid(192))
    model = CauchyInterpolant(z, dz, torch.stack([torch.exp(z), 0.3 * z - 0.2], dim=-1))
    return SpinorSurface(model, PlaneDomain.inside(BOUNDARY), (1.0, 2.0, 3.0))


@pytest.fixture(scope="module")
def plane():
    return triangulate_polygon(BOUNDARY.point(np.arange(80) / 80), lambda z: np.full(len(z), 0.1))


def test_positions_are_those_of_the_surface(surface, plane):
    expected = surface.position(plane.points[80:])
    # 1e-8 of an edge beside the boundary, more digits inside
    assert np.abs(inner_positions(surface, plane) - expected).max() < 1e-9


def test_positions_do_not_depend_on_how_many_edges_are_taken_at_once(surface, plane, monkeypatch):
    together = inner_positions(surface, plane)
    monkeypatch.setattr(embed, "EDGES_AT_ONCE", 17)
    np.testing.assert_allclose(inner_positions(surface, plane), together, rtol=0, atol=1e-13)


def test_positions_by_the_fast_sums(surface, plane, monkeypatch):
    directly = inner_positions(surface, plane)
    monkeypatch.setattr(interpolant, "_MANY", 0)
    np.testing.assert_allclose(inner_positions(surface, plane), directly, rtol=0, atol=1e-11)
