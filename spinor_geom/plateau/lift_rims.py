"""From a harmonic surface over rims to p and q: the lift of its null curve along all rims to Laurent series."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.domain.plane_domain import FourierBoundary, PlaneDomain
from spinor_geom.errors import SurfaceError
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.laurent import LaurentSeries, parts_on_circle, sums_on_circles
from spinor_geom.holomorphic.series import power_table
from spinor_geom.plateau.circles import DirichletForm, derivative, without_highest
from spinor_geom.plateau.douglas import resampled
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.residual import projected
from spinor_geom.plateau.rims_energy import HarmonicSurface
from spinor_geom.surface.formulas import null_vector
from spinor_geom.surface.frames import spin_invariant, spinors_from_phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# coefficients below this share of the largest are rounding errors
_ROUND_OFF = 1e-17
# rounds in which the constant of r and the nearest points of the curves are found from each other, and the share of the
# distance below which a move of the constant changes nothing
_CONSTANT_STEPS, _STILL = 3, 1e-3
# Newton steps to real residues, the imaginary part, as a share of |residue| and |φ|, that is rounding error, and the
# powers of each circle that close it
_CLOSING_STEPS, _CLOSED, _CLOSING_POWERS = 6, 1e-16, 4
# points for each node: between the nodes the distance is told too
_EACH = 4
# lifts in all, and the share of the last one's distance that a new one must come below
_MOST_LIFTS, _WORTHWHILE = 8, 0.9
# vertices of Ω on each circle, and most where the gaps are not so narrow that it takes more
_FEWEST_VERTICES, _MOST_VERTICES = 48, 256


@dataclass(frozen=True, kw_only=True, eq=False)
class RimLift:
    """Where one rim of a lifted surface lies, at 4n equal steps.

    Attributes:
        r: (4n, 3), positions.
        slide: (4n,), the parameter of the point of the curve near each.
        misfit: its distance from the curve.
    """

    r: Float[Tensor, "m 3"]
    slide: Float[Tensor, " m"]
    misfit: Misfit


@dataclass(frozen=True, kw_only=True, eq=False)
class Lift:
    """A minimal surface over a circular domain.

    Attributes:
        model: p and q; their periods are closed.
        shift: (3,), the constant beside Re ∫ φ dz in closed form.
        rims: of the outer circle and of the holes.
        area: ½∮ r·Im(φ dz) over all.
        period: the largest |Re ∮ φ dz| around a hole.
    """

    model: LaurentSeries
    shift: Float[Tensor, "3"]
    rims: tuple[RimLift, ...]
    area: float
    period: float

    @property
    def misfit(self) -> Misfit:
        """Distance of all rims from their curves."""
        return Misfit.together([rim.misfit for rim in self.rims])


def lifted(surface: HarmonicSurface, together: CurveTensors, *, allowed: float) -> Lift:
    """The minimal surface next to a harmonic one, and its distance from the curves at the nodes and between them.

    φ = 2∂X/∂z is known on all circles from X and ΛX. p and q are its spinors there, divided by √(z − c_j) for each hole
    around which they change their sign; on each circle the powers of its own coordinate are the positive frequencies.
    Where X is not quite conformal φ is not quite null, and the surface of p and q is off X: what it is off the curves
    is taken from X before the next lift, while that leaves it too far from them.

    Args:
        surface: X.
        curves: of the rims.
        allowed: RMS distance that is near enough.

    Raises:
        SurfaceError: the signs of p and q around the rims do not fit each other: this harmonic surface has a branch
            point of odd order.
    """
    points, slides = surface.points, surface.slides
    curves = tuple(together.alone(k) for k in range(len(slides)))
    form = DirichletForm.of(surface.domain, points.shape[1])
    best: Lift | None = None
    for _ in range(_MOST_LIFTS):
        try:
            model = closed(_model(points, form))
        except SurfaceError:
            if best is None:
                raise
            break
        lift, errors = _placed(model, slides, curves, allowed)
        if best is not None and not lift.misfit.rms < _WORTHWHILE * best.misfit.rms:
            break
        best, slides = lift, torch.stack([rim.slide[::_EACH] for rim in lift.rims])
        if best.misfit.rms <= allowed:
            break
        points = points - errors[:, ::_EACH]
    assert best is not None
    return best


def lifted_surface(lift: Lift, *, order: int) -> SpinorSurface:
    """The surface of a lift on its circular domain."""
    domain = lift.model.circles
    radii = [1.0, *domain.radii.tolist()]
    # edges no longer than the gaps are wide: so the polygons clear each other
    narrow = math.ceil(max(2 * math.pi * r / gap for r, gap in zip(radii, domain.clearances.tolist(), strict=True)))
    count = max(_FEWEST_VERTICES, narrow, min(len(lift.rims[0].r) // (4 * _EACH), _MOST_VERTICES))
    holes = tuple(
        FourierBoundary.round_hole(radius, count, centre=centre)
        for centre, radius in zip(domain.centres.tolist(), radii[1:], strict=True)
    )
    plane = PlaneDomain.inside(FourierBoundary.circle(1.0, count), holes=holes)
    surface = SpinorSurface(lift.model, plane, order=order).to(lift.shift.device)
    with torch.no_grad():
        root = torch.tensor([surface.root], dtype=torch.complex128, device=lift.shift.device)
        surface.constant.copy_(null_vector(*lift.model.primitive(root).unbind(-1)).real[0] + lift.shift)
    return surface


def _model(points: Float[Tensor, "m n 3"], form: DirichletForm) -> LaurentSeries:
    """The functions p and q of the harmonic surface with given values on all circles."""
    domain, n = form.domain, form.steps
    z = domain.circles(n)
    null = torch.complex(derivative(points), without_highest(form(points))) / domain.velocities(n)[..., None]
    spins = [spin_invariant(*spinors_from_phi(rim)) for rim in null]
    if math.prod(spins) < 0:
        raise SurfaceError(
            "the harmonic surface between the rims has a branch point of odd order, p and q change sign around an odd "
            "number of rims; no immersed minimal surface was found near it"
        )
    odd = [spin < 0 for spin in spins[1:]]
    root = (z[..., None] - domain.centres[torch.tensor(odd, device=z.device)]).prod(-1)
    rims = torch.stack([torch.stack(spinors_from_phi(rim), dim=-1) for rim in null / root[..., None]])
    spectra = torch.fft.fft(rims, dim=1)[:, : n // 2] / n
    own = [spectra[0], *spectra[1:, 1:]]
    signs = _agreeing_signs(rims, own, domain)
    outward = _trimmed(signs[0] * own[0])
    inward = torch.stack([sign * part for sign, part in zip(signs[1:], own[1:], strict=True)])
    kept = len(_trimmed(inward.transpose(0, 1).flatten(1)))
    return LaurentSeries(outward, inward[:, :kept], domain, antiperiodic=odd)


def _agreeing_signs(
    rims: Complex[Tensor, "m n 2"], own: list[Complex[Tensor, "_ 2"]], domain: CircularDomain
) -> list[int]:
    """Signs of the spinors of each circle with which what one has of the others' powers is what these have of them."""
    m, n = rims.shape[:2]
    lagging = torch.fft.fft(rims, dim=1)
    lagging[:, 1 : n // 2] = 0
    lagging = torch.fft.ifft(lagging, dim=1)
    agreement = torch.zeros(m, m, dtype=torch.float64)
    for k in range(m):
        seen = parts_on_circle(domain, own[0], torch.stack(own[1:]), n, k)
        agreement[k] = (lagging[k] * seen.conj()).sum((1, 2)).real.cpu()
        agreement[k, k] = 0
    vector = torch.linalg.eigh(agreement + agreement.T)[1][:, -1]
    return [1 if value * vector[0] >= 0 else -1 for value in vector.tolist()]


def _trimmed(coefficients: Complex[Tensor, "k 2"]) -> Complex[Tensor, "j 2"]:
    """Without what is rounding error at the end; one at least is left."""
    large = (coefficients.abs() > _ROUND_OFF * coefficients.abs().max()).any(-1).nonzero()
    return coefficients[: int(large[-1]) + 1] if len(large) else coefficients[:1]


def closed(model: LaurentSeries) -> LaurentSeries:
    """The series with the least change of some coefficients that makes the residues of φ real: Re ∮ φ dz = 0."""
    domain, holes = model.circles, len(model.circles.centres)
    n = 4 * max(len(model.outward), model.inward.shape[1] + 1)
    z = domain.circles(n)[1:]
    with torch.no_grad():
        root = model.sign_changing(z).square() * domain.velocities(n)[1:] / (-1j * n)
    few = min(_CLOSING_POWERS, len(model.outward)), min(_CLOSING_POWERS, model.inward.shape[1])
    outer, *inner = domain.coordinates(z)
    features = torch.cat([power_table(outer, few[0])] + [zeta * power_table(zeta, few[1]) for zeta in inner])
    weighted = (features * root).permute(1, 0, 2)  # hole, feature, step
    for _ in range(_CLOSING_STEPS):
        residue = null_vector(*model.residues().detach().unbind(-1))
        gap = residue.imag
        size = float(residue.abs().max() + (domain.radii * model.inward.detach().abs().amax((1, 2)) ** 2).max())
        if float(gap.abs().max()) <= _CLOSED * size:
            break
        with torch.no_grad():
            p, q = model.on_circles(n)[1:].unbind(-1)
        by_p, by_q = (torch.einsum("hfn,hn->hf", weighted, part) for part in (p, q))
        none = torch.zeros_like(by_p)
        rows = torch.stack(
            [
                torch.stack(null_vector(2 * by_p, none, by_q).unbind(-1)),
                torch.stack(null_vector(none, 2 * by_q, by_p).unbind(-1)),
            ],
            dim=-1,
        )
        # of complex coefficients the gap is Im(row · change)
        flat = rows.permute(1, 0, 2, 3).reshape(3 * holes, -1)
        jacobian = torch.cat([flat.imag, flat.real], dim=1)
        step = -torch.linalg.pinv(jacobian, rtol=1e-12) @ gap.flatten()
        half = len(step) // 2
        change = torch.complex(step[:half], step[half:]).reshape(-1, 2)
        with torch.no_grad():
            model.outward[: few[0]] += change[: few[0]]
            model.inward[:, : few[1]] += change[few[0] :].reshape(holes, few[1], 2)
    return model


def _placed(
    model: LaurentSeries, slides: Float[Tensor, "m n"], curves: tuple[CurveTensors, ...], allowed: float
) -> tuple[Lift, Float[Tensor, "m k 3"]]:
    """The surface as near to the curves as its constant can bring it, or as is allowed, and what it is off them."""
    k = _EACH * slides.shape[1]
    fine = torch.stack([resampled(slide, k) for slide in slides])
    steps = torch.diff(fine, append=fine[:, :1] + 1)
    speed = torch.stack([curve.point_and_derivative(s)[1].norm(dim=-1) for curve, s in zip(curves, fine, strict=True)])
    weights = (steps + steps.roll(1, -1)) / 2 * speed
    r, velocity, period = _on_circles(model, k)
    shift = r.new_zeros(3)
    for _ in range(_CONSTANT_STEPS):
        error = r + shift - _points(curves, fine)
        move = (weights[..., None] * error).sum((0, 1)) / weights.sum()
        shift = shift - move
        pairs = zip(r + shift, fine, curves, strict=True)
        fine = torch.stack([projected(rim, slide, curve, limit=1 / k) for rim, slide, curve in pairs])
        error = r + shift - _points(curves, fine)
        mean = float(((weights * error.square().sum(-1)).sum() / weights.sum()).sqrt())
        if mean <= allowed or float(move.norm()) < _STILL * mean:
            break
    rims = tuple(
        RimLift(r=rim, slide=slide, misfit=Misfit.of(rim, slide, curve))
        for rim, slide, curve in zip(r + shift, fine, curves, strict=True)
    )
    area = np.pi * float(((r + shift) * velocity.imag).sum()) / k
    return Lift(model=model, shift=shift, rims=rims, area=area, period=period), error


def _on_circles(model: LaurentSeries, k: int) -> tuple[Float[Tensor, "m k 3"], Complex[Tensor, "m k 3"], float]:
    """Re ∫ φ dz and φ dz/dτ at k equal steps of every circle, and the largest |Re ∮ φ dz| around a hole."""
    domain = model.circles
    z = domain.circles(k)
    with torch.no_grad():
        outward, inward, residues = model.integrals()
        p, q = model.on_circles(k).unbind(-1)
        factor = model.sign_changing(z).square() * domain.velocities(k)
    logarithms = (z[..., None] - domain.centres).abs().log().to(residues.dtype)
    integrals = sums_on_circles(domain, outward, inward, k) + logarithms @ residues
    velocity = null_vector(p * p * factor, q * q * factor, p * q * factor)
    period = float((2 * np.pi * null_vector(*residues.unbind(-1)).imag).norm(dim=-1).max())
    return null_vector(*integrals.unbind(-1)).real, velocity, period


def _points(curves: tuple[CurveTensors, ...], slides: Float[Tensor, "m n"]) -> Float[Tensor, "m n 3"]:
    return torch.stack([curve.point_and_derivative(s)[0] for curve, s in zip(curves, slides, strict=True)])
