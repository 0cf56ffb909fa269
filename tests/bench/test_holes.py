"""Holes of the benchmark are those that their names describe."""

import importlib.util
import os

import numpy as np
import pytest

from spinor_geom.bench.cases import KNOWN, known_case, points_limit
from spinor_geom.bench.fillers import FILLERS, OURS, Filled
from spinor_geom.bench.holes import hole_over
from spinor_geom.bench.measured import disk_figures, hole_figures
from spinor_geom.bench.odd_holes import odd_holes
from spinor_geom.errors import OptionError
from spinor_geom.meshing.embed import mesh_patch
from spinor_geom.plateau.solve import solve_plateau
from tests.plateau.rims import CATENOIDS
from tests.systems import every_second


def test_a_collar_has_one_rim_and_a_longer_outer_boundary():
    loop = known_case("enneper-0.8").loop(40)
    hole = hole_over("enneper", loop)
    assert [len(found) for found in hole.loops] == [41, 40]
    assert hole.rim_indices == [1]
    assert hole.edge_limit == 40
    np.testing.assert_array_equal(hole.vertices[hole.rim], loop.points)
    # the collar goes on where the surface ends: exactly so but for the discrete normals
    chart = known_case("enneper-0.8").chart
    assert chart.distances(hole.vertices).max() < 0.1


def test_an_untouched_hole_is_open_and_our_fill_closes_it():
    hole = hole_over("enneper", (case := known_case("enneper-0.8")).loop(40), case.area)
    open_ = hole_figures(Filled(vertices=hole.vertices, faces=hole.faces, succeeded=True), hole, case)
    assert open_["open_rim_edges"] == 40
    assert open_["triangles"] == 0
    assert open_["outer_kept_open"]
    fill, finish = FILLERS[OURS].call(hole)
    filled = finish(fill())
    figures = hole_figures(filled, hole, case)
    assert (figures["open_rim_edges"], figures["new_open_edges"], figures["nonmanifold_edges"]) == (0, 0, 0)
    assert figures["rim_kept"]
    assert figures["old_faces_kept"]
    assert figures["patches"] == 1
    # of the smooth surface; 40 chords enclose 0.6 % less
    assert figures["area_error"] < 1e-6 < figures["mesh_area_error"] < 0.02
    moved = Filled(vertices=filled.vertices + 1e-9, faces=filled.faces[:-1])
    worse = hole_figures(moved, hole, case)
    assert not worse["rim_kept"]
    assert worse["open_rim_edges"] + worse["new_open_edges"] > 0


@pytest.mark.parametrize(
    ("name", "patches", "says"),
    [
        ("island", 1, "joined to it"),
        ("facing-0.5", 1, ""),
        ("facing-0.6", 1, "local minimum of the area only"),
        ("facing-0.7", 0, "no annulus"),
    ],
)
def test_our_fill_joins_islands_and_facing_rims_where_a_surface_does(name, patches, says):
    hole = odd_holes()[name]
    fill, finish = FILLERS[OURS].call(hole)
    filled = finish(fill())
    figures = hole_figures(filled, hole, None)
    assert figures.get("patches", 0) == patches
    assert says in filled.message
    assert filled.succeeded == (patches > 0)
    assert (figures["open_rim_edges"] == 0) == (patches > 0)
    if name == "facing-0.5":
        assert abs(filled.area / CATENOIDS[0.5][0] - 1) < 1e-6


def require_peer(package):
    """Skips where a package is not installed, unless SPINOR_GEOM_PEERS=required. One that cannot be imported fails."""
    if importlib.util.find_spec(package) is None:
        message = f"{package} is not installed: pip install '.[peers]'"
        if os.environ.get("SPINOR_GEOM_PEERS") == "required":
            pytest.fail(message)
        pytest.skip(message)
    importlib.import_module(package)


@pytest.mark.parametrize("name", [name for name in FILLERS if name != OURS])
def test_every_peer_that_is_installed_takes_a_mesh_and_gives_one_back(name):
    tool = FILLERS[name]
    require_peer(tool.package)
    hole = hole_over("plane", (case := known_case("plane-square")).loop(16), case.area)
    fill, finish = tool.call(hole)
    filled = finish(fill())
    # not views of what goes with the tool's mesh
    assert filled.vertices.flags.owndata
    assert filled.faces.flags.owndata
    figures = hole_figures(filled, hole, known_case("plane-square"))
    if name == "trimesh":
        assert figures["open_rim_edges"] == 16
        assert filled.succeeded is False
    else:
        assert figures["open_rim_edges"] == 0
        # the smoothing of "nicely" folds triangles over one another even in a plane
        assert abs(figures["area_excess"]) < (1 if "nicely" in name else 1e-6)


@pytest.mark.parametrize("name", every_second(KNOWN))
def test_known_cases_have_an_area_and_a_loop_on_their_chart(name):
    case = known_case(name)
    assert case.area > 0
    assert case.chart.distances(case.loop(24).points).max() < 1e-9 * case.diameter


def test_samplings_keep_the_answer():
    even = known_case("twisted-circle@even").loop(60).edge_lengths
    assert even.max() / even.min() < 1.01
    for name in ("random-2", "enneper-0.8", "henneberg"):
        edges = known_case(f"{name}@even").loop(200).edge_lengths
        assert edges.max() / edges.min() < 1.01
        edges = known_case(f"{name}@uneven").loop(200).edge_lengths
        assert edges.max() / edges.min() > 3
        assert known_case(f"{name}@even").area == known_case(name).area
    messages = {"scherk@even": "samplings", "random-2@formula": "samplings", "ennneper": "random-SEED"}
    for wrong, message in messages.items():
        with pytest.raises(OptionError, match=message):
            known_case(wrong)
    assert known_case("random-77").area > 0
    assert set(odd_holes()) & set(KNOWN) == set()


def test_the_points_limit_is_the_error_of_interpolants_of_the_points():
    # equal steps of the parameter of a trigonometric curve say all of it
    assert points_limit(known_case("random-0"), 32) < 1e-14
    even = points_limit(known_case("random-0@even"), 48)
    assert 1e-8 < even < 1e-4
    # more points say more
    assert points_limit(known_case("random-0@even"), 96) < even / 4
    assert points_limit(known_case("random-0@uneven"), 96) > 0


def test_our_surface_is_measured_beside_its_mesh():
    case = known_case("enneper-0.8")
    loop = case.loop(48)
    solution = solve_plateau(loop)
    patch = mesh_patch(solution)
    figures = disk_figures(solution, patch, loop, case)
    # the surface is exact, the chords of its mesh are not
    assert figures["surface_distance_max"] < 1e-12 < 1e-4 < figures["distance_max"]
    assert figures["area_error"] < 1e-12 < 1e-4 < figures["mesh_area_error"]
