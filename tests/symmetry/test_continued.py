"""Schwarz's surfaces from their pieces: areas of cells, meshes, patches and solids of continued surfaces."""

from functools import cache

import numpy as np
import pytest
from scipy.special import ellipk

from spinor_geom import ContinuedSurface, OpenCurve, PlateauSolution, gallery, solve_plateau
from spinor_geom.errors import OptionError
from spinor_geom.mesh.topology import HalfEdges, boundary_edges
from tests.closed import is_watertight

ORIGIN = np.zeros(3)
K, K_PRIME = ellipk(0.25), ellipk(0.75)
# area / volume^(2/3) of the cubic cell of P, of twice 2 × 2 × 2 cells of D
P, D = 3 * K / K_PRIME, 12 * K_PRIME / K / 16 ** (2 / 3)


@cache
def p_quadrilateral() -> PlateauSolution:
    found = solve_plateau(gallery.schwarz_p_quadrilateral())
    assert isinstance(found, PlateauSolution)
    return found


@cache
def d_quarter() -> PlateauSolution:
    """A quarter of the film over four edges of a tetrahedron: one edge with its ends on two planes."""
    edge = np.array([[1, 1, 1], [1, -1, -1]]) / np.sqrt(8)
    found = solve_plateau(edge, mirror=[(ORIGIN, (1, 0, 1)), (ORIGIN, (1, 0, -1))])
    assert isinstance(found, PlateauSolution)
    return found


@cache
def p_triangle() -> PlateauSolution:
    found = solve_plateau(OpenCurve([ORIGIN, [0.5, 0.5, 0], [0, 1, 0]], corners=[1]), mirror=[(ORIGIN, (1, 0, -1))])
    assert isinstance(found, PlateauSolution)
    return found


@pytest.mark.parametrize(
    ("piece", "count", "ratio"), [(p_quadrilateral, 24, P), (p_triangle, 48, P), (d_quarter, 48, D)]
)
def test_the_cell_of_a_schwarz_surface_has_its_known_area(piece: object, count: int, ratio: float) -> None:
    cell = piece().continued("cell")
    assert len(cell.copies) == count
    assert cell.lattice.shape == (3, 3)
    volume = abs(np.linalg.det(cell.lattice))
    assert cell.area / volume ** (2 / 3) == pytest.approx(ratio, rel=1e-9)


def continuations() -> list[ContinuedSurface]:
    return [p_quadrilateral().continued(1), d_quarter().continued(1), d_quarter().continued("cell")]


def test_the_mesh_of_a_continuation_is_oriented_and_joined_at_sides() -> None:
    for one in continuations():
        piece, mesh = one.solution.continued(0).mesh(0.1), one.mesh(0.1)
        edges = HalfEdges.of(mesh.faces)
        assert len(mesh.faces) == len(one.copies) * len(piece.faces)
        assert (edges.counts <= 2).all()
        assert not edges.is_open[edges.twin >= 0].any()
        assert len(boundary_edges(mesh.faces)) < len(one.copies) * len(boundary_edges(piece.faces))


def test_the_patches_of_a_continuation_are_smooth_across_common_sides() -> None:
    for one in continuations()[:2]:
        surface = one.to_nurbs(tolerance=1e-5)
        assert surface.area == pytest.approx(one.area, rel=1e-6)
        assert surface.deviations.normals < 0.1  # degrees
        for seam in surface.seams:
            ends = [surface.patches[patch].side(side).control_points for patch, side in (seam.first, seam.second)]
            np.testing.assert_array_equal(ends[0], ends[1][::-1] if seam.reversed else ends[1])
        for rim in surface.boundary_curves:
            for curve, after in zip(rim, [*rim[1:], rim[0]], strict=True):
                np.testing.assert_array_equal(curve.ends[1], after.ends[0])
        # as many sides are joined as in the mesh
        mesh = one.mesh()
        length = np.linalg.norm(np.diff(mesh.vertices[boundary_edges(mesh.faces)], axis=1), axis=2).sum()
        sides = [curve.point(np.linspace(0, 1, 50)) for rim in surface.boundary_curves for curve in rim]
        lengths = [np.linalg.norm(np.diff(side, axis=0), axis=1).sum() for side in sides]
        assert sum(lengths) == pytest.approx(length, rel=0.02)


def test_the_solid_of_a_continuation_is_watertight() -> None:
    for one in [*continuations(), p_quadrilateral().continued(), p_triangle().continued()]:
        solid = one.solid(0.02, target_edge_length=0.1, edge="straight")
        assert is_watertight(solid.faces)
        assert solid.intersections == 0
        assert solid.volume == pytest.approx(0.02 * one.area, rel=0.02)


def test_what_cannot_be_a_solid_or_has_too_many_copies_is_refused() -> None:
    neighbours = d_quarter().continued(1)
    for thickness in (0, -1):
        with pytest.raises(OptionError, match="thickness must be a positive number"):
            neighbours.solid(thickness)
    with pytest.raises(OptionError, match="edge must be one of"):
        neighbours.solid(0.1, edge="sharp")  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="more than 1000 copies are reached across 100 sides"):
        d_quarter().continued(100)


def test_a_surface_without_symmetric_sides_cannot_be_continued() -> None:
    with pytest.raises(OptionError, match="no side of the surface is straight"):
        solve_plateau(gallery.tennis_seam(0.8)).continued()


def test_a_continuation_that_is_branched_or_overlaps_is_refused() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1.2, 1, 0.5], [0, 1, 0]])
    with pytest.raises(OptionError, match="does not divide 180°"):
        solve_plateau(gallery.polygon(square)).continued()
    e = np.eye(3)
    # half of the hexagon of P, which has a symmetry of order 3
    half = solve_plateau(OpenCurve([e[1], e[2], -e[0], -e[1]], corners=[1, 2]), mirror=[(ORIGIN, (1, 0, -1))])
    with pytest.raises(OptionError, match="copies overlap"):
        half.continued()


def test_a_surface_without_periods_is_continued_as_a_whole() -> None:
    t = np.pi * (np.arange(41) / 40 - 0.5)
    arc = np.column_stack([np.cos(t), np.sin(t), 0.3 * np.cos(2 * t)])
    arc[[0, -1], 0] = 0
    half = solve_plateau(arc, mirror=[(ORIGIN, (1, 0, 0))])
    whole = half.continued()
    assert len(whole.copies) == 2
    assert len(whole.lattice) == 0
    assert whole.area == pytest.approx(2 * half.area)


def test_a_cell_is_compact() -> None:
    # of representatives that differ by a translation the nearest one is taken: few sides are left open
    cell, piece = p_triangle().continued("cell").mesh(0.3), p_triangle().continued(0).mesh(0.3)
    assert len(boundary_edges(cell.faces)) < 0.12 * 48 * len(boundary_edges(piece.faces))
