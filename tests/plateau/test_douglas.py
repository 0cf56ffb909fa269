"""Douglas's slide: known energies, derivatives, gauge, and limits."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom import gallery
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.douglas import Slides, minimise_dirichlet_energies, resampled, slid, slide_downhill
from spinor_geom.plateau.newton import _line_search
from spinor_geom.plateau.threads import one_thread
from tests.loops import noisy_ellipse
from tests.plateau.slides import DISK, PEANUT, Solved, ellipse, even, form_of, increments, solved, tensors
from tests.strategies import SEEDS

SEAM_AREA = 4.36461878664500
SEAM = tensors(gallery.tennis_seam(0.8).sample(256))
NOISY = tensors(noisy_ellipse(120, amount=0.2))
# the tennis seam is about round: ellipses and a peanut are poor domains for it, and nothing may depend on that
FORMS = {"disk": DISK, "ellipse": form_of(ellipse(1.5), 64), "peanut": form_of(PEANUT, 512)}
every_form = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())


# --- saddles ----------------------------------------------------------------------------------------------------------


def test_from_a_saddle_there_is_a_way_down_and_from_a_minimum_there_is_none():
    assert slide_downhill(SEAM, DISK, solved(SEAM, DISK, even(128)).slide) is None
    lopsided = tensors(gallery.tennis_seam(0.75).sample(256))
    saddle = solved(lopsided, DISK, even(128))
    start = slide_downhill(lopsided, DISK, saddle.slide)
    assert (increments(start) > 0).all()
    below = solved(lopsided, DISK, start)
    stable, unstable = gallery.tennis_seam(0.75).disks
    assert abs(saddle.energy / unstable.area - 1) < 1e-9
    # 128 nodes leave a little of the lopsided disk out
    assert abs(below.energy / stable.area - 1) < 1e-6


# --- known energies ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [64, 128, 512])
def test_tennis_seam_has_its_known_area(n):
    disk = solved(SEAM, DISK, even(n))
    # 64 nodes leave 1e-11 of the area out
    assert abs(disk.energy / SEAM_AREA - 1) < (2e-11 if n == 64 else 1e-13)
    assert disk.gradient < 1e-12
    assert not disk.crowded
    assert 1 <= disk.steps <= 10
    np.testing.assert_allclose(disk.points, SEAM.point_and_derivative(disk.slide)[0])


@every_form
def test_area_does_not_depend_on_the_domain(form):
    disk = solved(SEAM, form, even(1024), tolerance=1e-10)
    assert disk.gradient < 1e-9
    assert abs(disk.energy / SEAM_AREA - 1) < 1e-10


# --- derivatives and steps --------------------------------------------------------------------------------------------


@every_form
def test_gradient_is_the_difference_quotient_of_the_energy(form):
    t = even(512)
    slide, curves = t + 0.02 * np.sin(2 * np.pi * t + 1), CurveTensors.batch([SEAM])
    here = Slides.of(curves, form, slide[None])
    gradient = (here.normal * here.tangent)[:, 0].sum(0)
    random = np.random.default_rng(0)
    for _ in range(4):
        # smooth directions: the third derivative of the energy along them is no larger than the first
        v = np.array(np.fft.irfft(random.normal(size=20) + 1j * random.normal(size=20), n=512) * 512)
        h = 1e-6
        energies = [Slides.of(curves, form, (slide + sign * h * v)[None]).energy[0] for sign in (1, -1)]
        quotient = float(energies[0] - energies[1]) / (2 * h)
        assert abs(quotient - float(gradient @ v)) < 1e-6 * float(np.linalg.norm(gradient) * np.linalg.norm(v))


@pytest.mark.parametrize("form", [FORMS["disk"], FORMS["ellipse"]], ids=["disk", "ellipse"])
def test_newton_converges_quadratically(form):
    minimum = solved(SEAM, form, even(512), tolerance=1e-11)
    start = minimum.slide + 3e-3 * np.sin(6 * np.pi * even(512))
    sizes = []
    again = solved(SEAM, form, start, tolerance=1e-11, near=True, on_step=sizes.append)
    assert len(sizes) == again.steps >= 3
    for before, after in pairwise(sizes):
        # below 1e-9 the samples see what conformal maps of Ω, which Newton's method leaves open, do between them
        assert after < 5 * before**2 + 1e-9
    assert abs(again.energy / minimum.energy - 1) < 1e-12


@settings(max_examples=8)
@given(seed=SEEDS, curve=st.sampled_from([NOISY, SEAM]))
def test_slide_never_falls_and_energy_is_below_that_of_the_start(seed, curve):
    steps = np.random.default_rng(seed).exponential(size=480)
    start = np.array(np.cumsum(steps) / steps.sum())
    first = solved(curve, DISK, start, max_steps=0).energy
    for limit in (1, 2, 4, 8):
        disk = solved(curve, DISK, start, max_steps=limit)
        assert disk.steps <= limit
        # where nodes crowd they are less than a rounding error apart
        assert (increments(disk.slide) >= 0).all()
        # a step may climb, but not above those before it
        assert disk.energy <= first * (1 + 1e-12)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_no_step_is_too_long_for_the_slide_to_increase(size):
    t = even(256)
    state = Slides.of(CurveTensors.batch([SEAM]), DISK, (t + 0.05 * np.sin(2 * np.pi * t))[None])
    direction = np.array(np.random.default_rng(0).normal(size=256)) - 0.5 * state.gradient
    moved, _ = _line_search(state, size * direction, state.energy)
    assert (increments(moved.slide[0]) > 0).all()
    assert float(moved.energy[0]) <= float(state.energy[0]) * (1 + 1e-12)


def test_nodes_in_one_point_move_without_overflow():
    # an increment of 0 was a division by 1e-300, whose square overflows
    moved = slid(np.array([[0.0, 0.25, 0.25, 0.5]]), np.array([[0.0, 1.0, 0.0, 0.0]]), 1.0)
    assert (increments(moved[0]) >= 0).all()


# --- several curves at once -------------------------------------------------------------------------------------------


@given(seed=SEEDS, tolerance=st.sampled_from([1e-4, 1e-10]))
def test_curves_of_a_batch_do_not_know_of_each_other(seed, tolerance):
    random = np.random.default_rng(seed)
    loops = [gallery.random_curve(int(random.integers(50))).sample(int(random.integers(20, 90))) for _ in range(3)]
    loops += [gallery.tennis_seam(0.8).sample(64), BoundaryLoop.from_points(random.normal(size=(3, 3)))]
    curves = [tensors(loop) for loop in loops]
    all_gradients = [[] for _ in curves]
    with one_thread():
        together = minimise_dirichlet_energies(
            CurveTensors.batch(curves),
            DISK,
            np.tile(even(256), (len(curves), 1)),
            tolerances=[tolerance] * len(curves),
            max_steps=[25] * len(curves),
            negligible=[0.0] * len(curves),
            on_step=[gradients.append for gradients in all_gradients],
        )
    for curve, disk, gradients in zip(curves, together, all_gradients, strict=True):
        alone = solved(curve, DISK, even(256), tolerance=tolerance, max_steps=25)
        disk = Solved.of(disk, curve, DISK, len(gradients))
        assert (disk.crowded, disk.steps) == (alone.crowded, alone.steps)
        np.testing.assert_allclose(disk.slide, alone.slide, rtol=0, atol=1e-7)
        assert abs(disk.energy / alone.energy - 1) < 1e-9


# --- crowding ---------------------------------------------------------------------------------------------------------


def test_long_ellipse_crowds_on_the_disk_and_reports_it():
    n = 256
    curve = tensors(gallery.ellipse(8.0).sample(200))
    assert solved(curve, DISK, even(n), tolerance=1e-8, max_steps=100).crowded
    assert not solved(curve, form_of(ellipse(8.0), 128), even(n), tolerance=1e-8).crowded


# --- other numbers of nodes -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("m", "n"), [(64, 96), (64, 256), (96, 100)])
def test_smooth_slides_are_resampled_exactly_and_come_back(m, n):
    def slides(n):
        t = even(n)
        smooth = t + 0.4 + 0.1 * np.sin(2 * np.pi * t) + 0.02 * np.cos(6 * np.pi * t)
        return np.stack([smooth, t + 0.01 * np.sin(20 * np.pi * t)])

    np.testing.assert_allclose(resampled(slides(m), n), slides(n), rtol=0, atol=1e-14)
    np.testing.assert_allclose(resampled(slides(n), m), slides(m), rtol=0, atol=1e-14)


@given(seed=SEEDS, n=st.integers(48, 400).map(lambda half: 2 * half))
def test_rough_slide_increases_when_it_is_resampled(seed, n):
    steps = np.random.default_rng(seed).exponential(size=120) ** 2 + 1e-9
    slide = np.array(np.cumsum(steps) / steps.sum()) - 0.3
    again = resampled(slide, n)
    assert len(again) == n
    assert (increments(again) > 0).all()
    # beside others, smooth or rough, it is the same
    assert np.array_equal(resampled(np.stack([slide, even(120), slide]), n)[2], again)
    # the old nodes lie between the new ones' neighbours
    assert float(np.abs(resampled(slide, 240)[::2] - slide).max()) < 1e-14


@every_form
def test_selected_slides_keep_what_was_computed_for_them(form):
    curves = CurveTensors.batch([SEAM, NOISY, SEAM])
    slides = np.stack([even(512) + 0.01 * np.sin(2 * np.pi * (even(512) + shift)) for shift in (0, 0.3, 0.5)])
    every = Slides.of(curves, form, slides)
    kept = {name: getattr(every, name) for name in ("gauge", "gradient", "size", "speed")}
    which = np.array([0, 2])
    some, anew = every.at(which), Slides.of(curves.at(which), form, slides[which])
    for name, values in kept.items():
        assert name in some.__dict__
        assert np.array_equal(getattr(some, name), values[which])
        assert np.array_equal(getattr(some, name), getattr(anew, name))


@every_form
def test_the_gauge_is_orthonormal(form):
    here = Slides.of(CurveTensors.batch([SEAM, NOISY]), form, np.stack([even(512), even(512) ** 1.5]))
    # three steps of Gram-Schmidt on functions as far from dependent as 1, cosine and sine
    assert np.abs(here.gauge @ here.gauge.mT - np.eye(3)).max() < 1e-13
