"""Positions, areas, similarities and training of SpinorSurface."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from spinor_geom.domain import PlaneDomain
from spinor_geom.errors import DomainError, DtypeError, OptionError
from spinor_geom.gallery import catenoid, enneper, helicoid, plane_disk, polynomial
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.surface.spinor_surface import SpinorSurface
from tests.surface.points import inside


def cauchy_surface(degree=6, count=24, seed=0):
    """A Cauchy network with random read-outs on the unit disk, its poles outside."""
    rim = torch.from_numpy(np.exp(2j * np.pi * np.arange(200) / 200))
    network = CauchyNetwork.orthonormal_on(
        rim,
        torch.ones(200, dtype=torch.float64),
        poles=1.4 * torch.from_numpy(np.exp(2j * np.pi * np.arange(count) / count)),
        scales=torch.full((count,), 0.4, dtype=torch.float64),
        degree=degree,
    )
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        network.readout.copy_(torch.randn(network.readout.shape, dtype=torch.complex128, generator=generator))
    return SpinorSurface(network, PlaneDomain.disk())


KNOWN = [enneper(1.0), catenoid(0.5), helicoid(1.0, 1.0), plane_disk(0.7), polynomial([1, 0.5j], [0.2, 1, 0.3])]


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.name)
def test_positions_equal_the_closed_formula(known):
    domain = known.surface.domain
    z = np.concatenate([inside(domain, 200), domain.boundary.point(np.arange(90) / 90)])
    size = np.ptp(known.position(z), axis=0).max()
    np.testing.assert_allclose(known.surface.position(z), known.position(z), atol=1e-14 * max(size, 1))


def horseshoe():
    """An annulus with a narrow gap along the positive real axis, finely divided on the lower side of the gap only."""
    t = np.linspace(0.01 * np.pi, 1.99 * np.pi, 60)
    lower = np.linspace(1.2, 0.6, 12)[1:-1] * np.exp(1j * t[-1])
    vertices = np.concatenate([1.2 * np.exp(1j * t), lower, 0.6 * np.exp(1j * t[::-1])])
    corners = np.zeros(len(vertices), dtype=bool)
    corners[[0, 59, 70, 129]] = True
    return PlaneDomain.from_boundary(vertices, corners)


class CutInTheGap(torch.nn.Module):
    """φ = (1, −i, 0)·(−z)^{−1/2}, with the root's cut along the positive real axis."""

    def value(self, z):
        return torch.stack([(-z).sqrt().rsqrt(), torch.zeros_like(z)], dim=-1)


def test_positions_in_a_domain_with_a_gap_do_not_cross_it():
    domain = horseshoe()
    z = inside(domain, 2000)
    vertices = domain.triangulation.points
    nearest = vertices[np.abs(z[:, None] - vertices).argmin(axis=1)]
    assert (nearest.imag * z.imag < 0)[z.real > 0].any()  # the nearest vertex of all is across the gap
    surface = SpinorSurface(CutInTheGap(), domain)
    exact = -2 * (np.sqrt(-z) - np.sqrt(-surface.root))
    position = surface.position(z)
    np.testing.assert_allclose(position[:, 0], exact.real, atol=1e-12)
    np.testing.assert_allclose(position[:, 1], exact.imag, atol=1e-12)


@pytest.mark.parametrize("bad", [complex("nan"), complex("inf"), complex(0, float("nan"))])
def test_points_must_be_finite(bad):
    with pytest.raises(DomainError, match="finite"):
        enneper(0.8).surface.position(np.array([0, bad]))


def test_real_tensors_are_refused_and_real_arrays_are_points_of_the_real_axis():
    surface = enneper(0.8).surface
    with pytest.raises(DtypeError):
        surface.position(torch.zeros(3, dtype=torch.float64))
    np.testing.assert_array_equal(surface.position(np.array([0.5])), surface.position(np.array([0.5 + 0j])))


# --- area -------------------------------------------------------------------------------------------------------------


def test_area_of_a_cauchy_network_equals_the_double_integral():
    surface = cauchy_surface()
    nodes, weights = np.polynomial.legendre.leggauss(40)
    radius, weight = (nodes + 1) / 2, weights / 2
    z = radius[:, None] * np.exp(2j * np.pi * np.arange(128) / 128)
    double = (surface.conformal_factor(z) ** 2 * (2 * np.pi / 128) * (radius * weight)[:, None]).sum()
    assert abs(surface.area() / double - 1) < 1e-11


# --- associates and similarities --------------------------------------------------------------------------------------


