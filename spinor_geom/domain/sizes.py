"""Wanted edge lengths at any point of a plane region, from the lengths of its boundary edges."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.errors import OptionError, require_count, require_positive
from spinor_geom.kernel import call, checked

Polygon = Complex[np.ndarray, " _"]

# largest increase and decrease of the edge length per unit of distance from the boundary
GROWTH, DECAY = 0.35, 0.5
MOST_NEIGHBOURS = 8  # as in size_field.hpp


class EdgeLengths(NamedTuple):
    """Lengths of edges of a surface: near its rims those of their edges, farther inside `target`.

    They increase by at most `growth` per unit of distance from the rims. With an infinite target they grow throughout.
    """

    target: float
    growth: float = GROWTH


# Of continued patches before they are refined. Growth by 0.12 takes twice the time of 0.35 for the same areas.
GRADED = EdgeLengths(np.inf, 0.2)


def edge_length_of(area: float, points: float) -> float:
    """The edge length of equilateral triangles of which some points, two triangles for each, cover an area."""
    return math.sqrt(2 * area / (math.sqrt(3) * max(points, 1.0)))


class KernelRegion:
    """A plane region with wanted edge lengths, as the compiled part takes it, see `SizeField`.

    Lengths are measured from the centre of the boundary and in its radius.

    Raises:
        OptionError: an array has another shape, indices are out of range, or numbers are not finite, in these units.
    """

    def __init__(
        self,
        boundary: Complex[np.ndarray, " m"],
        after: Int[np.ndarray, " m"],
        *,
        growth: float,
        decay: float,
        samples: Complex[np.ndarray, " n"],
        lengths: Float[np.ndarray, " n"],
        neighbours: int,
    ) -> None:
        m, n = len(boundary), len(samples)
        self.centre = boundary.mean()
        self.scale = float(np.abs(boundary - self.centre).max())
        self.points = self._scaled(boundary, "boundary", m)
        after = checked("after", after, np.int64, m, least=0, most=m - 1)
        samples = self._scaled(samples, "samples", n)
        logarithms = checked("logarithms of lengths", np.log(lengths / self.scale), np.float64, n)
        self._region = (m, self.points, after, growth, decay, n, samples, logarithms, neighbours)

    def _scaled(
        self, points: Complex[np.ndarray, " k"], name: str, length: int | None = None
    ) -> Complex[np.ndarray, " k"]:
        points = checked(name, points, np.complex128, length)
        return checked(name, (points - self.centre) / self.scale, np.complex128, length)

    def sizes(self, points: Complex[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Wanted edge lengths at points."""
        lengths = np.empty(len(points))
        call("sizes", *self._region, len(points), self._scaled(points, "points"), lengths)
        return lengths * self.scale

    def refined(
        self,
        faces: Int[np.ndarray, "t 3"],
        seeds: tuple[Complex[np.ndarray, " k"], Float[np.ndarray, " k"]] | None,
        max_points: int,
        seconds: float,
    ) -> tuple[Complex[np.ndarray, "_"], Int[np.ndarray, "_ 3"], bool]:
        """The inner points and faces of a refinement of a triangulation of the boundary, whose vertices come first.

        Refinement starts from seeds, points and their spacings, or from a lattice. It stops at `max_points`, except
        for points that split long edges between boundary vertices, and after some seconds. The last value is
        false in both cases.
        """
        m = len(self.points)
        require_count(least=0, max_points=max_points)
        faces = checked("faces", faces, np.int64, None, 3, least=0, most=m - 1)
        seed_count, places, spacing = -1, np.zeros(0, dtype=np.complex128), np.zeros(0)
        if seeds is not None:
            seed_count = len(seeds[0])
            places = self._scaled(seeds[0], "seeds")
            spacing = checked("spacing of seeds", np.divide(seeds[1], self.scale), np.float64, seed_count)
        points = np.empty(2 * m + max_points, dtype=np.complex128)
        made = np.empty((len(faces) + 2 * (m + max_points), 3), dtype=np.int64)
        made[: len(faces)] = faces
        counts = np.array([m, len(faces), 1])
        call("refine", *self._region, seed_count, places, spacing, max_points, seconds, points, made, counts)
        inner = points[m : counts[0]] * self.scale + self.centre
        return inner, made[: counts[1]].copy(), bool(counts[2])


@dataclass(frozen=True, kw_only=True, eq=False)
class SizeField:
    """Edge lengths that equal the local ones at the boundary of a region and grow or fall with the distance from it.

    h(z) ≤ min_j (e_j + growth·|z − b_j|) over the three nearest boundary vertices b_j. e_j is the mean of the two
    boundary edges at b_j, lowered where a neighbour's e_i + growth·|b_i − b_j| is smaller. h(z) is this bound or, with
    samples, the wanted lengths there, which are then bounded also by the local edge length at the nearest boundary
    vertex minus `decay` times the distance from it.

    Args:
        growth: largest increase per unit of distance.
        decay: largest decrease per unit of distance. By default there is no lower bound.
        samples: points (n,).
        lengths: wanted edge lengths at the samples, positive and finite.
        neighbours: 1 to 8. log h is the mean of that many nearest samples, weighted by inverse squared distances.

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
