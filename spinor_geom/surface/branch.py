"""Branch points: where p and q vanish together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from jaxtyping import Complex
from torch import Tensor

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.holomorphic.zeros import RESOLUTION, count_zeros, find_zeros

# a generic unit vector (a, b) of ℂ²: zeros of a·p + b·q and of −b̄·p + ā·q coincide only where p and q vanish
_A, _B = complex(0.552, 0.235), complex(-0.282, 0.749)


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchPoint:
    """A point of Ω where the surface is not an immersion.

    Attributes:
        z: where, in Ω.
        order: m, the common order of the zero of p and q; φ has a zero of order 2m there, and a small circle around
            it is mapped to a curve that winds 2m + 1 times around the normal.
    """

    z: complex
    order: int


def branch_points(
    spinors: Callable[[Complex[Tensor, " n"]], Complex[Tensor, "n 2"]], domain: PlaneDomain
) -> tuple[BranchPoint, ...]:
    """Common zeros of p and q inside ∂Ω, with their orders.

    The zeros of one generic combination u = a·p + b·q are found by the argument principle; those that the orthogonal
    combination v = −b̄·p + ā·q has too are the common ones. Zeros of u and v nearer to each other than 1e-4 of the
    domain's diameter count as common.

    Args:
        spinors: z ↦ (p, q), holomorphic on Ω.
        domain: Ω.

    Raises:
        ZeroOnContourError: u has a zero on ∂Ω or too near to it, for example a branch point there.
    """

    def u(z: Complex[Tensor, " n"]) -> Complex[Tensor, " n"]:
        pq = spinors(z)
        return _A * pq[..., 0] + _B * pq[..., 1]

    def v(z: Complex[Tensor, " n"]) -> Complex[Tensor, " n"]:
        pq = spinors(z)
        return -_B.conjugate() * pq[..., 0] + _A.conjugate() * pq[..., 1]

    found = []
    for zero in find_zeros(u, domain):
        order = min(zero.order, count_zeros(v, zero.z, RESOLUTION * domain.diameter))
        if order > 0:
            found.append(BranchPoint(z=zero.z, order=order))
    return tuple(found)
