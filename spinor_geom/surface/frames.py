"""The lift of frames along a curve from SO(3) to SU(2), that is, to spinors p and q.

Along a curve in Ω with unit direction τ, a surface with unit tangent T = dr/|dr|, unit normal N, conormal ν = N × T and
conformal factor λ has

    φ = λ (T − iν) τ̄,    since Re(φ τ) = λT and Re(φ iτ) = λν.

p and q are square roots of combinations of φ, so (p, q) is known up to a sign at each sample, and by continuity up to
one sign for the whole curve. Around a closed curve the sign either returns or changes: a ℤ₂ invariant. It returns for
every curve that bounds an immersed disk over Ω.

Source: Sun & Chern (2026); the SU(2) lift is classical (see Kusner & Schmitt, "The spinor representation of surfaces
in space", 1996).
"""

from typing import Literal

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from spinor_geom.errors import OptionError
from spinor_geom.holomorphic.blocks import require_complex

_ORTHOGONAL = 1e-8  # largest deviation of R·Rᵀ from the identity: matrices with 9 digits pass
_LEAST_OVERLAP = 0.5**0.5  # least |inner product| of spinors of neighbours whose frames differ by less than 90°


def phi_from_frames(
    tangent: Float[Tensor, "*batch n 3"],
    normal: Float[Tensor, "*batch n 3"],
    direction_in_omega: Complex[Tensor, "*batch n"],
    scale: Float[Tensor, "*batch n"],
) -> Complex[Tensor, "*batch n 3"]:
    """φ = λ (T − iν) τ̄ with ν = N × T at the samples of a curve; φ·φ = 0 and |φ|² = 2λ².

    The tangent and τ may have any length, and the normal any component along the tangent; none may be 0. The scale is
    λ, length in space per length in Ω.
    """
    require_complex(direction_in_omega=direction_in_omega)
    unit = torch.nn.functional.normalize(tangent, dim=-1)
    across = normal - (normal * unit).sum(-1, keepdim=True) * unit
    conormal = torch.linalg.cross(torch.nn.functional.normalize(across, dim=-1), unit)
    factor = scale * direction_in_omega.conj() / direction_in_omega.abs()
    return factor[..., None] * torch.complex(unit, -conormal)


def spinors_from_phi(
    phi: Complex[Tensor, "*batch n 3"],
) -> tuple[Complex[Tensor, "*batch n"], Complex[Tensor, "*batch n"]]:
    """Spinors p, q at the samples of a curve, with signs that make them continuous along the sequence.

    One is the root of the larger of p² = (φ₁ + iφ₂)/2 and q² = −(φ₁ − iφ₂)/2, the other follows from φ₃ = 2pq: no
    division by a small number. The first sample has the principal root. φ has to be null and not 0; between samples
    whose frames differ by a rotation of 180° the sign is ambiguous.
    """
    require_complex(phi=phi)
    p_squared = (phi[..., 0] + 1j * phi[..., 1]) / 2
    q_squared = -(phi[..., 0] - 1j * phi[..., 1]) / 2
    use_p = p_squared.abs() >= q_squared.abs()
    root = torch.where(use_p, p_squared, q_squared).sqrt()
    other = phi[..., 2] / (2 * root)
    p, q = torch.where(use_p, root, other), torch.where(use_p, other, root)
    sign = torch.cat([torch.ones_like(p.real[..., :1]), _signs(p, q)[..., 1:].cumprod(dim=-1)], dim=-1)
    return p * sign, q * sign


def signs_close_up(p: Complex[Tensor, "*batch n"], q: Complex[Tensor, "*batch n"]) -> Bool[Tensor, "*batch"]:
    """Whether spinors along closed sequences return to themselves, not to their negatives, by continuity."""
    return torch.gt(_signs(p, q).prod(-1), 0)


def loop_invariant(phi: Complex[Tensor, "n 3"], direction_in_omega: Complex[Tensor, " n"]) -> Literal[0, 1]:
    """The ℤ₂ invariant of a closed curve in Ω: 1 where the surface's frame along it lifts to SU(2), else 0.

    The frame is the curve's unit tangent, the surface's normal, and their cross product. Around a circle in an immersed
    disk it turns once, and does not lift; around a zero of φ of order m it turns m + 1 times. It raises an OptionError
    if the frames of neighbours differ by 90° or more.

    Source: Sun & Chern (2026), on branch points; Pinkall, "Regular homotopy classes of immersed surfaces" (1985).
    """
    tangent = (phi * direction_in_omega[:, None]).real
    normal = torch.linalg.cross(phi.real, -phi.imag)
    one = torch.ones_like(direction_in_omega)  # with τ = λ = 1 φ is the frame itself
    p, q = spinors_from_phi(phi_from_frames(tangent, normal, one, one.real))
    # the inner product of unit quaternions is the cosine of half the angle between the frames
    overlap = (p * p.roll(1).conj() + q * q.roll(1).conj()).real.abs()
    if not float(overlap.min()) > _LEAST_OVERLAP:
        k = int(overlap.argmin())
        raise OptionError(
            f"the frames of the samples {(k - 1) % len(p)} and {k} differ by 90° or more; take more samples"
        )
    return 1 if bool(signs_close_up(p, q)) else 0


def _signs(p: Complex[Tensor, "*batch n"], q: Complex[Tensor, "*batch n"]) -> Float[Tensor, "*batch n"]:
    """−1 where the spinors at k and k − 1 have opposite signs, else +1; entry 0 compares the first and the last."""
    overlap = p * p.roll(1, dims=-1).conj() + q * q.roll(1, dims=-1).conj()
    return torch.where(overlap.real < 0, -1.0, 1.0).to(p.real.dtype)


def su2_from_rotation(rotation: Float[Tensor, "3 3"]) -> Complex[Tensor, "2 2"]:
    """One of the two U in SU(2) for which φ(U(p, q)) = R φ(p, q), R the rotation; else an OptionError."""
    error = float((rotation @ rotation.mT - torch.eye(3, dtype=rotation.dtype).to(rotation.device)).abs().max())
    if not error <= _ORTHOGONAL:
        raise OptionError(f"a rotation matrix must be orthogonal, R·Rᵀ differs from the identity by {error:.3g}")
    if not float(torch.linalg.det(rotation)) > 0:
        raise OptionError(
            "the matrix has determinant −1: it is a reflection, not a rotation; reverse one axis of the domain instead"
        )
    column = torch.cat(spinors_from_phi(torch.complex(rotation[:, 0], -rotation[:, 1])[None]))
    column = column / torch.linalg.vector_norm(column)
    return torch.stack([column, torch.stack([-column[1].conj(), column[0].conj()])], dim=-1)
