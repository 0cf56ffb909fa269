"""From a harmonic disk to p and q: the lift of its null curve along ∂Ω, and where its boundary really lies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.domain.plane_domain import FourierBoundary, PlaneDomain
from spinor_geom.errors import SurfaceError
from spinor_geom.holomorphic.arnoldi import arnoldi_hessenberg, arnoldi_polynomials
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.douglas import HarmonicDisk, resampled
from spinor_geom.plateau.gauss_newton import normals_of
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.residual import projected
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.frames import spin_invariant, spinors_from_phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# coefficients of a power series below this share of the largest are rounding errors
_ROUND_OFF = 1e-17
# rounds in which the constant of r and the nearest points of Γ are found from each other
_CONSTANT_STEPS = 3
# and the share of the distance below which a move of the constant changes nothing
_STILL = 1e-3
# Gauss-Newton with polynomials: their degree, its steps, points that its equations are taken at, and its damping: it is
# singular where maps of Ω onto itself move the boundary along Γ
_SETTLING_DEGREE, _SETTLING_STEPS, _SETTLING_ROWS, _SETTLING_DAMPING = 16, 3, 4096, 1e-10
# largest turn of ∂Ω from one of its vertices to the next
_TURN_OF_AN_EDGE = np.radians(25.0)
# lifts in all, and the share of the last one's distance that a new one must come below
_MOST_LIFTS, _WORTHWHILE = 8, 0.9
# points for each node: while a surface is sought, and where its distance is told: with p and q, of up to half as many
# frequencies as nodes, the square of the distance has twice as many as nodes
_POINTS_PER_NODE, _POINTS_TOLD = 2, 4
# so few nodes that more points cost less than placing the surface once more
_FEW_NODES = 512


@dataclass(frozen=True, kw_only=True, eq=False)
class Lift:
    """A minimal surface over Ω and its boundary at four times as many points as it was made from.

    Attributes:
        model: p and q.
        null_curve: (4n, 3), ∫ φ dz along ∂Ω at t = j/(4n); its real part is the boundary, where it should be on Γ.
        slide: (4n,), the parameter of the point of Γ near each.
        misfit: distance between the boundary and Γ.
        area: ½∮ r·Im(φ dz).
    """

    model: PowerSeries | CauchyInterpolant
    null_curve: Complex[Tensor, "m 3"]
    slide: Float[Tensor, " m"]
    misfit: Misfit
    area: float


def lifted(
    disk: HarmonicDisk,
    form: DirichletForm,
    curve: CurveTensors,
    *,
    allowed: float,
) -> Lift:
    """The minimal surface next to a harmonic disk, and its distance from Γ at the nodes and between them.

    φ = 2∂X/∂z on ∂Ω comes from X and its conjugate; p and q are its spinors there, and the model continues them into Ω:
    a power series on the unit disk, Cauchy's formula elsewhere. Where X is not quite conformal φ is not quite null, and
    the surface of p and q is off X. While that leaves it too far from Γ, polynomials are added to p and q by
    Gauss-Newton, which takes away the slow part of the distance, and what is left of it is taken from X before the next
    lift.

    Args:
        disk: X.
        form: Λ of Ω; of the unit disk where it has no kernel.
        curve: Γ.
        allowed: RMS distance from Γ that is near enough.

    Raises:
        SurfaceError: p and q change sign around ∂Ω: this harmonic disk has a branch point of odd order.
    """
    each = _POINTS_TOLD if len(disk.slide) <= _FEW_NODES else _POINTS_PER_NODE
    sampled = _SampledBoundary.of(form, disk.slide, each, curve)
    points = disk.points
    best: _Placed | None = None
    for _ in range(_MOST_LIFTS):
        try:
            placed = sampled.placed(sampled.spinors(points), sampled.slide)
        except SurfaceError:
            if best is None:
                raise
            break
        if placed.rms > allowed:
            placed = sampled.settled(placed)
        if best is not None and not placed.rms < _WORTHWHILE * best.rms:
            break
        best = placed
        if best.rms <= allowed:
            break
        points = points - placed.error[::each]
    assert best is not None
    if each < _POINTS_TOLD:
        sampled = _SampledBoundary.of(form, disk.slide, _POINTS_TOLD, curve)
        told = sampled.placed(best.values, resampled(best.slide, len(sampled.slide)), rounds=1)
    else:
        told = best
    return Lift(
        model=sampled.model(told.values),
        null_curve=told.null_curve,
        slide=told.slide,
        misfit=Misfit.of(told.null_curve.real, told.slide, curve),
        area=0.5 * float((told.null_curve.real * told.velocity.imag).sum()) / len(told.slide),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Placed:
    """A surface with given p and q at the n nodes, as near to Γ as its constant can bring it; the rest at m points."""

    values: Tensor  # (n, 2)
    fine: Tensor  # (m, 2), p and q
    velocity: Tensor  # (m, 3), φ dz/dt
    null_curve: Tensor  # (m, 3)
    slide: Tensor  # (m,), of the point of Γ near each
    error: Tensor  # (m, 3), r − Γ(slide)
    rms: float


@dataclass(frozen=True, kw_only=True, eq=False)
class _SampledBoundary:
    """∂Ω at n nodes and at m = each·n points, the nodes and some between each two."""

    form: DirichletForm
    curve: CurveTensors
    each: int
    z: Tensor  # (m,)
    dz: Tensor  # (m,), dz/dt
    slide: Tensor  # (m,), where the harmonic disk has its points on Γ
    weights: Tensor  # (m,), arc length of Γ around each of them, of sum 1

    @classmethod
    def of(cls, form: DirichletForm, nodes: Float[Tensor, " n"], each: int, curve: CurveTensors) -> _SampledBoundary:
        slide = resampled(nodes, each * len(nodes))
        z, dz, _ = (torch.tensor(row, device=slide.device) for row in form.boundary.grid(len(slide)))
        step = torch.diff(slide, append=slide[:1] + 1)
        weights = (step + step.roll(1)) * curve.point_and_derivative(slide)[1].norm(dim=-1)
        return cls(form=form, curve=curve, each=each, z=z, dz=dz, slide=slide, weights=weights / weights.sum())

    def spinors(self, points: Float[Tensor, "n 3"]) -> Complex[Tensor, "n 2"]:
        """P and q at the nodes of the harmonic surface with given boundary values."""
        velocity = torch.complex(_derivative(points), 2 * np.pi * self.form(points))
        p, q = spinors_from_phi(velocity / self.dz[:: self.each, None])
        if spin_invariant(p, q) < 0:
            raise SurfaceError(
                "the harmonic disk over the loop has a branch point of odd order, p and q change sign around it; no "
                "immersed minimal surface was found near it"
            )
        return torch.stack([p, q], dim=-1)

    def model(self, values: Complex[Tensor, "n 2"]) -> PowerSeries | CauchyInterpolant:
        """The model with given values at the nodes."""
        if self.form.kernel is None:
            return PowerSeries(_series(values))
        return CauchyInterpolant(self.z[:: self.each], self.dz[:: self.each], values)

    def placed(
        self, values: Complex[Tensor, "n 2"], slide: Float[Tensor, " m"], *, rounds: int = _CONSTANT_STEPS
    ) -> _Placed:
        """The surface with given p and q at the nodes; the slide says where on Γ to look for the nearest points."""
        m = len(self.z)
        if self.form.kernel is None:
            fine = torch.fft.ifft(_series(values), n=m, dim=0) * m
        else:
            between = _between_nodes(values, self.form.kernel, self.each)
            fine = torch.cat([values[:, None], between], dim=1).reshape(m, 2)
        velocity = phi(fine[:, 0], fine[:, 1]) * self.dz[:, None]
        null_curve = _integral(velocity)
        weights = self.weights
        error = null_curve.real - self.curve.point_and_derivative(slide)[0]
        for _ in range(rounds):
            shift = weights @ error
            null_curve = null_curve - shift
            slide = projected(null_curve.real, slide, self.curve, limit=1 / m)
            error = null_curve.real - self.curve.point_and_derivative(slide)[0]
            rms = float((weights * error.square().sum(-1)).sum().sqrt())
            if float(shift.norm()) < _STILL * rms:
                break
        return _Placed(
            values=values, fine=fine, velocity=velocity, null_curve=null_curve, slide=slide, error=error, rms=rms
        )

    def settled(self, placed: _Placed) -> _Placed:
        """The surface with polynomials added to p and q that bring it nearer to Γ."""
        basis = self._polynomials
        for _ in range(_SETTLING_STEPS):
            change = self._gauss_newton_step(placed, basis)
            nearer = self.placed(placed.values + basis[:: self.each] @ change, placed.slide)
            if not nearer.rms < placed.rms:
                break
            enough = nearer.rms > _WORTHWHILE * placed.rms
            placed = nearer
            if enough:
                break
        return placed

    @cached_property
    def _polynomials(self) -> Complex[Tensor, "m k"]:
        hessenberg = arnoldi_hessenberg(self.z, self.dz.abs() / self.dz.abs().sum(), _SETTLING_DEGREE)
        return arnoldi_polynomials(self.z, hessenberg)

    def _gauss_newton_step(self, placed: _Placed, basis: Complex[Tensor, "m k"]) -> Complex[Tensor, "k 2"]:
        """Coefficients of the polynomials that lessen the distance normal to Γ, to first order."""
        stride = max(1, len(self.z) // _SETTLING_ROWS)
        by_p, by_q = (_integral(placed.fine[:, i : i + 1] * basis * self.dz[:, None])[::stride] for i in (0, 1))
        _, tangent = self.curve.point_and_derivative(placed.slide[::stride])
        root = self.weights[::stride].sqrt()[:, None]
        rows, right = [], []
        for normal in normals_of(tangent):
            e = root * normal
            along = torch.complex(e[:, :1], -e[:, 1:2])
            upright = e[:, 2:]
            row = torch.cat([along * by_p + upright * by_q, upright * by_p - along.conj() * by_q], dim=1)
            rows.append(2 * torch.cat([row.real, -row.imag, e / 2], dim=1))
            right.append(-(e * placed.error[::stride]).sum(1))
        matrix, k = torch.cat(rows), basis.shape[1]
        gram = matrix.T @ matrix
        gram.diagonal().add_(_SETTLING_DAMPING * gram.diagonal().mean())
        x = torch.linalg.solve(gram, matrix.T @ torch.cat(right))
        return torch.complex(x[: 2 * k], x[2 * k : 4 * k]).reshape(2, k).T


def surface_of(lift: Lift, boundary: FourierBoundary, *, order: int) -> SpinorSurface:
    """The surface of a lift; its constant is the boundary's, continued to the root by Cauchy's formula.

    Raises:
        DomainError: the polygon of the boundary's vertices is not simple.
    """
    domain = PlaneDomain.inside(_with_vertices(boundary, len(lift.null_curve)))
    surface = SpinorSurface(lift.model, domain, order=order).to(lift.null_curve.device)
    z, dz, _ = (torch.tensor(row, device=lift.null_curve.device) for row in boundary.grid(len(lift.null_curve)))
    unit = dz / (z - surface.root)
    with torch.no_grad():
        surface.constant.copy_(((unit @ lift.null_curve) / unit.sum()).real)
    return surface


def _with_vertices(boundary: FourierBoundary, most: int) -> FourierBoundary:
    """∂Ω with so many vertices that their polygon follows all of its bends: outside Ω the model means nothing."""
    tangent = boundary.grid(most)[1]
    turn = np.append(0.0, np.cumsum(np.abs(np.angle(np.roll(tangent, -1) / tangent))))
    count = len(boundary.vertices)
    while 2 * count <= most:
        at_vertices = np.interp(np.arange(count + 1) / count, np.arange(most + 1) / most, turn)
        if np.diff(at_vertices).max() <= _TURN_OF_AN_EDGE:
            break
        count *= 2
    return boundary if count == len(boundary.vertices) else FourierBoundary(boundary.coefficients, count)


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


def _between_nodes(
    values: Complex[Tensor, "n 2"], kernel: Complex[Tensor, "c c"], each: int
) -> Complex[Tensor, "n between 2"]:
    """What a `CauchyInterpolant` takes at the each − 1 equal steps between its nodes, from the parts of its kernel.

    At a share δ of the way from one node to the next the sum with the cotangent is ½ sign(k) + ½i cot(πδ) on Fourier
    series; the smooth part acts on low frequencies only.
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
    between = []
    for step in range(1, each):
        share = step / each
        turned = (total + 0.5j / np.tan(np.pi * share) * spectrum) * torch.exp(2j * np.pi * share / n * k)[:, None]
        shifted = torch.fft.ifft(turned, dim=0) * n
        between.append(shifted[:, :2] / shifted[:, 2:])
    return torch.stack(between, dim=1)


def _series(values: Complex[Tensor, "n 2"]) -> Complex[Tensor, "k 2"]:
    """Power series from values at the roots of unity, without what is rounding error."""
    coefficients = torch.fft.fft(values, dim=0)[: len(values) // 2] / len(values)
    large = (coefficients.abs() > _ROUND_OFF * coefficients.abs().max()).any(-1).nonzero()
    kept: Tensor = coefficients[: int(large[-1]) + 1]
    return kept
