"""Frames of CAD edges: exact rims, figures of shapes over them, promises."""

import numpy as np
import pytest

from spinor_geom.bench.cases import known_case
from spinor_geom.bench.frames import FRAMES, frame_edges
from spinor_geom.bench.tasks import run
from spinor_geom.mesh.curve import BoundaryCurve


@pytest.mark.parametrize("name", FRAMES)
def test_frames_are_exact(name):
    pytest.importorskip("OCP")
    from spinor_geom.adapters import to_rims

    case = known_case(name)
    (rim,) = to_rims(frame_edges(case))
    loop = case.loop(64)
    fitted = BoundaryCurve.from_formula(rim)
    away = np.linalg.norm(fitted.point(fitted.nearest(loop.points)) - loop.points, axis=1)
    assert away.max() < 1e-12 * case.diameter
    assert len(rim.corners) == loop.corners.sum()


def test_figures_of_a_filling_are_those_of_a_plane_region():
    """Open CASCADE fills a plane frame by a plane."""
    pytest.importorskip("OCP")
    task = {"suite": "cad", "method": "occ-filling", "case": "plane-l", "n": None, "repeat": 0, "data": None}
    record = run(task)
    assert record["status"] == "done", record
    assert record["faces"] == 1
    assert record["valid"]
    assert record["area_error"] < 1e-9
    assert record["rim_distance"] < 1e-9
    assert record["file_kib"] > 1
