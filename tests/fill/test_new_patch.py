"""The same hole gets the same patch, however the mesh lies, is scaled, numbered and oriented."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
import pytest

from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.fill_result import LoopOutcome
from spinor_geom.mesh.operators import face_areas
from tests.fill.copies import POLYGONS, Mesh, bucket, motions, renumbered
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
