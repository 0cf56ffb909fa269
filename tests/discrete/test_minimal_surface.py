"""Both discrete baselines: exact on plane loops, of order two on curved ones, and with an unchanged boundary."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinor_geom import gallery
from spinor_geom.discrete import minimal_surface
from spinor_geom.discrete.first_fill import disk_without_inner_points
from spinor_geom.discrete.minimal_surface import discrete_minimal_surface
from spinor_geom.errors import DomainError, OptionError
from spinor_geom.measures import discrete_mean_curvature
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import face_areas
from tests.loops import CONVEX, L_SHAPE, is_disk_on, planar, polygon_area, slit
from tests.strategies import SEEDS, rough_loops

METHODS = ("libigl", "pymeshlab")
ENNEPER = gallery.enneper(0.8)
both = pytest.mark.parametrize("method", METHODS)


def filled(loop, method, **options):
    return discrete_minimal_surface(loop, method=method, relative_change=1e-10, **options)


@both
@pytest.mark.parametrize("corners", [CONVEX, L_SHAPE], ids=["convex", "L"])
def test_plane_polygon_has_its_exact_area(corners, method):
    loop = planar(corners, 60)
    surface = filled(loop, method)
    assert surface.converged
    assert abs(surface.area / polygon_area(corners) - 1) < 1e-12
    assert is_disk_on(loop, surface.vertices, surface.faces)
    assert np.abs(surface.vertices[:, 2]).max() < 1e-14


@both
def test_area_of_enneper_converges_at_order_two(method):
    counts = np.array([24, 48, 96])
    errors = []
    for n in counts:
        loop = ENNEPER.rim(int(n))
        errors.append(abs(filled(loop, method, target_edge_length=loop.mean_edge_length).area / ENNEPER.area - 1))
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    # the polygons inscribed in the rim bound less area, in proportion to the squared edge length
    assert 1.8 < slope < 2.3
    assert errors[-1] < 2e-3


@both
@pytest.mark.parametrize("rim", [ENNEPER.rim(64), gallery.tennis_seam(0.8).sample(64)], ids=["Enneper", "seam"])
def test_stationary_means_no_normal_curvature_and_some_tangential_pull(rim, method):
    surface = filled(rim, method)
    assert surface.converged
    curvature = discrete_mean_curvature(surface.vertices, surface.faces)
    assert curvature.rms < 1e-4 * curvature.tangential_rms


@both
def test_slit_one_triangle_wide(method):
    loop = slit()
    surface = filled(loop, method)
    assert len(surface.vertices) == len(loop)
    assert abs(surface.area / (45 * 0.87) - 1) < 1e-12
    assert is_disk_on(loop, surface.vertices, surface.faces)


@both
@settings(max_examples=8)
@given(points=rough_loops())
def test_rough_loops_give_disks_on_their_own_boundary(points, method):
    loop = BoundaryLoop.from_points(points)
    surface = filled(loop, method)
    assert surface.boundary_size == len(loop)
    assert surface.vertices[: len(loop)].tobytes() == loop.points.tobytes()
    assert is_disk_on(loop, surface.vertices, surface.faces)
    assert (np.diff(surface.area_history) <= 0).all()
    assert surface.area == surface.area_history[-1]


@both
def test_target_edge_length_is_honoured(method):
    loop = ENNEPER.rim(32)
    sizes = []
    for target in (0.1, 0.05):
        surface = filled(loop, method, target_edge_length=target)
        ends = np.sort(np.stack([surface.faces, np.roll(surface.faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        inner = np.unique(ends[(ends >= len(loop)).all(axis=1)], axis=0)
        length = np.linalg.norm(surface.vertices[inner[:, 0]] - surface.vertices[inner[:, 1]], axis=1)
        assert 0.6 * target < np.median(length) < 1.25 * target
        assert np.quantile(length, 0.99) < 1.6 * target
        sizes.append(len(surface.vertices) - len(loop))
    assert 3 < sizes[1] / sizes[0] < 6


@pytest.mark.parametrize(
    "wrong",
    [
        {"method": "gmsh"},
        *({name: value} for name in ("target_edge_length", "relative_change") for value in (0.0, -1.0, float("nan"))),
    ],
)
def test_options_that_make_no_sense_are_refused(wrong):
    with pytest.raises(OptionError, match=next(iter(wrong))):
        discrete_minimal_surface(slit(), **wrong)


def tangle(count, kind, seed):
    """Random points in random order: knots, plane loops that cross themselves, points on a line in any order."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    points[:, {"space": 3, "plane": 2, "line": 1}[kind] :] = 0
    return BoundaryLoop.from_points(points)


tangles = given(count=st.integers(3, 30), kind=st.sampled_from(["space", "plane", "line"]), seed=SEEDS)


@tangles
def test_tangled_loops_are_closed(count, kind, seed):
    assert_closed(tangle(count, kind, seed))


def assert_closed(loop):
    surface = discrete_minimal_surface(loop)
    assert is_disk_on(loop, surface.vertices, surface.faces)
    assert np.isfinite(surface.vertices).all()
    assert surface.vertices[: len(loop)].tobytes() == loop.points.tobytes()
    assert surface.converged or surface.reason
    if surface.reason:  # what is not the usual surface is no worse than one without inner vertices
        bound = face_areas(loop.points, disk_without_inner_points(loop.points)).sum()
        assert surface.area <= bound * (1 + 1e-12)
    return surface


@pytest.mark.parametrize("seed", range(6))
def test_zigzag_collars_are_closed(seed):
    """Saw teeth in space, with turns of up to 170°."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(5, 41))
    t = 2 * np.pi * np.arange(count) / count
    tooth = np.where(np.arange(count) % 2, 1, -1)[:, None] * rng.uniform(size=(count, 2)) * (0.8, 1.5)
    radius = 1 + tooth[:, 0]
    assert_closed(BoundaryLoop.from_points(np.stack([radius * np.cos(t), radius * np.sin(t), tooth[:, 1]], axis=1)))


@pytest.mark.parametrize("width", [0.0, 1e-12, 1e-3])
def test_curved_slits_are_closed(width):
    """Loops that run along an arc and back, in space: all faces have little area or none."""
    x = np.linspace(0, 1, 18)
    there = np.stack([x, x**2, 0.2 * np.sin(5 * x)], axis=1)
    back = there[-2:0:-1] + np.array([0, width, 0])
    assert assert_closed(BoundaryLoop.from_points(np.concatenate([there, back]))).area < 2 * width + 1e-6


# other triangles, longer inside than at the rim: each within some thousandths of the surface
@pytest.mark.parametrize(("step", "error"), [("flatten", 6e-3), ("unfolded_loop", 2e-3)])
def test_a_loop_whose_first_step_fails_starts_from_another_domain(step, error, monkeypatch):
    loop = ENNEPER.rim(48)
    usual = discrete_minimal_surface(loop)
    monkeypatch.setattr(minimal_surface, step, crossed)
    surface = assert_closed(loop)
    assert surface.converged
    assert "crossed" in surface.reason
    assert abs(surface.area / usual.area - 1) < error


def crossed(*arguments, **options):
    raise DomainError("crossed")
