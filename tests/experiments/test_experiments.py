"""The paper's experiments at tiny settings: figures, verdicts, and the files that they write."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from unittest.mock import create_autospec

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure
from PIL import Image

from spinor_geom import gallery
from spinor_geom.cli.main import main
from spinor_geom.domain import PlaneDomain
from spinor_geom.errors import OptionError
from spinor_geom.experiments import NAMES, figures, forms, integration, paper_surfaces, trainings
from spinor_geom.experiments.experiment import Outcome, experiment, reproduce
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.render.portrait import Portrait
from spinor_geom.render.scene import Dots
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.training import LevenbergMarquardt

pytestmark = pytest.mark.usefixtures("drawn_by_one_process")
TINY_NETWORK = LevenbergMarquardt(depth=2, width=10, tolerance=1e-3)


@pytest.fixture
def undrawn(monkeypatch):
    """Leaves out the drawing of surfaces, which takes most of an experiment's time at these settings."""
    for module in (forms, integration, trainings):
        drawn = create_autospec(figures.surfaces, side_effect=lambda *_, **__: Figure())
        monkeypatch.setattr(module, "surfaces", drawn)


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_an_experiment_that_quick_shortens(name):
    one = experiment(name)
    full, quick = one.settings(quick=False), one.settings(quick=True)
    assert full.keys() == quick.keys()
    assert one.quick
    assert all(full[path.partition(".")[0]] != quick[path.partition(".")[0]] for path in one.quick)
    # by its settings a run knows what an earlier one finished
    description = one.description(quick=False)
    assert json.loads(json.dumps(description)) == description != one.description(quick=True)


def test_slopes_are_fitted_above_the_floor_only():
    assert abs(integration.fitted_slope((10, 20, 40), (1.0, 0.25, 1e-9), 1e-6) + 2) < 1e-12
    assert np.isnan(integration.fitted_slope((10, 20), (1e-12, 1e-13), 1e-6))


def test_catenoid_errors_fall_at_the_rules_orders():
    outcome = integration.catenoid_error(grid=(12, 5), steps=(20, 40, 80))
    assert outcome.reproduced
    assert [round(row["max error"]) for row in outcome.rows if row["N"] == "slope"] == [-2, -4]
    # second order: |Δz|³ max|φ″|/(12 N²) bounds the trapezoid's error
    first = outcome.rows[0]
    assert first["max error"] < abs(1 + 2j * np.pi) ** 3 * np.sqrt(2) * np.cosh(1) / (12 * 20**2)


def test_prescribed_boundaries_have_their_own_derivatives():
    for surface in (paper_surfaces.random_networks(2), paper_surfaces.perturbed_series(2)):
        curve = paper_surfaces.boundary_of(surface, "prescribed")
        t, h = np.linspace(0, 1, 7), 1e-5
        for f, df in ((curve.point, curve.derivative), (curve.derivative, curve.second_derivative)):
            slope = (f(t + h) - f(t - h)) / (2 * h)
            assert np.allclose(slope, df(t), atol=1e-6 * np.abs(slope).max())


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("steps", "reproduced"), [(100, True), (2, False)])
def test_mean_curvature_is_nearly_zero_where_the_rule_is_fine(monkeypatch, steps, reproduced):
    surface = paper_surfaces.random_networks(2)
    monkeypatch.setattr(integration, "reconstructed", lambda _: {"random networks": surface})
    outcome = integration.heat_maps(grid=(3, 8), steps=steps, network=TINY_NETWORK)
    assert outcome.reproduced == reproduced
    assert list(outcome.pictures) == ["heat-maps"]


@pytest.mark.parametrize(("a", "turn", "sign"), [(0.0, 0.3, 1), (0.3 - 0.4j, -2.0, -1), (-0.5, 3.0, 1)])
def test_the_moebius_map_of_a_reparametrised_surface_is_found(a, turn, sign):
    truth = gallery.polynomial([1, 0.2j, 0.1], [0.3, 0.5]).surface
    z = np.exp(2j * np.pi * np.arange(256) / 256)
    root = np.exp(0.5j * turn) * np.sqrt(1 - abs(a) ** 2) / (1 - np.conj(a) * z)
    spinors = sign * truth.spinors(np.exp(1j * turn) * (z - a) / (1 - np.conj(a) * z)) * root[:, None]
    coefficients = torch.tensor(np.fft.fft(spinors, axis=0)[:100] / 256)
    found = SpinorSurface(PowerSeries(coefficients), PlaneDomain.disk())
    fit = trainings.fit_moebius(found, truth)
    assert abs(fit.center - a) < 1e-10
    assert abs(np.exp(1j * fit.turn) - np.exp(1j * turn)) < 1e-10
    assert fit.sign == sign
    assert max(fit.residuals[name] for name in ("p, q", "f", "g")) < 1e-10


