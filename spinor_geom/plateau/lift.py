"""From a harmonic disk to p and q: the lift of its null curve along ∂Ω, and where its boundary really lies."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float, Int
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
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.frames import signs_close_up, spinors_from_phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# coefficients of a power series below this share of the largest are rounding errors
_ROUND_OFF = 1e-17
# Newton steps by which the constant of r and the nearest points of Γ are found, and what keeps the former from running
# along a curve that is hardly wider than a line
_PLACING_STEPS, _STIFFNESS = 2, 1e-3
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


def lifted(disk: HarmonicDisk, form: DirichletForm, curve: CurveTensors, *, allowed: float) -> Lift:
    """The minimal surface next to a harmonic disk; see `lifted_together`.

    Raises:
        SurfaceError: p and q change sign around ∂Ω: this harmonic disk has a branch point of odd order.
    """
    (lift,) = lifted_together([disk], form, CurveTensors.batch([curve]), allowed=[allowed])
    if lift is None:
        raise SurfaceError(
            "the harmonic disk over the loop has a branch point of odd order, p and q change sign around it; no "
            "immersed minimal surface was found near it"
        )
    return lift


def lifted_together(
    disks: Sequence[HarmonicDisk], form: DirichletForm, curves: CurveTensors, *, allowed: Sequence[float]
) -> tuple[Lift | None, ...]:
    """The minimal surfaces next to harmonic disks on one Ω, and their distances from Γ at the nodes and between them.

    φ = 2∂X/∂z on ∂Ω comes from X and its conjugate; p and q are its spinors there, and the model continues them into Ω:
    a power series on the unit disk, Cauchy's formula elsewhere. Where X is not quite conformal φ is not quite null, and
    the surface of p and q is off X. While that leaves it too far from Γ, polynomials are added to p and q by
    Gauss-Newton, which takes away the slow part of the distance, and what is left of it is taken from X before the next
    lift.

    Args:
        disks: X of each curve, all with the same number of nodes; they do not know of each other.
        form: Λ of Ω; of the unit disk where it has no kernel.
        curves: Γ of each, as a batch.
        allowed: RMS distance from Γ that is near enough, for each.

    Returns:
        Of each disk its surface; None where p and q change sign around ∂Ω, around a branch point of odd order.
    """
    slides = torch.stack([disk.slide for disk in disks])
    points = torch.stack([disk.points for disk in disks])
    limits = slides.new_tensor(allowed)
    each = _POINTS_TOLD if slides.shape[1] <= _FEW_NODES else _POINTS_PER_NODE
    every = sampled = _SampledBoundary.of(form, slides, each, curves)
    number = torch.arange(len(slides), device=slides.device)
    best: _Placed | None = None
    is_lifted = torch.zeros_like(number, dtype=torch.bool)
    for _ in range(_MOST_LIFTS):
        values, is_immersed = sampled.spinors(points)
        placed = sampled.placed(values, sampled.slide)
        far = (is_immersed & (placed.rms > limits[number])).nonzero()[:, 0]
        if len(far):
            placed = placed.replaced(far, sampled.at(far).settled(placed.at(far)))
        better = is_immersed
        if best is None:
            best = placed
        else:
            better = better & (placed.rms < _WORTHWHILE * best.rms[number])
            best = best.replaced(number[better], placed.at(better.nonzero()[:, 0]))
        is_lifted[number[better]] = True
        left = (better & (placed.rms > limits[number])).nonzero()[:, 0]
        if not len(left):
            break
        points = points[left] - placed.error[left][..., ::each].mT
        number, sampled = number[left], sampled.at(left)
    assert best is not None
    told = best
    if each < _POINTS_TOLD:
        every = _SampledBoundary.of(form, slides, _POINTS_TOLD, curves)
        told = every.placed(best.values, torch.stack([resampled(row, every.slide.shape[1]) for row in best.slide]))
    return every.lifts(told, is_lifted)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Placed:
    """Surfaces with given p and q at the n nodes, as near to Γ as their constants bring them; the rest at m points."""

    values: Tensor  # (b, 2, n), p and q
    velocity: Tensor  # (b, 3, m), φ dz/dt
    null_curve: Tensor  # (b, 3, m)
    slide: Tensor  # (b, m), of the point of Γ near each
    error: Tensor  # (b, 3, m), r − Γ(slide)
    tangent: Tensor  # (b, 3, m), Γ'(slide)
    rms: Tensor  # (b,)

    def at(self, which: Int[Tensor, " k"]) -> _Placed:
        return _Placed(**{field.name: getattr(self, field.name)[which] for field in fields(self)})

    def replaced(self, which: Int[Tensor, " k"], other: _Placed) -> _Placed:
        """With some of them from another."""
        return _Placed(
            **{
                field.name: getattr(self, field.name).index_copy(0, which, getattr(other, field.name))
                for field in fields(self)
            }
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _SampledBoundary:
    """∂Ω at n nodes and at m = each·n points, the nodes and some between each two, for b curves."""

    form: DirichletForm
    curves: CurveTensors
    each: int
    z: Tensor  # (m,)
    dz: Tensor  # (m,), dz/dt
    slide: Tensor  # (b, m), where the harmonic disks have their points on Γ
    weights: Tensor  # (b, m), arc length of Γ around each of them, of sum 1

    @classmethod
    def of(cls, form: DirichletForm, nodes: Float[Tensor, "b n"], each: int, curves: CurveTensors) -> _SampledBoundary:
        slide = torch.stack([resampled(row, each * len(row)) for row in nodes])
        z, dz, _ = (torch.tensor(row, device=slide.device) for row in form.boundary.grid(slide.shape[1]))
        step = torch.diff(slide, append=slide[:, :1] + 1)
        weights = (step + step.roll(1, -1)) * curves.point_and_derivative(slide)[1].square().sum(-1).sqrt()
        weights = weights / weights.sum(-1, keepdim=True)
        return cls(form=form, curves=curves, each=each, z=z, dz=dz, slide=slide, weights=weights)

    def at(self, which: Int[Tensor, " k"]) -> _SampledBoundary:
        """With some of the curves."""
        return replace(self, curves=self.curves.at(which), slide=self.slide[which], weights=self.weights[which])

    def spinors(self, points: Float[Tensor, "b n 3"]) -> tuple[Complex[Tensor, "b 2 n"], Bool[Tensor, " b"]]:
        """P and q at the nodes of harmonic surfaces with given boundary values, and whether their signs close up."""
        velocity = torch.complex(_derivative(points), 2 * np.pi * self.form(points))
        p, q = spinors_from_phi(velocity / self.dz[:: self.each, None])
        return torch.stack([p, q], dim=1), signs_close_up(p, q)

    def placed(self, values: Complex[Tensor, "b 2 n"], slide: Float[Tensor, "b m"]) -> _Placed:
        """The surfaces with given p and q at the nodes; the slides say where on Γ to look for the nearest points.

        Constant and slide are found together by Newton's method.
        """
        m = len(self.z)
        if self.form.kernel is None:
            fine = torch.fft.ifft(_series(values), n=m) * m
        else:
            fine = _with_between_nodes(values, self.form.kernel, self.each)
        velocity = phi(fine[:, 0], fine[:, 1]).mT * self.dz
        null_curve = _integral(velocity)
        for step in itertools.count():
            point, tangent, bend = (part.mT for part in self.curves.point_and_derivatives(slide))
            error = null_curve.real - point
            if step == _PLACING_STEPS:
                break
            # the mean first, which brings what lies anywhere to its place
            shift = (self._normal_shift(error, tangent) if step else (self.weights[:, None] * error).sum(-1))[..., None]
            null_curve, error = null_curve - shift, error - shift
            speed2 = tangent.square().sum(1)
            move = (error * tangent).sum(1) / torch.maximum(speed2 - (error * bend).sum(1), speed2 / 2)
            slide = slide + move.clamp(-1 / m, 1 / m)
        return _Placed(
            values=values,
            velocity=velocity,
            null_curve=null_curve,
            slide=slide,
            error=error,
            tangent=tangent,
            rms=(self.weights * error.square().sum(1)).sum(-1).sqrt(),
        )

    def _normal_shift(self, error: Float[Tensor, "b 3 m"], tangent: Float[Tensor, "b 3 m"]) -> Float[Tensor, "b 3"]:
        """The constant that takes most from the mean squared distance normal to Γ."""
        unit = tangent / tangent.square().sum(1, keepdim=True).sqrt()
        weighted = self.weights[:, None] * unit
        along = (weighted[:, :, None] * unit[:, None]).sum(-1)
        normal = (self.weights[:, None] * error).sum(-1) - (weighted * (unit * error).sum(1, keepdim=True)).sum(-1)
        # a long straight curve hardly says where along it the constant is
        identity = torch.eye(3, dtype=error.dtype, device=error.device)
        move: Tensor = torch.linalg.solve((1 + _STIFFNESS) * identity - along, normal)
        return move

    def settled(self, placed: _Placed) -> _Placed:
        """The surfaces with polynomials added to p and q that bring them nearer to Γ."""
        number, sampled = torch.arange(len(placed.rms), device=placed.rms.device), self
        for _ in range(_SETTLING_STEPS):
            before = placed.at(number)
            values = before.values + sampled._gauss_newton_step(before)
            nearer = sampled.placed(values, before.slide)
            better = (nearer.rms < before.rms).nonzero()[:, 0]
            placed = placed.replaced(number[better], nearer.at(better))
            left = (nearer.rms <= _WORTHWHILE * before.rms).nonzero()[:, 0]
            if not len(left):
                break
            number, sampled = number[left], sampled.at(left)
        return placed

    @cached_property
    def _polynomials(self) -> Complex[Tensor, "k n"]:
        z, dz = self.z[:: self.each], self.dz[:: self.each]
        if self.form.kernel is None:
            return z ** torch.arange(_SETTLING_DEGREE + 1, device=z.device)[:, None]
        hessenberg = arnoldi_hessenberg(z, dz.abs() / dz.abs().sum(), _SETTLING_DEGREE)
        return arnoldi_polynomials(z, hessenberg).T

    def _gauss_newton_step(self, placed: _Placed) -> Complex[Tensor, "b 2 n"]:
        """Changes of p and q by polynomials that lessen the distance normal to Γ at the nodes, to first order."""
        basis, dz = self._polynomials, self.dz[:: self.each]
        stride = max(1, len(dz) // _SETTLING_ROWS)
        nodes = slice(None, None, self.each * stride)
        by_p, by_q = (_integral(placed.values[:, i, None] * basis * dz)[..., ::stride] for i in (0, 1))
        root, error = self.weights[:, None, nodes].sqrt(), placed.error[..., nodes]
        rows, right = [], []
        for normal in normals_of(placed.tangent[..., nodes].mT):
            e = root * normal.mT
            along = torch.complex(e[:, :1], -e[:, 1:2])
            upright = e[:, 2:]
            row = torch.cat([along * by_p + upright * by_q, upright * by_p - along.conj() * by_q], dim=1)
            rows.append(2 * torch.cat([row.real, -row.imag, e / 2], dim=1))
            right.append(-(e * error).sum(1))
        matrix, k = torch.cat(rows, dim=2), len(basis)
        # one after the other: BLAS rounds a loop's product otherwise when others are beside it
        gram = torch.stack([one @ one.T for one in matrix])
        diagonal = gram.diagonal(dim1=1, dim2=2)
        diagonal.add_(_SETTLING_DAMPING * diagonal.mean(-1, keepdim=True))
        x = torch.linalg.solve(gram, (matrix * torch.cat(right, dim=1)[:, None]).sum(-1))
        change = torch.complex(x[:, : 2 * k], x[:, 2 * k : 4 * k]).reshape(len(x), 2, k)
        return torch.stack([one @ basis for one in change])

    def lifts(self, placed: _Placed, is_lifted: Bool[Tensor, " b"]) -> tuple[Lift | None, ...]:
        """What is kept of surfaces, apart from each other."""
        r = placed.null_curve.real
        misfits = Misfit.each(
            r.mT,
            placed.slide,
            placed.error.square().sum(1).sqrt(),
            placed.tangent.square().sum(1).sqrt(),
            self.curves.local_edge(placed.slide),
            alone=self.curves.alone,
        )
        areas = 0.5 * (r * placed.velocity.imag).sum((1, 2)) / len(self.z)
        if self.form.kernel is None:
            series = _series(placed.values)
            large = (series.abs() > _ROUND_OFF * series.abs().amax((1, 2), keepdim=True)).any(1)
            places = torch.arange(1, series.shape[2] + 1, device=series.device)
            terms = (large * places).amax(-1).tolist()
        return tuple(
            None
            if not whole
            else Lift(
                model=PowerSeries(series[i, :, : terms[i]].T)
                if self.form.kernel is None
                else CauchyInterpolant(self.z[:: self.each], self.dz[:: self.each], placed.values[i].T),
                null_curve=placed.null_curve[i].T,
                slide=placed.slide[i],
                misfit=misfits[i],
                area=area,
            )
            for i, (whole, area) in enumerate(zip(is_lifted.tolist(), areas.tolist(), strict=True))
        )


def surface_of(lift: Lift, boundary: FourierBoundary) -> SpinorSurface:
    """The surface of a lift; its constant is the boundary's, continued to the root by Cauchy's formula.

    Raises:
        DomainError: the polygon of the boundary's vertices is not simple.
    """
    domain = PlaneDomain.inside(_with_vertices(boundary, len(lift.null_curve)))
    surface = SpinorSurface(lift.model, domain).to(lift.null_curve.device)
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


def _derivative(x: Float[Tensor, "b n 3"]) -> Float[Tensor, "b n 3"]:
    """dX/dt of samples at t = j/n."""
    n = x.shape[1]
    # along rows, as in DirichletForm
    spectrum = torch.fft.rfft(x.mT.contiguous())
    spectrum[..., n // 2] = 0
    frequency = torch.arange(n // 2 + 1, dtype=x.dtype, device=x.device)
    slope: Tensor = torch.fft.irfft(2j * np.pi * frequency * spectrum, n=n).mT
    return slope


def _integral(velocity: Complex[Tensor, "*rows n"]) -> Complex[Tensor, "*rows n"]:
    """∫ f dt from samples at t = j/n, of mean 0; the integral around the circle is taken to vanish."""
    n = velocity.shape[-1]
    frequency = torch.fft.fftfreq(n, 1 / n, dtype=velocity.real.dtype, device=velocity.device)
    frequency[0] = 1
    spectrum = torch.fft.fft(velocity.contiguous()) / (2j * np.pi * frequency)
    spectrum[..., 0] = spectrum[..., n // 2] = 0
    integral: Tensor = torch.fft.ifft(spectrum)
    return integral


def _with_between_nodes(
    values: Complex[Tensor, "b 2 n"], kernel: Complex[Tensor, "c c"], each: int
) -> Complex[Tensor, "b 2 m"]:
    """What `CauchyInterpolant`s take at their nodes and each − 1 equal steps between them, from the kernel's parts.

    At a share δ of the way from one node to the next the sum with the cotangent is ½ sign(k) + ½i cot(πδ) on Fourier
    series; the smooth part acts on low frequencies only.
    """
    n, count = values.shape[-1], len(kernel)
    half = count // 2
    k = torch.fft.fftfreq(n, 1 / n, dtype=values.real.dtype, device=values.device)
    spectrum = torch.fft.fft(torch.cat([values, torch.ones_like(values[:, :1])], dim=1)) / n
    low = torch.zeros(len(values), 3, count, dtype=values.dtype, device=values.device)
    low[..., :half], low[..., -half + 1 :] = spectrum[..., :half], spectrum[..., -half + 1 :]
    smooth = torch.fft.fft(-1j * (torch.fft.ifft(low) * count) @ kernel.T) / count
    total = 0.5 * k.sign() * spectrum
    total[..., :half] += smooth[..., :half]
    total[..., -half + 1 :] += smooth[..., -half + 1 :]
    total[..., n // 2] = 0
    share = torch.arange(1, each, dtype=k.dtype, device=k.device)[:, None] / each
    cotangent = 0.5j / torch.tan(np.pi * share)
    turned = (total[:, :, None] + cotangent * spectrum[:, :, None]) * torch.exp(2j * np.pi * share / n * k)
    shifted = torch.fft.ifft(turned) * n
    between = shifted[:, :2] / shifted[:, 2:]
    return torch.cat([values[:, :, None], between], dim=2).mT.flatten(2)


def _series(values: Complex[Tensor, "b 2 n"]) -> Complex[Tensor, "b 2 k"]:
    """Power series from values at the roots of unity."""
    n = values.shape[-1]
    coefficients: Tensor = torch.fft.fft(values)[..., : n // 2] / n
    return coefficients
