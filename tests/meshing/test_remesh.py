"""Remeshed patches: same shape, edges of one length, domains of given angles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spinor_geom.discrete.strip import ruled_annulus
from spinor_geom.domain.triangulation import triangulate_polygon
from spinor_geom.errors import TooManyPointsError
from spinor_geom.meshing.embed import Patch, over_domain_of_angles, remesh


def disk(count: int = 60) -> Patch:
    plane = triangulate_polygon(np.exp(2j * np.pi * np.arange(count) / count), lambda z: np.full(len(z), 0.1))
    vertices = np.column_stack([plane.points.real, plane.points.imag, np.zeros(len(plane.points))])
    return Patch(vertices=vertices, faces=plane.faces, boundary_size=count, points=plane.points)


def lengths(patch: Patch) -> np.ndarray:
    edges = np.asarray(patch.faces)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edges = edges[(edges >= patch.boundary_size).all(axis=1)]
    return np.asarray(np.linalg.norm(patch.vertices[edges[:, 0]] - patch.vertices[edges[:, 1]], axis=1))


def test_a_bulge_gets_edges_of_one_length_and_keeps_its_shape() -> None:
    flat = disk()
    r = np.abs(flat.points)
    # a paraboloid three times as high as wide: edges along its meridians become six times as long
    bulge = replace(flat, vertices=np.column_stack([flat.vertices[:, :2], 3 * (1 - r**2)]))
    assert lengths(bulge).max() > 0.5
    fine = remesh(bulge, 0.1)
    assert (fine.vertices[:60] == bulge.vertices[:60]).all()
    assert np.median(lengths(fine)) == pytest.approx(0.1, rel=0.5)
    # on the old faces: the chords' height over an edge of 0.1 in Ω
    x, y, z = fine.vertices.T
    assert np.abs(z - 3 * (1 - x**2 - y**2)).max() < 0.03
    assert fine.area == pytest.approx(bulge.area, rel=0.01)


def test_a_tiny_edge_length_is_refused() -> None:
    with pytest.raises(TooManyPointsError):
        remesh(disk(), 1e-6)


def test_a_tube_is_remeshed_between_its_rims() -> None:
    turn = 2 * np.pi * np.arange(24) / 24
    low = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    high = np.flipud(low) + np.array([0, 0, 1.5])
    plane, vertices = ruled_annulus(low, high, 0.25)
    # straight lines between circles one over the other: the cylinder, but for the chords
    assert np.abs(np.hypot(vertices[:, 0], vertices[:, 1]) - 1).max() < 0.01
    patch = Patch(
        vertices=vertices,
        faces=plane.faces,
        boundary_size=48,
        points=plane.points,
        hole_sizes=plane.hole_sizes,
    )
    fine = remesh(patch, 0.1)
    assert len(fine.vertices) > 3 * len(vertices)
    assert fine.rims == (24, 24)
    assert np.abs(np.hypot(fine.vertices[:, 0], fine.vertices[:, 1]) - 1).max() < 0.03


def test_a_domain_has_the_given_angles() -> None:
    # a square's rim over a domain whose corners are its own, though the patch is bent
    side = np.arange(8) / 8
    square = np.concatenate([side, 1 + 1j * side, 1 + 1j - side, 1j - 1j * side])
    plane = triangulate_polygon(square, lambda z: np.full(len(z), 0.12))
    height = 0.3 * plane.points.real * (1 - plane.points.real)
    vertices = np.column_stack([plane.points.real, plane.points.imag, height])
    patch = Patch(vertices=vertices, faces=plane.faces, boundary_size=32, points=plane.points)
    angles = np.full(32, np.pi)
    angles[::8] = np.pi / 2
    new = over_domain_of_angles(patch, angles, 0.12)
    assert (new.vertices[:32] == vertices[:32]).all()
    ring = new.points[:32]
    turn = np.angle((np.roll(ring, -1) - ring) / (ring - np.roll(ring, 1)))
    np.testing.assert_allclose(np.pi - turn, angles, atol=1e-9)
    assert (new.vertices[32:, 2] < 0.08).all()
