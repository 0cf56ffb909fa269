"""Exact rational patches of surfaces whose p and q are polynomials."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BSpline

import spinor_geom
from spinor_geom.gallery import surfaces
from spinor_geom.gallery.known import KnownSurface
from spinor_geom.nurbs.nurbs_surface import NurbsSurface
from tests.open_cascade import area_of, distances, free_boundary, free_wires, is_valid

CASES = {
    "disk": (surfaces.plane_disk, 1),
    "enneper": (surfaces.enneper, 3),
    "cubic": (lambda: surfaces.random_polynomial(1, degree=3), 7),
    "quintic": (lambda: surfaces.random_polynomial(3, degree=5), 11),
}


@pytest.mark.parametrize("name", CASES)
def test_patches_are_exact(name: str) -> None:
    make, degree = CASES[name]
    known: KnownSurface = make()
    film = NurbsSurface.of_polynomials(known.surface)
    assert film.converged
    assert [patch.degrees for patch in film.patches] == [(2 * degree, degree)] * 4 + [(2 * degree, 2 * degree)]
    assert abs(film.area / known.area - 1) < 1e-12
    assert film.deviations.surface < 1e-14 * film.deviations.diagonal
    assert film.deviations.normals < 1e-11


def test_the_rim_is_the_trigonometric_curve() -> None:
    known, u = surfaces.enneper(), np.linspace(0, 1, 9)
    (rim,) = NurbsSurface.of_polynomials(known.surface).boundary_curves
    cosine, sine = (0.5**0.5 * each for each in ((1 - u) ** 2 + 2**1.5 * (1 - u) * u + u**2, u**2 - (1 - u) ** 2))
    for quarter, side in enumerate(rim):
        # the arc from −45° to 45° has the control points 1 − i, √2 and 1 + i over √2, of weights 1, √½ and 1
        angle = np.arctan2(sine, cosine) + quarter * np.pi / 2
        assert np.abs(side.point(u) - known.position(0.8 * np.exp(1j * angle))).max() < 1e-15


def test_control_points_of_enneper_follow_from_its_formula() -> None:
    """Those of the inner patch, from values of the polynomials of bidegree 6 at 7 × 7 points."""
    known = surfaces.enneper()
    *_, inner = NurbsSurface.of_polynomials(known.surface).patches
    u = (1 - np.cos(np.pi * np.arange(7) / 6)) / 2
    weight = (1 - u) ** 2 + 2**0.5 * u * (1 - u) + u**2
    along = 0.5**1.5 * (2 * u - 1) / weight
    total = np.multiply.outer(weight**3, weight**3)
    values = total[..., None] * known.position(0.8 * (along[:, None] + 1j * along))
    inverse = np.linalg.inv(BSpline(inner.knots[0], np.eye(7), 6)(u))
    weights = inverse @ total @ inverse.T
    assert np.abs(inner.weights - weights).max() < 1e-13
    points = np.tensordot(inverse, inverse @ values, axes=1) / weights[..., None]
    assert np.abs(inner.control_points - points).max() < 1e-13


def test_a_solution_with_polynomials_is_exact() -> None:
    known = surfaces.enneper()
    film = spinor_geom.solve_plateau(known.rim(96)).to_nurbs()
    assert (len(film.patches), film.size) == (5, 161)
    assert "exact" in film.reason
    assert abs(film.area / known.area - 1) < 1e-13
    assert film.deviations.rim < 1e-13


# IGES files have fewer digits
@pytest.mark.parametrize(("suffix", "tolerance"), [(".step", 1e-11), (".igs", 2e-9), (".brep", 1e-12)])
def test_files_hold_rational_patches(tmp_path: Path, suffix: str, tolerance: float) -> None:
    pytest.importorskip("OCP")
    from spinor_geom.adapters.open_cascade import read_shape

    known = surfaces.enneper()
    NurbsSurface.of_polynomials(known.surface).save(tmp_path / f"film{suffix}")
    shape = read_shape(tmp_path / f"film{suffix}")
    assert is_valid(shape)
    assert free_wires(shape) == (1, 0, 4)
    assert abs(area_of(shape) / known.area - 1) < tolerance
    assert distances(free_boundary(shape), known.point(np.arange(12) / 12)).max() < tolerance
