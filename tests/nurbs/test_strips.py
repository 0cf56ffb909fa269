"""Tests of patches fitted strip by strip."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spinor_geom.nurbs.strips import Grid, QuadMesh, Values, fitted


def positions(grids: Sequence[Grid]) -> list[tuple[Values, Values]]:
    found = []
    for _, u, v, _ in grids:
        x, y = np.meshgrid(u, v, indexing="ij")
        noise = np.where((x > 1 - 1e-6) & (x < 1), 0.02 * np.sin(1e9 * x), 0.0)
        exact = np.stack([x, y, np.sqrt(1 - x) + noise], axis=2)
        found.append((exact, exact))
    return found


def test_pieces_are_not_halved_where_positions_are_inaccurate() -> None:
    mesh = QuadMesh(quads=np.arange(4)[None], rims=())
    fit = fitted(mesh, positions, 1e-6, 0.0)
    assert fit.error < 2e-3
