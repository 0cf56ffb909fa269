"""Polynomials orthogonal on a set of nodes, by the Arnoldi recurrence, and their interpolation at Leja points.

Source: Brubeck, Nakatsukasa & Trefethen, "Vandermonde with Arnoldi", SIAM Review 63 (2021); Reichel, "Newton
interpolation at Leja points", BIT 30 (1990), for the points.
"""

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

_MOST_CANDIDATES = 600  # points from which Leja points are chosen


def arnoldi_hessenberg(z: Complex[Tensor, " n"], weight: Float[Tensor, " n"], degree: int) -> Complex[Tensor, "d1 d"]:
    """Coefficients H of the recurrence z·Q_k = Σ_{j ≤ k+1} H_jk Q_j of the orthonormal polynomials.

    The inner product is ⟨f, g⟩ = Σ weight·conj(f)·g with weights of sum 1, on more nodes than the degree. The
    subdiagonal of H is positive.
    """
    # complex products in numpy take a tenth of their time in torch; rows of the basis include the factor √weight
    nodes, root = z.cpu().numpy(), weight.sqrt().cpu().numpy()
    basis = np.empty((degree + 1, len(nodes)), dtype=np.complex128)
    basis[0] = root
    hessenberg = np.zeros((degree + 1, degree), dtype=np.complex128)
    for k in range(degree):
        v = nodes * basis[k]
        for _ in range(2):  # the second pass gives orthogonality to round-off
            h = (basis[: k + 1] @ v.conj()).conj()
            v -= h @ basis[: k + 1]
            hessenberg[: k + 1, k] += h
        hessenberg[k + 1, k] = norm = np.linalg.norm(v)
        basis[k + 1] = v / norm
    return torch.tensor(hessenberg, device=z.device)


def arnoldi_polynomials(z: Complex[Tensor, "*pts"], hessenberg: Complex[Tensor, "d1 d"]) -> Complex[Tensor, "*pts d1"]:
    """Values of the polynomials Q_0 = 1, …, Q_d at the points z."""
    points, recurrence = z.detach().cpu().numpy().ravel(), hessenberg.cpu().numpy()
    rows = np.ones((len(recurrence), len(points)), dtype=np.complex128)
    for k, h in enumerate(recurrence.T):
        rows[k + 1] = (points * rows[k] - h[: k + 1] @ rows[: k + 1]) / h[k + 1]
    return torch.tensor(rows.T, device=z.device).reshape(*z.shape, len(rows))


def leja_points(z: Complex[Tensor, " n"], count: int) -> Complex[Tensor, " count"]:
    """Leja points of a set: each maximises the product of its distances from the previous ones."""
    candidates = z[:: max(1, len(z) // _MOST_CANDIDATES)]
    chosen = [candidates[(candidates - candidates.mean()).abs().argmax()]]
    product = torch.zeros(len(candidates), dtype=candidates.real.dtype, device=z.device)
    for _ in range(count - 1):
        product = product + (candidates - chosen[-1]).abs().log()
        chosen.append(candidates[product.argmax()])
    return torch.stack(chosen)


def barycentric_weights(points: Complex[Tensor, " k"]) -> Complex[Tensor, " k"]:
    """w_j ∝ Π_{k≠j} 1/(ζ_j − ζ_k), for which Σ w_j f_j/(ζ_j − z)/Σ w_j/(ζ_j − z) is the interpolating polynomial."""
    logarithms = (points[:, None] - points + torch.eye(len(points), device=points.device)).log().sum(dim=1)
    return (logarithms.real.mean() - logarithms).exp()
