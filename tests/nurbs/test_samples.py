"""Positions on grids against integrals of φ along paths in Ω."""

from functools import cache

import numpy as np
import pytest

import spinor_geom
from spinor_geom import gallery
from spinor_geom.gallery import schwarz
from spinor_geom.nurbs.blocks import Blocks
from spinor_geom.nurbs.rims import Rim
from spinor_geom.nurbs.samples import Samples
from spinor_geom.nurbs.spline_space import SplineSpace
from spinor_geom.plateau.solution import PlateauSolution

CURVES = {"interpolant": gallery.random_curve(2), "network": schwarz.schwarz_d_quadrilateral()}
CURVES |= {"series": gallery.tennis_seam(0.8)}


@cache
def sampled(name: str) -> tuple[PlateauSolution, Blocks, Samples]:
    solution = spinor_geom.solve_plateau(CURVES[name])
    rims = Rim.all_of(solution)
    blocks = Blocks.of(solution.domain, rims)
    return solution, blocks, Samples(surface=solution.array_surface, rims=rims, blocks=blocks, accuracy=1e-9)


@pytest.mark.parametrize("name", CURVES)
def test_positions_are_those_of_the_surface(name: str) -> None:
    solution, blocks, samples = sampled(name)
    space = SplineSpace.on(9, (0.0, 0.125, 0.25, 0.5, 1.0))
    u, v = np.array([0.2, 0.5]), np.array([0.3, 0.8])
    grids = [(quad, u, v, space.breaks) for quad in range(len(blocks.quads))]
    for (quad, *_), (exact, _) in zip(grids, samples.on(grids), strict=True):
        first = None
        if quad < len(blocks.parts):
            start, end = blocks.parts[quad]
            first = samples.rims[0].point(start + u * (end - start))
        z = blocks.grid(quad, u, v, first)
        assert np.abs(exact - solution.array_surface.position(z)).max() < 1e-9 * solution.loop.diagonal


def test_rims_are_moved_to_the_given_curve() -> None:
    solution, blocks, samples = sampled("interpolant")
    u = np.linspace(0, 1, 5)
    ((exact, moved),) = samples.on([(0, u, np.array([0.0, 0.5, 1.0]), (0.0, 1.0))])
    start, end = blocks.parts[0]
    assert np.array_equal(moved[:, 0], solution.curve.point(start + u * (end - start)))
    assert np.array_equal(moved[:, 2], exact[:, 2])
    assert np.abs(moved - exact).max() <= solution.boundary_residual.max * 1.01
