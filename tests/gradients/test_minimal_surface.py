"""`minimal_surface` and `nearest_on_surface` as torch functions."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import spinor_geom
from spinor_geom.errors import NotDifferentiableError, UncertainGradientWarning
from spinor_geom.gradients.minimal_surface import position_gradient, require_isolated
from spinor_geom.mesh.topology import HalfEdges
from spinor_geom.plateau import Laurent, solve_plateau
from tests.gradients.cases import LIFT, QUADRILATERAL, RING, TURN, enneper_boundary, wavy

# rotations of e₃ to three directions in a plane
AROUND = [np.array([[0, -np.sin(a), np.cos(a)], [0, np.cos(a), np.sin(a)], [-1, 0, 0]]) for a in (0.0, 2.1, 4.2)]


def test_rim_vertices_are_the_points():
    points = torch.tensor(wavy(48), requires_grad=True)
    vertices, _ = spinor_geom.minimal_surface(points)
    weight = torch.tensor(np.random.default_rng(0).normal(size=(48, 3)))
    (vertices[:48] * weight).sum().backward()
    assert torch.equal(points.grad, weight)


def test_rims_of_an_annulus_in_the_given_order_and_direction():
    small, large = torch.tensor(0.8 * RING[::-2] + LIFT), torch.tensor(RING - LIFT)
    rims = [small.requires_grad_(), large.requires_grad_()]
    vertices, _ = spinor_geom.minimal_surface(rims)
    vertices.sum().backward()
    along = small.grad.sum(0) + large.grad.sum(0)
    given = [small.detach().numpy(), large.detach().numpy()]
    solution = solve_plateau(given, between="quintic", tolerance=1e-6)
    patch = spinor_geom.mesh_patch(solution)
    normal = solution.surface.normal(patch.points[patch.boundary_size :])
    # a translation moves the vertices of the rims as a whole, those inside along their normals
    expected = patch.boundary_size * np.ones(3) + (normal.sum(axis=1, keepdims=True) * normal).sum(axis=0)
    assert along.numpy() == pytest.approx(expected, rel=1e-6)


TRIPOD = [np.roll(RING @ turn.T + 0.8 * turn[:, 2], k, axis=0) for k, turn in enumerate(AROUND)]
BETWEEN = {
    "as the surface has them": [RING - LIFT, RING + LIFT],
    "reversed": [RING[::-1] - LIFT, 0.9 * RING[::-2] + LIFT],
    "the larger second": [0.4 * RING[::2], RING[::-1] + 0.1 * LIFT],
    "three, permuted and reversed": [TRIPOD[2], TRIPOD[0][::-1], TRIPOD[1]],
}


@pytest.mark.parametrize("name", BETWEEN)
def test_vertices_begin_with_the_rims_in_the_given_order_and_direction(name):
    rims = [torch.tensor(np.ascontiguousarray(rim), requires_grad=True) for rim in BETWEEN[name]]
    vertices, faces = spinor_geom.minimal_surface(rims)
    given = torch.cat(rims)
    assert torch.equal(vertices[: len(given)], given)
    half_edges = HalfEdges.of(faces.numpy())
    edges = half_edges.origin[half_edges.boundary], half_edges.target[half_edges.boundary]
    ends = np.cumsum([len(rim) for rim in rims])
    after = np.arange(len(given)) + 1
    after[ends - 1] -= [len(rim) for rim in rims]
    found = {frozenset(pair) for pair in zip(*map(np.ndarray.tolist, edges), strict=True)}
    assert found == set(map(frozenset, enumerate(after.tolist())))
    weight = torch.tensor(np.random.default_rng(0).normal(size=given.shape))
    (vertices[: len(given)] * weight).sum().backward()
    assert torch.equal(torch.cat([rim.grad for rim in rims]), weight)


def test_poisson_kernel_of_a_plane_disk():
    points, radius = torch.tensor(RING, requires_grad=True), np.array([0.0, 0.5])
    places = torch.tensor(np.stack([radius, 0 * radius, 0 * radius], axis=1))
    heights = spinor_geom.nearest_on_surface(points, places)[:, 2]
    for r, height in zip(radius, heights, strict=True):
        (gradient,) = torch.autograd.grad(height, points, retain_graph=True)
        kernel = (1 - r**2) / (1 - 2 * r * np.cos(TURN) + r**2) / 64
        # splines of degree 5 over steps of 0.1
        assert gradient[:, 2].numpy() == pytest.approx(kernel, abs=0.1**6 / 48)


def test_centre_of_a_symmetric_quadrilateral():
    points = torch.tensor(QUADRILATERAL, requires_grad=True)
    place = torch.tensor([[0.5, 0.5, 0.3]], dtype=torch.float64)
    on_film = spinor_geom.nearest_on_surface(points, place, corners=[0, 1, 2, 3], tolerance=1e-5)
    (gradient,) = torch.autograd.grad(on_film[0, 2], points)
    # by symmetry the film passes through the centre with a horizontal tangent, and all corners raise it equally
    assert on_film[0].detach().numpy() == pytest.approx([0.5, 0.5, 0.25], abs=1e-6)
    assert gradient[:, 2].numpy() == pytest.approx(np.full(4, 0.25), abs=1e-5)
    assert gradient.sum(0).numpy() == pytest.approx([0, 0, 1], abs=1e-6)


def test_unstable_surface_is_refused():
    # the catenoid with the thin neck
    thin = solve_plateau([RING - LIFT, RING + LIFT], model=Laurent(modulus=5), unstable="keep")
    assert thin.stability.verdict == "unstable"
    with pytest.raises(NotDifferentiableError, match="unstable"):
        require_isolated(thin)
    assert np.isfinite(thin.area_gradient[1]).all()


def test_degenerate_surface_is_refused():
    # at the end of the catenoids two of them meet
    lift = np.array([0, 0, 0.66274274])
    end = solve_plateau([RING - lift, RING + lift], unstable="keep")
    with pytest.raises(NotDifferentiableError, match="degenerate"):
        position_gradient(end, np.array([0.9 + 0j]), np.ones((1, 3)))


def test_enneper_surfaces_near_the_degenerate_one():
    # at R = 1 the Gauss map covers a hemisphere, whose eigenvalue is 1
    points, weights = np.array([0.3 + 0.1j]), np.ones((1, 3))
    surfaces = {radius: solve_plateau(enneper_boundary(radius), unstable="keep") for radius in (0.99, 0.999, 1.0, 1.05)}
    assert {surface.route for surface in surfaces.values()} == {"disk"}
    position_gradient(surfaces[0.99], points, weights)
    with pytest.warns(UncertainGradientWarning, match="nearly degenerate"):
        position_gradient(surfaces[0.999], points, weights)
    with pytest.raises(NotDifferentiableError, match="degenerate"):
        position_gradient(surfaces[1.0], points, weights)
    with pytest.raises(NotDifferentiableError, match="unstable"):
        position_gradient(surfaces[1.05], points, weights)
