"""Wanted edge lengths at any point of a plane region, from the lengths of its boundary edges."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.domain.kernel_region import KernelRegion
from spinor_geom.errors import OptionError, require_count, require_positive
from spinor_geom.kernel import checked

Polygon = Complex[np.ndarray, " _"]

# largest increase and decrease of the edge length per unit of distance from the boundary
GROWTH, DECAY = 0.35, 0.5
MOST_NEIGHBOURS = 8  # as in size_field.hpp


class EdgeLengths(NamedTuple):
    """Lengths of edges of a surface: near its rims those of their edges, farther inside `target`.

    They increase by at most `growth` per unit of distance from the rims; with an infinite target they grow throughout.
    """

    target: float
    growth: float = GROWTH


# Of continued patches before they are refined. Growth by 0.12 takes twice the time of 0.35 for the same areas.
GRADED = EdgeLengths(np.inf, 0.2)


def edge_length_of(area: float, points: float) -> float:
    """The edge length of equilateral triangles of which some points, two triangles for each, cover an area."""
    return math.sqrt(2 * area / (math.sqrt(3) * max(points, 1.0)))


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
        OptionError: a number is out of its range or not finite, or there is not one length for each sample.
    """

    growth: float = GROWTH
    decay: float = np.inf
    samples: Complex[np.ndarray, "_"] = field(default_factory=lambda: np.zeros(0, dtype=np.complex128))
    lengths: Float[np.ndarray, "_"] = field(default_factory=lambda: np.zeros(0))
    neighbours: int = 1

    def __post_init__(self) -> None:
        require_positive("growth", self.growth)
        require_positive("decay", self.decay, finite=False)
        require_count(neighbours=self.neighbours)
        if self.neighbours > MOST_NEIGHBOURS:
            raise OptionError(f"neighbours must be at most {MOST_NEIGHBOURS}, not {self.neighbours}")
        samples = checked("samples", self.samples, np.complex128, None)
        lengths = checked("wanted edge lengths", self.lengths, np.float64, len(samples), least=np.finfo(float).tiny)
        object.__setattr__(self, "samples", samples)
        object.__setattr__(self, "lengths", lengths)

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
