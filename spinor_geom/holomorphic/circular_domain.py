"""Circular domains: the unit disk without round holes. Every plane domain with holes is conformal to one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Complex, Float
from torch import Tensor


@dataclass(frozen=True, kw_only=True, eq=False)
class CircularDomain:
    """The unit disk without round holes, the first of them centred at 0.

    Domains that are conformal to each other differ by a rotation only. The coordinate ζ of the outer circle is z, that
    of the circle of a hole is r/(z − c): |ζ| = 1 on the circle, |ζ| < 1 in Ω.
    """

    centres: Complex[Tensor, " holes"]
    log_radii: Float[Tensor, " holes"]

    @classmethod
    def annulus(cls, modulus: float, device: torch.device | str = "cpu") -> CircularDomain:
        """The annulus between the unit circle and that of radius e^{−modulus}."""
        radii = torch.tensor([-modulus], dtype=torch.float64, device=device)
        return cls(centres=torch.zeros_like(radii, dtype=torch.complex128), log_radii=radii)

    @property
    def rims(self) -> int:
        """m, the number of circles."""
        return len(self.centres) + 1

    @cached_property
    def radii(self) -> Float[Tensor, " holes"]:
        """Radii of the holes."""
        return self.log_radii.exp()

    @property
    def modulus(self) -> float:
        """Modulus log(1/r) of the annulus between the unit circle and the first hole."""
        return -float(self.log_radii[0])

    def circles(self, n: int) -> Complex[Tensor, "m n"]:
        """Points at n equal steps of every circle, with Ω on the left: clockwise around holes."""
        angle = torch.arange(n, dtype=self.radii.dtype, device=self.radii.device) * (2 * math.pi / n)
        turn = torch.polar(torch.ones_like(angle), angle)
        return torch.cat([turn[None], self.centres[:, None] + self.radii[:, None] * turn.conj()])

    def velocities(self, n: int) -> Complex[Tensor, "m n"]:
        """dz/dτ at the points of `circles`, τ from 0 to 2π."""
        turn = self.circles(n)[0]
        return 1j * torch.cat([turn[None], -self.radii[:, None] * turn.conj()])

    def coordinates(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "m *pts"]:
        """Coordinate ζ of every circle at the points z."""
        shape = (-1, *([1] * z.ndim))
        return torch.cat([z[None], self.radii.reshape(shape) / (z - self.centres.reshape(shape))])

    def coordinates_on_circles(self, n: int) -> Complex[Tensor, "m m n"]:
        """Coordinate ζ of every circle at the points of `circles`; on its own circle without rounding error."""
        circles = self.circles(n)
        zeta = self.coordinates(circles)
        own = torch.arange(self.rims)
        zeta[own, own] = circles[0]
        return zeta

    def squared_root(self, z: Complex[Tensor, "*pts"], antiperiodic: Sequence[bool]) -> Complex[Tensor, "*pts"]:
        """The product of z − c_j over the holes around which p and q change their sign."""
        odd = torch.tensor(antiperiodic, dtype=torch.bool, device=z.device)
        return torch.prod(z[..., None] - self.centres[odd], -1)

    @cached_property
    def gaps(self) -> Float[Tensor, "m m"]:
        """Largest |ζ_j| on circle i, entry (i, j): 1 where the circles touch, more where they cross; 0 for i = j."""
        c, r = self.centres, self.radii
        far = (c[:, None] - c).abs()
        gaps = torch.full((self.rims, self.rims), 0.0, dtype=r.dtype, device=r.device)
        gaps[1:, 1:] = r / (far - r[:, None]).clamp(min=torch.finfo(r.dtype).tiny)
        gaps[1:, 1:][far <= r[:, None]] = math.inf
        gaps[1:, 0] = c.abs() + r
        gaps[0, 1:] = r / (1 - c.abs()).clamp(min=torch.finfo(r.dtype).tiny)
        gaps.fill_diagonal_(0.0)
        return gaps

    @property
    def nearness(self) -> float:
        """The largest of `gaps`, less than 1 for a domain."""
        return float(self.gaps.max())

    @cached_property
    def room(self) -> tuple[Float[Tensor, " holes"], Float[Tensor, " holes"]]:
        """Width and modulus log(R/r), NaN if there is none, of the widest concentric ring in Ω around each hole."""
        c, r = self.centres, self.radii
        far = (c[:, None] - c).abs() - r
        far.fill_diagonal_(1.0)
        reach = torch.minimum(far.min(dim=1).values, 1 - c.abs())
        return reach - r, reach.log() - self.log_radii

    @property
    def clearances(self) -> Float[Tensor, " m"]:
        """Distance of every circle from the nearest other one."""
        width, _ = self.room
        return torch.cat([(1 - self.centres.abs() - self.radii).min()[None], width])

    def moved(self, step: Float[Tensor, " p"]) -> CircularDomain:
        """The domain after a step of its conformal moduli.

        The moduli are the logarithm of the modulus of the first hole's ring (see `room`), then for each other hole x
        and y of its centre, divided by the width of its ring, and the logarithm of the modulus of that ring.
        """
        others = step[1:].reshape(-1, 3)
        width, modulus = self.room
        move = torch.complex(others[:, 0], others[:, 1]) * width[1:]
        change = modulus * torch.expm1(torch.cat([step[:1], others[:, 2]]))
        return CircularDomain(
            centres=torch.cat([self.centres[:1], self.centres[1:] + move]), log_radii=self.log_radii - change
        )
