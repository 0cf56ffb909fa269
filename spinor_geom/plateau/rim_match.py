"""A loop and the boundary of Ω that a surface maps to it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float
from scipy.interpolate import PchipInterpolator

from spinor_geom.domain.plane_domain import Boundary
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.loop_frame import LoopFrame
from spinor_geom.mesh.spacing import edge_lengths

_ROUNDED = 0.1  # an edge that is longer by this share is not divided


@dataclass(frozen=True, kw_only=True, eq=False)
class RimMatch:
    """A loop and the boundary of Ω that the surface maps to it.

    Attributes:
        loop: the loop, in the direction of the surface's boundary.
        curve: Γ, through all points of the loop.
        boundary: the boundary of Ω.
        matching: (n, 2) increasing pairs (t, s): the boundary point at parameter t corresponds to Γ(s). One period of
            both, in which s may exceed [0, 1).
    """

    loop: BoundaryLoop
    curve: BoundaryCurve
    boundary: Boundary
    matching: Float[np.ndarray, "n 2"]

    def __repr__(self) -> str:
        return f"RimMatch({self.loop!r}, {len(self.matching)} matched points)"

    def placed_by(self, frame: LoopFrame, loop: BoundaryLoop, boundary: Boundary) -> RimMatch:
        """The match in the coordinates outside a frame, of a loop and the boundary, mirrored if it is backward."""
        curve, (t, s) = self.curve.turned(frame.axes), self.matching.T
        if frame.is_backward:
            curve = curve.reversed()
            # the first pair stays the first, so that pairs at the loop's points remain
            t, s = (np.concatenate([-x[:1], 1 - x[:0:-1]]) for x in (t, s))
        return RimMatch(
            loop=loop, curve=curve.placed(loop.points, frame.size), boundary=boundary, matching=np.column_stack([t, s])
        )

    def divided(self, longest: float) -> RimMatch:
        """The match with more points on Γ, so that edges are at most about `longest`, in mesh units.

        The match is unchanged if Γ is not known between the points of the loop, see `BoundaryCurve.is_of_surface`.
        """
        parts = np.ceil(edge_lengths(self.loop.points) / longest - _ROUNDED).astype(np.int64).clip(1)
        if self.curve.is_of_surface or (parts == 1).all():
            return self
        curve = self.curve.divided(parts)
        points = curve.coefficients[-1].copy()
        points[np.cumsum(parts) - parts] = self.loop.points
        return replace(self, loop=BoundaryLoop.from_points(points, corners=np.flatnonzero(curve.corners)), curve=curve)

    @cached_property
    def bulge(self) -> float:
        """Largest distance of a piece of Γ from its edge of the loop, in mesh units."""
        return self.curve.bulge()

    def points_in_domain(self) -> Complex[np.ndarray, " m"]:
        """The points of ∂Ω that correspond to the loop's points, in loop order."""
        return self.boundary.point(self.parameters(self.curve.at_loop))

    def points_between(self, edge: int, count: int) -> Complex[np.ndarray, " count"]:
        """Points inside Ω next to the part of ∂Ω between two neighbouring points of the loop, in order.

        They divide the edge's part of Γ evenly. Their distance from ∂Ω is a parabola, in the middle a quarter of their
        spacing, so that edge and points form a convex polygon.
        """
        ends = np.append(self.curve.at_loop, self.curve.at_loop[0] + 1)[edge : edge + 2]
        share = np.arange(1, count + 1) / (count + 1)
        t = self.parameters(ends[0] + share * (ends[1] - ends[0]))
        velocity = self.boundary.derivative(t)
        length = np.abs(np.diff(self.boundary.point(self.parameters(ends)))) / (count + 1)
        inwards = 1j * velocity / np.abs(velocity)
        return np.asarray(self.boundary.point(t) + share * (1 - share) * length * inwards)

    def places(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Parameters of Γ that correspond to ∂Ω at t, −1 < t < 2."""
        # three periods, so that the places are not extrapolated. Equal t are one knot
        around = np.concatenate([self.matching - 1, self.matching, self.matching + 1])
        return np.asarray(PchipInterpolator(*around[np.append(True, np.diff(around[:, 0]) > 0)].T)(t))

    def parameters(self, at: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Parameters on ∂Ω that correspond to Γ(s), −1 < s < 2."""
        t, s = self.matching.T
        if np.array_equal(at, s[: len(at)]):  # matched points
            return np.asarray(t[: len(at)])
        # three periods, so that the parameters are not extrapolated. Equal s are one knot
        s = np.concatenate([s - 1, s, s + 1])
        keep = np.flatnonzero(np.append(True, np.diff(np.maximum.accumulate(s)) > 0))
        s, t = s[keep], np.concatenate([t - 1, t, t + 1])[keep]
        # the slope at a knot depends on its two neighbours
        first, last = np.searchsorted(s, [at.min(), at.max()])
        around = slice(max(0, first - 3), last + 3)
        return np.asarray(PchipInterpolator(s[around], t[around])(at))
