"""Starts of Douglas's problem for several rims: the circles of Ω, the directions of the rims, and their slides.

For two rims the energy of all shifts of one against the other is evaluated for many moduli at once. Three rims and more
are projected as circles onto spheres around several view points. The projections of least energy are used.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import EPS, Array, Place, cis, namespace, norm, place_of, to_numpy, unit
from spinor_geom.holomorphic.circular_domain import CircularDomain, centring, turned, turned_circles
from spinor_geom.holomorphic.laurent import ROUND_OFF
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.dirichlet import multipliers
from spinor_geom.plateau.rims.energy import MOST_MODULUS, HarmonicSurface

_KEPT = 2  # number of starts returned. One is not enough for noisy rims on the sides of a cube
# Shares of the circles' widths, tried in order until circles are apart: those of rims with corners, as of the faces of
# a tetrahedron, cross though the rims do not. Above the second number, a `CircularDomain.nearness`, the first nodes do
# not resolve the gap.
_SHARES_OF_WIDTHS, _NEAREST = 0.8 ** np.arange(8), 0.9

_LoopOrCurve = TypeVar("_LoopOrCurve", BoundaryLoop, BoundaryCurve)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rim:
    """A curve Γ over one rim, in both directions."""

    number: int  # index of the given loop
    directions: tuple[CurveTensors, CurveTensors]  # the curve as given, and reversed

    @property
    def place(self) -> Place:
        """The place of the curve's arrays."""
        return place_of(self.directions[0].breaks)

    def samples(self, n: int, *, backward: bool = False) -> Float[np.ndarray, "n 3"]:
        """Points at equal steps of the parameter."""
        return to_numpy(self.directions[backward].point_and_derivative(self.place.put(np.arange(n) / n))[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class OrientedSurface:
    """A harmonic surface, with the rim and direction of each circle."""

    rims: tuple[Rim, ...]  # of the outer circle, of the hole around 0, and of the other holes
    backward: tuple[bool, ...]  # whether the curve of each rim is reversed
    surface: HarmonicSurface

    @classmethod
    def of(
        cls, rims: Sequence[Rim], backward: Sequence[bool], slides: Float[Array, "m n"], domain: CircularDomain
    ) -> OrientedSurface:
        """The surface with given slides over a given domain, whose arrays are put in the place of the curves."""
        put = rims[0].place.put
        domain = CircularDomain(centres=put(domain.centres), log_radii=put(domain.log_radii))
        curves = CurveTensors.batch([rim.directions[flip] for rim, flip in zip(rims, backward, strict=True)])
        surface = HarmonicSurface.of(curves, put(slides), domain, ROUND_OFF)
        return cls(rims=tuple(rims), backward=tuple(backward), surface=surface)

    def as_directed(self, given: Sequence[_LoopOrCurve]) -> list[_LoopOrCurve]:
        """The given loops or curves, in the order and direction of the boundaries of Ω."""
        rims = zip(self.rims, self.backward, strict=True)
        return [given[rim.number].reversed() if backward else given[rim.number] for rim, backward in rims]

    def with_first_as_given(self) -> OrientedSurface:
        """This surface, or the same over the mirror image of Ω, so that the first given rim is not reversed."""
        if not any(backward for rim, backward in zip(self.rims, self.backward, strict=True) if rim.number == 0):
            return self
        slides, domain = self.surface.slides, self.surface.domain
        mirrored = CircularDomain(centres=domain.centres.conj(), log_radii=domain.log_radii)
        xp = namespace(slides)
        ahead = xp.concat([1 - slides[:, :1], 2 - xp.flip(slides[:, 1:], axis=1)], axis=1)
        return OrientedSurface.of(self.rims, [not backward for backward in self.backward], ahead, mirrored)


def start_between(first: Rim, second: Rim, n: int, *, backward: bool) -> OrientedSurface:
    """The start of two rims: equal steps of both parameters with the shift of least energy.

    The modulus is that of the first minimum of the energy, else of the first maximum of its slope, else 1 more than
    that between concentric circles of the curves' lengths.
    """
    points = np.stack([first.samples(n), second.samples(n, backward=backward)])
    spectrum = np.fft.rfft(points, axis=1)
    weight = np.full(n // 2 + 1, 2.0)
    weight[0] = weight[-1] = 1.0
    square = weight * (np.abs(spectrum) ** 2).sum(axis=(0, 2)) / n
    cross = (spectrum[0] * spectrum[1]).sum(-1)
    moduli = np.geomspace(2 * math.pi / n, MOST_MODULUS, 2 * n)
    own, other = multipliers(moduli, n)
    # for all shifts of the second curve by j steps, in a row for each modulus
    energies = 0.5 * (own @ square)[:, None] + np.fft.irfft(other * cross, n=n)
    sizes = np.log(norm(np.roll(points, -1, axis=1) - points).sum(axis=1)).tolist()
    usual = int(np.abs(moduli - 1 - abs(sizes[0] - sizes[1])).argmin())
    row = _first_valley(energies.min(axis=1), usual)
    even, domain = np.arange(n) / n, CircularDomain.annulus(float(moduli[row]))
    slides = np.stack([even, even + int(energies[row].argmin()) / n])
    return OrientedSurface.of((first, second), (False, backward), slides, domain)


def projected_starts(rims: Sequence[Rim], n: int) -> list[OrientedSurface]:
    """Starts of three rims or more, projected onto spheres around view points. n is even.

    Rims of a junction do not overlap in the projection from their centre. Those of a hole with islands do not in one
    from above. Circles that cross in all projections are made smaller.
    """
    samples = np.stack([rim.samples(n) for rim in rims])
    middle = samples.mean(axis=1).mean(axis=0)
    axes = np.linalg.eigh(np.einsum("mni,mnj->ij", samples - middle, samples - middle))[1].T
    views = norm(samples - middle).max() * np.concatenate([np.zeros((1, 3)), axes, -axes])
    for share in _SHARES_OF_WIDTHS:
        starts = [_projected(rims, samples, middle + view, share) for view in views]
        found = [start for start in starts if start is not None]
        if found:
            # few nodes do not show the energy where they crowd
            found.sort(key=lambda start: (start.surface.crowded, start.surface.dirichlet_energy))
            return [start.with_first_as_given() for start in found[:_KEPT]]
    return []


def _projected(
    rims: Sequence[Rim], samples: Float[np.ndarray, "m n 3"], view: Float[np.ndarray, "3"], share: float
) -> OrientedSurface | None:
    """The start from the projection around a view point, or None if circles of a share of the rims' widths overlap."""
    m, n = samples.shape[:2]
    away = unit(samples - view)
    mean = away.mean(axis=1)
    axis = np.linalg.eigh(np.einsum("mni,mnj->mij", away - mean[:, None], away - mean[:, None]))[1][..., 0]
    height = (away @ axis[..., None]).mean(axis=(1, 2))
    # orient each axis away from the other rims
    side = np.einsum("kni,mi->mkn", away, axis) - height[:, None, None]
    side[np.arange(m), np.arange(m)] = 0
    sign = -np.sign(side.sum(axis=(1, 2)))
    axis, width = sign[:, None] * axis, np.arccos(np.clip(sign * height, EPS - 1, 1 - EPS))
    # the widest circle is the outer one, the one opposite to it surrounds 0
    opposite = axis @ axis[width.argmax()]
    opposite[width.argmax()] = -math.inf
    order = opposite.argsort()
    projected = _circles_on_sphere(axis[order], share * width[order], away[order])
    if projected is None:
        return None
    domain, points = projected
    even, coordinates = np.arange(n) / n, domain.coordinates(points)
    slides, backward = [], []
    for k in range(m):
        turn = np.unwrap(np.angle(coordinates[k, k])) / (2 * np.pi)
        backward.append(bool(turn[-1] < turn[0]))
        own = -even if backward[-1] else even
        slides.append(even + np.interp(even, turn, own - turn, period=1))
    return OrientedSurface.of([rims[k] for k in order.tolist()], backward, np.stack(slides), domain)


def _circles_on_sphere(
    axis: Float[np.ndarray, "m 3"], width: Float[np.ndarray, " m"], points: Float[np.ndarray, "m k 3"]
) -> tuple[CircularDomain, Complex[np.ndarray, "m k"]] | None:
    """Ω between circles on a sphere, the first one outer and the second one around 0, and images of points in Ω.

    None if circles cross or nearly touch.
    """
    basis = np.linalg.qr(axis[:1].T, mode="complete")[0]
    frame = np.stack([basis[:, 1], np.cross(axis[0], basis[:, 1]), axis[0]])
    # stereographic projection from the pole of the first circle, which becomes the unit circle
    outer = np.tan(width[0] / 2)
    x, y, z = np.moveaxis(points @ frame.T, -1, 0)
    flat = (x + 1j * y) / (1 - z) * outer
    # images of the two points of each circle on the meridian of its axis
    x, y, z = (axis[1:] @ frame.T).T
    angle = np.arccos(np.clip(z, -1, 1))
    near, far = (outer / np.tan((angle + sign * width[1:]) / 2) for sign in (1, -1))
    centre, radius = (near + far) / 2 * cis(np.arctan2(y, x)), (far - near) / 2
    to = centring(complex(centre[0]), float(radius[0]))
    centre, radius = turned_circles(centre, radius, to)
    if radius.min() <= 0:
        return None
    centre[0] = 0
    domain = CircularDomain(centres=centre, log_radii=np.log(radius))
    return (domain, turned(flat, to)) if domain.nearness < _NEAREST else None


def _first_valley(energy: Float[np.ndarray, " k"], usual: int) -> int:
    """Index of the first local minimum of a function, else of the first local maximum of its slope, else `usual`."""
    inner = (energy[1:-1] <= energy[:-2]) & (energy[1:-1] < energy[2:])
    if not inner.any():
        slope = np.diff(energy)
        inner = (slope[1:-1] > slope[:-2]) & (slope[1:-1] >= slope[2:])
    return 1 + int(inner.argmax()) if inner.any() else usual
