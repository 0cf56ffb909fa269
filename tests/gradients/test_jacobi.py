"""Normal displacements of surfaces: rigid motions and scalings, which are known, and differences of solves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from spinor_geom.gradients.minimal_surface import normal_fields, position_gradient
from spinor_geom.gradients.slide_adjoint import SlideAdjoint
from spinor_geom.plateau import solve_plateau
from tests.gradients.cases import LIFT, LINKED, RING, ROUTES, difference, moved, moves_of, names, solved


def inner_points(solution, count=12):
    """Some points of Ω, up to an edge from its boundary."""
    mesh = solution.domain.triangulation
    z = mesh.points[mesh.boundary_size :]
    return z[np.linspace(0, len(z) - 1, count).astype(int)]


def normal_offsets(solution, x, normal):
    """How far a surface is from points along given normals, by Newton's method from its nearest vertex."""
    surface, vertices = solution.surface, solution.domain.triangulation.points
    z = vertices[cKDTree(surface.position(vertices)).query(x)[1]].copy()

    def tangential(v):
        return v - (v * normal).sum(axis=1, keepdims=True) * normal

    for _ in range(12):
        phi = surface.null_curve(z)
        both = np.stack([tangential(phi.real), tangential(-phi.imag)], axis=2)
        away = tangential(surface.position(z) - x)
        step = np.linalg.solve(both.mT @ both, both.mT @ away[..., None])[..., 0]
        z -= step[:, 0] + 1j * step[:, 1]
    return ((surface.position(z) - x) * normal).sum(axis=1)


@pytest.mark.parametrize("name", [*names(), *LINKED])
def test_similarities_are_reproduced(name):
    solution = solved(name)
    z = inner_points(solution)
    fields = normal_fields(solution, z)
    normal, x = solution.surface.normal(z), solution.surface.position(z)
    on_rims = [rim.curve.point(nodes.places) for rim, nodes in zip(solution.rims, fields.rims, strict=True)]
    axes = np.eye(3)
    motions = [
        *(lambda points, axis=axis: np.broadcast_to(axis, points.shape) for axis in axes),
        *(lambda points, axis=axis: np.cross(axis, points) for axis in axes),
        lambda points: points,
    ]
    for number in range(len(z)):
        weights = fields.by_boundary(np.eye(len(z))[number])
        for motion in motions:
            u = sum((own * motion(points)).sum() for own, points in zip(weights, on_rims, strict=True))
            # surfaces and fields are of size 1 to 5. The adjoint of Newton's equations has errors of rounding, least
            # squares of 2e-6. Networks are fitted to 1e-5 of an edge
            error = 1e-10 if isinstance(fields, SlideAdjoint) else 1e-5 if "network" in name else 3e-6
            assert abs(u - motion(x)[number] @ normal[number]) < error


@pytest.mark.parametrize("name", names("network", "flattened"))
def test_gradient_equals_differences_of_solves(name):
    rims, moves, solution = ROUTES[name], moves_of(name), solved(name)
    z, rng = inner_points(solution), np.random.default_rng(0)
    x, normal, weights = solution.surface.position(z), solution.surface.normal(z), rng.normal(size=(len(z), 3))
    gradient = position_gradient(solution, z, weights)
    by_u = (weights * normal).sum(axis=1)
    slope = difference(lambda size: by_u @ normal_offsets(solved(name, moved(rims, moves, size)), x, normal))
    own = sum((rows * move).sum() for rows, move in zip(gradient, moves, strict=True))
    size = sum(map(np.linalg.norm, gradient)) * max(map(np.linalg.norm, moves))
    assert abs(own - slope) < (1e-5 if "network" in name else 1e-7) * size


def test_plane_region_rises_by_a_harmonic_function():
    solution = solved("plane")
    z, (ellipse,) = inner_points(solution), ROUTES["plane"]
    normal, (x, y, _) = solution.surface.normal(z), solution.surface.position(z).T
    rise = ellipse[:, 0] ** 2 - ellipse[:, 1] ** 2
    for number, one in enumerate(np.eye(len(z))):
        (gradient,) = position_gradient(solution, z, one[:, None] * normal)
        # 5 nodes between neighbouring points
        assert gradient[:, 2] @ rise == pytest.approx(x[number] ** 2 - y[number] ** 2, abs=1e-6)


def test_points_far_from_the_centre_of_a_disk_near_its_rim():
    solution = solved("disk")
    z = 0.97 * np.exp(1j * np.linspace(0, 6, 40))
    fields = normal_fields(solution, z)
    weights = fields.by_boundary(np.ones(len(z)))
    (nodes,), (own,) = fields.rims, weights
    points = solution.curve.point(nodes.places)
    normal, x = solution.surface.normal(z), solution.surface.position(z)
    assert (own * points).sum() == pytest.approx((normal * x).sum(), abs=1e-7)


def test_noisy_rims_are_translated_exactly():
    rng = np.random.default_rng(0)
    lower, upper = (rim + 0.01 * rng.normal(size=rim.shape) for rim in (RING - LIFT, 0.8 * RING[::2] + LIFT))
    solution = solve_plateau([lower, upper], between="smooth")
    assert (solution.route, solution.rims[0].curve.kind) == ("annulus", "cubic")
    z = inner_points(solution)
    normal = solution.surface.normal(z)
    weights = np.random.default_rng(1).normal(size=len(z))
    along = sum(rows.sum(axis=0) for rows in position_gradient(solution, z, weights[:, None] * normal))
    # although the boundary is met to 1e-3 of an edge only
    assert along == pytest.approx(weights @ normal, abs=1e-12)
