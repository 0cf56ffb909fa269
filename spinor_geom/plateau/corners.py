"""Corners of Γ: which nodes may go where, and the conformal moduli that decide whether Ω's corners can meet them.

A conformal map takes three boundary points where one wants; with n corners, n − 3 numbers, the moduli of Ω with its
corners, must be right before a surface over Ω can have all its corners on Γ's. A domain flattened from a mesh has them
to a few digits. They are corrected with the fit: Ω is moved along fields v = conj(g), g holomorphic with g' = 0 at the
corners. Such a field is conformal at the corners, so their angles stay, and no holomorphic change of coordinates undoes
it, as its Beltrami coefficient conj(g') is paired with the quadratic differentials of Ω.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from numpy.polynomial import Polynomial

from spinor_geom.domain.plane_domain import PlaneDomain

# A node stays this far in s from the corners of its side: Γ' there is that of its own side.
_INSIDE = 1e-13
# One move of Ω is at most this share of its diameter.
_LARGEST_MOVE = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class CornerPairs:
    """Corners of Ω and of Γ that belong together: parameters t of ∂Ω and s of Γ, both ascending in one turn."""

    t: Float[np.ndarray, " c"]
    s: Float[np.ndarray, " c"]

    def slide_bounds(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
        """Lowest and highest s for nodes at parameters t: each node stays on its own side."""
        if not len(self.t):
            return np.broadcast_to([-np.inf, np.inf], (len(t), 2))
        ends = np.concatenate([self.s[-1:] - 1, self.s, self.s[:1] + 1])
        side = np.searchsorted(self.t, t, side="right")
        return np.stack([ends[side] + _INSIDE, ends[side + 1] - _INSIDE], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModulusFields:
    """Vector fields conj(g) on Ω that change its moduli and keep its corners' angles.

    Attributes:
        centre: origin of the polynomials' variable.
        scale: its unit.
        potentials: the polynomials g; each gives two fields, conj(g) and i·conj(g), at most 1 in size on Ω's corners.
    """

    centre: complex
    scale: float
    potentials: tuple[Polynomial, ...]

    @classmethod
    def of(cls, domain: PlaneDomain) -> ModulusFields:
        """Enough fields for the moduli of a domain; none where it has fewer than four corners."""
        corner = domain.boundary.vertices[domain.boundary.corners]
        centre, scale = complex(domain.boundary.vertices.mean()), domain.diameter
        potentials = []
        if len(corner) > 3:
            still = Polynomial.fromroots((corner - centre) / scale)
            for power in range((len(corner) - 2) // 2):
                g = (still * Polynomial.basis(power)).integ()
                potentials.append(g / np.abs(g((domain.boundary.vertices - centre) / scale)).max())
        return cls(centre=centre, scale=scale, potentials=tuple(potentials))

    def __call__(self, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n k"]:
        """The fields at points, one a column, in units of Ω."""
        values = [np.conj(g((z - self.centre) / self.scale)) * self.scale for g in self.potentials]
        return np.stack([w for v in values for w in (v, 1j * v)], axis=1) if values else np.zeros((len(z), 0), complex)

    def moved(self, domain: PlaneDomain, amounts: Float[np.ndarray, " k"]) -> PlaneDomain:
        """Ω with its boundary's vertices moved.

        Raises:
            DomainError: the moved polygon is not simple.
        """
        vertices = domain.boundary.vertices
        move = self(vertices) @ amounts
        move *= min(1.0, _LARGEST_MOVE * domain.diameter / np.abs(move).max(initial=1e-300))
        return PlaneDomain.from_boundary(vertices + move, domain.boundary.corners, domain.log_scale)
