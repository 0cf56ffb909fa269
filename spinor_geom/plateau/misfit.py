"""The distance between a surface's boundary and Γ, with one definition for all routes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.arrays import TINY, Array, arange, closed_steps, indices, namespace, norm, shifted, square
from spinor_geom.mesh.curve import SAMPLES_PER_PIECE
from spinor_geom.plateau.curve_tensors import CurveTensors

# Largest allowed distance in local edges, as a multiple of the tolerance: 0.1 for a tolerance of 1e-3. Good fits of
# noisy and narrow loops stay below half of it. Where the boundary skips a finger of Γ the distance is several edges.
LOCAL_TOLERANCES = 100.0
# A curve turns back between two points if the arc is longer than this multiple of their distance. The boundary skips
# such an arc of Γ, and parts of Γ face each other. In tests for skipped arcs 1.1 and 2 give equal results. In those for
# narrow places domains of long ellipses count as too narrow with 1, and with 4 a rim cut along triangles is met five
# times less closely.
TURNS_BACK = 2.0


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """Distance between a surface's boundary and Γ.

    The mean is weighted by the arc length of Γ or of the boundary, whichever is longer near each point. Therefore a
    boundary that skips a part of Γ has a large misfit too.
    """

    rms: float  # root of the mean squared distance
    max: float  # largest distance
    max_per_local_edge: float  # largest ratio of the distance to the mean length of the three nearest loop edges
    length: float  # length of Γ

    @classmethod
    def of(cls, r: Float[Array, "n 3"], slide: Float[Array, " n"], curve: CurveTensors) -> Misfit:
        """The misfit of points r of the boundary, in order, and the nearby points Γ(slide).

        Where Γ is much longer than the boundary, points of Γ between these are included.
        """
        point, tangent = curve.point_and_derivative(slide)
        known = r, slide, norm(r - point), norm(tangent), curve.local_edge(slide)
        (misfit,) = cls.each(*(part[None] for part in known), alone=lambda _: curve)
        return misfit

    @classmethod
    def each(
        cls,
        r: Float[Array, "b n 3"],
        slide: Float[Array, "b n"],
        distance: Float[Array, "b n"],
        speed: Float[Array, "b n"],
        local_edge: Float[Array, "b n"],
        *,
        alone: Callable[[int], CurveTensors],
    ) -> tuple[Misfit, ...]:
        """The misfits of several boundaries from distances, |Γ′| and local edges. `alone` returns one of the curves."""
        xp = namespace(r)
        step, chord, ahead = closed_steps(slide), norm(shifted(r, -1, axis=1) - r), shifted(speed, -1)
        arc = step * (speed + ahead) / 2
        skipped = step * xp.maximum(speed, ahead) > TURNS_BACK * chord + distance
        span = xp.where(skipped, 0.0, xp.maximum(arc, chord))
        squares = ((span + shifted(span, 1)) / 2 * square(distance)).sum(-1)
        largest, local = xp.max(distance, axis=-1), xp.max(distance / local_edge, axis=-1)
        # a diverged fit may have its whole boundary at one point of Γ, up to rounding
        lengths = xp.maximum(arc.sum(-1), np.finfo(float).eps * speed.sum(-1))
        for i in indices(skipped.any(-1)).tolist():
            curve = alone(i)
            parameters, missed, weights = _on_skipped(r[i], slide[i], indices(skipped[i]), curve)
            squares[i] += weights @ square(missed)
            largest[i] = xp.maximum(largest[i], missed.max())
            local[i] = xp.maximum(local[i], (missed / curve.local_edge(parameters)).max())
        return tuple(
            cls(rms=(square / length) ** 0.5, max=far, max_per_local_edge=ratio, length=length)
            for square, far, ratio, length in xp.stack([squares, largest, local, lengths], axis=1).tolist()
        )

    @classmethod
    def together(cls, parts: Sequence[Misfit]) -> Misfit:
        """The misfit of several rims."""
        length = sum(part.length for part in parts)
        return cls(
            rms=(sum(part.length * part.rms**2 for part in parts) / length) ** 0.5,
            max=max(part.max for part in parts),
            max_per_local_edge=max(part.max_per_local_edge for part in parts),
            length=length,
        )

    def excess(self, *, allowed: float, tolerance: float) -> float:
        """Ratio of distance to allowed distance, RMS or in local edges: at most 1 if the tolerance is met."""
        return max(self.rms / allowed, self.max_per_local_edge / (LOCAL_TOLERANCES * tolerance))

    def enlarged(self, scale: float) -> Misfit:
        """The misfit after scaling surface and curve."""
        return replace(self, rms=scale * self.rms, max=scale * self.max, length=scale * self.length)

    def with_offset(self, distance: float) -> Misfit:
        """The misfit of a surface whose boundary has a given RMS distance from the measured curve."""
        return replace(self, rms=float(np.hypot(self.rms, distance)), max=max(self.max, distance))


@dataclass(frozen=True, kw_only=True)
class BoundaryResidual:
    """Distance between the surface's boundary and Γ, on points that are not the nodes of the fit, in mesh units.

    Attributes:
        rms: root of the mean squared distance by arc length.
        max: largest distance.
        max_per_local_edge: largest ratio of the distance to the mean length of the three nearest loop edges.
        mean_edge: mean edge length of the loop.
        diagonal: diagonal of the loop's bounding box.
    """

    rms: float
    max: float
    max_per_local_edge: float
    mean_edge: float
    diagonal: float

    def enlarged(self, scale: float, *, diagonal: float) -> BoundaryResidual:
        """The residual after scaling surface and loop, whose bounding box then has a given diagonal."""
        return replace(
            self, rms=scale * self.rms, max=scale * self.max, mean_edge=scale * self.mean_edge, diagonal=diagonal
        )

    def verdict(self, tolerance: float, *, steps: int, limit: str) -> tuple[bool, str]:
        """Whether a tolerance is met, and a sentence with the residual. It ends with `limit` if it is not met."""
        reached = f"residual {self.rms_per_edge:.1e} of the mean edge after {steps} steps"
        if not self.rms_per_edge <= tolerance:
            return False, f"{reached}, above the tolerance {tolerance:.1e}: {limit}"
        local = LOCAL_TOLERANCES * tolerance
        if not self.max_per_local_edge <= local:
            missed = f"the largest distance is {self.max_per_local_edge:.1e} of the edges there"
            return False, f"{reached}, but {missed}, above {local:.1e}: {limit}"
        return True, reached

    @property
    def rms_per_edge(self) -> float:
        """`rms` in mean loop edges."""
        return self.rms / self.mean_edge

    @property
    def max_per_edge(self) -> float:
        """`max` in mean loop edges."""
        return self.max / self.mean_edge

    @property
    def rms_per_diagonal(self) -> float:
        """`rms` in diagonals of the loop."""
        return self.rms / self.diagonal

    @property
    def max_per_diagonal(self) -> float:
        """`max` in diagonals of the loop."""
        return self.max / self.diagonal


def _on_skipped(
    r: Float[Array, "n 3"], slide: Float[Array, " n"], over: Int[Array, " j"], curve: CurveTensors
) -> tuple[Float[Array, " k"], Float[Array, " k"], Float[Array, " k"]]:
    """Points of Γ on pieces that the boundary skips: parameters, distances, arc lengths.

    A boundary that skips a finger of Γ can be near Γ at all of its own points.
    """
    xp = namespace(r)
    start, end, step = r[over], shifted(r, -1, axis=0)[over], closed_steps(slide)[over]
    share = (arange(SAMPLES_PER_PIECE, step) + 0.5) / SAMPLES_PER_PIECE
    parameters = (slide[over, None] + step[:, None] * share).reshape(-1)
    point, tangent = curve.point_and_derivative(parameters)
    chord = (end - start)[:, None]
    offset = point.reshape(len(over), SAMPLES_PER_PIECE, 3) - start[:, None]
    # the chord may have length 0
    along = (offset * chord).sum(-1) / xp.clip(square(chord).sum(-1), TINY, None)
    missed = norm(offset - xp.clip(along, 0, 1)[..., None] * chord)
    arcs = step[:, None] / SAMPLES_PER_PIECE * norm(tangent).reshape(len(over), SAMPLES_PER_PIECE)
    return parameters, missed.reshape(-1), arcs.reshape(-1)
