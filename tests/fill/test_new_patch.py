"""The same hole gets the same patch, however the mesh lies, is scaled, numbered and oriented."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
import pytest

from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.fill_result import LoopOutcome
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.mesh.operators import face_areas
from tests.fill.copies import POLYGONS, Mesh, bucket, motions, renumbered
from tests.fill.shapes import together, tube
from tests.systems import every_second


def copies(mesh: Mesh, rng: np.random.Generator) -> Iterator[tuple[float, Mesh]]:
    vertices, faces = mesh
    for scale, move in motions(rng):
        yield scale, (move(vertices), faces)
    yield 1.0, renumbered(mesh, rng)
    yield 1.0, (vertices, faces[:, ::-1])


def filled(mesh: Mesh, continuity: Literal["C0", "C1"]) -> tuple[LoopOutcome, float]:
    (vertices, faces), report = fill_hole(mesh, continuity=continuity, return_report=True)
    (outcome,) = report.loops
    np.testing.assert_array_equal(vertices[: len(mesh[0])], mesh[0])
    np.testing.assert_array_equal(faces[: len(mesh[1])], mesh[1])
    return outcome, float(face_areas(vertices, faces[len(mesh[1]) :]).sum())


@pytest.mark.parametrize("continuity", ["C0", "C1"])
@pytest.mark.parametrize("name", every_second(list(POLYGONS)))
def test_the_same_hole_gets_the_same_patch(name: str, continuity: Literal["C0", "C1"]) -> None:
    rng = np.random.default_rng(3)
    mesh = bucket(POLYGONS[name](rng))
    outcome, area = filled(mesh, continuity)
    # films are computed to rounding, relaxations and continuations stop at a tolerance
    allowed = {"minimal": 1e-6, "discrete": 1e-2, "smooth": 1e-3}[str(outcome.kind)]
    # so does the search for a mesh of the film without intersections
    allowed_of_mesh = max(allowed, 1e-3 if outcome.displacement else 0)
    for scale, copy in copies(mesh, rng):
        found, found_area = filled(copy, continuity)
        assert found.kind == outcome.kind
        assert found.converged == outcome.converged
        assert found_area / scale**2 == pytest.approx(area, rel=allowed_of_mesh)
        assert found.area / scale**2 == pytest.approx(outcome.area, rel=allowed)


@pytest.mark.parametrize(("sides", "tilt"), [((16, 16), 0.5), ((20, 13), 0.3), ((9, 24), 0.0)])
def test_the_same_gap_gets_the_same_strip(sides: tuple[int, int], tilt: float) -> None:
    # regular rims, whose first points only the other rim decides
    turn = [[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]
    upper, lower = tube(sides[0]), tube(sides[1])
    mesh = together(upper, (lower[0] * [1, -1, -1] @ np.array(turn) - [0.2, 0.1, 1.0], lower[1]))
    areas = []
    for scale, (vertices, faces) in [(1.0, mesh), *copies(mesh, np.random.default_rng(3))]:
        bridge = np.argsort([-loop.perimeter for loop in boundary_loops((vertices, faces))], kind="stable")[:2].tolist()
        report = fill_hole((vertices, faces), bridge=bridge, continuity="C1", return_report=True)[1]
        (outcome,) = (loop for loop in report.loops if loop.patch is not None)
        assert outcome.kind == "smooth"
        areas.append(outcome.area / scale**2)
    np.testing.assert_allclose(areas, areas[0], rtol=1e-9)  # to rounding, as the local coordinates are equal
