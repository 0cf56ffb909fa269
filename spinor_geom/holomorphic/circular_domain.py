"""Circular domains: the unit disk without round holes. Every plane domain with holes is conformal to one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import NUMPY, TINY, Array, Place, arange, cis, complex_of, namespace, place_of


@dataclass(frozen=True, kw_only=True, eq=False)
class CircularDomain:
    """The unit disk without round holes, the first of them centred at 0.

    Domains that are conformal to each other differ by a rotation only. The coordinate ζ of the outer circle is z, that
    of the circle of a hole is r/(z − c): |ζ| = 1 on the circle, |ζ| < 1 in Ω.
    """

    centres: Complex[Array, " holes"]
    log_radii: Float[Array, " holes"]

    @classmethod
    def annulus(cls, modulus: float, place: Place = NUMPY) -> CircularDomain:
        """The annulus between the unit circle and that of radius e^{−modulus}."""
        return cls(centres=place.put(np.zeros(1, dtype=np.complex128)), log_radii=place.put(np.array([-modulus])))

    @property
    def _xp(self) -> Any:
        return namespace(self.log_radii)

    @property
    def rims(self) -> int:
        """m, the number of circles."""
        return len(self.centres) + 1

    @cached_property
    def radii(self) -> Float[Array, " holes"]:
        """Radii of the holes."""
        return self._xp.exp(self.log_radii)

    @property
    def modulus(self) -> float:
        """Modulus log(1/r) of the annulus between the unit circle and the first hole."""
        return -float(self.log_radii[0])

    def circles(self, n: int) -> Complex[Array, "m n"]:
        """Points at n equal steps of every circle, with Ω on the left: clockwise around holes."""
        turn = cis(arange(n, self.radii) * (2 * math.pi / n))
        return self._xp.concat([turn[None], self.centres[:, None] + self.radii[:, None] * turn.conj()])

    def velocities(self, n: int) -> Complex[Array, "m n"]:
        """dz/dτ at the points of `circles`, τ from 0 to 2π."""
        turn = self.circles(n)[0]
        return 1j * self._xp.concat([turn[None], -self.radii[:, None] * turn.conj()])

    def coordinates(self, z: Complex[Array, "*pts"]) -> Complex[Array, "m *pts"]:
        """Coordinate ζ of every circle at the points z."""
        shape = (-1, *([1] * z.ndim))
        return self._xp.concat([z[None], self.radii.reshape(shape) / (z - self.centres.reshape(shape))])

    def coordinates_on_circles(self, n: int) -> Complex[Array, "m m n"]:
        """Coordinate ζ of every circle at the points of `circles`, on its own circle without rounding error."""
        circles = self.circles(n)
        zeta = self.coordinates(circles)
        own = self._xp.arange(self.rims)
        zeta[own, own] = circles[0]
        return zeta

    def squared_root(self, z: Complex[Array, "*pts"], antiperiodic: Sequence[bool]) -> Complex[Array, "*pts"]:
        """The product of z − c_j over the holes around which p and q change their sign."""
        return (z[..., None] - self.centres[np.flatnonzero(antiperiodic)]).prod(-1)

    @cached_property
    def gaps(self) -> Float[Array, "m m"]:
        """Largest |ζ_j| on circle i, entry (i, j): 1 where the circles touch, more where they cross, or 0 for i = j."""
        c, r, xp = self.centres, self.radii, self._xp
        far = abs(c[:, None] - c)
        gaps = place_of(r).put(np.zeros((self.rims, self.rims)))
        gaps[1:, 1:] = r / xp.clip(far - r[:, None], TINY, None)
        gaps[1:, 1:][far <= r[:, None]] = math.inf
        gaps[1:, 0] = abs(c) + r
        gaps[0, 1:] = r / xp.clip(1 - abs(c), TINY, None)
        own = xp.arange(self.rims)
        gaps[own, own] = 0.0
        return gaps

    @property
    def nearness(self) -> float:
        """The largest of `gaps`, less than 1 for a domain."""
        return float(self.gaps.max())

    @cached_property
    def room(self) -> tuple[Float[Array, " holes"], Float[Array, " holes"]]:
        """Width and modulus log(R/r), NaN if there is none, of the widest concentric ring in Ω around each hole."""
        c, r, xp = self.centres, self.radii, self._xp
        far = abs(c[:, None] - c) - r
        own = xp.arange(len(c))
        far[own, own] = 1.0
        reach = xp.minimum(xp.min(far, axis=1), 1 - abs(c))
        return reach - r, xp.log(reach) - self.log_radii

    @property
    def clearances(self) -> Float[Array, " m"]:
        """Distance of every circle from the nearest other one."""
        width, _ = self.room
        return self._xp.concat([(1 - abs(self.centres) - self.radii).min()[None], width])

    def moved(self, step: Float[Array, " p"]) -> CircularDomain:
        """The domain after a step of its conformal moduli.

        The moduli are the logarithm of the modulus of the first hole's ring (see `room`), then for each other hole x
        and y of its centre, divided by the width of its ring, and the logarithm of the modulus of that ring.
        """
        others = step[1:].reshape(-1, 3)
        width, modulus = self.room
        move = complex_of(others[:, 0], others[:, 1]) * width[1:]
        change = modulus * self._xp.expm1(self._xp.concat([step[:1], others[:, 2]]))
        return CircularDomain(
            centres=self._xp.concat([self.centres[:1], self.centres[1:] + move]), log_radii=self.log_radii - change
        )


def turned(z: Complex[np.ndarray, "*pts"], to: complex) -> Complex[np.ndarray, "*pts"]:
    """Images of points by the conformal map of the unit disk onto itself that moves a point to 0."""
    return np.asarray((z - to) / (1 - np.conj(to) * z))


def turned_circles(
    centres: Complex[np.ndarray, " k"], radii: Float[np.ndarray, " k"], to: complex
) -> tuple[Complex[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Centres and radii of the images of circles by the same map."""
    below = np.abs(1 - np.conj(to) * centres) ** 2 - np.abs(to * radii) ** 2
    moved = (centres - to) * (1 - to * np.conj(centres)) + to * radii**2
    return moved / below, radii * (1 - abs(to) ** 2) / below


def centring(centre: complex, radius: float) -> complex:
    """The point that the same map must move to 0 to make a circle concentric."""
    size = abs(centre)
    if size == 0:
        return 0j
    # the ends of the diameter through 0 become opposite
    near, far = size - radius, size + radius
    product = 1 + near * far
    root = (near + far) / (product + math.sqrt(max(product**2 - (near + far) ** 2, 0.0)))
    return root * centre / size
