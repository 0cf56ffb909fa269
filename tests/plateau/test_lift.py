"""The lift of harmonic surfaces to p and q: exact data are recovered, and the reported distance is correct."""

from __future__ import annotations

import numpy as np
import pytest

from spinor_geom.arrays import NUMPY
from spinor_geom.domain import FourierBoundary, PlaneDomain
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.douglas import HarmonicDisk
from spinor_geom.plateau.harmonic.lift import lifted_between, lifted_together
from spinor_geom.plateau.harmonic.lifted_surface import circles_of, domain_of, surface_of
from spinor_geom.plateau.harmonic.traces import with_between_nodes
from spinor_geom.plateau.rims.energy import HarmonicSurface
from spinor_geom.surface.array_surface import ArraySurface
from spinor_geom.surface.formulas import phi
from tests.exact_solutions import ENNEPER
from tests.loops import noisy_ellipse
from tests.plateau.slides import DISK, ellipse, even, form_of, solved, tensors

# coefficients of z⁰, z¹, … as pairs (p, q)
POLYNOMIAL = ((1, 0.2), (0, 0.4), (0.25, 0))
BENT = FourierBoundary(np.array([0.05j, 0.1, 0.2 - 0.1j, 1.0, 0.15 + 0.1j]), 64)
FORMS = {"disk": DISK, "ellipse": form_of(ellipse(2.0), 128), "bent": form_of(BENT, 128)}
every_form = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())


def exact_surface(form, coefficients):
    series = PowerSeries(np.array(coefficients, dtype=np.complex128))
    return ArraySurface(series, PlaneDomain.inside(form.boundary))


def exact_disk(form, surface, n=256):
    """Γ through many points of a surface's boundary, and the surface as a harmonic disk at n nodes."""
    rim = surface.position(form.boundary.point(np.arange(400) / 400))
    curve = BoundaryCurve.from_loop(BoundaryLoop.from_points(rim, corners=()))
    points = surface.position(form.boundary.grid(n)[0])
    slide = np.unwrap(2 * np.pi * curve.nearest(points)) / (2 * np.pi)
    disk = HarmonicDisk(slide=np.array(slide), points=np.array(points), crowded=False)
    return CurveTensors.of(curve, NUMPY), disk


def lifted(disk, form, curve, *, allowed):
    (lift,) = lifted_together([disk], form, CurveTensors.batch([curve]), allowed=[allowed])
    return lift


def off_but_for_sign(lift, known, z):
    """The largest difference of p and q, up to their sign."""
    found, expected = lift.model.value(np.array(z)), known.spinors(z)
    return np.abs(np.sign((found * np.conj(expected)).sum().real) * found - expected).max()


# --- exact data -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("coefficients", [ENNEPER, POLYNOMIAL], ids=["Enneper", "polynomial"])
@every_form
def test_p_and_q_of_a_known_surface_come_back_up_to_their_sign(form, coefficients):
    known = exact_surface(form, coefficients)
    curve, disk = exact_disk(form, known)
    lift = lifted(disk, form, curve, allowed=1e-8)
    assert isinstance(lift.model, PowerSeries if form is DISK else CauchyInterpolant)
    assert lift.misfit.rms < 1e-9
    assert lift.misfit.rms <= lift.misfit.max
    z = known.domain.triangulation.points * 0.99
    assert off_but_for_sign(lift, known, z) < 1e-10
    assert abs(lift.area / known.area() - 1) < 1e-10
    surface = surface_of(lift, domain_of(lift, form.boundary))(1.0, np.zeros(3))
    assert np.abs(surface.position(z) - known.position(z)).max() < 1e-9


@every_form
def test_null_curve_is_the_surface_at_the_nodes_and_between_them(form):
    curve, disk = exact_disk(form, exact_surface(form, ENNEPER), n=128)
    lift = lifted(disk, form, curve, allowed=1e-8)
    (null_curve,), (slide,) = lift.null_curve, lift.slides
    assert null_curve.shape == (384, 3)
    assert slide.shape == (384,)
    surface = surface_of(lift, domain_of(lift, form.boundary))(1.0, np.zeros(3))
    z, dz, _ = form.boundary.grid(384)
    assert np.abs(surface.position(z) - null_curve.real).max() < 1e-10
    gap = null_curve.real - curve.point_and_derivative(slide)[0]
    assert abs(float(np.linalg.norm(gap, axis=1).max()) - lift.misfit.max) < 1e-14
    # d/dt of the null curve is φ dz/dt
    p, q = np.array(surface.spinors(z)).T
    velocity = phi(p, q) * dz[:, None]
    frequency = np.fft.fftfreq(384, 1 / 384)[:, None]
    slope = np.fft.ifft(2j * np.pi * frequency * np.fft.fft(null_curve, axis=0), axis=0)
    assert np.abs(slope - velocity).max() < 1e-9 * np.abs(velocity).max()


