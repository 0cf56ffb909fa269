"""The start of a fit, and the limit on its threads."""

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.arrays import NUMPY
from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.domain.flattening import flatten
from spinor_geom.domain.triangulation import triangulate_polygon
from spinor_geom.plateau.initial_spinors import lifted_frames, lifted_spinors
from spinor_geom.plateau.solve import solve_plateau
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.frames import signs_close_up, spinors_from_phi
from tests.loops import noisy_ellipse


def test_plane_disk_lifts_to_constant_spinors():
    polygon = np.exp(2j * np.pi * np.arange(40) / 40)
    mesh = triangulate_polygon(polygon)
    vertices = np.column_stack([mesh.points.real, mesh.points.imag, 0 * mesh.points.real])
    spinors = lifted_spinors(vertices, mesh.faces, mesh.points, (40,), NUMPY)
    # n = e₃: p² = 1, q = 0
    np.testing.assert_allclose(np.abs(spinors), np.tile([1.0, 0.0], (40, 1)), atol=1e-12)
    assert float(np.abs(spinors[:, 0] - spinors[0, 0]).max()) < 1e-12


@pytest.mark.parametrize("curve", [gallery.tennis_seam(0.8), gallery.ellipse(8.0, 0.3)], ids=lambda c: c.name)
def test_lifted_spinors_reproduce_the_edges_of_the_loop(curve):
    loop = curve.sample(100)
    disk = first_disk(loop.points)
    flat = flatten(disk.vertices, disk.faces, len(loop))
    spinors = lifted_spinors(disk.vertices, disk.faces, flat.images, (len(loop),), NUMPY)
    edge = np.roll(flat.boundary, -1) - flat.boundary
    along = (phi(spinors[:, 0], spinors[:, 1]) * edge[:, None]).real
    np.testing.assert_allclose(along, np.roll(loop.points, -1, axis=0) - loop.points, atol=1e-12 * loop.diagonal)
    # the sign follows the boundary, and closes up
    step = (np.abs(spinors - np.roll(spinors, 1, axis=0)) ** 2).sum(axis=1) / (np.abs(spinors) ** 2).sum(axis=1)
    assert float(step.max()) < 1


@pytest.mark.parametrize("seed", [2, 5])
def test_signs_are_right_where_frames_turn_so_far_that_neighbours_on_the_boundary_do_not_tell_them(seed):
    loop = noisy_ellipse(150, amount=0.35, seed=seed)
    disk = first_disk(loop.points)
    flat = flatten(disk.vertices, disk.faces, len(loop)).boundary
    after = np.roll(np.arange(len(loop)), -1)
    around = [(disk.faces == k).any(axis=1) for k in range(len(loop))]
    face = [np.flatnonzero(around[a] & around[b])[0] for a, b in enumerate(after)]
    a, b, c = disk.vertices[disk.faces[face].T]
    frames = spinors_from_phi(lifted_frames(disk.vertices, np.cross(b - a, c - a), flat, after))
    assert not signs_close_up(*frames)
    solution = solve_plateau(loop, between="free")
    assert solution.route == "vertices"
    assert solution.converged
