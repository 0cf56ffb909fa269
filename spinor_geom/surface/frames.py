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

import numpy as np
from jaxtyping import Bool, Complex, Float

from spinor_geom.arrays import Array, complex_of, cross, namespace, norm, place_of, shifted, unit
from spinor_geom.errors import OptionError
from spinor_geom.holomorphic.blocks import require_complex

_ORTHOGONAL = 1e-8  # largest deviation of R·Rᵀ from the identity: matrices with 9 digits pass
_LEAST_OVERLAP = 0.5**0.5  # least |inner product| of spinors of neighbours whose frames differ by less than 90°


def phi_from_frames(
    tangent: Float[Array, "*batch n 3"],
    normal: Float[Array, "*batch n 3"],
    direction_in_omega: Complex[Array, "*batch n"],
    scale: Float[Array, "*batch n"],
) -> Complex[Array, "*batch n 3"]:
    """φ = λ (T − iν) τ̄ with ν = N × T at the samples of a curve, so that φ·φ = 0 and |φ|² = 2λ².

    The tangent and τ may have any length, and the normal any component along the tangent. None may be 0. The scale is
    λ, length in space per length in Ω.
    """
    require_complex(direction_in_omega=direction_in_omega)
    along = unit(tangent)
    across = normal - (normal * along).sum(-1)[..., None] * along
    conormal = cross(unit(across), along)
    factor = scale * direction_in_omega.conj() / abs(direction_in_omega)
    return factor[..., None] * complex_of(along, -conormal)


def spinors_from_phi(
    phi: Complex[Array, "*batch n 3"],
) -> tuple[Complex[Array, "*batch n"], Complex[Array, "*batch n"]]:
    """Spinors p, q at the samples of a curve, with signs that make them continuous along the sequence.

    One is the root of the larger of p² = (φ₁ + iφ₂)/2 and q² = −(φ₁ − iφ₂)/2, the other follows from φ₃ = 2pq without a
    division by a small number. The first sample has the principal root. φ must be null and not 0. Between samples whose
    frames differ by a rotation of 180° the sign is ambiguous.
    """
    require_complex(phi=phi)
    p_squared = (phi[..., 0] + 1j * phi[..., 1]) / 2
    q_squared = -(phi[..., 0] - 1j * phi[..., 1]) / 2
    use_p, xp = abs(p_squared) >= abs(q_squared), namespace(phi)
    root = xp.sqrt(xp.where(use_p, p_squared, q_squared))
    other = phi[..., 2] / (2 * root)
    p, q = xp.where(use_p, root, other), xp.where(use_p, other, root)
    sign = xp.concat([xp.ones_like(p.real[..., :1]), _signs(p, q)[..., 1:].cumprod(-1)], axis=-1)
    return p * sign, q * sign


def signs_close_up(p: Complex[Array, "*batch n"], q: Complex[Array, "*batch n"]) -> Bool[Array, "*batch"]:
    """Whether spinors along closed sequences return to themselves, not to their negatives, by continuity."""
    return _signs(p, q).prod(-1) > 0


def loop_invariant(phi: Complex[Array, "n 3"], direction_in_omega: Complex[Array, " n"]) -> Literal[0, 1]:
    """The ℤ₂ invariant of a closed curve in Ω: 1 if the surface's frame along it lifts to SU(2), else 0.

    The frame is the curve's unit tangent, the surface's normal, and their cross product. Around a circle in an immersed
    disk it turns once, and does not lift. Around a zero of φ of order m it turns m + 1 times. Raises an OptionError if
    the frames of neighbours differ by 90° or more.

    Source: Sun & Chern (2026), on branch points; Pinkall, "Regular homotopy classes of immersed surfaces" (1985).
    """
    tangent = (phi * direction_in_omega[:, None]).real
    xp = namespace(phi)
    normal = cross(phi.real, -phi.imag)
    one = xp.ones_like(direction_in_omega)  # with τ = λ = 1 φ is the frame itself
    p, q = spinors_from_phi(phi_from_frames(tangent, normal, one, one.real))
    # the inner product of unit quaternions is the cosine of half the angle between the frames
    overlap = abs((p * xp.roll(p, 1).conj() + q * xp.roll(q, 1).conj()).real)
    if not float(overlap.min()) > _LEAST_OVERLAP:
        k = int(overlap.argmin())
        raise OptionError(
            f"the frames of the samples {(k - 1) % len(p)} and {k} differ by 90° or more; take more samples"
        )
    return 1 if bool(signs_close_up(p, q)) else 0


def _signs(p: Complex[Array, "*batch n"], q: Complex[Array, "*batch n"]) -> Float[Array, "*batch n"]:
    """−1 where the spinors at k and k − 1 have opposite signs, else +1. Entry 0 compares the first and the last."""
    xp = namespace(p)
    overlap = p * shifted(p, 1).conj() + q * shifted(q, 1).conj()
    return xp.where(overlap.real < 0, -1.0, xp.ones_like(overlap.real))


def su2_from_rotation(rotation: Float[Array, "3 3"]) -> Complex[Array, "2 2"]:
    """One of the two U in SU(2) for which φ(U(p, q)) = R φ(p, q), R the rotation, else an OptionError."""
    xp = namespace(rotation)
    error = float(abs(rotation @ rotation.mT - place_of(rotation).put(np.eye(3))).max())
    if not error <= _ORTHOGONAL:
        raise OptionError(f"a rotation matrix must be orthogonal, R·Rᵀ differs from the identity by {error:.3g}")
    if not float(xp.linalg.det(rotation)) > 0:
        raise OptionError(
            "the matrix has determinant −1: it is a reflection, not a rotation; reverse one axis of the domain instead"
        )
    column = xp.concat(spinors_from_phi(complex_of(rotation[:, 0], -rotation[:, 1])[None]))
    column = column / norm(column)
    return xp.stack([column, xp.stack([-column[1].conj(), column[0].conj()])], axis=-1)
