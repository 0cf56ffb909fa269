"""Solids are watertight, and their sides have the distance that was asked for."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from spinor_geom import BoundaryLoop, PlateauSolution, gallery, read_mesh, solve_plateau
from spinor_geom.errors import OptionError
from tests.closed import is_watertight


def circle(z: float) -> BoundaryLoop:
    t = 2 * np.pi * np.arange(60) / 60
    return BoundaryLoop.from_points(np.column_stack([np.cos(t), np.sin(t), z + 0 * t]))


def solutions() -> dict[str, PlateauSolution]:
    found = {"disk": solve_plateau(circle(0)), "catenoid": solve_plateau([circle(0), circle(0.8)])}
    found["seam"] = solve_plateau(gallery.tennis_seam(0.75))
    return {name: one for name, one in found.items() if isinstance(one, PlateauSolution)}


@pytest.mark.parametrize("edge", ["straight", "rounded"])
def test_a_solid_is_watertight_and_has_the_volume_of_its_thickness(edge: Literal["straight", "rounded"]) -> None:
    thickness = 0.05
    for solution in solutions().values():
        solid = solution.solid(thickness, edge=edge)
        assert is_watertight(solid.faces)
        assert solid.intersections == 0
        # between parallel surfaces at ±t/2 the volume is t·area + O(t³); half a disk is swept along the rims
        length = sum(rim.loop.perimeter for rim in solution.rims)
        rounding = (edge == "rounded") * np.pi / 8 * thickness**2 * length
        assert solid.volume == pytest.approx(
            thickness * solution.area + rounding, rel=0.02
        )  # inscribed meshes are smaller


def test_sides_are_at_half_the_thickness_along_exact_normals() -> None:
    plate = solve_plateau(circle(0)).solid(0.1, edge="straight")
    assert np.abs(np.abs(plate.vertices[:, 2]) - 0.05).max() < 1e-12
    catenoid = solutions()["catenoid"]
    upper, lower = catenoid.solid(0.1, edge="straight").vertices.reshape(2, -1, 3)
    assert np.allclose(np.linalg.norm(upper - lower, axis=1), 0.1, rtol=1e-12)


def test_a_solid_that_is_too_thick_counts_its_intersections(tmp_path: Path) -> None:
    seam = solutions()["seam"]
    assert seam.solid(2.0).intersections > 0
    for wrong in (0, -1, np.nan, np.inf):
        with pytest.raises(OptionError, match="thickness"):
            seam.solid(wrong)
    unknown: Any = "sharp"
    with pytest.raises(OptionError, match="rounded"):
        seam.solid(0.1, edge=unknown)
    solid = seam.solid(0.1)
    for suffix in (".stl", ".3mf"):
        solid.write(tmp_path / f"solid{suffix}")
        assert is_watertight(read_mesh(tmp_path / f"solid{suffix}").mesh.faces)
