"""The border of a sheet is not filled, because a patch over it would lie on the mesh."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext

import numpy as np
import pytest

from spinor_geom.bench.holes import lattice
from spinor_geom.deadline import time_limit
from spinor_geom.errors import ImperfectFillWarning, OutOfTimeError, SheetBorderError
from spinor_geom.fill.borders import require_no_border
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.fill.shapes import circle, collar


def sheet(height: Callable[[np.ndarray, np.ndarray], np.ndarray] = lambda x, _: 0 * x) -> tuple[np.ndarray, np.ndarray]:
    """A square sheet of 21 × 21 vertices with a round hole in its middle."""
    (x, y), faces = lattice(20, 20)
    vertices = np.column_stack([x - 10, y - 10, height(x - 10, y - 10)])
    return vertices, faces[np.linalg.norm(vertices[faces].mean(axis=1)[:, :2], axis=1) > 3]


def turned(mesh: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    return mesh[0] @ np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0], mesh[1]


SHEETS = {
    "plane": sheet(),
    "tilted": turned(sheet()),
    "hilly": sheet(lambda x, y: 2 * np.sin(x / 3) * np.cos(y / 4)),
    "of two faces": (np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1.0, 0]]), np.array([[0, 1, 2], [0, 2, 3]])),
}


@pytest.mark.parametrize("name", SHEETS)
def test_the_border_of_a_sheet_stays_open_with_the_reason(name: str) -> None:
    _, report = fill_hole(SHEETS[name], return_report=True)
    border, *holes = report.loops
    assert border.is_border
    assert (border.requested, border.filled, border.kind) == (False, False, None)
    assert "border of a sheet" in border.reason
    assert "give its index in loop=" in border.reason
    assert all(hole.converged for hole in holes)
    assert report.closed
    assert report.complete
    assert report.intersection_free
    assert not report.watertight
    assert border.to_dict()["border"]
    with pytest.warns(ImperfectFillWarning, match="was left open: it is the border of a sheet"):
        fill_hole(SHEETS[name])


@pytest.mark.parametrize(("depth", "is_border"), [(0.0, True), (0.5, False)])
def test_a_rim_of_many_points_is_compared_at_some_of_them(depth: float, is_border: bool) -> None:
    rim = circle(12_000)
    mesh = TriangleMesh(*collar(rim, [0, 0, -depth] if depth else -0.5 * rim))  # a tube or an annulus
    loop = find_boundary_loops(mesh)[0]
    with pytest.raises(SheetBorderError) if is_border else nullcontext():
        require_no_border(PatchedMesh(mesh, [loop]), loop)
    with time_limit(-1), pytest.raises(OutOfTimeError):
        require_no_border(PatchedMesh(mesh, [loop]), loop)
