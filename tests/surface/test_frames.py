"""The lift of frames to spinors, and SU(2) ↔ SO(3)."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from spinor_geom.errors import OptionError
from spinor_geom.gallery import enneper
from spinor_geom.surface import formulas, frames
from spinor_geom.surface.spinor_surface import SpinorSurface


def rim_frames(known, n):
    """Exact z, tangent, normal, direction and scale on the circle |z| = 1."""
    z = torch.from_numpy(np.exp(2j * np.pi * np.arange(n) / n))
    surface = SpinorSurface.of(known.surface).requires_grad_(False)
    p, q = surface.spinors(z).unbind(-1)
    tangent = (formulas.phi(p, q) * (1j * z)[:, None]).real
    return p, q, tangent, surface.normal(z), 1j * z, surface.conformal_factor(z)


def test_frames_of_an_exact_surface_give_its_phi_and_spinors_back():
    p, q, tangent, normal, direction, scale = rim_frames(enneper(1.0), 40)
    phi = frames.phi_from_frames(3.0 * tangent, normal + 0.3 * tangent, 2.0 * direction, scale)
    np.testing.assert_allclose(phi, formulas.phi(p, q), atol=1e-14)
    lifted = torch.stack(frames.spinors_from_phi(phi))
    exact = torch.stack([p, q])
    sign = torch.sign((lifted[:, 0] * exact[:, 0].conj()).sum().real)
    np.testing.assert_allclose(sign * lifted, exact, atol=1e-14)  # one sign for all samples
    assert frames.signs_close_up(*lifted)


def test_frame_and_direction_agree_with_the_surface():
    generator = torch.Generator().manual_seed(1)
    tangent, normal = torch.randn(2, 9, 3, dtype=torch.float64, generator=generator)
    direction = torch.randn(9, dtype=torch.complex128, generator=generator)
    scale = 1 + torch.rand(9, dtype=torch.float64, generator=generator)
    phi = frames.phi_from_frames(tangent, normal, direction, scale)
    along = (phi * (direction / direction.abs())[:, None]).real
    unit = tangent / torch.linalg.vector_norm(tangent, dim=1, keepdim=True)
    np.testing.assert_allclose(along, scale[:, None] * unit, atol=1e-14)
    p, q = frames.spinors_from_phi(phi)
    np.testing.assert_allclose(formulas.phi(p, q), phi, atol=1e-13)
    np.testing.assert_allclose(formulas.conformal_factor(p, q), scale, atol=1e-13)
    conormal = torch.linalg.cross(formulas.normal(p, q), unit)
    across = (phi * (1j * direction / direction.abs())[:, None]).real
    np.testing.assert_allclose(across, scale[:, None] * conormal, atol=1e-13)


def test_lift_works_where_p_or_q_vanishes():
    one, zero = torch.ones(5, dtype=torch.complex128), torch.zeros(5, dtype=torch.complex128)
    for p, q in ((one, zero), (zero, one)):
        back = torch.stack(frames.spinors_from_phi(formulas.phi(p, q)))
        np.testing.assert_allclose(back.abs(), torch.stack([p, q]).abs(), atol=1e-15)


def test_a_full_turn_of_the_frame_does_not_close_up():
    # the spinor turns half as fast as the frame: one full turn about e3 along the sequence gives −1, two give +1
    angle = 2 * np.pi * torch.arange(24, dtype=torch.float64) / 24
    for turns, closes in ((1, False), (2, True), (3, False), (0, True)):
        phi = torch.exp(1j * turns * angle)[:, None] * torch.tensor([1, -1j, 0], dtype=torch.complex128)
        assert bool(frames.signs_close_up(*frames.spinors_from_phi(phi))) == closes


def rotation_from_su2(unitary):
    turned = formulas.phi(unitary[0, 0], unitary[1, 0])  # p = 1, q = 0 has φ = e₁ − i e₂
    first, second = turned.real, -turned.imag
    return torch.stack([first, second, torch.linalg.cross(first, second)], dim=-1)


@pytest.mark.parametrize("seed", range(5))
def test_su2_acts_on_phi_as_the_rotation(seed):
    rotation = torch.from_numpy(Rotation.random(rng=np.random.default_rng(seed)).as_matrix())
    unitary = frames.su2_from_rotation(rotation)
    np.testing.assert_allclose(unitary @ unitary.mH, np.eye(2), atol=1e-15)
    np.testing.assert_allclose(torch.linalg.det(unitary), 1.0, atol=1e-15)
    np.testing.assert_allclose(rotation_from_su2(unitary), rotation, atol=1e-14)
    p, q = torch.randn(2, 6, dtype=torch.complex128, generator=torch.Generator().manual_seed(seed))
    turned = torch.stack([p, q], dim=-1) @ unitary.mT
    expected = formulas.phi(p, q) @ rotation.to(torch.complex128).mT
    np.testing.assert_allclose(formulas.phi(*turned.unbind(-1)), expected, atol=1e-13)


@pytest.mark.parametrize("matrix", [np.diag([1.0, 1.0, -1.0]), np.diag([1.0, 1.0, 1.1]), np.full((3, 3), np.nan)])
def test_matrices_that_are_no_rotations_are_refused(matrix):
    with pytest.raises(OptionError):
        frames.su2_from_rotation(torch.from_numpy(matrix))
