"""The repr of a public object is short, and has the main facts."""

import numpy as np

import spinor_geom
from spinor_geom import gallery
from spinor_geom.shown import MOST_SHOWN
from tests.fill.shapes import tube


def test_descriptions_are_short_and_have_the_main_facts():
    solution = spinor_geom.solve_plateau(gallery.enneper(0.8).rim(200))  # its arrays would fill pages
    t = 2 * np.pi * np.arange(200) / 200
    circle = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    annulus = spinor_geom.solve_plateau([circle, circle + np.array([0, 0, 0.5])])
    assert isinstance(annulus, spinor_geom.PlateauSolution)
    film = solution.to_nurbs(tolerance=1e-4)
    _, report = spinor_geom.fill_hole(tube(), return_report=True, continuity="C1")
    baseline = spinor_geom.discrete_minimal_surface(solution.loop)
    t = np.pi * (np.arange(31) / 30 - 0.5)
    arc = spinor_geom.OpenCurve(np.column_stack([np.cos(t).round(15), np.sin(t), np.cos(2 * t)]))
    part = spinor_geom.solve_plateau(arc, mirror=[(np.zeros(3), (1, 0, 0))])
    objects = (
        *(solution, solution.loop, solution.curve, solution.rims[0], solution.domain, solution.stability),
        *(solution.surface, solution.surface.model, solution.array_surface, solution.array_surface.model),
        *(annulus, annulus.annulus, annulus.surface, annulus.array_surface.model),
        *(spinor_geom.mesh_patch(solution), solution.solid(0.1), arc, part, part.continued()),
        *(film, film.patches[0], film.boundary_curves[0][0], baseline, spinor_geom.compare(solution, baseline)),
        *(report, report.loops[0], report.loops[0].continuation, report.extension, report.original),
        *(spinor_geom.read_mesh("data/demosthenes_low_res.obj"), gallery.enneper(0.8), gallery.tennis_seam(0.8)),
    )
    for one in objects:
        assert len(repr(one)) <= MOST_SHOWN, repr(one)
        assert " at 0x" not in repr(one)
    assert all(word in repr(solution) for word in ("200 points", "area 3.57", "converged", "disk", "of an edge"))


def test_long_descriptions_are_cut_in_the_middle():
    name = "x" * 1000
    mesh = spinor_geom.TriangleMesh(np.eye(3), [[0, 1, 2]], vertex_attributes={name: np.zeros(3)})
    assert len(repr(mesh)) <= MOST_SHOWN
    assert repr(mesh).startswith("TriangleMesh(3 vertices")
