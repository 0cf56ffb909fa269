"""From a harmonic disk to p and q: the lift of its null curve along ∂Ω, and where its boundary really lies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.domain.plane_domain import FourierBoundary, PlaneDomain
from spinor_geom.errors import SurfaceError
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.douglas import HarmonicDisk, band_limited
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.residual import projected
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.frames import spin_invariant, spinors_from_phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# coefficients of a power series below this share of the largest are rounding errors
_ROUND_OFF = 1e-17
# rounds in which the constant of r and the nearest points of Γ are found from each other
_CONSTANT_STEPS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Lift:
    """A minimal surface over Ω and its boundary at twice as many points as it was made from.

    Attributes:
        model: p and q.
        null_curve: (2n, 3), ∫ φ dz along ∂Ω at t = j/(2n); its real part is the boundary, where it should be on Γ.
        slide: (2n,), the parameter of the point of Γ near each.
        rms: root of the mean squared distance from Γ by arc length of ∂Ω.
        max: largest distance.
        area: ½∮ r·Im(φ dz).
    """

    model: PowerSeries | CauchyInterpolant
    null_curve: Complex[Tensor, "m 3"]
    slide: Float[Tensor, " m"]
    rms: float
    max: float
    area: float


def lifted(disk: HarmonicDisk, form: DirichletForm, curve: CurveTensors) -> Lift:
    """The minimal surface next to a harmonic disk, and its distance from Γ at the nodes and between them.

    φ = 2∂X/∂z on ∂Ω comes from X and its conjugate; p and q are its spinors there, and the model continues them into Ω:
    a power series on a disk, Cauchy's formula elsewhere. Where X is not quite conformal φ is not quite null, and the
    surface of p and q is off X by as much: that is in the distance, as it is that surface's own boundary.

    Raises:
        SurfaceError: p and q change sign around ∂Ω: this harmonic disk has a branch point of odd order.
    """
    n = len(disk.slide)
    device = disk.points.device
    z, dz, _ = (torch.tensor(row, device=device) for row in form.boundary.grid(n))
    p, q = spinors_from_phi(torch.complex(_derivative(disk.points), 2 * np.pi * form(disk.points)) / dz[:, None])
    if spin_invariant(p, q) < 0:
        raise SurfaceError(
            "the harmonic disk over the loop has a branch point of odd order, p and q change sign around it; no "
            "immersed minimal surface was found near it"
        )
    values = torch.stack([p, q], dim=-1)
    fine_dz = torch.tensor(form.boundary.grid(2 * n)[1], device=device)
    model: PowerSeries | CauchyInterpolant
    if form.kernel is None:
        coefficients = torch.fft.fft(values, dim=0)[: n // 2] / n
        large = (coefficients.abs() > _ROUND_OFF * coefficients.abs().max()).any(-1).nonzero()
        coefficients = coefficients[: int(large[-1]) + 1]
        model = PowerSeries(coefficients)
        fine = torch.fft.ifft(coefficients, n=2 * n, dim=0) * (2 * n)
    else:
        model = CauchyInterpolant(z, dz, values)
        between = _between_nodes(values, form.kernel)
        fine = torch.stack([values, between], dim=1).reshape(2 * n, 2)
    velocity = phi(fine[:, 0], fine[:, 1]) * fine_dz[:, None]
    null_curve = _integral(velocity)
    start = band_limited((disk.slide - torch.arange(n, device=device) / n)[:, None], 2 * n)[:, 0]
    slide = start + torch.arange(2 * n, device=device) / (2 * n)
    weights = fine_dz.abs() / fine_dz.abs().sum()
    error = null_curve.real - curve.point_and_derivative(slide)[0]
    for _ in range(_CONSTANT_STEPS):
        null_curve = null_curve - weights @ error
        slide = projected(null_curve.real, slide, curve, limit=0.5 / n)
        error = null_curve.real - curve.point_and_derivative(slide)[0]
    square = error.square().sum(-1)
    return Lift(
        model=model,
        null_curve=null_curve,
        slide=slide,
        rms=float((weights * square).sum().sqrt()),
        max=float(square.max().sqrt()),
        area=0.5 * float((null_curve.real * velocity.imag).sum()) / (2 * n),
    )


def surface_of(lift: Lift, boundary: FourierBoundary, *, order: int) -> SpinorSurface:
    """The surface of a lift; its constant is the boundary's, continued to the root by Cauchy's formula.

    Raises:
        DomainError: the polygon of the boundary's vertices is not simple.
    """
    surface = SpinorSurface(lift.model, PlaneDomain.inside(boundary), order=order).to(lift.null_curve.device)
    z, dz, _ = (torch.tensor(row, device=lift.null_curve.device) for row in boundary.grid(len(lift.null_curve)))
    unit = dz / (z - surface.root)
    with torch.no_grad():
        surface.constant.copy_(((unit @ lift.null_curve) / unit.sum()).real)
    return surface


def _derivative(x: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
    """dX/dt of samples at t = j/n."""
    n = len(x)
    spectrum = torch.fft.rfft(x, dim=0)
    spectrum[n // 2] = 0
    frequency = torch.arange(n // 2 + 1, dtype=x.dtype, device=x.device)
    slope: Tensor = torch.fft.irfft(2j * np.pi * frequency[:, None] * spectrum, n=n, dim=0)
    return slope


def _integral(velocity: Complex[Tensor, "n 3"]) -> Complex[Tensor, "n 3"]:
    """∫ f dt from samples at t = j/n, of mean 0; the integral around the circle is taken to vanish."""
    n = len(velocity)
    spectrum = torch.fft.fft(velocity, dim=0)
    frequency = torch.fft.fftfreq(n, 1 / n, dtype=velocity.real.dtype, device=velocity.device)
    frequency[0] = 1
    spectrum = spectrum / (2j * np.pi * frequency[:, None])
    spectrum[0] = spectrum[n // 2] = 0
    integral: Tensor = torch.fft.ifft(spectrum, dim=0)
    return integral


def _between_nodes(values: Complex[Tensor, "n 2"], kernel: Complex[Tensor, "c c"]) -> Complex[Tensor, "n 2"]:
    """What a `CauchyInterpolant` takes halfway between its nodes, from the parts of its kernel.

    The cotangent's part is ½ sign(k) on Fourier series, the smooth part acts on low frequencies only.
    """
    n, count = len(values), len(kernel)
    half = count // 2
    k = torch.fft.fftfreq(n, 1 / n, dtype=values.real.dtype, device=values.device)
    spectrum = torch.fft.fft(torch.cat([values, torch.ones_like(values[:, :1])], dim=1), dim=0) / n
    low = torch.zeros(count, 3, dtype=values.dtype, device=values.device)
    low[:half], low[-half + 1 :] = spectrum[:half], spectrum[-half + 1 :]
    smooth = torch.fft.fft(-1j * kernel @ (torch.fft.ifft(low, dim=0) * count), dim=0) / count
    total = 0.5 * k.sign()[:, None] * spectrum
    total[:half] += smooth[:half]
    total[-half + 1 :] += smooth[-half + 1 :]
    total[n // 2] = 0
    shifted = torch.fft.ifft(total * torch.exp(1j * np.pi * k / n)[:, None], dim=0) * n
    between: Tensor = shifted[:, :2] / shifted[:, 2:]
    return between
