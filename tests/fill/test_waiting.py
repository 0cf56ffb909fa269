"""Loops of one mesh are meshed together, with a limit on the time that a loop waits for the others."""

from __future__ import annotations

from itertools import count

import numpy as np
import pytest

from spinor_geom.fill import exact_patches
from spinor_geom.fill.fill_options import FillOptions
from spinor_geom.mesh.boundary_loop import BoundaryLoop


@pytest.mark.parametrize(("tick", "groups"), [(0.01, [9]), (0.4, [3, 3, 3]), (1.5, [1] * 9)])
def test_a_surface_waits_about_a_second_for_others(
    monkeypatch: pytest.MonkeyPatch, tick: float, groups: list[int]
) -> None:
    """A loop is seen in the progress a second after it was solved, and loops that are solved faster share a mesh."""
    angle = 2 * np.pi * np.arange(12) / 12
    loops = [BoundaryLoop.from_points(np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]))] * 9
    sizes: list[int] = []

    def meshed(waiting: list[object], _: FillOptions) -> list[object]:
        sizes.append(len(waiting))
        return list(waiting)

    ticks = count()
    monkeypatch.setattr(exact_patches, "solve_plateau_batch", lambda loops, **_: iter(list(loops)))
    monkeypatch.setattr(exact_patches, "exact_patches", meshed)
    # read once at the start, once a loop, and again where a group was meshed
    monkeypatch.setattr(exact_patches, "perf_counter", lambda: tick * next(ticks))
    options = FillOptions(target_edge_length="auto", model="auto", tolerance=1e-3)
    assert len(list(exact_patches.minimal_patches(loops, options))) == 9
    assert [size for size in sizes if size] == groups
