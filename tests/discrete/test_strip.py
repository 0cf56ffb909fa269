"""Strips between two loops, and the discrete annuli that start from them."""

import numpy as np
import pytest

from spinor_geom import compare, discrete_minimal_surface, solve_plateau
from spinor_geom.discrete.strip import minimum_area_strip
from spinor_geom.errors import OptionError, TooManyRimsError
from spinor_geom.mesh.operators import face_areas
from tests.plateau.rims import CATENOIDS, coaxial, sampled, skew


def circle(count, radius=1.0, height=0.0, *, clockwise=False, phase=0.0):
    angle = 2 * np.pi * np.arange(count) / count * (-1 if clockwise else 1) + phase
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, height)])


@pytest.mark.parametrize(("m", "n", "phase"), [(30, 30, 0.0), (30, 30, 2.0), (24, 36, 1.0), (40, 7, 0.3)])
def test_strip_runs_once_around_both_rims(m, n, phase):
    first, second = circle(m), circle(n, 0.6, 0.1, clockwise=True, phase=phase)
    faces, area = minimum_area_strip(first, second)
    assert len(faces) == m + n
    assert abs(face_areas(np.concatenate([first, second]), faces).sum() / area - 1) < 1e-12
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    codes = directed @ [m + n, 1]
    lone = directed[~np.isin(codes, directed[:, ::-1] @ [m + n, 1])]
    rim = [*((i, (i + 1) % m) for i in range(m)), *((m + i, m + (i + 1) % n) for i in range(n))]
    assert sorted(map(tuple, lone.tolist())) == sorted(rim)
    # hardly more than the frustum and what the inner polygon leaves of its circle
    frustum, left_out = np.pi * 1.6 * np.hypot(0.4, 0.1), 0.36 * (np.pi - n / 2 * np.sin(2 * np.pi / n))
    assert area < 1.01 * (frustum + left_out)


@pytest.mark.parametrize("h", [0.25, 0.5])
def test_discrete_catenoid_is_near_the_exact_one(h):
    first, second = (sampled(curve, 60) for curve in coaxial(h, phase=1.0))
    discrete = discrete_minimal_surface((first, second.reversed()))
    assert discrete.converged
    np.testing.assert_array_equal(discrete.vertices[:120], np.concatenate([first.points, second.reversed().points]))
    # chords of the rims and flat triangles
    assert abs(discrete.area / CATENOIDS[h][0] - 1) < 5e-3


def test_comparison_of_annuli():
    first, second = skew()
    comparison = compare(solve_plateau((sampled(first, 60), sampled(second, 48))))
    assert abs(comparison.baseline_area / comparison.exact_area - 1) < 5e-3
    assert comparison.hausdorff.max < 0.05
    assert comparison.exact_curvature.max < 1e-9


def test_what_has_no_discrete_annulus_is_refused():
    loops = [sampled(curve, 20) for curve in coaxial(0.3)]
    with pytest.raises(TooManyRimsError):
        discrete_minimal_surface([*loops, loops[0]])
    with pytest.raises(OptionError):
        discrete_minimal_surface(loops, method="pymeshlab")
