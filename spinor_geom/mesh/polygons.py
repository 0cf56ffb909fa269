"""Closed polygons in space of as many points each, measured side by side."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, kw_only=True, eq=False)
class Polygons:
    """B closed polygons of M points each; a measure is made of all of them when one is first asked for."""

    points: Float[np.ndarray, "b m 3"]

    @cached_property
    def edge_lengths(self) -> Float[np.ndarray, "b m"]:
        """Edge i runs from point i to point i + 1 (mod M)."""
        return np.asarray(np.linalg.norm(np.roll(self.points, -1, axis=1) - self.points, axis=2))

    @cached_property
    def perimeters(self) -> Float[np.ndarray, " b"]:
        """Sums of the edge lengths."""
        return np.asarray(self.edge_lengths.sum(axis=1))

    @cached_property
    def diagonals(self) -> Float[np.ndarray, " b"]:
        """Of the axis-parallel bounding boxes."""
        return np.asarray(np.linalg.norm(np.ptp(self.points, axis=1), axis=1))

    @cached_property
    def centroids(self) -> Float[np.ndarray, "b 3"]:
        """Centres of mass of the edges."""
        # relative to point 0: a loop far from the origin loses no digits
        first = self.points[:, 0]
        return np.asarray(first + (self._weights[..., None] * (self.points - first[:, None])).sum(axis=1))

    @cached_property
    def area_vectors(self) -> Float[np.ndarray, "b 3"]:
        """½ Σ P_i × P_{i+1}."""
        # all components in one product: those of cross products take several times as long
        moments = self._centred.swapaxes(1, 2) @ np.roll(self._centred, -1, axis=1)
        return np.asarray(0.5 * (moments - moments.swapaxes(1, 2))[:, [1, 2, 0], [2, 0, 1]])

    @cached_property
    def principal_spreads(self) -> tuple[Float[np.ndarray, "b 3 3"], Float[np.ndarray, "b 3"]]:
        """Principal axes as rows, widest first, and the root mean squared deviation along each."""
        _, deviations, axes = np.linalg.svd(self._centred * np.sqrt(self._weights)[..., None], full_matrices=False)
        return axes, deviations

    @cached_property
    def elongations(self) -> Float[np.ndarray, " b"]:
        """Longest side over second longest side of the points' boxes along their principal axes; ∞ on a line."""
        sides = np.sort(np.ptp(self._centred @ self.principal_spreads[0].swapaxes(1, 2), axis=1))
        on_a_line = np.full(len(sides), np.inf)
        return np.asarray(np.divide(sides[:, 2], sides[:, 1], out=on_a_line, where=sides[:, 1] > 0))

    @cached_property
    def _centred(self) -> Float[np.ndarray, "b m 3"]:
        return np.asarray(self.points - self.centroids[:, None])

    @cached_property
    def _weights(self) -> Float[np.ndarray, "b m"]:
        """Half the length of a point's two edges over the perimeter; the sum is 1."""
        both, perimeters = self.edge_lengths + np.roll(self.edge_lengths, 1, axis=1), self.perimeters[:, None]
        even = np.full_like(both, 1 / both.shape[1])
        return np.asarray(np.divide(both, 2 * perimeters, out=even, where=perimeters > 0))
