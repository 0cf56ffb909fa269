"""Plane regions with wanted edge lengths, as the compiled part takes them."""

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.errors import require_count
from spinor_geom.kernel import call, checked


class KernelRegion:
    """A plane region with wanted edge lengths, as the compiled part takes it; see `SizeField`.

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