def test_a_fitted_moebius_map_moves_the_functions():
    truth = gallery.polynomial([1, 0.2j, 0.1], [0.3, 0.5]).surface
    fit = trainings.MoebiusFit(center=0.2 - 0.1j, turn=1.0, sign=-1, residuals={})
    z = np.array([0.1 + 0.3j, -0.6, 0.2 - 0.1j])
    w, root = fit.reparametrised(z)
    assert w[2] == 0
    h = 1e-6
    slope = (fit.reparametrised(z + h)[0] - fit.reparametrised(z - h)[0]) / (2 * h)
    assert np.allclose(root**2, slope, atol=1e-9)
    moved, own = trainings.functions(truth, fit), trainings.functions(truth)
    # f dz and g belong to the surface, not to its parameter
    assert np.allclose(moved["f"](z), own["f"](w) * slope, atol=1e-9)
    assert np.allclose(moved["g"](z), own["g"](w), atol=1e-12)
    phi = truth.null_curve(z)
    assert np.allclose(own["f"](z), phi[:, 0] - 1j * phi[:, 1], atol=1e-14)


@pytest.mark.usefixtures("undrawn")
def test_branch_points_last_where_the_order_is_odd_and_spinors_have_none():
    outcome = forms.lasting_branch_points(orders=(1, 2, 3), random=4)
    assert outcome.reproduced
    known = [row for row in outcome.rows if "removable" in row]
    assert [row["order of φ"] for row in known] == [2, 4, 6, 1, 2, 3]
    assert [row["removable"] for row in known] == [True] * 3 + [False, True, False]
    assert max(row["found off by"] for row in known) < 1e-12
    assert outcome.rows[-2]["such points"] == 0 < outcome.rows[-1]["such points"]


def test_triangles_of_the_disk_cover_it_once_and_turn_one_way():
    z, faces = figures.disk_grid(5, 12)
    a, b, c = z[faces].T
    areas = ((b - a).conj() * (c - a)).imag / 2
    assert areas.min() > 0
    assert abs(areas.sum() - 6 * np.sin(np.pi / 6)) < 1e-12


def test_surfaces_are_drawn_whole_with_dots_and_a_scale_of_colours():
    surface = gallery.enneper(1.0).surface
    field = {"|H|": np.linspace(0, 1, 1 + 3 * 24)}
    dots = Dots(vertices=surface.position(np.array([0j])), colour="#ff00ff", width=20)
    dotted = Portrait(layers=(*figures.over_disk(surface, grid=(3, 24)).layers, dots))
    figure = figures.surfaces({"a": dotted, "b": figures.over_disk(surface, grid=(3, 24), fields=field)})
    assert [axes.get_title() for axes in figure.axes] == ["a", "b", ""]  # the third is a scale of colours
    for axes, has_dots in zip(figure.axes[:2], (True, False), strict=True):
        picture = np.asarray(axes.images[0].get_array())[..., :3]
        drawn = np.argwhere(picture.min(axis=-1) < 0.95)
        low, high = drawn.min(axis=0) / len(picture), drawn.max(axis=0) / len(picture)
        assert low.min() > 0
        assert high.max() < 1
        assert (high - low)[1] > 0.7
        is_magenta = (picture[..., 0] > 0.6) & (picture[..., 1] < 0.4) & (picture[..., 2] > 0.6)
        assert is_magenta.any() == has_dots


def test_a_run_leaves_report_data_and_pictures(tmp_path):
    reported = []
    reproduce(["catenoid"], tmp_path / "new", quick=True, on_start=reported.append)
    assert reported == ["catenoid"]
    written = sorted(path.name for path in (tmp_path / "new").rglob("*") if path.is_file())
    assert written == ["catenoid.png", "data.json", "report.html", "report.md"]
    folder = tmp_path / "new" / "catenoid"
    data = json.loads((folder / "data.json").read_text())
    assert (data["quick"], data["reproduced"], data["settings"]["grid"]) == (True, True, [120, 30])
    with Image.open(folder / "catenoid.png") as picture:
        assert picture.size[0] > 500
    text = (tmp_path / "new" / "report.md").read_text()
    assert "**Shortened.** steps (10, 20, 40, 80, 160) instead of (10, 20, 40, 80, 160, 320, 640)." in text
    assert "![catenoid](catenoid/catenoid.png)" in text
    assert "**Reproduced.**" in text
    page = (tmp_path / "new" / "report.html").read_text()
    # the page holds its pictures: it can be moved
    pictures = re.findall(r'<img alt="catenoid" src="data:image/png;base64,([^"]+)">', page)
    assert [base64.b64decode(data) for data in pictures] == [(folder / "catenoid.png").read_bytes()]
    assert "<td>trapezoid</td>" in page
    assert "<strong>Reproduced.</strong>" in page
    assert not re.search(r'(src|href)="(?!data:)', page)


def test_an_unknown_name_is_refused_before_anything_runs(tmp_path, capsys):
    with pytest.raises(OptionError, match="no experiment 'catenary'"):
        reproduce(["catenoid", "catenary"], tmp_path / "out")
    assert main(["reproduce", "catenary", "-o", str(tmp_path / "out")]) == 2
    assert "choose from: " in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_unconfirmed_statement_of_the_paper_is_an_exit_status(tmp_path, capsys, monkeypatch):
    outcome = Outcome(rows=[{"a": 1}], reproduced=False, verdict="Slope 0.")
    not_seen = replace(experiment("catenoid"), measure=lambda **_: outcome)
    monkeypatch.setitem(integration.EXPERIMENTS, "catenoid", not_seen)
    assert main(["reproduce", "catenoid", "-o", str(tmp_path)]) == 1
    *_, counts, verdict = capsys.readouterr().err.splitlines()
    assert counts.startswith("spinor-geom: 0 of 1 agree with the paper")
    assert verdict == "spinor-geom: catenoid: Slope 0."