# --- branch points ----------------------------------------------------------------------------------------------------


@every_form
def test_branch_point_of_odd_order_is_refused(form):
    """φ = z·(Enneper's φ): p and q are square roots of z times polynomials."""
    z = form.boundary.grid(256)[0]
    points = np.stack([z**2 / 2 - z**4 / 4, -1j * (z**2 / 2 + z**4 / 4), 2 * z**3 / 3], axis=1).real
    curve, disk = exact_disk(form, exact_surface(form, ENNEPER))
    branched = HarmonicDisk(slide=disk.slide, points=np.array(points), crowded=False)
    assert lifted(branched, form, curve, allowed=1e-8) is None


@every_form
def test_branch_point_of_even_order_is_kept(form):
    """p = z, q = z²."""
    known = exact_surface(form, ((0, 0), (1, 0), (0, 1)))
    z = form.boundary.grid(256)[0]
    # the boundary winds three times and more around the branch point: Γ is taken as it comes
    curve, disk = exact_disk(form, exact_surface(form, ENNEPER))
    points = np.array(known.position(z))
    branched = HarmonicDisk(slide=disk.slide, points=points, crowded=False)
    lift = lifted(branched, form, curve, allowed=np.inf)
    assert off_but_for_sign(lift, known, 0.5 * known.domain.triangulation.points) < 1e-10


# --- the reported distance --------------------------------------------------------------------------------------------


def rough_disk(form, n):
    loop = noisy_ellipse(80, amount=0.1)
    curve = tensors(loop)
    return curve, solved(curve, form, even(n), tolerance=1e-8, max_steps=200)


@pytest.mark.parametrize("n", [160, 320])
def test_distance_from_the_curve_is_measured_on_the_surface_itself(n):
    form = form_of(ellipse(2.0), 128)
    curve, disk = rough_disk(form, n)
    lift = lifted(disk, form, curve, allowed=0.0)
    surface = surface_of(lift, domain_of(lift, form.boundary))(1.0, np.zeros(3))
    none = np.zeros(80, dtype=bool)
    exact = BoundaryCurve(kind="cubic", breaks=curve.breaks, coefficients=curve.coefficients, corners=none)
    # other points than the lift's
    t = (np.arange(3000) + 0.3) / 3000
    r = surface.position(form.boundary.point(t))
    distance = np.linalg.norm(r - exact.point(exact.nearest(r)), axis=1)
    rms = np.sqrt(np.average(distance**2, weights=np.linalg.norm(r - np.roll(r, 1, axis=0), axis=1)))
    # far more than rounding: the nodes do not resolve the noise
    assert lift.misfit.rms > 1e-5
    assert abs(rms / lift.misfit.rms - 1) < 0.1
    assert abs(distance.max() / lift.misfit.max - 1) < 0.2
    assert abs(surface.area() / lift.area - 1) < 1e-5


def test_corrections_bring_the_surface_nearer_and_end_where_it_is_near_enough():
    form = form_of(ellipse(2.0), 128)
    curve, disk = rough_disk(form, 320)
    first, best = (lifted(disk, form, curve, allowed=allowed) for allowed in (np.inf, 0.0))
    assert best.misfit.rms < first.misfit.rms
    between = lifted(disk, form, curve, allowed=2 * best.misfit.rms)
    assert best.misfit.rms <= between.misfit.rms <= 2 * best.misfit.rms


# --- several rims -----------------------------------------------------------------------------------------------------

RING = CircularDomain.annulus(1.2)
TWO_HOLES = CircularDomain(centres=np.array([0.0, 0.55], dtype=np.complex128), log_radii=np.log([0.25, 0.2]))
# outward and inward coefficients of p and q: a catenoid, a disk around whose middle a ring changes its sign, three rims
BETWEEN = {
    "catenoid": (RING, [[1, 0]], [[[0, 2.0]]], (False,)),
    "antiperiodic": (RING, [[1, 0], [0, 0.3]], [[[0, 0]]], (True,)),
    "three rims": (TWO_HOLES, [[1, 0], [0.1, 0]], [[[0, 0]], [[0, 0.4]]], (False, False)),
}


