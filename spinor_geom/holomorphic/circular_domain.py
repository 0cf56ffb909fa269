"""Circular domains: the unit disk less round holes, which every domain with holes is conformal to."""

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
    """The unit disk less round holes, the first of which is about 0: what is left of the moduli is one rotation."""

    centres: Complex[Tensor, " holes"]  # complex, of the holes; 0 first
    log_radii: Float[Tensor, " holes"]  # of the holes

    @classmethod
    def annulus(cls, modulus: float, device: torch.device | str = "cpu") -> CircularDomain:
        """The ring between the unit circle and one of radius e^{−modulus}."""
        radii = torch.tensor([-modulus], dtype=torch.float64, device=device)
        return cls(centres=torch.zeros_like(radii, dtype=torch.complex128), log_radii=radii)

    @property
    def rims(self) -> int:
        """m, the number of circles."""
        return len(self.centres) + 1

    @cached_property
    def radii(self) -> Float[Tensor, " holes"]:
        """Of the holes."""
        return self.log_radii.exp()

    @property
    def modulus(self) -> float:
        """Of the annulus between the unit circle and the first hole: the logarithm of their radii's ratio."""
        return -float(self.log_radii[0])

    def circles(self, n: int) -> Complex[Tensor, "m n"]:
        """N equal steps of every circle, with Ω on the left: the outer one's angle rises, the holes' fall."""
        angle = torch.arange(n, dtype=self.radii.dtype, device=self.radii.device) * (2 * math.pi / n)
        turn = torch.polar(torch.ones_like(angle), angle)
        return torch.cat([turn[None], self.centres[:, None] + self.radii[:, None] * turn.conj()])

    def velocities(self, n: int) -> Complex[Tensor, "m n"]:
        """dz/dτ at the points of `circles`, τ from 0 to 2π."""
        turn = self.circles(n)[0]
        return 1j * torch.cat([turn[None], -self.radii[:, None] * turn.conj()])

    def coordinates(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "m *pts"]:
        """ζ of every circle."""
        shape = (-1, *([1] * z.ndim))
        return torch.cat([z[None], self.radii.reshape(shape) / (z - self.centres.reshape(shape))])

    def coordinates_on_circles(self, n: int) -> Complex[Tensor, "m m n"]:
        """ζ of every circle at n equal steps of every circle, its own exactly, however small it is."""
        circles = self.circles(n)
        zeta = self.coordinates(circles)
        own = torch.arange(self.rims)
        zeta[own, own] = circles[0]
        return zeta

    def squared_root(self, z: Complex[Tensor, "*pts"], antiperiodic: Sequence[bool]) -> Complex[Tensor, "*pts"]:
        """The product of z − c_j over the holes around which spinors change their sign."""
        odd = torch.tensor(antiperiodic, dtype=torch.bool, device=z.device)
        return torch.prod(z[..., None] - self.centres[odd], -1)

    @cached_property
    def gaps(self) -> Float[Tensor, "m m"]:
        """|ζ| of every circle j where it is largest on circle i, (i, j): 1 where they touch, more where they cross."""
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
        """The largest of `gaps`: below 1 for a domain."""
        return float(self.gaps.max())

    @cached_property
    def room(self) -> tuple[Float[Tensor, " holes"], Float[Tensor, " holes"]]:
        """Of each hole the width of the widest ring around it in Ω, and its modulus log(R/r), NaN where none is."""
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
        """The domain after a step of the moduli.

        They are the log modulus of the first hole's ring, then of each other hole its place x and y, by the width of
        its ring, and the log modulus of that; see `room`.
        """
        others = step[1:].reshape(-1, 3)
        width, modulus = self.room
        move = torch.complex(others[:, 0], others[:, 1]) * width[1:]
        change = modulus * torch.expm1(torch.cat([step[:1], others[:, 2]]))
        return CircularDomain(
            centres=torch.cat([self.centres[:1], self.centres[1:] + move]), log_radii=self.log_radii - change
        )
