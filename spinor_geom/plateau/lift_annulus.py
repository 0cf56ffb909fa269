"""From a harmonic annulus to p and q: the lift of its null curve along both rims to Laurent series."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import SurfaceError
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.plateau.douglas import resampled
from spinor_geom.plateau.douglas_annulus import HarmonicAnnulus
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.residual import projected
from spinor_geom.surface.formulas import null_vector
from spinor_geom.surface.frames import spin_invariant, spinors_from_phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# coefficients below this share of the largest are rounding errors
_ROUND_OFF = 1e-17
# rounds in which the constant of r and the nearest points of the curves are found from each other, and the share of the
# distance below which a move of the constant changes nothing
_CONSTANT_STEPS, _STILL = 3, 1e-3
# Newton steps to real residues, and the imaginary part, as a share of |residue| and |φ|, that is rounding error
_CLOSING_STEPS, _CLOSED = 6, 1e-16
# points for each node: between the nodes the distance is told too
_EACH = 4
# lifts in all, and the share of the last one's distance that a new one must come below
_MOST_LIFTS, _WORTHWHILE = 8, 0.9
# vertices of Ω on each circle, and most where the annulus is not so narrow that it takes more
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
class AnnularLift:
    """A minimal surface over the annulus e^{−m} < |z| < 1.

    Attributes:
        model: p and q; their period is closed.
        shift: (3,), the constant beside Re ∫ φ dz in closed form.
        rims: of the outer and of the inner circle.
        area: ½∮ r·Im(φ dz) over both.
        period: |Re ∮ φ dz| around the annulus.
    """

    model: LaurentSeries
    shift: Float[Tensor, "3"]
    rims: tuple[RimLift, RimLift]
    area: float
    period: float

    @property
    def misfit(self) -> Misfit:
        """Distance of both rims from their curves."""
        return Misfit.together([rim.misfit for rim in self.rims])


def lifted_annulus(
    annulus: HarmonicAnnulus, curves: tuple[CurveTensors, CurveTensors], *, allowed: float
) -> AnnularLift:
    """The minimal surface next to a harmonic annulus, and its distance from the curves at the nodes and between them.

    φ = 2∂X/∂z is a Laurent series with the coefficients of X. p and q are its spinors on both circles, single-valued or
    antiperiodic; the outer circle gives the powers of z, the inner one those of 1/z. Where X is not quite conformal φ
    is not quite null, and the surface of p and q is off X: what it is off the curves is taken from X before the next
    lift, while that leaves it too far from them.

    Args:
        annulus: X.
        curves: of both rims.
        allowed: RMS distance that is near enough.

    Raises:
        SurfaceError: p and q change sign around one rim and not around the other: this harmonic annulus has a branch
            point of odd order.
    """
    points, slides = annulus.points, annulus.slides
    best: AnnularLift | None = None
    for _ in range(_MOST_LIFTS):
        try:
            model = _closed(_model(points, annulus.modulus))
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


def annular_surface(lift: AnnularLift, *, order: int) -> SpinorSurface:
    """The surface of a lift on its annulus."""
    inner = lift.model.inner
    # edges no longer than the annulus is wide: so the outer polygon clears the hole too
    narrow = math.ceil(2 * math.pi / (1 - inner))
    count = max(_FEWEST_VERTICES, narrow, min(len(lift.rims[0].r) // (4 * _EACH), _MOST_VERTICES))
    domain = PlaneDomain.annulus(inner, n=count)
    surface = SpinorSurface(lift.model, domain, order=order).to(lift.shift.device)
    with torch.no_grad():
        root = torch.tensor([surface.root], dtype=torch.complex128, device=lift.shift.device)
        surface.constant.copy_(_positions(lift.model, root)[0] + lift.shift)
    return surface


def _model(points: Float[Tensor, "2 n 3"], modulus: float) -> LaurentSeries:
    """The functions p and q of the harmonic surface with given values on both circles, the inner one run clockwise."""
    n, half = points.shape[1], points.shape[1] // 2
    spectrum = torch.fft.fft(points, dim=1)[:, :half] / n
    a, b = spectrum[0], spectrum[1].conj()
    k = torch.arange(half, dtype=points.dtype, device=points.device)[1:, None]
    fading = torch.exp(-k * modulus)
    full = -torch.expm1(-2 * k * modulus)
    # φz = Σ c_k z^k: those of k > 0, and of k < 0 by powers of ρ/z; 2∂/∂z of the harmonic function
    ahead = 2 * k * (a[1:] - fading * b[1:]) / full
    back = -2 * k * ((b[1:] - fading * a[1:]) / full).conj()
    middle = ((a[:1] - b[:1]).real / modulus).to(ahead.dtype)
    radius = math.exp(-modulus)
    outer = torch.cat([middle, ahead, torch.zeros_like(middle), (fading * back).flip(0)])
    inner = torch.cat([middle, fading * ahead, torch.zeros_like(middle), back.flip(0)])
    angle = 2 * np.pi * torch.arange(n, dtype=points.dtype, device=points.device) / n
    circle = torch.polar(torch.ones_like(angle), angle)
    rims = []
    for values, size in ((outer, 1.0), (inner, radius)):
        null = torch.fft.ifft(values, dim=0) * n / (size * circle)[:, None]
        rims.append(torch.stack(spinors_from_phi(null), dim=-1))
    signs = {spin_invariant(*rim.unbind(-1)) for rim in rims}
    if len(signs) > 1:
        raise SurfaceError(
            "the harmonic annulus between the rims has a branch point of odd order, p and q change sign around one rim "
            "only; no immersed minimal annulus was found near it"
        )
    antiperiodic = signs == {-1}
    if antiperiodic:
        half_turn = torch.polar(torch.ones_like(angle), -angle / 2)[:, None]
        rims = [rims[0] * half_turn, rims[1] * half_turn / radius**0.5]
    out, into = (torch.fft.fft(rim, dim=0) / n for rim in rims)
    if float((out * into.conj()).sum().real) < 0:
        into = -into
    return LaurentSeries(
        _trimmed(out[:half]), _trimmed(into.flip(0)[: half - 1]), inner=radius, antiperiodic=antiperiodic
    )


def _trimmed(coefficients: Complex[Tensor, "k 2"]) -> Complex[Tensor, "j 2"]:
    """Without what is rounding error at the end; one at least is left."""
    large = (coefficients.abs() > _ROUND_OFF * coefficients.abs().max()).any(-1).nonzero()
    return coefficients[: int(large[-1]) + 1] if len(large) else coefficients[:1]


def _closed(model: LaurentSeries) -> LaurentSeries:
    """The series with the least change of its coefficients that makes the residues of φ real: Re ∮ φ dz = 0."""
    for _ in range(_CLOSING_STEPS):
        residue = null_vector(*model.residues())
        gap = residue.imag
        size = float(residue.detach().abs().max() + model.inner * model.inward.detach().abs().max() ** 2)
        if float(gap.detach().abs().max()) <= _CLOSED * size:
            break
        parameters = list(model.parameters())
        rows = [
            torch.cat(
                [torch.view_as_real(g).flatten() for g in torch.autograd.grad(one, parameters, retain_graph=True)]
            )
            for one in gap
        ]
        jacobian = torch.stack(rows)
        step = -jacobian.T @ torch.linalg.solve(jacobian @ jacobian.T, gap.detach())
        with torch.no_grad():
            for parameter, part in zip(parameters, step.split([2 * p.numel() for p in parameters]), strict=True):
                parameter.add_(torch.view_as_complex(part.reshape(*parameter.shape, 2)))
    return model


def _positions(model: LaurentSeries, z: Complex[Tensor, " n"]) -> Float[Tensor, "n 3"]:
    with torch.no_grad():
        return null_vector(*model.primitive(z).unbind(-1)).real


def _placed(
    model: LaurentSeries, slides: Float[Tensor, "2 n"], curves: tuple[CurveTensors, CurveTensors], allowed: float
) -> tuple[AnnularLift, Float[Tensor, "2 m 3"]]:
    """The surface as near to the curves as its constant can bring it, or as is allowed, and what it is off them."""
    m = _EACH * slides.shape[1]
    fine = torch.stack([resampled(slide, m) for slide in slides])
    steps = torch.diff(fine, append=fine[:, :1] + 1)
    speed = torch.stack([curve.point_and_derivative(s)[1].norm(dim=-1) for curve, s in zip(curves, fine, strict=True)])
    weights = (steps + steps.roll(1, -1)) / 2 * speed
    r, velocity = _on_circles(model, m)
    shift = r.new_zeros(3)
    for _ in range(_CONSTANT_STEPS):
        error = r + shift - _points(curves, fine)
        move = (weights[..., None] * error).sum((0, 1)) / weights.sum()
        shift = shift - move
        pairs = zip(r + shift, fine, curves, strict=True)
        fine = torch.stack([projected(rim, slide, curve, limit=1 / m) for rim, slide, curve in pairs])
        error = r + shift - _points(curves, fine)
        mean = float(((weights * error.square().sum(-1)).sum() / weights.sum()).sqrt())
        if mean <= allowed or float(move.norm()) < _STILL * mean:
            break
    period = float((2 * np.pi * null_vector(*model.residues().detach()).imag).norm())
    rims = [
        RimLift(r=rim, slide=slide, misfit=Misfit.of(rim, slide, curve))
        for rim, slide, curve in zip(r + shift, fine, curves, strict=True)
    ]
    area = 0.5 * float(((r + shift) * velocity.imag).sum()) / m
    return AnnularLift(model=model, shift=shift, rims=(rims[0], rims[1]), area=area, period=period), error


def _on_circles(model: LaurentSeries, m: int) -> tuple[Float[Tensor, "2 m 3"], Complex[Tensor, "2 m 3"]]:
    """Re ∫ φ dz and φ dz/dt at m equal steps of both boundaries, by the Fourier series that φ has on circles."""
    with torch.no_grad():
        outward, inward = model.products()
    k = torch.arange(1, max(len(outward), len(inward)) + 1, dtype=outward.real.dtype, device=outward.device)[:, None]
    j, i = len(outward), len(inward)
    radius = model.inner / model.outer
    positions, velocities = [], []
    for ratio_out, ratio_in, size in ((1.0, radius, model.outer), (radius, 1.0, model.inner)):
        # z·(coefficient of z^k): frequencies 1 … K, then 0 with the residue, then the negative ones
        ahead = size * ratio_out ** (k[:j] - 1) * outward
        back = size * ratio_in ** k[:i] * inward
        velocity, primitive = (ahead.new_zeros(m, 3) for _ in range(2))
        velocity[1 : j + 1], velocity[0] = ahead, back[0]
        primitive[1 : j + 1] = ahead / k[:j]
        primitive[0] = math.log(size / model.outer) * back[0]
        if i > 1:
            velocity[-(i - 1) :] = back[1:].flip(0)
            primitive[-(i - 1) :] = -(back[1:] / k[: i - 1]).flip(0)
        velocities.append(2j * np.pi * null_vector(*(torch.fft.ifft(velocity, dim=0) * m).unbind(-1)))
        positions.append(null_vector(*(torch.fft.ifft(primitive, dim=0) * m).unbind(-1)).real)
    # the inner circle is run clockwise
    turned = [torch.roll(part[1].flip(0), 1, 0) for part in (positions, velocities)]
    return torch.stack([positions[0], turned[0]]), torch.stack([velocities[0], -turned[1]])


def _points(curves: tuple[CurveTensors, CurveTensors], slides: Float[Tensor, "2 m"]) -> Float[Tensor, "2 m 3"]:
    return torch.stack([curve.point_and_derivative(s)[0] for curve, s in zip(curves, slides, strict=True)])
