import numpy as np
import pytest

from spinor_geom import BoundaryLoop
from spinor_geom.meshing.embed import mesh_patch
from spinor_geom.meshing.triangulate import even_seeds
from spinor_geom.plateau import solve_plateau


def neighbours(z):
    """Distances of each point to the others, ascending."""
    return np.sort(np.abs(z[:, None] - z), axis=1)[:, 1:]


@pytest.mark.parametrize("strength", [0.0, 0.3, 0.6])
def test_images_in_the_plane_form_a_triangular_lattice(strength):
    """p = 1 + a z, q = 0: λ = |p|² and G = ∫ p² dz is the surface itself."""
    z = np.exp(2j * np.pi * np.arange(64) / 64)
    area = np.pi * (1 + 2 * strength**2 + strength**4 / 3)
    seeds, spacing = even_seeds(np.abs(1 + strength * z) ** 2, 0.1, area)
    assert (np.abs(seeds) < 1).all()
    assert spacing * np.abs(1 + strength * seeds) ** 2 == pytest.approx(np.full(len(seeds), 0.1), rel=1e-2)
    image = seeds + strength * seeds**2 + strength**2 * seeds**3 / 3
    distance = neighbours(image)
    assert distance[:, 0] == pytest.approx(np.full(len(seeds), 0.1), rel=1e-2)
    assert np.ptp(distance[:, 0]) < 1e-5
    assert 0.8 < len(seeds) * np.sqrt(0.75) * 0.01 / area < 1
    assert (distance[:, 5] < 0.11).mean() > 0.7


def test_a_flattening_that_overlaps_itself_gives_points_of_the_disk_only():
    z = np.exp(2j * np.pi * np.arange(256) / 256)
    # G = exp(4z)/4 turns by more than a whole turn
    seeds, _ = even_seeds(np.abs(np.exp(4 * z)), 0.5, 1e4)
    assert len(seeds)
    assert (np.abs(seeds) < 1).all()


@pytest.mark.parametrize("factor", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("loop", ["saddle", "ellipse", "uneven"])
def test_patches_over_the_disk_have_round_triangles_of_even_size(loop, factor):
    t = 2 * np.pi * np.arange(96) / 96
    t = t + 0.5 * np.sin(t) if loop == "uneven" else t
    width, height = (1.0, 0.4) if loop == "saddle" else (1.5, 0.3)
    points = np.stack([width * np.cos(t), np.sin(t), height * np.cos(2 * t)], axis=1)
    solution = solve_plateau(BoundaryLoop.from_points(points))
    assert solution.route == "disk"
    target = factor * solution.loop.mean_edge_length
    patch = mesh_patch(solution, target)
    corners = patch.vertices[patch.faces]
    ahead = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(ahead, axis=2)
    angle = np.degrees(np.arccos((-ahead * np.roll(ahead, 1, axis=1)).sum(2) / (length * np.roll(length, 1, axis=1))))
    assert angle.min() > 20
    assert np.median(angle.min(axis=1)) > (54 if factor == 1.0 else 45)
    if factor == 1.0 and loop != "uneven":
        inner = length[(patch.faces >= patch.boundary_size).all(axis=1)]
        assert 0.9 < inner.mean() / target < 1.1
        assert inner.std() / target < 0.12
