"""Positions of a solved surface on grids of quadrilaterals, with the given curves as its rims."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.nurbs.blocks import Blocks
from spinor_geom.nurbs.rims import Rim
from spinor_geom.nurbs.strips import Grid, Values
from spinor_geom.surface.array_surface import ArraySurface


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """A surface whose rims are moved to the given curves.

    The surface misses Γ by the boundary residual. A point at parameter v of a ring, 0 on ∂Ω and 1 at its inner side, is
    moved by (1 − v)² times the displacement of the rim, so that the film fits the frame and stays smooth.
    """

    surface: ArraySurface
    rims: tuple[Rim, ...]
    blocks: Blocks

    def on(self, grids: Sequence[Grid]) -> list[tuple[Values, Values]]:
        """For each grid the positions of the minimal surface, and those moved to fit the rims."""
        known = {(quad, id(u)): self._side(quad, u) for quad, u, _ in grids}
        sides = [known[quad, id(u)] for quad, u, _ in grids]
        z, inside = [], []
        for (quad, u, v), side in zip(grids, sides, strict=True):
            z.append(self.blocks.grid(quad, u, v, None if side is None else side[0]))
            inside.append(np.broadcast_to((v > 0) | (side is None), z[-1].shape))
        positions = self.surface.positions_inside(np.concatenate([w[own] for w, own in zip(z, inside, strict=True)]))
        parts = np.split(positions, np.cumsum([np.count_nonzero(own) for own in inside])[:-1])
        found = []
        for (_, _, v), side, own, part in zip(grids, sides, inside, parts, strict=True):
            exact = np.empty((*own.shape, 3))
            exact[own] = part
            if side is None:
                found.append((exact, exact))
                continue
            _, on_rim, given = side
            exact[:, v == 0] = on_rim[:, None]
            moved = exact + ((1 - v) ** 2)[:, None] * (given - on_rim)[:, None]
            moved[:, v == 0] = given[:, None]
            found.append((exact, moved))
        return found

    def _side(
        self, quad: int, u: Float[np.ndarray, " n"]
    ) -> tuple[Complex[np.ndarray, " n"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]] | None:
        """Points of a side on ∂Ω, their positions, and the points of Γ; None for quadrilaterals inside."""
        if quad >= len(self.blocks.parts):
            return None
        start, end = self.blocks.parts[quad]
        rim, s = self.rims[self.blocks.rim_of(quad)], start + u * (end - start)
        t = rim.on_boundary(s)
        return rim.boundary.point(t), rim.positions(t), rim.curve.point(s)
