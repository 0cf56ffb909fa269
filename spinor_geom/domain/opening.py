"""Powers of z that map reentrant corners of a plane domain to convex ones.

At a corner between two straight edges a minimal surface fills the angle θ < π, even if away from the corner it lies on
the side of the angle 2π − θ. Its normal is then reversed in a small region near the corner. On a domain with the angle
2π − θ there, p and q have a singularity that even many poles do not resolve. A power of z maps this angle to θ. On the
image p and q are nearly smooth.

Source: Gray, "Linear Differential Equations and Group Theory from Riemann to Poincaré" (2000), chapter VI, for the
exponents of a minimal surface at a corner, due to Riemann and Weierstrass.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from spinor_geom.arrays import EPS
from spinor_geom.domain.plane_domain import SplineBoundary, sampled
from spinor_geom.domain.polygons import bound_domain

_ASIDE = 1e-9  # distance of one-sided derivatives from a corner
_SHARE = np.linspace(0, 1, 129) ** 4  # points per side, denser at its ends, so that steps along its image are even
_DENSE = _SHARE / (_SHARE + _SHARE[::-1])
_SHORTEST = EPS**0.5  # shortest piece of the image per its length. Parts of shorter ones may have no length


@dataclass(frozen=True, kw_only=True)
class _Power:
    """The map ((z − corner)/middle)^exponent. Its branch cut lies outside Ω."""

    corner: complex
    middle: complex
    exponent: float

    def __call__(self, z: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        return np.asarray(((z - self.corner) / self.middle) ** self.exponent)

    def root_of_slope(self, z: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        """A square root of the derivative that is continuous in Ω."""
        unit = (z - self.corner) / self.middle
        return np.asarray(np.sqrt(self.exponent / self.middle) * unit ** ((self.exponent - 1) / 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class Opening:
    """The image of a domain's boundary under powers of z at its reentrant corners.

    Attributes:
        boundary: of the image, with as many vertices.
        before: parameters of its vertices on the given boundary, increasing. The last is the first one plus 1.
        powers: the maps, in the order in which they are applied.
        given: the given boundary.
    """

    boundary: SplineBoundary
    before: Float[np.ndarray, " m1"]
    powers: tuple[_Power, ...]
    given: SplineBoundary

    @classmethod
    def of(cls, given: SplineBoundary, angles: Float[np.ndarray, " c"]) -> Opening | None:
        """Maps reentrant corners to given angles.

        On sides that end in opened corners, vertices are evenly spaced in the image. None without such corners, or if
        the boundary would cross itself or have pieces without length.

        Args:
            given: boundary of a domain without holes, counter-clockwise.
            angles: of the image at each corner, in order. A reentrant corner is opened if its angle here is below π.
        """
        corners = np.flatnonzero(given.corners)
        ends = given.parameters[corners]
        before, after = (given.derivative(ends + side) for side in (-_ASIDE, _ASIDE))
        own = np.pi - np.angle(after / before)
        is_opened = (own > np.pi) & (angles < np.pi)
        t = ends[:, None] + np.diff(np.append(ends, ends[:1] + 1))[:, None] * _DENSE
        image, powers = given.point(t), []
        for side in np.flatnonzero(is_opened).tolist():
            around = np.roll(image, -side, axis=0).ravel()
            along = np.unwrap(np.angle(around[1:-1] - around[0]))
            if np.ptp(along) >= 2 * np.pi:
                return None
            middle = np.exp(0.5j * (along.min() + along.max()))
            powers.append(
                _Power(corner=complex(around[0]), middle=complex(middle), exponent=float(angles[side] / own[side]))
            )
            image = powers[-1](image)
        if not powers:
            return None
        parameters = _even(t, image, given.parameters, corners, is_opened | np.roll(is_opened, -1))
        vertices = given.point(parameters[:-1])
        for power in powers:
            vertices = power(vertices)
        vertices *= np.abs(np.diff(given.vertices)).sum() / np.abs(np.diff(vertices)).sum()
        boundary = SplineBoundary.through(vertices, given.corners)
        if np.diff(boundary.parameters).min() < _SHORTEST or not bound_domain((sampled(boundary),)):
            return None
        return cls(boundary=boundary, before=parameters, powers=tuple(powers), given=given)

    def given_parameters(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Parameters on the given boundary that correspond to those on the image, linear between vertices."""
        return np.asarray(np.interp(t, self.boundary.parameters, self.before))

    def factor(self, t: Float[np.ndarray, " n"]) -> Complex[np.ndarray, " n"]:
        """The factor of p and q at parameters on the image, up to a constant, for which φ dz does not change."""
        z, root = self.given.point(self.given_parameters(t)), np.ones(len(t), dtype=np.complex128)
        for power in self.powers:
            root, z = root * power.root_of_slope(z), power(z)
        return np.asarray(1 / root)


def _even(
    t: Float[np.ndarray, "c n"],
    image: Complex[np.ndarray, "c n"],
    parameters: Float[np.ndarray, " m1"],
    corners: Int[np.ndarray, " c"],
    chosen: Bool[np.ndarray, " c"],
) -> Float[np.ndarray, " m1"]:
    """Parameters of the vertices: evenly spaced in the image on chosen sides, the given ones on others."""
    m, parts = len(parameters) - 1, []
    numbers = np.append(corners, corners[0] + m)
    for side, (first, last) in enumerate(itertools.pairwise(numbers.tolist())):
        own = np.arange(first, last)
        along = np.append(0.0, np.cumsum(np.abs(np.diff(image[side]))))
        even = np.interp(np.arange(len(own)) / len(own) * along[-1], along, t[side])
        parts.append(even if chosen[side] else parameters[own % m] + own // m)
    found = np.roll(np.concatenate(parts), corners[0])
    found[: corners[0]] -= 1
    return np.append(found, found[0] + 1)
