"""The unit disk less round holes, with the images of corners on its circles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import compress

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.arrays import EPS, cis
from spinor_geom.holomorphic.circular_domain import turned, turned_circles
from spinor_geom.plateau.newton import MOST_STEPS
from spinor_geom.plateau.rims.sides import CorneredRims, Place, Side, cluster

# Distance of the limit of images, in radii, below which poles surround it. Farther ones are shown by powers.
_NARROW = 0.5
_CROWDING = 0.25  # density of nodes and modes at a gap between circles, times its width


@dataclass(frozen=True, kw_only=True, eq=False)
class Circles:
    """The circles of ∂Ω, and the images of corners on them. The first circle is the unit circle."""

    centres: Complex[np.ndarray, " m"]
    log_radii: Float[np.ndarray, " m"]
    arguments: Float[np.ndarray, " c"]  # of the corners, in the direction of ∂Ω: clockwise around holes

    @property
    def radii(self) -> Float[np.ndarray, " m"]:
        """Radii of all circles."""
        return np.asarray(np.exp(self.log_radii))

    @property
    def signs(self) -> Float[np.ndarray, " m"]:
        """1 for the outer circle, −1 for holes."""
        return np.where(np.arange(len(self.centres)) == 0, 1.0, -1.0)

    def images(self, rim_of_corner: Int[np.ndarray, " c"]) -> Complex[np.ndarray, " c"]:
        """Images of the corners."""
        turn = cis(self.signs[rim_of_corner] * self.arguments)
        return np.asarray(self.centres[rim_of_corner] + self.radii[rim_of_corner] * turn)

    def arc(self, side: Side) -> tuple[float, float]:
        """The argument of the first end of a side, and the length of its arc."""
        if side.corners is None:
            return 0.0, 2 * np.pi
        first, last = self.arguments[list(side.corners)].tolist()
        return first, (last - first) % (2 * np.pi) or 2 * np.pi

    def places(self, rim_of_corner: Int[np.ndarray, " c"], side: Side) -> Place:
        """`Side.place` that is steep where other circles are near: about the conformal coordinate of a narrow gap.

        At points z of one circle, |z − c|² − r² of another one is a − b cos of the angle from the nearest point.
        """
        first, arc = self.arc(side)
        radius, others = float(self.radii[side.rim]), np.delete(np.arange(len(self.radii)), side.rim)
        towards = (self.centres[others] - self.centres[side.rim]) * np.where(others == 0, -1, 1)
        away = np.abs(towards)
        power = np.abs(away**2 + radius**2 - self.radii[others] ** 2)
        near, far = np.log(arc / self.arcs(rim_of_corner)[list(side.corners or ())]).tolist()
        return Place(
            arc=arc,
            first=first - self.signs[side.rim] * np.angle(towards),
            eccentricities=2 * away * radius / power,
            weights=2 * _CROWDING * arc * radius * self.radii[others] / power,
            near=(near, far),
        )

    def _marks(self, rim_of_corner: Int[np.ndarray, " c"]) -> Complex[np.ndarray, " k"]:
        """Images of corners on the outer circle, and centres of holes."""
        return np.concatenate([self.images(rim_of_corner)[rim_of_corner == 0], self.centres[1:]])

    def spread(self, rim_of_corner: Int[np.ndarray, " c"]) -> tuple[Circles, list[complex]]:
        """A conformal image where 0 is the mean of holes and corners, and the points for `turned` that lead to it."""
        circles, points = self, []
        for _ in range(MOST_STEPS):
            points.append(complex(circles._marks(rim_of_corner).mean()) / 2)
            circles = circles.turned(points[-1], rim_of_corner)
        return circles, points

    def turned(self, to: complex, rim_of_corner: Int[np.ndarray, " c"]) -> Circles:
        """The image by the conformal map of the unit disk onto itself that moves a point to 0."""
        centres, radii = turned_circles(self.centres, self.radii, to)
        centres[0], radii[0] = 0.0, 1.0
        arguments = self.signs[rim_of_corner] * np.angle(
            turned(self.images(rim_of_corner), to) - centres[rim_of_corner]
        )
        for rim in np.unique(rim_of_corner):
            own = rim_of_corner == rim
            arguments[own] = arguments[own][0] + (arguments[own] - arguments[own][0]) % (2 * np.pi)
        return Circles(centres=centres, log_radii=np.log(radii), arguments=arguments)

    def rotations(self, rim_of_corner: Int[np.ndarray, " c"]) -> Float[np.ndarray, "p 3"]:
        """Velocities of the moduli, as steps of `moved`, by conformal maps of the unit disk onto itself."""
        c, radii, z, columns = self.centres, self.radii, self.images(rim_of_corner), []
        for field in ((0, 1j, 0), (1, 0, -1), (1j, 0, 1j)):  # coefficients of 1, z, z²
            velocities = np.polyval(field[::-1], c) + np.conj(field[2]) * radii**2
            growths = np.polyval((2 * field[2], field[1]), c).real
            velocities[0] = 0.0  # the unit circle
            around = (np.polyval(field[::-1], z) - velocities[rim_of_corner]) / (z - c[rim_of_corner])
            holes = np.stack([velocities.real, velocities.imag, growths], axis=1)[1:]
            columns.append(np.concatenate([self.signs[rim_of_corner] * around.imag, holes.ravel()]))
        return np.stack(columns, axis=1)

    def moved(self, step: Float[np.ndarray, " p"]) -> Circles:
        """The circles after a step of all arguments, then of x, y and log radius of each hole."""
        count = len(self.arguments)
        x, y, log = step[count:].reshape(-1, 3).T
        return Circles(
            centres=self.centres + np.append(0.0, x + 1j * y),
            log_radii=self.log_radii + np.append(0.0, log),
            arguments=self.arguments + step[:count],
        )

    def is_domain(self, rim_of_corner: Int[np.ndarray, " c"]) -> bool:
        """Whether no circles meet and the corners are in order."""
        for rim in np.unique(rim_of_corner):
            own = self.arguments[rim_of_corner == rim]
            if not (np.diff(np.append(own, own[0] + 2 * np.pi)) > 0).all():
                return False
        return bool((self.gaps[~np.eye(len(self.centres), dtype=bool)] > 0).all())

    @cached_property
    def gaps(self) -> Float[np.ndarray, "m m"]:
        """Widths of the gaps between circles, 0 on the diagonal."""
        radii = self.radii
        gaps = np.abs(self.centres[:, None] - self.centres) - radii[:, None] - radii
        gaps[0] = gaps[:, 0] = 1 - np.abs(self.centres) - radii
        np.fill_diagonal(gaps, 0.0)
        return np.asarray(gaps)

    def arcs(self, rim_of_corner: Int[np.ndarray, " c"]) -> Float[np.ndarray, " c"]:
        """The shorter arc beside each corner."""
        arcs = np.empty(len(rim_of_corner))
        for rim in np.unique(rim_of_corner):
            own = rim_of_corner == rim
            ahead = np.diff(np.append(self.arguments[own], self.arguments[own][0] + 2 * np.pi))
            arcs[own] = np.minimum(ahead, np.roll(ahead, 1))
        return arcs

    def poles(
        self, of: CorneredRims
    ) -> tuple[Complex[np.ndarray, " k"], Float[np.ndarray, " k"], Int[np.ndarray, " j"]]:
        """Poles at corners, along short arcs, and at narrow gaps, their distances from the circles, and corners."""
        rim_of_corner = of.rim_of_corner
        radii, signs = self.radii, self.signs
        # rims without corners need not have poles
        positions, distances, counts = [np.zeros(0, complex)], [np.zeros(0)], list[int]()
        turns = cis(signs[rim_of_corner] * self.arguments)
        arcs = self.arcs(rim_of_corner)
        for rim, turn, exponent, arc in zip(rim_of_corner, turns, of.exponents, arcs, strict=True):
            # the poles of a hole stay between its circle and its centre
            far = cluster(float(exponent), float(arc), of.resolution) * radii[rim] * (1.0 if rim == 0 else 0.5)
            positions.append(self.centres[rim] + turn * (radii[rim] + signs[rim] * far))
            distances.append(far)
            counts.append(len(far))
        for side in compress(of.sides, of.are_short):
            (first, arc), count, radius = self.arc(side), side.degree // 2, radii[side.rim]
            turn = cis(signs[side.rim] * (first + arc * (np.arange(count) + 0.5) / count))
            positions.append(self.centres[side.rim] + turn * radius * (1 + signs[side.rim] * arc / 4))
            distances.append(np.full(count, arc / 4 * radius))
        count = 6 + of.resolution.degree // 6
        around = EPS ** (0.5 / count) * cis(2 * np.pi * np.arange(count) / count)
        for rim, other in zip(*np.nonzero(~np.eye(len(radii), dtype=bool)), strict=True):
            towards, radius = self.centres[other] - self.centres[rim], radii[rim]
            if not towards:
                continue
            # limits of the images of the two circles in each other: inside and outside of the first one, as 1 / a and a
            apart = np.abs(towards)
            both = (apart + (radius**2 - radii[other] ** 2) / apart) / (2 * radius)
            outside = both + math.copysign(math.sqrt(both**2 - 1), both)
            own, opposite = (1 / outside, outside) if rim else (outside, 1 / outside)
            if np.abs(1 - np.abs(own)) < _NARROW:
                # around the first one, where w = (z - own)/(z - opposite) is on a circle smaller than on the rim
                w = np.abs((1 - own) / (1 - opposite)) * around
                at = (own - w * opposite) / (1 - w)
                positions.append(self.centres[rim] + towards / apart * radius * at)
                distances.append(radius * np.abs(np.abs(at) - 1))
        return np.concatenate(positions), np.concatenate(distances), np.repeat(np.arange(len(counts)), counts)