def between(name, n, *, disturbed=0.0):
    """A known surface, the curves that its rims lie on, and the harmonic surface with a slide that may be off."""
    domain, outward, inward, odd = BETWEEN[name]
    parts = (np.array(part, dtype=np.complex128) for part in (outward, inward))
    model = LaurentSeries(*parts, domain, antiperiodic=odd)
    boundary, *holes = circles_of(domain, [64] * domain.rims)
    known = ArraySurface(model, PlaneDomain.inside(boundary, holes=tuple(holes)))
    curves, slides, t = [], [], even(n)
    for rim in known.domain.boundaries:
        points = known.position(rim.point(np.arange(300) / 300))
        curve = BoundaryCurve.from_loop(BoundaryLoop.from_points(points, corners=()))
        curves.append(CurveTensors.of(curve, NUMPY))
        slides.append(np.array(np.unwrap(2 * np.pi * curve.nearest(known.position(rim.point(t)))) / (2 * np.pi)))
    together = CurveTensors.batch(curves)
    off = disturbed * np.sin(6 * np.pi * t)
    return known, together, HarmonicSurface.of(together, np.stack(slides) + off, domain, 1e-17)


@pytest.mark.parametrize("name", BETWEEN)
def test_p_and_q_between_rims_come_back_up_to_their_sign(name):
    known, curves, harmonic = between(name, 128)
    lift = lifted_between(harmonic.domain, harmonic.points, harmonic.slides, curves, allowed=1e-8)
    assert lift.series.antiperiodic == BETWEEN[name][3]
    assert lift.misfit.rms < 1e-8
    assert lift.period < 1e-14
    assert abs(lift.area / known.area() - 1) < 1e-8
    z = known.domain.triangulation.points * 0.999
    assert off_but_for_sign(lift, known, z) < 1e-6
    domain = domain_of(lift, *circles_of(harmonic.domain, [64] * len(harmonic.slides)))
    surface = surface_of(lift, domain)(1.0, np.zeros(3))
    assert np.abs(surface.position(z) - known.position(z)).max() < 1e-7


@pytest.mark.parametrize("name", BETWEEN)
def test_rims_settle_and_stay_closed(name):
    """X is not conformal: the distance of its lift from the curves is mostly smooth, with periods around the holes."""
    _, curves, harmonic = between(name, 128, disturbed=3e-3)
    given = harmonic.domain, harmonic.points, harmonic.slides, curves
    first, best = (lifted_between(*given, allowed=allowed) for allowed in (np.inf, 0.0))
    assert first.misfit.rms > 1e-5
    assert best.misfit.rms < 0.3 * first.misfit.rms
    for lift in (first, best):
        assert lift.period < 1e-14
        residues = lift.series.integrals()[2]
        assert np.abs((residues[:, 0] - residues[:, 1]).imag).max() < 1e-15
        assert np.abs(residues[:, 2].imag).max() < 1e-15


# --- between the nodes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("each", [2, 4, 5])
@pytest.mark.parametrize("n", [128, 512])
@pytest.mark.parametrize("name", ["ellipse", "bent"])
def test_values_between_the_nodes_are_those_of_the_interpolant(name, n, each):
    """The values are not those of a holomorphic function, so that the two rules are compared exactly."""
    form, random = FORMS[name], np.random.default_rng(0)
    z, dz, _ = (np.array(row) for row in form.boundary.grid(n))
    spectrum = random.normal(size=(n, 2)) + 1j * random.normal(size=(n, 2))
    spectrum[n // 2] = 0  # its two halves are one
    values = np.array(np.fft.ifft(spectrum, axis=0) * n**0.5)
    fine = form.boundary.grid(each * n)[0].reshape(n, each)
    expected = CauchyInterpolant(z, dz, values).value(fine[:, 1:])
    found = with_between_nodes(values.mT[None], form.kernel, each)[0].mT.reshape(n, each, 2)
    np.testing.assert_allclose(found[:, 0], values, rtol=0, atol=0)
    np.testing.assert_allclose(found[:, 1:], expected, rtol=0, atol=1e-11)
