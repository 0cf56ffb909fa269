"""Signs and identities of the pointwise formulas."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.errors import DtypeError
from spinor_geom.surface import formulas

ROUND_OFF = 1e-13


def complex_numbers():
    return st.complex_numbers(max_magnitude=3.0, allow_nan=False, allow_infinity=False).filter(lambda u: abs(u) > 1e-2)


def scalar(u):
    return torch.tensor(u, dtype=torch.complex128)


def test_p_alone_is_the_plane_with_normal_plus_e3():
    p, q = scalar(1.0), scalar(0.0)
    phi = formulas.phi(p, q)
    np.testing.assert_array_equal(phi.real, [1.0, 0.0, 0.0])  # r_x
    np.testing.assert_array_equal(-phi.imag, [0.0, 1.0, 0.0])  # r_y
    np.testing.assert_array_equal(formulas.normal(p, q), [0.0, 0.0, 1.0])


@given(complex_numbers(), complex_numbers())
def test_null_conformal_and_orthonormal_frame(p, q):
    p, q = scalar(p), scalar(q)
    phi, factor, normal = formulas.phi(p, q), formulas.conformal_factor(p, q), formulas.normal(p, q)
    r_x, r_y = phi.real, -phi.imag
    scale = float(factor) ** 2
    assert abs((phi * phi).sum()) < ROUND_OFF * scale
    assert abs(r_x @ r_x - scale) < ROUND_OFF * scale
    assert abs(r_y @ r_y - scale) < ROUND_OFF * scale
    np.testing.assert_allclose(torch.linalg.cross(r_x, r_y) / scale, normal, atol=ROUND_OFF)


@given(complex_numbers(), complex_numbers())
def test_gauss_map_is_the_stereographic_normal_and_weierstrass_data_give_phi_back(p, q):
    p, q = scalar(p), scalar(q)
    n, g = formulas.normal(p, q), formulas.gauss_map(p, q)
    # both sides blow up near n = e3, where 1 − n₃ cancels
    assert abs((n[0] + 1j * n[1]) - g * (1 - n[2])) < 1e-9 * (1 + abs(g))
    f = -2 * q * q
    back = torch.stack([f * (1 - g * g) / 2, 1j * f * (1 + g * g) / 2, f * g])
    np.testing.assert_allclose(back, formulas.phi(p, q), atol=1e-12 * float(formulas.conformal_factor(p, q)))


def test_second_fundamental_form_is_symmetric_and_traceless():
    p, q, dp, dq = torch.randn(4, 7, dtype=torch.complex128, generator=torch.Generator().manual_seed(0))
    second = formulas.second_fundamental_form(p, q, dp, dq)
    assert torch.equal(second, second.mT)
    assert torch.equal(second[:, 0, 0], -second[:, 1, 1])
    gauss = torch.linalg.det(second) / formulas.conformal_factor(p, q) ** 4
    np.testing.assert_allclose(gauss, formulas.gauss_curvature(p, q, dp, dq), rtol=1e-12)


@pytest.mark.parametrize("function", [formulas.phi, formulas.conformal_factor, formulas.normal, formulas.gauss_map])
def test_real_spinors_are_refused(function):
    real, cplx = torch.ones(3, dtype=torch.float64), torch.ones(3, dtype=torch.complex128)
    with pytest.raises((DtypeError, TypeError), match=r"complex|q"):
        function(cplx, real)
