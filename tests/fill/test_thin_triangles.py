"""Continued patches have no thin triangles after they were moved off the mesh."""

from __future__ import annotations

import numpy as np
import pytest

from spinor_geom.bench.holes import Hole
from spinor_geom.bench.ragged import reported_bowls
from spinor_geom.fill.fairing import SMALLEST_ANGLE, smallest_angles
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.mesh.intersections import intersections_between, self_intersections
from spinor_geom.mesh.topology import HalfEdges

# bowls whose continuations had angles of less than 10°
THIN = [hole for k, hole in enumerate(reported_bowls()) if k in (0, 7)]


@pytest.mark.parametrize("hole", THIN, ids=lambda hole: hole.name)
def test_angles_are_increased_without_new_intersections(hole: Hole) -> None:
    (vertices, faces), report = fill_hole((hole.vertices, hole.faces), 0, continuity="C1", return_report=True)
    (outcome,) = report.loops
    rim, others = smallest_angles(outcome.patch)
    assert others >= SMALLEST_ANGLE
    assert outcome.continuation.smallest_angle == pytest.approx(min(rim, others), rel=1e-8)
    # counted anew, not as reported
    patch = faces[len(hole.faces) :]
    assert outcome.intersections == 0
    assert not len(self_intersections(vertices, patch))
    assert not len(intersections_between(vertices, patch, hole.vertices, hole.faces))
    assert (HalfEdges.of(faces).counts == 2).all()
    np.testing.assert_array_equal(vertices[: len(hole.vertices)], hole.vertices)
