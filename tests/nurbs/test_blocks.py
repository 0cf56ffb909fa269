"""Quadrilaterals that cover Ω, by the area that their sides enclose."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from jaxtyping import Complex, Float
from numpy.typing import ArrayLike

from spinor_geom import solve_plateau
from spinor_geom.domain.delaunay import cross
from spinor_geom.errors import DomainError
from spinor_geom.gallery import curves
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.nurbs.blocks import Blocks, _Ring
from spinor_geom.nurbs.rims import Rim
from spinor_geom.plateau.solution import PlateauSolution
from tests.fill.shapes import circle

PARAMETERS = np.linspace(0, 1, 17)


@cache
def annulus() -> PlateauSolution:
    rims = [circle(32, height=height) for height in (0.0, 0.5)]
    solution = solve_plateau([BoundaryLoop.from_points(rim, corners=()) for rim in rims])
    assert isinstance(solution, PlateauSolution)
    return solution


def plane_polygon(corners: ArrayLike) -> BoundaryLoop:
    z = np.asarray(corners, dtype=np.complex128)
    return BoundaryLoop.from_points(np.column_stack([z.real, z.imag, 0 * z.real]), corners=range(len(z)))


CASES = {
    "disk": (lambda: solve_plateau(curves.tennis_seam()), 5),
    "L": (lambda: solve_plateau(curves.l_shape()), 8),
    "annulus": (annulus, 24),
    "ragged": (lambda: solve_plateau("data/demosthenes_low_res.obj"), 101),
    "narrow in places": (lambda: solve_plateau(curves.random_curve(0)), 30),
}


def areas(solution: PlateauSolution) -> tuple[Blocks, float, float, float]:
    """The blocks, their least Jacobian and their total area, and the area of Ω."""
    rims = Rim.all_of(solution)
    blocks = Blocks.of(solution.domain, rims)
    least, total = np.inf, 0.0
    for quad in range(len(blocks.quads)):
        first = None
        if quad < len(blocks.parts):
            start, end = blocks.parts[quad]
            first = rims[blocks.rim_of(quad)].point(start + PARAMETERS * (end - start))
        z = blocks.grid(quad, PARAMETERS, PARAMETERS, first)
        cells = cross(z[1:, 1:] - z[:-1, :-1], z[:-1, 1:] - z[1:, :-1]) / 2
        least, total = min(least, cells.min()), total + cells.sum()
    t = np.linspace(0, 1, 20001)
    outline = [rim.boundary.point(t) for rim in rims]
    return blocks, least, total, sum(float(np.sum(cross(z[:-1], z[1:]))) / 2 for z in outline)


SLOW = ("ragged", "narrow in places")


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in CASES])
def test_blocks_cover_the_domain_once(name: str) -> None:
    solve, most = CASES[name]
    blocks, least, total, area = areas(solve())
    assert least > 0
    assert abs(total / area - 1) < 2e-2  # the sides on ∂Ω are 16 chords each
    assert len(blocks.quads) <= most


def test_every_side_is_shared_or_on_the_boundary() -> None:
    blocks, *_ = areas(annulus())
    sides = np.stack([blocks.quads, np.roll(blocks.quads, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, times = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    assert (times == 1).sum() == len(blocks.parts)
    assert times.max() == 2


def test_regions_with_too_many_corners_for_quadrilaterals_are_triangulated() -> None:
    turn = np.exp(2j * np.pi * np.arange(120) / 120) * np.tile([1.0, 0.98], 60)
    blocks, least, total, area = areas(solve_plateau(plane_polygon(turn)))
    assert len(blocks.quads) == 2 * 120 + 3 * 118
    assert least > 0
    assert abs(total / area - 1) < 1e-6  # the outline is sampled at 20,001 points, which are not the corners


def test_a_domain_that_is_too_narrow_is_an_error() -> None:
    solution = solve_plateau(plane_polygon([0, 1, 1 + 1e-3j]))
    with pytest.raises(DomainError, match="too narrow"):
        Blocks.of(solution.domain, Rim.all_of(solution))


def test_rims_that_run_back_and_forth_are_an_error_after_few_rounds() -> None:
    class BackAndForth(Rim):
        def derivative(self, x: Float[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
            return super().derivative(x) * np.where(np.sin(1e6 * x) > 0, 1, -1)

    solution, sizes = solve_plateau(curves.tennis_seam()), []
    (rim,) = Rim.all_of(solution)
    halved = _Ring.halved

    def counted(self: _Ring, *rest: Any) -> _Ring:
        sizes.append(len(self))
        return halved(self, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_Ring, "halved", counted)
        with pytest.raises(DomainError, match="too far from its curve"):
            Blocks.of(solution.domain, [BackAndForth(match=rim.match, start=rim.start, primitive=rim.primitive)])
    assert max(sizes) < 1024
