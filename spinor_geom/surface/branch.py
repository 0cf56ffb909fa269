"""Branch points: where φ vanishes, and whether a small change of the surface removes them.

Where p and q have a common zero φ has one of twice its order. The frame along a small circle around a zero of φ of
order m turns m + 1 times. Where m is odd it lifts to SU(2), as it does around no regular point, and the branch point
stays whatever is changed nearby. Spinors have only those with even m.

Source: Sun & Chern (2026), theorems on removable branch points and on the existence of p and q.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Complex
from torch import Tensor

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.holomorphic.zeros import RESOLUTION, Zero, find_zeros, zero_inside
from spinor_geom.surface.frames import loop_invariant

# a generic unit vector (a, b) of ℂ²: zeros of a·p + b·q and of −b̄·p + ā·q coincide only where p and q vanish
_A, _B = complex(0.552, 0.235), complex(-0.282, 0.749)
# share of the distance to the next branch point, or to ∂Ω, that the circle around one has as its radius
_RADIUS = 0.3
# samples of that circle for each turn of the frame
_SAMPLES_PER_TURN = 32


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchPoint:
    """A point of Ω where the surface is not an immersion.

    Attributes:
        z: where, in Ω.
        order: m, the order of the zero of φ, twice that of p and q together; a small circle around it is mapped to a
            curve that winds m + 1 times around the normal.
        invariant: the ℤ₂ invariant of such a circle, from frames of the surface: 1 where they lift to SU(2), else 0.
    """

    z: complex
    order: int
    invariant: Literal[0, 1]

    @property
    def removable(self) -> bool:
        """Whether a small change of the surface near it, not a minimal one, makes an immersion."""
        return self.invariant == 0


def branch_points(
    spinors: Callable[[Complex[Tensor, " n"]], Complex[Tensor, "n 2"]],
    phi: Callable[[Complex[Tensor, " n"]], Complex[Tensor, "n 3"]],
    domain: PlaneDomain,
) -> tuple[BranchPoint, ...]:
    """Common zeros of p and q, z ↦ (p, q), inside ∂Ω, with their orders and invariants.

    The zeros of one generic combination u = a·p + b·q are found by the argument principle; those that the orthogonal
    combination v = −b̄·p + ā·q has too are the common ones. Zeros of u and v nearer to each other than 1e-4 of the
    domain's diameter count as common.
    """

    def u(z: Complex[Tensor, " n"]) -> Complex[Tensor, " n"]:
        pq = spinors(z)
        return _A * pq[..., 0] + _B * pq[..., 1]

    def v(z: Complex[Tensor, " n"]) -> Complex[Tensor, " n"]:
        pq = spinors(z)
        return -_B.conjugate() * pq[..., 0] + _A.conjugate() * pq[..., 1]

    common = []
    for zero in find_zeros(u, domain):
        order = min(zero.order, zero_inside(v, zero.z, RESOLUTION * domain.diameter).order)
        if order > 0:
            common.append(Zero(z=zero.z, order=2 * order))
    return with_invariants(common, phi, domain)


def with_invariants(
    zeros: Sequence[Zero], phi: Callable[[Complex[Tensor, " n"]], Complex[Tensor, "n 3"]], domain: PlaneDomain
) -> tuple[BranchPoint, ...]:
    """All zeros of φ in Ω as branch points, each with the invariant of a circle around it."""
    z = np.array([zero.z for zero in zeros])
    apart = np.abs(z[:, None] - np.concatenate([z, domain.boundary.vertices]))
    np.fill_diagonal(apart, np.inf)
    found = []
    for zero, radius in zip(zeros, (_RADIUS * apart.min(axis=1, initial=np.inf)).tolist(), strict=True):
        count = _SAMPLES_PER_TURN * (zero.order + 1)
        turn = 2 * np.pi * torch.arange(count, dtype=torch.float64) / count
        out = torch.polar(torch.ones_like(turn), turn)
        with torch.no_grad():
            invariant = loop_invariant(phi(zero.z + radius * out), 1j * out)
        found.append(BranchPoint(z=zero.z, order=zero.order, invariant=invariant))
    return tuple(found)
