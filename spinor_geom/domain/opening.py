"""Maps of plane domains that open reentrant corners near them.

At a corner between two sides of angle θ < π a minimal surface fills this angle, even if away from the corner it lies on
the side of the angle 2π − θ. Its normal is then reversed in a region near the corner. On a domain with the angle 2π − θ
there, p and q have a singularity that even many poles do not resolve: distances in space grow like those in the domain
to the power θ/(2π − θ). On an image that ends in a spike of angle θ and the region's size p and q are nearly smooth.

Source: Gray, "Linear Differential Equations and Group Theory from Riemann to Poincaré" (2000), chapter VI, for the
exponents of a minimal surface at a corner, due to Riemann and Weierstrass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.special import hyp2f1

from spinor_geom.arrays import EPS
from spinor_geom.domain.plane_domain import SplineBoundary, sampled
from spinor_geom.domain.polygons import bound_domain

_SHARE = np.linspace(0, 1, 129) ** 4  # points per side, dense at its ends
_DENSE = _SHARE / (_SHARE + _SHARE[::-1])
_SHORTEST = EPS**0.5  # shortest piece of the image per its length. Parts of shorter ones may have no length
# Around an opened corner vertices are at steps of log(1 + ζ) and log(1 + 4w) below this one
_STEP, _INSIDE = 0.5, 4.0


@dataclass(frozen=True, kw_only=True)
class _Spike:
    """The map w(ζ) with w' = α ζ^(α − 1) (1 + ζ)^(1 − α) and ζ = ((z − corner)/middle)^power/size.

    The power maps the corner's angle to π. The image has the angle πα there, and for ζ far above 1 its boundary is
    smooth. Branch cuts lie outside Ω.
    """

    corner: complex
    middle: complex
    power: float
    size: float
    angle: float  # α

    def half_plane(self, z: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        """ζ."""
        return np.asarray(((z - self.corner) / self.middle) ** self.power / self.size)

    def __call__(self, z: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        zeta, a = self.half_plane(z), self.angle
        return np.asarray(zeta**a * hyp2f1(a - 1, a, a + 1, -zeta))

    def root_of_slope(self, z: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        """A square root of the derivative that is continuous in Ω, NaN at the corner."""
        constant = self.angle * self.power / self.middle * self.size**-self.angle
        with np.errstate(divide="ignore", invalid="ignore"):
            unit = ((z - self.corner) / self.middle) ** ((self.angle * self.power - 1) / 2)
        return np.asarray(np.sqrt(constant) * unit * (1 + self.half_plane(z)) ** ((1 - self.angle) / 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class Opening:
    """The image of a domain's boundary under maps that open its reentrant corners.

    Attributes:
        boundary: of the image.
        before: parameters of its vertices on the given boundary, increasing. The last is the first one plus 1.
        spikes: the maps, in the order in which they are applied.
        scale: by which their image is multiplied, so that ∂Ω keeps its length.
        given: the given boundary.
    """

    boundary: SplineBoundary
    before: Float[np.ndarray, " m1"]
    spikes: tuple[_Spike, ...]
    scale: float
    given: SplineBoundary

    @classmethod
    def of(
        cls, given: SplineBoundary, angles: Float[np.ndarray, " c"], lengths: Float[np.ndarray, " c"]
    ) -> Opening | None:
        """Maps corners to given angles.

        Vertices are as dense as the given ones, and denser around opened corners. None without such corners, or if the
        boundary would cross itself or have pieces without length.

        Args:
            given: boundary of a domain without holes, counter-clockwise.
            angles: of the image at each corner, in order, if it is opened.
            lengths: distances in the given domain from each corner within which the image has these angles, 0 at
                corners that are kept.
        """
        corners, m = np.flatnonzero(given.corners), len(given.corners)
        ends = given.parameters[corners]
        own = given.corner_angles
        t = ends[:, None] + np.diff(np.append(ends, ends[:1] + 1))[:, None] * _DENSE
        image, slope, spikes, reaches = given.point(t), np.ones(t.shape), list[_Spike](), []
        number = np.interp(t, np.append(given.parameters, given.parameters[1:] + 1), np.arange(2 * m + 1))
        squares = np.diff(number) ** 2  # of steps in the number of vertices
        for side in np.flatnonzero(lengths).tolist():
            around = np.roll(image, -side, axis=0).ravel()
            along = np.unwrap(np.angle(around[1:-1] - around[0]))
            if np.ptp(along) >= 2 * np.pi:
                return None
            power = float(np.pi / own[side])
            spike = _Spike(
                corner=complex(around[0]),
                middle=complex(np.exp(0.5j * (along.min() + along.max()))),
                power=power,
                size=float((slope[side, 0] * lengths[side]) ** power),
                angle=float(angles[side] / np.pi),
            )
            slope *= np.abs(spike.root_of_slope(image)) ** 2
            zeta, image = spike.half_plane(image), spike(image)
            for place in (zeta, _INSIDE * image):
                squares += np.abs(np.diff(np.log1p(place)) / _STEP) ** 2
            spikes.append(spike)
            reaches.append(((side, np.abs(image[side, 1]), -1), (side - 1, np.abs(image[side - 1, -2]), 1)))
        if not spikes:
            return None
        number[:, 1:] = np.cumsum(np.sqrt(squares), axis=1)
        number[:, 0] = 0.0
        counts = np.rint(number[:, -1]).astype(np.int64).tolist()
        places = [np.arange(n) / n * own[-1] for n, own in zip(counts, number, strict=True)]
        rows = [np.interp(*row) for row in zip(places, number, t, strict=True)]
        by_side = [given.point(row) for row in rows]
        for spike, reach in zip(spikes, reaches, strict=True):
            by_side = [spike(own) for own in by_side]
            # next to the end of the spike points of the given domain are too near to each other
            for side, limit, sign in reach:
                away = places[side] if sign < 0 else number[side, -1] - places[side]
                distance = np.expm1(_STEP * away) / _INSIDE
                is_near = distance < limit
                by_side[side][is_near] = (distance * np.exp(0.5j * np.pi * sign * spike.angle))[is_near]
        parameters, vertices = np.concatenate(rows), np.concatenate(by_side)
        flags = np.concatenate([place == 0 for place in places])
        first = int(np.searchsorted(parameters, 1.0))
        parameters = np.append(parameters[first:] - 1, parameters[:first])
        vertices, flags = np.roll(vertices, -first), np.roll(flags, -first)
        scale = float(np.abs(np.diff(given.vertices)).sum() / np.abs(np.diff(vertices)).sum())
        boundary = SplineBoundary.through(scale * vertices, flags)
        if np.diff(boundary.parameters).min() < _SHORTEST or not bound_domain((sampled(boundary),)):
            return None
        return cls(
            boundary=boundary,
            before=np.append(parameters, parameters[0] + 1),
            spikes=tuple(spikes),
            scale=scale,
            given=given,
        )

    def given_parameters(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Parameters on the given boundary that correspond to those on the image, linear between vertices."""
        return np.asarray(np.interp(t, self.boundary.parameters, self.before))

    def factor(self, t: Float[np.ndarray, " n"]) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, "k n"]]:
        """For parameters on the given boundary, the factor of p and q for which φ dz does not change, and ζ.

        The factor is NaN at opened corners. There is a row of ζ for each spike.
        """
        z, root, places = self.given.point(t), np.ones(len(t), dtype=np.complex128), []
        for spike in self.spikes:
            places.append(spike.half_plane(z))
            root, z = root * spike.root_of_slope(z), spike(z)
        return np.asarray(self.scale**-0.5 / root), np.array(places)
