"""Where Douglas's problem for several rims starts: each one's place in Ω, its direction, and what is opposite what.

Two rims are matched by all shifts of one against the other and all moduli at once. More are seen as circles on a sphere
around some points, from where the energy is least.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.laurent import ROUND_OFF
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.dirichlet import multipliers
from spinor_geom.plateau.rims.energy import MOST_MODULUS, HarmonicSurface

_STEP = 0.05  # step of the logarithm of a modulus
_KEPT = 2  # starts that are kept: with one, noisy rims on the sides of a cube are not met in their points
# Eyes' distances from the rims' middle, in the rims' largest distance from it.
_EYES = (0.5, 2.0)
# Narrowest circles on a sphere, as the cosine of their angle, and how often those that cross are made smaller.
_NARROWEST, _SHRINKINGS = 0.9999, 20


_Run = TypeVar("_Run", BoundaryLoop, BoundaryCurve)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rim:
    """A curve in both directions."""

    number: int  # of the rim among those that were given
    ways: tuple[CurveTensors, CurveTensors]  # its curve as it was given, and reversed

    def samples(self, n: int, *, back: bool = False) -> Float[Tensor, "n 3"]:
        """Points at equal steps of the parameter."""
        breaks = self.ways[back].breaks
        even = torch.arange(n, dtype=breaks.dtype, device=breaks.device) / n
        return self.ways[back].point_and_derivative(even)[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Placement:
    """Rims in their places."""

    rims: tuple[Rim, ...]  # that of the outer circle, of the hole about 0, and of all others
    back: tuple[bool, ...]  # which of them run against the curve that was given
    surface: HarmonicSurface

    @classmethod
    def of(
        cls, rims: Sequence[Rim], back: Sequence[bool], slides: Float[Tensor, "m n"], domain: CircularDomain
    ) -> Placement:
        """The placement with given slides over a given domain."""
        curves = CurveTensors.batch([rim.ways[way] for rim, way in zip(rims, back, strict=True)])
        surface = HarmonicSurface.of(curves, slides, domain, ROUND_OFF)
        return cls(rims=tuple(rims), back=tuple(back), surface=surface)

    def as_run(self, given: Sequence[_Run]) -> list[_Run]:
        """What was given of each rim, in the order and in the direction of the boundary of Ω."""
        rims = zip(self.rims, self.back, strict=True)
        return [given[rim.number].reversed() if back else given[rim.number] for rim, back in rims]

    def with_first_as_given(self) -> Placement:
        """This, or its mirror image in Ω, such that the first rim that was given runs as it was given."""
        if not any(back for rim, back in zip(self.rims, self.back, strict=True) if rim.number == 0):
            return self
        slides, domain = self.surface.slides, self.surface.domain
        mirrored = CircularDomain(centres=domain.centres.conj(), log_radii=domain.log_radii)
        ahead = torch.cat([1 - slides[:, :1], 2 - slides[:, 1:].flip(1)], dim=1)
        return Placement.of(self.rims, [not back for back in self.back], ahead, mirrored)


def start_between(first: Rim, second: Rim, n: int, *, back: bool) -> Placement:
    """Slides by the curves' own parameters, one shifted against the other, and the modulus where E first has a minimum.

    Where it has none, the modulus is 1 more than between circles of the curves' lengths in one plane. Of all shifts the
    one of least energy is taken.
    """
    points = torch.stack([first.samples(n), second.samples(n, back=back)])
    spectrum = torch.fft.rfft(points, dim=1)
    weight = torch.full_like(points[0, : n // 2 + 1, 0], 2.0)
    weight[0] = weight[-1] = 1.0
    square = weight * spectrum.abs().square().sum((0, 2)) / n
    cross = (spectrum[0] * spectrum[1]).sum(-1)
    logarithms = torch.arange(math.log(2 * math.pi / n), math.log(MOST_MODULUS), _STEP, dtype=weight.dtype)
    moduli = logarithms.to(weight.device).exp()
    own, other = multipliers(moduli, n)
    # the second curve shifted by j steps, for all j at once; a row for each modulus
    energy, shift = (0.5 * (own @ square)[:, None] + torch.fft.irfft(other * cross, n=n, dim=-1)).min(dim=1)
    sizes = (points.roll(-1, 1) - points).norm(dim=-1).sum(1).log().tolist()
    usual = int((moduli - 1 - abs(sizes[0] - sizes[1])).abs().argmin())
    row = _first_valley(energy, usual)
    even = torch.arange(n, dtype=weight.dtype, device=weight.device) / n
    domain = CircularDomain.annulus(float(moduli[row]), weight.device)
    slides = torch.stack([even, even + float(shift[row]) / n])
    return Placement.of((first, second), (False, back), slides, domain)


def seen_starts(rims: Sequence[Rim], n: int) -> list[Placement]:
    """Starts with three rims or more as circles on a sphere around a point, at an even number of nodes.

    From the rims' middle those of a junction are seen beside each other, and from above those of a hole and of islands
    in it; circles that cross are made smaller.
    """
    samples = torch.stack([rim.samples(n) for rim in rims])
    middle = samples.mean(1).mean(0)
    axes = torch.linalg.eigh(torch.einsum("mni,mnj->ij", samples - middle, samples - middle))[1].T
    size = (samples - middle).norm(dim=-1).max()
    ways = [torch.zeros_like(axes[0]), *(share * way for share in _EYES for way in (*axes, *-axes))]
    starts = [_seen(rims, samples, middle + size * way) for way in ways]
    found = sorted((start for start in starts if start is not None), key=lambda start: start.surface.dirichlet_energy)
    return [start.with_first_as_given() for start in found[:_KEPT]]


def _seen(rims: Sequence[Rim], samples: Float[Tensor, "m n 3"], eye: Float[Tensor, "3"]) -> Placement | None:
    """The start that a point shows; none where two rims are seen in one direction."""
    m, n = samples.shape[:2]
    away = torch.nn.functional.normalize(samples - eye, dim=-1)
    mean = away.mean(1)
    axis = torch.linalg.eigh(torch.einsum("mni,mnj->mij", away - mean[:, None], away - mean[:, None]))[1][..., 0]
    height = (away @ axis[..., None]).mean((1, 2))
    # to the side of each circle on which the other rims are not
    side = torch.einsum("kni,mi->mkn", away, axis) - height[:, None, None]
    side[torch.arange(m), torch.arange(m)] = 0
    sign = -side.sum((1, 2)).sign()
    axis, width = sign[:, None] * axis, (sign * height).clamp(-_NARROWEST, _NARROWEST).acos()
    # the widest outside, and about 0 what is opposite to it
    opposite = axis @ axis[width.argmax()]
    order = opposite.index_fill(0, width.argmax(), -math.inf).argsort()
    seen = _circles_on_sphere(axis[order], width[order], away[order])
    if seen is None:
        return None
    domain, points = seen
    even, coordinates = np.arange(n) / n, domain.coordinates(points).cpu().numpy()
    slides, back = [], []
    for k in range(m):
        turn = np.unwrap(np.angle(coordinates[k, k])) / (2 * np.pi)
        back.append(bool(turn[-1] < turn[0]))
        own = -even if back[-1] else even
        slides.append(even + np.interp(even, turn, own - turn, period=1))
    return Placement.of(
        [rims[k] for k in order.tolist()], back, torch.as_tensor(np.stack(slides), device=away.device), domain
    )


def _circles_on_sphere(
    axis: Float[Tensor, "m 3"], width: Float[Tensor, " m"], points: Float[Tensor, "m k 3"]
) -> tuple[CircularDomain, Complex[Tensor, "m k"]] | None:
    """Ω between circles on a sphere, the first one outside and the second one about 0, and points of the sphere in it.

    None where circles cross and cannot be made so small that they do not.
    """
    apart = (axis @ axis.T).clamp(-1, 1).acos()
    apart.fill_diagonal_(math.inf)
    for _ in range(_SHRINKINGS):
        excess = (width[:, None] + width - apart).max(dim=1).values.clamp(min=0)
        if not excess.any():
            break
        width = (width - excess).maximum(width / 2)
    basis = torch.linalg.qr(axis[:1].T, mode="complete")[0]
    frame = torch.stack([basis[:, 1], torch.linalg.cross(axis[0], basis[:, 1]), axis[0]])
    # from the pole of the first circle, which becomes the unit circle
    outer = torch.tan(width[0] / 2)
    x, y, z = (points @ frame.T).unbind(-1)
    flat = torch.complex(x, y) / (1 - z) * outer
    # the meridians' points of each circle that are nearest to and farthest from that pole
    x, y, z = (axis[1:] @ frame.T).unbind(-1)
    angle = z.clamp(-1, 1).acos()
    near, far = (outer / torch.tan((angle + way * width[1:]) / 2) for way in (1, -1))
    centre, radius = torch.polar((near + far) / 2, torch.atan2(y, x)), (far - near) / 2
    # the unit disk is moved into itself along the line through the second circle's centre
    product = 1 + near[0] * far[0]
    root = (near + far)[0] / (product + (product.square() - (near + far)[0].square()).clamp(min=0).sqrt())
    to = torch.polar(root, centre[0].angle())
    below = (1 - to.conj() * centre).abs().square() - (root * radius).square()
    centre = ((centre - to) * (1 - to * centre.conj()) + to * radius.square()) / below
    centre[0] = 0
    domain = CircularDomain(centres=centre, log_radii=(radius * (1 - root.square()) / below).log())
    return (domain, (flat - to) / (1 - to.conj() * flat)) if domain.nearness < 1 else None


def _first_valley(energy: Float[Tensor, " k"], usual: int) -> int:
    """Where a function has its first minimum; else where it falls least before it falls more; else the usual place."""
    inner = (energy[1:-1] <= energy[:-2]) & (energy[1:-1] < energy[2:])
    if not inner.any():
        slope = energy.diff()
        inner = (slope[1:-1] > slope[:-2]) & (slope[1:-1] >= slope[2:])
    return 1 + int(inner.to(torch.int8).argmax()) if inner.any() else usual
