"""Branch points, the zeros of φ, and whether a small change of the surface removes them.

At a common zero of p and q, φ has a zero of twice the order. The frame along a small circle around a zero of φ of order
m turns m + 1 times. For odd m it lifts to SU(2). Around a regular point it does not, so no local change can remove the
branch point. For spinors, the zeros of φ have even order m.

Source: Sun & Chern (2026), theorems on removable branch points and on the existence of p and q.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Complex

from spinor_geom.arrays import cis
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.holomorphic.zeros import RESOLUTION, Zero, find_zeros, zero_inside
from spinor_geom.surface.frames import loop_invariant

Functions = Callable[[Complex[np.ndarray, " n"]], Complex[np.ndarray, "n _"]]

# a generic unit vector (a, b) of ℂ²: a·p + b·q and −b̄·p + ā·q have common zeros only where p and q vanish
_A, _B = complex(0.552, 0.235), complex(-0.282, 0.749)
_RADIUS = 0.3  # radius of the circle around a branch point, as a share of the distance to the next one or to ∂Ω
_SAMPLES_PER_TURN = 32  # samples along that circle for each turn of the frame


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchPoint:
    """A point of Ω where the surface is not an immersion."""

    z: complex  # in Ω
    order: int  # m, of the zero of φ. The image of a small circle around it winds m + 1 times around the normal
    invariant: Literal[0, 1]  # in ℤ₂: 1 if the frames along such a circle lift to SU(2)

    @property
    def removable(self) -> bool:
        """Whether a small change of the surface near it gives an immersion, which need not be minimal."""
        return self.invariant == 0


def branch_points(spinors: Functions, phi: Functions, domain: PlaneDomain) -> tuple[BranchPoint, ...]:
    """Common zeros of p and q in Ω, from the functions z ↦ (p, q) and z ↦ φ.

    They are computed as common zeros of two generic combinations, u = a·p + b·q and v = −b̄·p + ā·q. Zeros up to 1e-4 of
    the domain's diameter apart count as common.
    """
    u, v = np.array([[_A, _B], [-_B.conjugate(), _A.conjugate()]])
    common = []
    for zero in find_zeros(lambda z: spinors(z) @ u, domain):
        other = zero_inside(lambda z: spinors(z) @ v, zero.z, RESOLUTION * domain.diameter)
        order = min(zero.order, other.order)
        if order > 0:
            common.append(Zero(z=zero.z, order=2 * order))
    return with_invariants(common, phi, domain)


def with_invariants(zeros: Sequence[Zero], phi: Functions, domain: PlaneDomain) -> tuple[BranchPoint, ...]:
    """Branch points at the given zeros, which are all zeros of φ in Ω."""
    z = np.array([zero.z for zero in zeros])
    apart = np.abs(z[:, None] - np.concatenate([z, domain.vertices]))
    np.fill_diagonal(apart, np.inf)
    found = []
    for zero, radius in zip(zeros, (_RADIUS * apart.min(axis=1, initial=np.inf)).tolist(), strict=True):
        count = _SAMPLES_PER_TURN * (zero.order + 1)
        out = cis(2 * np.pi * np.arange(count) / count)
        invariant = loop_invariant(phi(zero.z + radius * out), 1j * out)
        found.append(BranchPoint(z=zero.z, order=zero.order, invariant=invariant))
    return tuple(found)
