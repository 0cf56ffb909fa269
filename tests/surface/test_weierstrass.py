"""The Weierstrass-Enneper form: the same surfaces as in the spinor form, and branch points."""

import numpy as np
import torch

from spinor_geom.domain import PlaneDomain
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface
from tests.surface.points import inside

DISK = PlaneDomain.disk()


def surface(f, g, constant=(0.0, 0.0, 0.0)):
    size = max(len(f), len(g))
    terms = torch.zeros(size, 2, dtype=torch.complex128)
    terms[: len(f), 0], terms[: len(g), 1] = (torch.tensor(data, dtype=torch.complex128) for data in (f, g))
    return WeierstrassSurface(PowerSeries(terms), DISK, torch.tensor(constant, dtype=torch.float64))


def test_it_agrees_with_the_spinor_form():
    # p = z and q = i/√2 give f = −2q² = 1 and g = −p/q = i√2 z
    terms = torch.tensor([[0, 1j / np.sqrt(2)], [1, 0]], dtype=torch.complex128)
    spinors = SpinorSurface(PowerSeries(terms), DISK)
    other = surface([1.0], [0.0, 1j * np.sqrt(2)])
    z = inside(DISK, 50)
    difference = spinors.position(z) - other.position(z)
    np.testing.assert_allclose(difference, np.broadcast_to(difference[0], difference.shape), atol=1e-13)
