"""The lift of frames to spinors: SO(3) → SU(2) by square roots with a sign that is continuous along a boundary.

Along a curve in Ω with unit direction τ, a surface with unit tangent T = dr/|dr|, unit normal N, conormal ν = N × T and
stretch λ (length in space per length in Ω) has

    φ = λ (T − iν) τ̄,    since Re(φ τ) = λT and Re(φ iτ) = λν.

p and q are square roots of combinations of φ, so (p, q) is known up to one sign at each sample; continuity along the
sequence fixes all of them but one. Around a closed curve the sign either closes up or not: a ℤ₂ invariant. It closes
up for every curve that bounds an immersed disk over Ω.

Source: Sun & Chern (2026); the SU(2) lift is classical (see Kusner & Schmitt, "The spinor representation of surfaces
in space", 1996).
"""

from typing import Literal

import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from spinor_geom.errors import OptionError
from spinor_geom.holomorphic.blocks import require_complex

_ORTHOGONAL = 1e-8  # how far R·Rᵀ may be from the identity: matrices typed with 9 digits pass
_LEAST_OVERLAP = 0.5**0.5  # of the spinors of neighbours on a closed curve: their frames differ by less than 90°


def phi_from_frames(
    tangent: Float[Tensor, "*batch n 3"],
    normal: Float[Tensor, "*batch n 3"],
    direction_in_omega: Complex[Tensor, "*batch n"],
    scale: Float[Tensor, "*batch n"],
) -> Complex[Tensor, "*batch n 3"]:
    """φ = scale·(T − iν)·conj(τ) with ν = N × T, at each sample of a curve: φ·φ = 0 and |φ|² = 2·scale².

    Of the tangent dr and of dz only the directions are used, of the normal the part orthogonal to the tangent; none may
    be 0. The scale is λ, length in space per length in Ω.
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
    """Spinors p, q at the samples of a curve, with the sign that makes them continuous along the sequence.

    p² = (φ₁ + iφ₂)/2 and q² = −(φ₁ − iφ₂)/2; the root of the larger is taken and the other follows from φ₃ = 2pq, so
    that no sample divides by a small number. The sign at the first sample is that of the principal root. φ is null and
    not 0; where the frames of neighbours differ by a turn of 180° the sign between them is a guess.
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
    """Whether the spinors of closed sequences come back to themselves, not to their negatives, whatever their signs."""
    return torch.gt(_signs(p, q).prod(-1), 0)


def loop_invariant(phi: Complex[Tensor, "n 3"], direction_in_omega: Complex[Tensor, " n"]) -> Literal[0, 1]:
    """The ℤ₂ invariant of a closed curve in Ω: 1 where the surface's frame along it lifts to SU(2), else 0.

    The frame is the curve's unit tangent, the surface's normal, and their cross product. Around a circle in an immersed
    disk it turns once in all, and does not lift; around a zero of φ of order m it turns m + 1 times. Neighbours
    whose frames differ by 90° or more, so that a turn between them might go unseen, are an OptionError.

    Source: Sun & Chern (2026), on branch points; Pinkall, "Regular homotopy classes of immersed surfaces" (1985).
    """
    tangent = (phi * direction_in_omega[:, None]).real
    normal = torch.linalg.cross(phi.real, -phi.imag)
    one = torch.ones_like(direction_in_omega)  # without a direction in Ω and a stretch φ is the frame itself
    p, q = spinors_from_phi(phi_from_frames(tangent, normal, one, one.real))
    # as unit quaternions: the cosine of half the angle between the frames
    overlap = (p * p.roll(1).conj() + q * q.roll(1).conj()).real.abs()
    if not float(overlap.min()) > _LEAST_OVERLAP:
        k = int(overlap.argmin())
        raise OptionError(
            f"the frames of the samples {(k - 1) % len(p)} and {k} differ by 90° or more; take more samples"
        )
    return 1 if bool(signs_close_up(p, q)) else 0


def _signs(p: Complex[Tensor, "*batch n"], q: Complex[Tensor, "*batch n"]) -> Float[Tensor, "*batch n"]:
    """Entry k: −1 where (p, q) at k points away from (p, q) at k − 1 (at 0: from the last), else +1."""
    overlap = p * p.roll(1, dims=-1).conj() + q * q.roll(1, dims=-1).conj()
    return torch.where(overlap.real < 0, -1.0, 1.0).to(p.real.dtype)


def su2_from_rotation(rotation: Float[Tensor, "3 3"]) -> Complex[Tensor, "2 2"]:
    """One of the two U in SU(2) for which φ(U(p, q)) is φ(p, q) turned by the rotation."""
    error = float((rotation @ rotation.mT - torch.eye(3, dtype=rotation.dtype).to(rotation.device)).abs().max())
    if not error <= _ORTHOGONAL:
        raise OptionError(f"a rotation matrix must be orthogonal, R·Rᵀ differs from the identity by {error:.3g}")
    if not float(torch.linalg.det(rotation)) > 0:
        raise OptionError(
            "the matrix has determinant −1: it reflects; a reflected minimal surface is minimal, but not by a rotation "
            "of its spinors, so reverse one axis of the domain instead"
        )
    column = torch.cat(spinors_from_phi(torch.complex(rotation[:, 0], -rotation[:, 1])[None]))
    column = column / torch.linalg.vector_norm(column)
    return torch.stack([column, torch.stack([-column[1].conj(), column[0].conj()])], dim=-1)
