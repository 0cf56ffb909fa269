"""Wanted edge lengths at any point of a plane region, from the lengths of its boundary edges."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.domain.kernel import KernelRegion
from spinor_geom.errors import OptionError

Polygon = Complex[np.ndarray, " _"]

# largest increase and decrease of the edge length per unit of distance from the boundary
GROWTH, DECAY = 0.35, 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class SizeField:
    """Edge lengths that equal the local ones at the boundary of a region and grow or fall with the distance from it.

    h(z) ≤ min_j (e_j + growth·|z − b_j|) over the three nearest boundary vertices b_j; e_j is the mean of the two
    boundary edges at b_j, lowered where a neighbour's e_i + growth·|b_i − b_j| is smaller. h(z) is this bound or, with
    samples, the wanted lengths there, which are then bounded also by the local edge length at the nearest boundary
    vertex minus `decay` times the distance from it.

    Args:
        growth: largest increase per unit of distance.
        decay: largest decrease per unit of distance; by default there is no lower bound.
        samples: points (n,).
        lengths: wanted edge lengths at the samples, positive and finite.
        neighbours: 1 to 8; log h is the mean of those of so many nearest samples, weighted by the inverse squared
            distances.

    Raises:
        OptionError: a length is not positive and finite.
    """

    growth: float = GROWTH
    decay: float = np.inf
    samples: Complex[np.ndarray, "_"] = field(default_factory=lambda: np.zeros(0, dtype=np.complex128))
    lengths: Float[np.ndarray, "_"] = field(default_factory=lambda: np.zeros(0))
    neighbours: int = 1

    def __post_init__(self) -> None:
        wrong = ~((self.lengths > 0) & np.isfinite(self.lengths))
        if wrong.any():
            raise OptionError(f"wanted edge lengths must be positive and finite, got {self.lengths[wrong][0]}")

    def over(self, *polygons: Polygon) -> KernelRegion:
        """The field in a region bounded by polygons."""
        after = rim_successors(tuple(map(len, polygons)))
        return KernelRegion(
            np.concatenate(polygons),
            after,
            growth=self.growth,
            decay=self.decay,
            samples=self.samples,
            lengths=self.lengths,
            neighbours=self.neighbours,
        )
