"""Polynomials orthogonal on a set of nodes, by the Arnoldi recurrence, and their interpolation at Leja points.

Source: Brubeck, Nakatsukasa & Trefethen, "Vandermonde with Arnoldi", SIAM Review 63 (2021); Reichel, "Newton
interpolation at Leja points", BIT 30 (1990), for the points.
"""

import math

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import Array, add_to_diagonal, namespace, place_of, to_numpy

# Share of a vector's length that a pass of orthogonalisation must leave, for orthogonality to round-off. With 0.3 the
# polynomials are orthogonal to 1e-14 or not at all.
_KEPT = 0.5
_MOST_CANDIDATES = 600  # points from which Leja points are chosen


def arnoldi_hessenberg(z: Complex[Array, " n"], weight: Float[Array, " n"], degree: int) -> Complex[Array, "d1 d"]:
    """The coefficients of `arnoldi_basis`."""
    return arnoldi_basis(z, weight, degree)[0]


def arnoldi_basis(
    z: Complex[Array, " n"], weight: Float[Array, " n"], degree: int
) -> tuple[Complex[Array, "d1 d"], Complex[Array, "n d1"]]:
    """Coefficients H of the recurrence z·Q_k = Σ_{j ≤ k+1} H_jk Q_j of the orthonormal polynomials Q, and Q(z).

    The inner product is ⟨f, g⟩ = Σ weight·conj(f)·g with weights of sum 1, on more nodes than the degree. The
    subdiagonal of H is positive.
    """
    # complex products in numpy take a tenth of their time in torch. Rows of the basis include the factor √weight
    nodes, root = to_numpy(z), np.sqrt(to_numpy(weight))
    basis = np.empty((degree + 1, len(nodes)), dtype=np.complex128)
    basis[0] = root
    hessenberg = np.zeros((degree + 1, degree), dtype=np.complex128)
    for k in range(degree):
        v, before = nodes * basis[k], np.inf
        norm = math.sqrt(np.vdot(v, v).real)
        while norm <= _KEPT * before:  # repeated if a pass leaves little of the vector
            h = (basis[: k + 1] @ v.conj()).conj()
            v -= h @ basis[: k + 1]
            hessenberg[: k + 1, k] += h
            before, norm = norm, math.sqrt(np.vdot(v, v).real)
        hessenberg[k + 1, k] = norm
        basis[k + 1] = v / norm
    place = place_of(z)
    return place.put(hessenberg), place.put((basis / root).T)


def arnoldi_polynomials(z: Complex[Array, "*pts"], hessenberg: Complex[Array, "d1 d"]) -> Complex[Array, "*pts d1"]:
    """Values of the polynomials Q_0 = 1, …, Q_d at the points z."""
    points, recurrence = to_numpy(z).ravel(), to_numpy(hessenberg)
    rows = np.ones((len(recurrence), len(points)), dtype=np.complex128)
    for k, h in enumerate(recurrence.T):
        rows[k + 1] = (points * rows[k] - h[: k + 1] @ rows[: k + 1]) / h[k + 1]
    return place_of(z).put(rows.T.reshape(*z.shape, len(rows)))


def leja_points(z: Complex[Array, "*b n"], count: int) -> Complex[Array, "*b count"]:
    """Leja points of sets: each maximises the product of its distances from the previous ones."""
    candidates = to_numpy(z)[..., :: max(1, z.shape[-1] // _MOST_CANDIDATES)]
    sets = candidates.reshape(-1, candidates.shape[-1])
    own, product, far = np.arange(len(sets)), np.ones(sets.shape), np.abs(sets - sets.mean(axis=1, keepdims=True))
    chosen = [sets[own, far.argmax(axis=1)]]
    for _ in range(count - 1):
        product *= np.abs(sets - chosen[-1][:, None])
        largest = product.argmax(axis=1)
        product /= product[own, largest][:, None]  # it would overflow or underflow
        chosen.append(sets[own, largest])
    return place_of(z).put(np.stack(chosen, axis=-1).reshape(*z.shape[:-1], count))


def barycentric_weights(points: Complex[Array, "*b k"]) -> Complex[Array, "*b k"]:
    """w_j ∝ Π_{k≠j} 1/(ζ_j − ζ_k), for which Σ w_j f_j/(ζ_j − z)/Σ w_j/(ζ_j − z) is the interpolating polynomial."""
    xp, difference = namespace(points), points[..., :, None] - points[..., None, :]
    add_to_diagonal(difference, 1)
    logarithms = xp.log(difference).sum(-1)
    return xp.exp(logarithms.real.mean(-1)[..., None] - logarithms)
