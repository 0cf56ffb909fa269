"""Borders of sheets and holes of vessels: whole families, each with smooth and with ragged rims."""

from __future__ import annotations

import igl
import numpy as np
import pytest

from spinor_geom.bench.ragged import reported_bowls, reported_tubes
from spinor_geom.errors import SheetBorderError
from spinor_geom.fill.borders import require_no_border
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.fill.sheets import Heights, Mesh, garments, moebius, ribbons, round_sheet, square, terrain

VESSELS: dict[str, Heights] = {
    "cone, 50°": lambda x, y: np.hypot(x, y) / np.tan(np.radians(40)),
    "cone, 80°": lambda x, y: np.hypot(x, y) / np.tan(np.radians(10)),
    "paraboloid, 50°": lambda x, y: 0.6 * (x**2 + y**2),
    "paraboloid, 63°": lambda x, y: x**2 + y**2,
    "ellipsoid": lambda x, y: 1.5 * np.sqrt(np.maximum(1.3 - x**2 - y**2, 0)),
    "oval ellipsoid": lambda x, y: 1.5 * np.sqrt(np.maximum(1.3 - x**2 - 0.7 * y**2, 0)),
    "oblique paraboloid": lambda x, y: x**2 + y**2 + 0.5 * x,
}
SHEETS: dict[str, Heights] = {
    "plane": lambda x, _: 0 * x,
    "spherical": lambda x, y: np.sqrt(5 - x**2 - y**2),
    "cylindrical": lambda x, _: np.sqrt(4 - x**2),
    "saddle": lambda x, y: x**2 - y**2,
    "shallow saddle": lambda x, y: 0.4 * x * y,
    "monkey saddle": lambda x, y: 0.6 * (x**3 - 3 * x * y**2),
    "waves": lambda x, y: 0.2 * np.sin(6 * x) * np.cos(5 * y),
    "roof": lambda x, _: abs(x),
    "hills": terrain(1, 0.25),
    "steep hills": terrain(2, 0.4),
    "small hills": terrain(3, 0.4, 8.0),
    "long hills": terrain(4, 0.3, 1.5),
}


def is_border(patched: PatchedMesh, loop: BoundaryLoop) -> bool:
    try:
        require_no_border(patched, loop)
    except SheetBorderError:
        return True
    return False


def are_borders(arrays: Mesh) -> list[bool]:
    """The answer for every loop, longest first."""
    mesh = TriangleMesh(*arrays)
    loops = find_boundary_loops(mesh)
    patched = PatchedMesh(mesh, loops)
    return [is_border(patched, loop) for loop in loops]


def test_ragged_bowls_and_tubes_have_holes() -> None:
    cases = [*reported_bowls(12), *reported_tubes(4)]
    assert [hole.name for hole in cases if are_borders((hole.vertices, hole.faces))[0]] == []


@pytest.mark.parametrize("ragged", [False, True])
@pytest.mark.parametrize("name", VESSELS)
def test_vessels_have_holes_whether_smooth_or_ragged(name: str, ragged: bool) -> None:
    assert not are_borders(round_sheet(VESSELS[name], ragged=ragged))[0]


@pytest.mark.parametrize("ragged", [False, True])
@pytest.mark.parametrize("name", SHEETS)
def test_sheets_have_borders_whether_smooth_or_ragged(name: str, ragged: bool) -> None:
    assert are_borders(round_sheet(SHEETS[name], ragged=ragged))[0]
    assert are_borders(square(12 if ragged else 24, SHEETS[name]))[0]


def test_ribbons_and_bands_have_borders() -> None:
    assert [name for name, mesh in ribbons() if not are_borders(mesh)[0]] == []
    assert all(are_borders(moebius(width)) == [True] for width in (0.2, 0.5, 0.8))


def test_ends_of_garments_and_bent_tubes_are_holes() -> None:
    assert [name for name, mesh in garments() if any(are_borders(mesh))] == []


@pytest.mark.parametrize("hole", [(0.0, 0.3), (0.55, 0.25), (0.3, 0.6), (0.0, 0.8)])
@pytest.mark.parametrize("name", ["plane", "saddle", "hills", "steep hills"])
def test_holes_in_sheets_are_holes_and_their_borders_are_borders(name: str, hole: tuple[float, float]) -> None:
    # near the border, and so large that a thin ring is left
    place, radius = hole
    rng = np.random.default_rng(0)
    mesh = square(30, SHEETS[name], lambda p: np.hypot(p[:, 0] - place, p[:, 1]) > radius + 0.03 * rng.random(len(p)))
    border, *holes = are_borders(mesh)
    assert border
    assert not any(holes)


@pytest.mark.parametrize("ragged", [False, True])
@pytest.mark.parametrize("shape", [VESSELS["paraboloid, 50°"], SHEETS["steep hills"]], ids=["vessel", "sheet"])
def test_the_answer_depends_on_neither_position_size_orientation_nor_fineness(shape: Heights, ragged: bool) -> None:
    vertices, faces = round_sheet(shape, ragged=ragged)
    rng = np.random.default_rng(1)
    answer = are_borders((vertices, faces))[0]
    for size in (1e-6, 1.0, 1e6):
        turned = size * (vertices @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + 10 * rng.normal(size=3))
        assert are_borders((turned, faces))[0] == answer
    assert are_borders((vertices, faces[:, ::-1]))[0] == answer
    order = rng.permutation(len(faces))
    assert are_borders((vertices, faces[order]))[0] == answer
    finer, quarters = igl.upsample(vertices, faces.astype(np.int64), 1)
    assert are_borders((np.asarray(finer), np.asarray(quarters, dtype=np.int64)))[0] == answer