@given(st.floats(-7, 7))
def test_associates_are_isometric_and_share_normals(angle):
    surface = polynomial([1, 0.5j], [0.2, 1, 0.3]).surface
    other = surface.associate(angle)
    z = inside(surface.domain, 30)
    np.testing.assert_allclose(other.conformal_factor(z), surface.conformal_factor(z), rtol=1e-13)
    np.testing.assert_allclose(other.normal(z), surface.normal(z), atol=1e-14)
    np.testing.assert_allclose(other.gauss_curvature(z), surface.gauss_curvature(z), rtol=1e-12)
    assert abs(other.area() / surface.area() - 1) < 1e-13
    np.testing.assert_array_equal(other.position(np.array(surface.root)), surface.position(np.array(surface.root)))


def test_conjugate_of_the_catenoid_is_the_helicoid():
    surface = catenoid(0.5).surface
    neck = catenoid(0.5).position(np.array(0j))[0]
    conjugate = surface.associate(np.pi / 2)
    z = inside(surface.domain, 50)
    x, y = z.real, z.imag
    exact = neck * np.stack([-np.sinh(x) * np.sin(y), np.sinh(x) * np.cos(y), -y], axis=-1)
    shift = conjugate.position(z[:1]) - exact[:1]
    np.testing.assert_allclose(conjugate.position(z), exact + shift, atol=1e-13)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_similarities_act_on_positions_normals_and_area(seed, scale):
    surface = cauchy_surface(seed=seed)
    rng = np.random.default_rng(seed)
    rotation, translation = Rotation.random(rng=rng).as_matrix(), scale * rng.normal(size=3)
    moved = surface.transform(rotation, scale, translation)
    z = inside(surface.domain, 30)
    expected = scale * surface.position(z) @ rotation.T + translation
    np.testing.assert_allclose(moved.position(z), expected, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_allclose(moved.normal(z), surface.normal(z) @ rotation.T, atol=1e-12)
    assert abs(moved.area() / (scale**2 * surface.area()) - 1) < 1e-12
    again = moved.transform(rotation.T, 1 / scale, -rotation.T @ translation / scale)
    np.testing.assert_allclose(again.position(z), surface.position(z), atol=1e-12 * np.abs(surface.position(z)).max())


@pytest.mark.parametrize(
    "options",
    [
        *({"rotation": bad} for bad in (np.diag([1.0, 1.0, -1.0]), np.diag([1.0, 2.0, 1.0]), np.eye(2))),
        *({"scale": bad} for bad in (0.0, -1.0, float("nan"), float("inf"))),
        *({"translation": bad} for bad in ([1.0, 2.0], [1.0, 2.0, float("nan")], "here")),
    ],
)
def test_what_is_no_similarity_is_refused(options):
    with pytest.raises(OptionError):
        plane_disk().surface.transform(**options)


# --- training ---------------------------------------------------------------------------------------------------------


def untrained(seed=0):
    generator = torch.Generator().manual_seed(seed)
    start = 0.1 * torch.randn(4, 2, dtype=torch.complex128, generator=generator)
    start[0, 0] += 1
    return SpinorSurface(PowerSeries(start), PlaneDomain.disk(n=32))


def test_gradients_by_parameters_and_points_are_right():
    surface = untrained()
    z = torch.tensor([0.3 + 0.2j, -0.5j], dtype=torch.complex128, requires_grad=True)
    coefficients = surface.model.coefficients

    def position(z, coefficients, constant):
        parameters = {"model.coefficients": coefficients, "constant": constant}
        return torch.func.functional_call(_Position(surface), {f"surface.{k}": v for k, v in parameters.items()}, (z,))

    assert torch.autograd.gradcheck(position, (z, coefficients, surface.constant))


class _Position(torch.nn.Module):
    """functional_call calls a module, so the position becomes one."""

    def __init__(self, surface):
        super().__init__()
        self.surface = surface

    def forward(self, z):
        return self.surface.position(z)


def test_zeros_of_antiperiodic_spinors_are_found():
    # p = √z (z − 0.7), q = √z around the hole |z| < 0.4
    outward = torch.tensor([[-0.7, 1], [1, 0]], dtype=torch.complex128)
    inward = torch.zeros(1, 1, 2, dtype=torch.complex128)
    model = LaurentSeries(outward, inward, CircularDomain.annulus(-np.log(0.4)), antiperiodic=(True,))
    of_p, of_q = SpinorSurface(model, PlaneDomain.annulus(0.4)).spinor_zeros()
    assert [zero.order for zero in of_p] == [1]
    assert abs(of_p[0].z - 0.7) < 1e-12
    assert of_q == ()
