"""The repr of every public object is one line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import spinor_geom
from spinor_geom import gallery
from spinor_geom.mesh.triangle_mesh import MeshExtension
from spinor_geom.shown import MOST_SHOWN
from tests.fill.shapes import tube


def described() -> Mapping[str, tuple[Any, tuple[str, ...]]]:
    """An object of each public class, large enough for its arrays to fill pages, and what its description says."""
    known = gallery.enneper(0.8)
    solution = spinor_geom.solve_plateau(known.rim(200))
    t = 2 * np.pi * np.arange(200) / 200
    circle = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    rings = [spinor_geom.BoundaryLoop.from_points(circle + np.array([0, 0, z])) for z in (0, 0.5)]
    apart = [rings[0], spinor_geom.BoundaryLoop.from_points(circle + np.array([0, 0, 9]))]
    annulus = spinor_geom.solve_plateau(rings)
    assert isinstance(annulus, spinor_geom.PlateauSolution)
    patch = spinor_geom.mesh_patch(solution)
    film = solution.to_nurbs(tolerance=1e-4)
    filled, report = spinor_geom.fill_hole(tube(), return_report=True, continuity="C1")
    baseline = spinor_geom.discrete_minimal_surface(solution.loop)
    t = np.pi * (np.arange(31) / 30 - 0.5)
    flat = np.column_stack([np.cos(t).round(15), np.sin(t), -1 + 0 * t])[::-1]
    arc = spinor_geom.OpenCurve(np.column_stack([np.cos(t).round(15), np.sin(t), np.cos(2 * t)]))
    made = (
        (solution, ("200 points", "area 3.57", "converged", "disk", "of an edge")),
        (solution.loop, ("200 points", "perimeter")),
        (solution.curve, ("200 pieces",)),
        (solution.rims[0], ("200 points",)),
        (solution.domain, ("0 holes",)),
        (solution.surface, ("PowerSeries",)),
        (solution.surface.model, ("PowerSeries",)),
        (solution.array_surface, ("PowerSeries",)),
        (solution.array_surface.model, ("coefficients (", ", 2)")),
        (solution.stability, ("stable",)),
        (annulus, ("200 + 200 points",)),
        (annulus.annulus, ("modulus",)),
        (annulus.surface, ("LaurentSeries",)),
        (annulus.array_surface.model, ("LaurentSeries",)),
        (spinor_geom.solve_plateau(apart), ("200 + 200 points", "cone")),
        (patch, ("vertices", "rim of 200 points", "area 3.5")),
        (solution.solid(0.1), ("faces", "thickness 0.1")),
        (part := spinor_geom.solve_plateau(arc, mirror=[(np.zeros(3), (1, 0, 0))]), ("'mirrored'",)),
        (part.continued(), ("2 copies", "mirrored")),
        (arc, ("31 points",)),
        (rope := spinor_geom.Cable(start=[0, -1, -1], end=[0, 1, -1], tension=1.5), ("tension=1.5",)),
        (tent := spinor_geom.solve_membrane([spinor_geom.OpenCurve(flat, corners=()), rope]), ("1 cables", "area")),
        (tent.cables[0], ("tension 1.5",)),
        (film, ("5 patches", "area 3.57", "converged")),
        (film.patches[0], ("degrees",)),
        (film.boundary_curves[0][0], ("degree",)),
        (baseline, ("libigl", "converged")),
        (spinor_geom.compare(solution, baseline), ("exact surface",)),
        (report, ("2 of 2 loops filled", "watertight")),
        (report.loops[0], ("loop 0", "smooth", "points")),
        (report.loops[0].continuation, ("converged", "bend")),
        (report.extension, ("faces",)),
        (report.original, ("vertices",)),
        (spinor_geom.read_mesh("data/demosthenes_low_res.obj"), ("demosthenes_low_res.obj",)),
        (MeshExtension(vertices=filled[0], faces=filled[1], face_loops=0 * filled[1][:, 0]), ("vertices",)),
        (known, ("Enneper", "area 3.57")),
        (gallery.tennis_seam(0.8), ("seam",)),
        (gallery.schwarz_d_quadrilateral(), ("area 0.6396",)),
        (gallery.tennis_seam(0.8).sample(100), ("100 points",)),
    )
    return {f"{type(one).__name__} {place}": (one, words) for place, (one, words) in enumerate(made)}


@pytest.fixture(scope="module")
def objects() -> Mapping[str, tuple[Any, tuple[str, ...]]]:
    return described()


def test_descriptions_are_short_and_have_the_main_facts(
    objects: Mapping[str, tuple[Any, tuple[str, ...]]],
) -> None:
    for name, (one, words) in objects.items():
        text = repr(one)
        assert len(text) <= MOST_SHOWN, (name, len(text), text)
        assert " at 0x" not in text, (name, text)
        for word in words:
            assert word in text, (name, word, text)


def test_long_descriptions_are_cut_in_the_middle() -> None:
    name = "x" * 1000
    mesh = spinor_geom.TriangleMesh(np.eye(3), [[0, 1, 2]], vertex_attributes={name: np.zeros(3)})
    assert len(repr(mesh)) <= MOST_SHOWN
    assert repr(mesh).startswith("TriangleMesh(3 vertices")
