import numpy as np
import pytest

from spinor_geom.domain.sizes import EdgeLengths
from spinor_geom.meshing.triangulate import Piece, size_field
from tests.exact_solutions import ENNEPER, PLANE, exact_solution
from tests.fill.shapes import on_circle


def patch_size_field(surface, boundary, target):
    samples = surface.domain.triangulation.points
    factor, area = surface.conformal_factor(samples), surface.area()
    piece = Piece(rims=[boundary], samples=samples, factor=factor, lengths=EdgeLengths(target), area=area)
    return size_field(piece).over(boundary).sizes


def test_size_is_target_over_stretch_inside():
    surface = exact_solution(ENNEPER, 200).surface
    z = 0.5 * on_circle(7)
    # λ = 1 + |z|² between samples that are a few hundredths apart
    assert patch_size_field(surface, on_circle(200), 0.02)(z) == pytest.approx(np.full(7, 0.02 / 1.25), rel=0.05)


def test_size_grows_and_falls_no_faster_than_allowed():
    surface = exact_solution(PLANE, 60).surface
    edge, z = abs(on_circle(60)[1] - 1), np.linspace(1, 0.5, 30) + 0j
    coarse, fine = (patch_size_field(surface, on_circle(60), target)(z) for target in (100.0, 1e-6))
    assert coarse == pytest.approx(edge + 0.35 * (1 - z.real), rel=1e-6)
    assert fine == pytest.approx(np.maximum(edge - 0.5 * (1 - z.real), 1e-6), rel=1e-6)


def test_branch_point_does_not_ask_for_endless_edges():
    surface = exact_solution(((0, 0), (1, 0)), 60).surface  # p = z, q = 0
    size = patch_size_field(surface, on_circle(60), 0.01)(np.array([0j, 0.01]))
    assert np.isfinite(size).all()
    assert (size > 0).all()
