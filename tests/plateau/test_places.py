"""numpy and torch give the same surfaces, to rounding."""

import numpy as np
import pytest
import torch

from spinor_geom import gallery
from spinor_geom.gallery import noisy_loop
from spinor_geom.plateau import solve_plateau, solve_plateau_batch
from tests.loops import noisy_ellipse

LOOPS = {
    "plane": gallery.polygon([(0, 0, 0), (3, 0, 0), (3, 1, 0), (0, 2, 0)]).sample(24),
    "disk": gallery.enneper(0.8).rim(64),
    "disk of a formula": gallery.twisted_circle(),
    "flattened": gallery.ellipse(8.0, 0.5).sample(96),
    "corners": gallery.scherk().sample(48),
    "noisy": noisy_ellipse(40),
    "noisy disk": noisy_loop(gallery.enneper(0.8).rim(80), 0.3, seed=1),
}


def check(by_numpy, by_torch):
    assert (by_numpy.route, by_numpy.converged) == (by_torch.route, by_torch.converged)
    # where a step almost meets a criterion, rounding decides about one more
    assert abs(len(by_numpy.history) - len(by_torch.history)) <= 2
    surface, other = by_numpy.array_surface, by_torch.array_surface
    assert isinstance(surface.constant, np.ndarray)
    assert isinstance(other.constant, torch.Tensor)
    # stopped at a relative gradient of 1e-7 or more, steps differ by the rounding errors of their sums
    scale = by_numpy.boundary_residual.diagonal
    assert by_torch.area == pytest.approx(by_numpy.area, rel=1e-9)
    assert abs(by_torch.boundary_residual.rms - by_numpy.boundary_residual.rms) < 1e-7 * scale
    z = by_numpy.domain.triangulation.points
    z = z[by_numpy.domain.triangulation.boundary_size :][::7]
    np.testing.assert_allclose(other.position(z), surface.position(z), rtol=0, atol=1e-7 * scale)
    np.testing.assert_allclose(other.normal(z), surface.normal(z), rtol=0, atol=1e-6)


@pytest.mark.parametrize("loop", [LOOPS[name] for name in ("disk of a formula", "flattened", "corners")], ids=str)
def test_disks_are_the_same_by_numpy_and_by_torch(loop):
    check(solve_plateau(loop), solve_plateau(loop, device="cpu"))


def test_either_of_two_mirror_images_may_follow_an_unstable_disk():
    loop = gallery.tennis_seam(0.75).sample(64)
    by_numpy, by_torch = solve_plateau(loop), solve_plateau(loop, device="cpu")
    assert "replaces an unstable surface" in by_numpy.reason
    assert (by_torch.route, by_torch.converged) == (by_numpy.route, by_numpy.converged)
    # both residuals are below the tolerance, and differ
    assert by_torch.area == pytest.approx(by_numpy.area, rel=2e-7)


def test_batches_are_the_same_by_numpy_and_by_torch():
    loops = [LOOPS[name] for name in ("disk", "noisy", "noisy disk", "plane")]
    for pair in zip(solve_plateau_batch(loops), solve_plateau_batch(loops, device="cpu"), strict=True):
        check(*pair)


def test_a_solution_by_torch_is_on_its_device_and_one_by_numpy_becomes_a_module_on_demand():
    loop = LOOPS["disk"]
    for device in (None, "cpu"):
        surface = solve_plateau(loop, device=device).surface
        assert isinstance(surface, torch.nn.Module)
        z = torch.tensor([0.1 + 0.2j], dtype=torch.complex128, requires_grad=True)
        surface.position(z).sum().backward()
        assert z.grad is not None
        assert all(parameter.grad is not None for parameter in surface.parameters())
