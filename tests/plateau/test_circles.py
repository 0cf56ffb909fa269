"""Dirichlet's form of circular domains and the energy over them: known functions, and derivatives by differences."""

import math

import numpy as np
import pytest

from spinor_geom.arrays import NUMPY
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.dirichlet import CirclesForm
from spinor_geom.plateau.rims.capacity_path import mean_modulus
from spinor_geom.plateau.rims.energy import HarmonicSurface
from tests.plateau.rims import facing


def domain(centres, radii):
    return CircularDomain(centres=np.array(centres, dtype=np.complex128), log_radii=np.log(radii))


RING, THREE = domain([0], [0.3]), domain([0, 0.6, -0.3 - 0.5j], [0.3, 0.15, 0.1])


def harmonic(z, centres):
    """A harmonic function with terms of every kind, and the derivative of the function whose real part it is."""
    value, slope = (z**3).imag, -3j * z**2
    for weight, c in enumerate(centres, start=1):
        value = value + (1 / (z - c)).real + weight * np.log(np.abs(z - c))
        slope = slope - 1 / (z - c) ** 2 + weight / (z - c)
    return value, slope


@pytest.mark.parametrize(("where", "n"), [(RING, 64), (THREE, 160), (THREE, 512)], ids=["ring", "full", "low alone"])
def test_normal_derivatives_of_a_harmonic_function_and_the_modulus_of_a_ring(where, n):
    z, centres = where.circles(n), where.centres.tolist()
    value, slope = harmonic(z, centres)
    exact = (slope * where.velocities(n)).imag
    form = CirclesForm.of(where, n)
    np.testing.assert_allclose(form(value[..., None])[..., 0], exact, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(form.matrix() @ value.flatten(), exact.flatten(), rtol=1e-11, atol=1e-11)
    assert mean_modulus(RING) == pytest.approx(math.log(1 / 0.3), rel=1e-13)


def test_derivatives_of_the_energy():
    loops = facing(np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [-1.0, -0.5, -0.3]]))
    curves = CurveTensors.batch([CurveTensors.of(BoundaryCurve.from_loop(loop), NUMPY) for loop in loops])
    n = 160
    even = np.arange(n, dtype=np.float64) / n
    slides = even + 0.02 * np.sin(2 * np.pi * even + np.arange(4)[:, None])
    here = HarmonicSurface.of(curves, slides, THREE, 1e-17)
    gradient, count, step = here.gradient[0], slides.size, 1e-4
    hessian = here.matrix() - here.stiffness * np.outer(here.rotation, here.rotation)
    for k in range(len(gradient) - count):
        move = np.zeros(len(gradient) - count, dtype=np.float64)
        move[k] = step
        after, before = (HarmonicSurface.of(curves, slides, THREE.moved(way * move), 1e-17) for way in (1, -1))
        assert float(after.energy[0] - before.energy[0]) / (2 * step) == pytest.approx(
            float(gradient[count + k]), rel=1e-5
        )
        second = float((after.energy - 2 * here.energy + before.energy)[0]) / step**2
        assert second == pytest.approx(float(hessian[count + k, count + k]), rel=1e-4)
        slope = (after.by_slides - before.by_slides) / (2 * step)
        np.testing.assert_allclose(slope, hessian[:count, count + k], rtol=1e-4, atol=1e-5)
