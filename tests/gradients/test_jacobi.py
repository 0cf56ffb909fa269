"""Normal displacements of surfaces: rigid motions and scalings, which are known, and differences of solves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from spinor_geom.gradients.area import as_given
from spinor_geom.gradients.curve_chain import by_points
from spinor_geom.gradients.minimal_surface import normal_fields, position_gradient
from tests.gradients.cases import LINKED, ROUTES, difference, moved, moves_of, names, order_of, solved


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
            # surfaces and fields are of size 1 to 5; quadrature beside a rim has errors of 2e-6, networks are fitted to
            # 1e-5 of an edge
            assert abs(u - motion(x)[number] @ normal[number]) < (1e-5 if "network" in name else 3e-6)


@pytest.mark.parametrize("name", names())
def test_gradient_equals_differences_of_solves(name):
    rims, moves, solution = ROUTES[name], moves_of(name), solved(name)
    z, rng = inner_points(solution), np.random.default_rng(0)
    x, normal, weights = solution.surface.position(z), solution.surface.normal(z), rng.normal(size=(len(z), 3))
    gradient = position_gradient(solution, z, weights)
    by_u = (weights * normal).sum(axis=1)
    slope = difference(lambda size: by_u @ normal_offsets(solved(name, moved(rims, moves, size)), x, normal))
    own = sum((rows * move).sum() for rows, move in zip(gradient, moves, strict=True))
    size = sum(map(np.linalg.norm, gradient)) * max(map(np.linalg.norm, moves))
    assert abs(own - slope) < (1e-5 if "network" in name else 1e-6) * size


@pytest.mark.parametrize("name", names("network", "flattened"))
def test_remainder_is_of_second_order(name):
    if name == "plane":
        pytest.skip("displacements within the plane do not move the surface along its normal")
    rims, moves, solution = ROUTES[name], moves_of(name), solved(name)
    z = inner_points(solution, 6)
    x, normal = solution.surface.position(z), solution.surface.normal(z)
    fields = normal_fields(solution, z)

    def change(by_u):
        parts = zip(solution.rims, fields.rims, fields.by_boundary(by_u), strict=True)
        gradients = as_given(solution, [by_points(rim.curve, nodes.places, own) for rim, nodes, own in parts])
        return sum((rows * move).sum() for rows, move in zip(gradients, moves, strict=True))

    slopes = np.array(list(map(change, np.eye(len(z)))))

    def remainder(step):
        there = solved(name, moved(rims, moves, step))
        return np.linalg.norm(normal_offsets(there, x, normal) - step * slopes)

    assert abs(order_of(remainder) - 2) < 0.15  # the terms of third order


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
