"""The associate family: isometric, with the known members; animations and the page that show it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom import gallery
from spinor_geom.cli.main import main
from spinor_geom.domain import PlaneDomain
from spinor_geom.errors import OptionError, PeriodError
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.meshing.embed import mesh_surface
from spinor_geom.render.morph import SUFFIXES, morph
from spinor_geom.render.portrait import GAUSS, GRID_LINES, grid_lines, surface_layers
from spinor_geom.surface.array_surface import ArraySurface
from tests.browser import visit
from tests.render.test_viewer import array, data_of

ANGLES = st.floats(-10, 10)


def catenoid_on_a_ring():
    """p = 1, q = 1/z over the unit disk: ∮ φ dz is not 0 around the pole, and imaginary."""
    z = np.exp(2j * np.pi * np.arange(64) / 64)
    ones = np.ones(64, dtype=np.float64)
    pole, scale = np.zeros(1, dtype=np.complex128), ones[:1]
    model = CauchyNetwork.orthonormal_on(z, ones, poles=pole, scales=scale, degree=1)
    wanted = np.stack([np.ones_like(z), 1 / z], axis=1)
    readout = np.linalg.lstsq(model.features(z), wanted)[0]
    return ArraySurface(replace(model, readout=readout), PlaneDomain.disk())


@pytest.fixture(scope="module")
def catenoid():
    return surface_layers(gallery.catenoid().surface, vertices=600, family=True)[0]


@given(angle=ANGLES)
def test_members_are_those_of_the_surface_up_to_a_shift(catenoid, angle):
    surface = gallery.catenoid().surface
    z = mesh_surface(surface, vertices=600).points
    apart = catenoid.turned(angle)[: len(z)] - surface.associate(angle).position(z)
    np.testing.assert_allclose(apart - apart.mean(axis=0), 0, atol=1e-12)
    # the mean stays where it is
    np.testing.assert_allclose(catenoid.turned(angle).mean(axis=0), catenoid.vertices.mean(axis=0), atol=1e-12)


@given(angle=ANGLES)
def test_the_metric_stays_to_round_off(angle):
    surface = gallery.enneper(1.2).surface
    z = surface.domain.triangulation.points
    turned, h = surface.associate(angle), 1e-3
    for step in (h, 1j * h):
        # lengths of the images of short segments, by quadrature of the speed along them
        nodes, weights = np.polynomial.legendre.leggauss(8)
        along = z[:, None] + step * (nodes + 1) / 2
        lengths = [(np.asarray(s.conformal_factor(along)) * weights).sum(axis=1) for s in (surface, turned)]
        np.testing.assert_allclose(lengths[1], lengths[0], rtol=1e-14)


def test_lines_of_the_grid_lie_in_the_domain_and_are_straight_there():
    domain = gallery.catenoid().surface.domain
    mesh = domain.triangulation
    points, lines = grid_lines(mesh.points, mesh.faces, np.column_stack([mesh.points.real, mesh.points.imag]))
    z = points @ np.array([1.0, 1.0j])
    assert domain.contains(z[lines].mean(axis=1)).all()  # its ends may lie on the rim
    step = np.abs(points[lines[:, 1]] - points[lines[:, 0]])
    assert (step.min(axis=1) < 1e-12 * domain.diameter).all()
    # each piece lies in a triangle
    edge = np.abs(mesh.points[mesh.faces] - mesh.points[np.roll(mesh.faces, 1, axis=1)]).max()
    assert (step.max(axis=1) <= edge).all()
    assert len(lines) > 2 * GRID_LINES


def test_a_pole_in_the_domain_is_named_as_the_reason_for_no_family():
    with pytest.raises(PeriodError, match=r"the domain's boundary.*-12\.6") as caught:
        surface_layers(catenoid_on_a_ring(), family=True)
    np.testing.assert_allclose(caught.value.period, [0, 0, -4 * np.pi], atol=1e-9)


@pytest.mark.usefixtures("drawn_by_one_process")
def test_an_animation_has_its_frames_and_begins_with_the_surface(tmp_path):
    from PIL import Image, ImageSequence

    path = tmp_path / "catenoid.gif"
    morph(gallery.catenoid().surface, path, frames=4)
    with Image.open(path) as image:
        assert image.n_frames == 4
        assert image.info["duration"] == 40
        assert image.info["loop"] == 0
        frames = [np.asarray(frame.convert("RGB")).astype(int) for frame in ImageSequence.Iterator(image)]
    assert [item.name for item in tmp_path.iterdir()] == ["catenoid.gif"]
    assert all((frame[0, 0] == 255).all() for frame in frames)
    drawn = [np.argwhere((frame < 240).any(axis=2)) for frame in frames]
    height, width = zip(*(np.ptp(where, axis=0) for where in drawn), strict=True)
    # a catenoid between unit circles one apart is wider than high, the helicoid is high; half a turn is a reflection
    assert width[0] > height[0]
    assert height[1] > 2 * width[1]
    assert (height[2], width[2]) == pytest.approx((height[0], width[0]), abs=3)
    # both sides in their colours
    red, _, blue = np.moveaxis(frames[0], -1, 0)
    assert ((red - blue) > 60).mean() > 0.02
    assert ((blue - red) > 40).mean() > 0.02


def test_the_page_holds_surface_and_conjugate(tmp_path):
    path = tmp_path / "enneper.html"
    morph(gallery.enneper(0.8).surface, path)
    text = path.read_text(encoding="utf-8")
    (view,) = data_of(text)["views"]
    surface, grid, rim = view["layers"]
    family, *_ = surface_layers(gallery.enneper(0.8).surface, family=True)
    assert view["layers"][0]["fields"].keys() == {GAUSS}
    for layer in (surface, grid, rim):
        for name, expected in (("vertices", family.vertices), ("conjugate", family.conjugate)):
            found = array(text, layer[name], "<f4").reshape(-1, 3)
            found = view["reach"] * (found - found.mean(axis=0)) + expected.mean(axis=0)
            np.testing.assert_allclose(found, expected, atol=1e-6)
    assert array(text, surface["elements"], "<u4").max() == family.faces.max()


@pytest.mark.slow
def test_the_slider_of_the_page_turns_the_surface_in_a_browser(chromium, tmp_path):
    path = tmp_path / "catenoid.html"
    morph(gallery.catenoid().surface, path)
    with visit(chromium, path.as_uri(), ready=True) as opened:
        page = opened.page
        canvas = page.locator("canvas")
        seen = []
        for angle in (0, 90, 360):
            moved = "(slider, angle) => { slider.value = angle; slider.dispatchEvent(new Event('input')); }"
            page.locator("input[type=range]").evaluate(moved, angle)
            seen.append(canvas.screenshot())
            assert page.locator("output").text_content() == f"{angle}°"
        assert seen[0] == seen[2]
        assert seen[0] != seen[1]
        assert not opened.errors
        assert not opened.foreign


@pytest.mark.parametrize("name", ["catenoid.avi", "catenoid", "catenoid.gif.txt"])
def test_unknown_formats_are_refused_before_work(tmp_path, name, capsys):
    with pytest.raises(OptionError, match=re.escape(", ".join(SUFFIXES))):
        morph(gallery.catenoid().surface, tmp_path / name)
    assert main(["morph", "catenoid", "-o", str(tmp_path / name)]) == 2
    assert "one of .gif, .html, .mp4" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_command_takes_a_name_or_a_saved_surface(tmp_path, capsys):
    saved, first, second = tmp_path / "a.safetensors", tmp_path / "first.html", tmp_path / "second.html"
    gallery.named_surface("enneper").save(saved)
    assert main(["morph", "enneper", "-o", str(first)]) == 0
    assert main(["morph", str(saved), "-o", str(second)]) == 0
    views = [path.read_text(encoding="utf-8").split('id="data"')[1] for path in (first, second)]
    assert views[0] == views[1]
    assert main(["morph", "ennepers", "-o", str(first)]) == 2
    assert "it has associate, catenoid" in capsys.readouterr().err
    assert main(["morph", str(tmp_path / "none.safetensors"), "-o", str(first)]) == 2
    assert "none.safetensors" in capsys.readouterr().err
