"""Figures known to 12 digits and more, computed by the gallery, and here in closed form or by quadrature."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from spinor_geom import gallery

# area by closed form or 25-digit quadrature; π, elliptic integrals and hyperbolic functions only
SURFACE_AREAS = [
    (lambda: gallery.enneper(0.5), 0.998110165984257227),
    (lambda: gallery.enneper(1.0), 7 * math.pi / 3),
    (lambda: gallery.enneper(1.5), 34.9011308859741093),
    (lambda: gallery.enneper(math.sqrt(3)), 21 * math.pi),
    (lambda: gallery.polynomial([1, 0.5], [0, 0.5]), 11 * math.pi / 6),
    (lambda: gallery.polynomial([1], [0, 1 / 3, 1 / 2]), 25703 * math.pi / 19440),
    (lambda: gallery.polynomial([1, 0, 0.25], [0.2, 0.4]), 649783 * math.pi / 480000),
    (lambda: gallery.helicoid(1.0, 1.0), 7.211799724207046965),
    (lambda: gallery.helicoid(2.0, 1.0), 18.58494406536481366),
    (lambda: gallery.helicoid(2.0, 1.0, both_sides=True), 2 * 18.58494406536481366),
    (lambda: gallery.catenoid(0.25), 3.10811242123163774),
    (lambda: gallery.catenoid(0.5), 5.99179697580228191),
    (lambda: gallery.catenoid(0.6), 6.99964256762198862),
    (lambda: gallery.plane_disk(2.0), 4 * math.pi),
]


@pytest.mark.parametrize(("make", "area"), SURFACE_AREAS, ids=lambda value: None if callable(value) else f"{value:.6g}")
def test_surface_areas(make, area):
    known = make()
    assert abs(known.area / area - 1) < 1e-14  # the gallery's closed formula
    assert abs(known.surface.area() / area - 1) < 1e-12  # ½ ∮ r · Im(φ dz)


CURVE_AREAS = [
    (gallery.schwarz_d_quadrilateral(), 0.6396307855855032331),
    (gallery.schwarz_d_hexagon(), 1.918892356756509699),
    (gallery.schwarz_p_hexagon(), 2.345102884044167260),
    (gallery.schwarz_p_quadrilateral(), 0.3908504806740278767),
    (gallery.ellipse(8.0), 8 * math.pi),
]


@pytest.mark.parametrize(("curve", "area"), CURVE_AREAS, ids=lambda value: getattr(value, "name", None))
def test_curve_areas(curve, area):
    assert abs(curve.disks[0].area / area - 1) < 1e-14


def douglas_area(curve, waves, start):
    """Least Dirichlet energy of harmonic disks over a curve, by slides θ + Σ a_j sin jkθ + b_j cos jkθ."""
    n = 512
    theta = 2 * np.pi * np.arange(n) / n
    frequencies = np.abs(np.fft.fftfreq(n, 1 / n))[:, None]
    angles = np.outer(theta, waves * np.arange(1, len(start) // 2 + 1))
    basis = np.hstack([np.sin(angles), np.cos(angles)])

    def energy(slide):
        t = (theta + basis @ slide) / (2 * np.pi)
        c = np.fft.fft(curve.point(t), axis=0) / n
        outward = np.fft.ifft(frequencies * c, axis=0).real * n
        return np.pi * (frequencies * np.abs(c) ** 2).sum(), basis.T @ (outward * curve.derivative(t)).sum(axis=1) / n

    return minimize(energy, start, jac=True, method="BFGS", options={"gtol": 1e-11}).fun


# the period of the slide, by the symmetry of the disk: 2π/6, 2π/4, and 2π/2 for the disks that break that of the seam
@pytest.mark.parametrize(
    ("curve", "waves", "first", "place", "stable"),
    [
        (gallery.twisted_circle(), 6, 0.0, 0, None),
        (gallery.tennis_seam(0.8), 4, 0.0, 0, True),
        (gallery.tennis_seam(0.75), 2, 0.2, 0, True),
        (gallery.tennis_seam(0.75), 4, 0.0, 1, False),
    ],
)
def test_areas_are_least_energies_of_harmonic_disks(curve, waves, first, place, stable):
    start = np.zeros(100)
    start[0] = first
    disk = curve.disks[place]
    assert disk.stable is stable
    assert abs(douglas_area(curve, waves, start) / disk.area - 1) < 1e-12


def test_scherk_areas_equal_the_double_integral():
    nodes, weights = np.polynomial.legendre.leggauss(200)
    for side in (1.0, 2.0, 2.5, 3.0):
        x, w = nodes * side / 2, weights * side / 2
        slope = 1 + np.tan(x)[:, None] ** 2 + np.tan(x) ** 2
        assert abs(w @ np.sqrt(slope) @ w / gallery.scherk(side).disks[0].area - 1) < 1e-12
