"""The lift: the minimal surface of p and q near a harmonic surface X, and the distance of its boundary from Γ.

φ = 2∂X/∂z on ∂Ω follows from X and its conjugate. Its spinors p and q there are continued into Ω, as one power series
per circle or by Cauchy's formula. Where X is not exactly conformal, φ is not exactly null and the surface of p and q
differs from X. While its boundary is too far from Γ, Gauss-Newton steps in low powers of p and q remove the low
frequencies of the error; the remaining error is subtracted from X before the next lift. The least change of the same
powers keeps Re ∮ φ dz = 0 around holes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache, partial
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float, Int
from torch import Tensor

from spinor_geom.domain.plane_domain import FourierBoundary, PlaneDomain
from spinor_geom.errors import SurfaceError
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.plateau.curve_tensors import CurveTensors, normals_of
from spinor_geom.plateau.harmonic.dirichlet import CirclesForm, DirichletForm
from spinor_geom.plateau.harmonic.douglas import HarmonicDisk, resampled
from spinor_geom.plateau.harmonic.traces import OnCircles, OnCurve, changes, closed, gap_rows, gaps, moves_by, slopes
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.stability import Curvature, curvature_within
from spinor_geom.surface.formulas import null_vector
from spinor_geom.surface.frames import signs_close_up, spinors_from_phi
from spinor_geom.surface.spinor_surface import SpinorSurface, Vector

# Steps for the constant and the closest points; with one the distance from folded curves is 2 % too large.
_PLACING_STEPS = 2
WORTHWHILE = 0.5  # a new lift, a Gauss-Newton step or more nodes must reduce the distance by this factor
_EACH = 3  # sample points per node; with three the mean squared distance is exact
_TURN_OF_AN_EDGE = np.radians(25.0)  # largest turn of ∂Ω between neighbouring vertices


_Points = TypeVar("_Points", bound="_OnCurves")


@dataclass(frozen=True, kw_only=True, eq=False)
class Lift:
    """A minimal surface over Ω, and its boundary at three points per node."""

    traces: OnCircles | OnCurve  # discretisation on ∂Ω
    functions: Complex[Tensor, "2 m t"]  # p and q in that discretisation
    # ∫ φ dz along each rim at equal steps, with log |z − c| for log(z − c); its real part is the boundary
    null_curve: Complex[Tensor, "m k 3"]
    slides: Float[Tensor, "m k"]  # parameters of the closest points of Γ
    misfit: Misfit  # distance of the boundary from Γ
    area: float  # ½∮ r·Im(φ dz)
    curvature: Curvature  # total curvature
    period: float  # the largest |Re ∮ φ dz| around a hole

    @cached_property
    def model(self) -> PowerSeries | LaurentSeries | CauchyInterpolant:
        """The functions p and q."""
        return self.traces.model_of(self.functions)()

    @property
    def series(self) -> LaurentSeries:
        """The functions p and q over several rims."""
        assert isinstance(self.model, LaurentSeries)
        return self.model

    @cached_property
    def shift(self) -> Float[Tensor, "3"]:
        """The constant to add to Re ∫ φ dz in closed form, over several rims."""
        with torch.no_grad():
            start = self.series.primitive(self.null_curve.new_ones(1))
        return self.null_curve[0, 0].real - null_vector(*start.unbind(-1))[0].real


def lifted_between(
    domain: CircularDomain,
    points: Float[Tensor, "m n 3"],
    slides: Float[Tensor, "m n"],
    curves: CurveTensors,
    *,
    allowed: float,
) -> Lift:
    """The minimal surface near a harmonic one between several rims.

    Args:
        domain: Ω of the harmonic surface.
        points: its boundary, at the nodes of each rim.
        slides: the curve parameters of these points.
        curves: Γ, a curve for each rim.
        allowed: RMS distance from Γ at which the lift stops.

    Raises:
        SurfaceError: p and q change sign around an odd number of rims: X has a branch point of odd order.
    """
    form = CirclesForm.of(domain, points.shape[1])
    traces = OnCircles.of(domain, slopes(form, points))
    (lift,) = _lifted(traces, form, points[None], slides[None], curves, slides.new_tensor([allowed]))
    if lift is None:
        raise SurfaceError(
            "the harmonic surface between the rims has a branch point of odd order, p and q change sign around an odd "
            "number of rims; no immersed minimal surface was found near it"
        )
    return lift


def lifted_together(
    disks: Sequence[HarmonicDisk], form: DirichletForm, curves: CurveTensors, *, allowed: Sequence[float]
) -> tuple[Lift | None, ...]:
    """The minimal surfaces near harmonic disks on one Ω; None where p and q change sign around a branch point.

    The disks have the same number of nodes and are independent; `allowed` is as for `lifted_between`, for each.
    """
    slides, points = torch.stack([disk.slide for disk in disks]), torch.stack([disk.points for disk in disks])
    slides, points, n = slides[:, None], points[:, None], slides.shape[1]
    traces: OnCircles | OnCurve
    if form.kernel is None:
        none = slides.new_zeros(0)
        traces = OnCircles(domain=CircularDomain(centres=none.to(torch.complex128), log_radii=none), nodes=n)
    else:
        traces = OnCurve(boundary=form.boundary, kernel=form.kernel, nodes=n)
    return _lifted(traces, form, points, slides, curves, slides.new_tensor(allowed))


def _lifted(
    traces: OnCircles | OnCurve,
    form: CirclesForm | DirichletForm,
    points: Float[Tensor, "b m n 3"],
    slides: Float[Tensor, "b m n"],
    curves: CurveTensors,
    allowed: Float[Tensor, " b"],
) -> tuple[Lift | None, ...]:
    every = sampled = _SampledBoundary.of(traces, form, slides, curves)
    number = torch.arange(len(slides), device=slides.device)
    best: _Placed | None = None
    is_lifted = torch.zeros_like(number, dtype=torch.bool)
    while True:
        spinors, better = sampled.spinors(points)
        placed = sampled.placed(spinors, sampled.start)
        far = (better & (placed.rms > allowed[number])).nonzero()[:, 0]
        if len(far):
            placed = placed.replaced(far, sampled.at(far).brought_nearer(placed.at(far)))
        if best is None:
            best = placed
        else:
            better = better & (placed.rms < WORTHWHILE * best.rms[number])
            best = best.replaced(number[better], placed.at(better.nonzero()[:, 0]))
        is_lifted[number[better]] = True
        left = (better & (placed.rms > allowed[number])).nonzero()[:, 0]
        if not len(left):
            return every.lifts(best, is_lifted)
        points = points[left] - placed.error[left][..., ::_EACH].movedim(1, -1)
        number, sampled = number[left], sampled.at(left)


@dataclass(frozen=True, kw_only=True, eq=False)
class _OnCurves:
    """Points of Γ for b surfaces, k on each of m rims."""

    slides: Tensor  # (b, m, k)
    point: Tensor  # (b, 3, m, k), Γ(slide)
    tangent: Tensor  # (b, 3, m, k), Γ'(slide)
    bend: Tensor  # (b, 3, m, k), Γ"(slide)

    def at(self: _Points, which: Int[Tensor, " j"]) -> _Points:
        return type(self)(**{field.name: getattr(self, field.name)[which] for field in fields(self)})

    def moved(self, by: Float[Tensor, "b m k"]) -> _OnCurves:
        """The points moved along Γ by changes of the slides, to second order."""
        along = by[:, None]
        return _OnCurves(
            slides=self.slides + by,
            point=self.point + along * (self.tangent + along / 2 * self.bend),
            tangent=self.tangent + along * self.bend,
            bend=self.bend,
        )

    def replaced(self: _Points, which: Int[Tensor, " j"], other: _Points) -> _Points:
        """The points with those of some surfaces replaced."""
        copied = {
            field.name: getattr(self, field.name).index_copy(0, which, getattr(other, field.name))
            for field in fields(self)
        }
        return type(self)(**copied)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Placed(_OnCurves):
    """Surfaces with given p and q and the best constants, and the closest points of Γ."""

    functions: Tensor  # (b, 2, m, terms), p and q
    spinors: Tensor  # (b, 2, m, k), their values
    velocity: Tensor  # (b, 3, m, k), φ dz/dτ
    null_curve: Tensor  # (b, 3, m, k)
    error: Tensor  # (b, 3, m, k), r − Γ(slide)
    rms: Tensor  # (b,)


@dataclass(frozen=True, kw_only=True, eq=False)
class _SampledBoundary:
    """∂Ω at k points of each rim, the n nodes and points between them, for b surfaces."""

    traces: OnCircles | OnCurve
    form: CirclesForm | DirichletForm
    curves: CurveTensors  # b m of them
    dz: Tensor  # (m, k), the weights of φ
    start: _OnCurves  # points of Γ at the slides of the harmonic surfaces
    weights: Tensor  # (b, m, k), share of the arc length of Γ around each

    @classmethod
    def of(
        cls,
        traces: OnCircles | OnCurve,
        form: CirclesForm | DirichletForm,
        nodes: Float[Tensor, "b m n"],
        curves: CurveTensors,
    ) -> _SampledBoundary:
        slides = resampled(nodes, _EACH * nodes.shape[-1])
        start = _on(curves, slides)
        step = torch.diff(start.slides, append=start.slides[..., :1] + 1)
        weights = (step + step.roll(1, -1)) * start.tangent.square().sum(1).sqrt()
        weights = weights / weights.sum((1, 2), keepdim=True)
        return cls(
            traces=traces, form=form, curves=curves, dz=traces.weights(slides.shape[-1]), start=start, weights=weights
        )

    def at(self, which: Int[Tensor, " j"]) -> _SampledBoundary:
        """The boundaries of the selected surfaces; several surfaces have one rim each."""
        if len(which) == len(self.weights):
            return self
        return replace(self, curves=self.curves.at(which), start=self.start.at(which), weights=self.weights[which])

    def spinors(self, points: Float[Tensor, "b m n 3"]) -> tuple[Complex[Tensor, "b 2 m t"], Bool[Tensor, " b"]]:
        """Functions p and q of harmonic surfaces, from values at the nodes; and whether their signs close up."""
        p, q = spinors_from_phi(slopes(self.form, points) * (1 / self.dz[:, ::_EACH, None]))
        return self.traces.functions(torch.stack([p, q], dim=1)), signs_close_up(p, q).all(-1)

    def placed(self, functions: Complex[Tensor, "b 2 m t"], near: _OnCurves) -> _Placed:
        """The surfaces with given p and q, corrected to close around holes, and the closest points of Γ.

        The constant minimises the mean squared distance; Newton's method finds the closest points.
        """
        functions, spinors, velocity = closed(self.traces, functions, self.dz)
        null_curve, most = self.traces.integral(velocity), 1 / self.dz.shape[1]
        for _ in range(_PLACING_STEPS):
            null_curve = null_curve - self._mean(null_curve.real - near.point)[..., None, None]
            error, speed2 = null_curve.real - near.point, near.tangent.square().sum(1)
            move = (error * near.tangent).sum(1) / torch.maximum(speed2 - (error * near.bend).sum(1), speed2 / 2)
            near = near.moved(move.clamp(-most, most))
        near = _on(self.curves, near.slides)
        error = null_curve.real - near.point
        return _Placed(
            slides=near.slides,
            point=near.point,
            tangent=near.tangent,
            bend=near.bend,
            functions=functions,
            spinors=spinors,
            velocity=velocity,
            null_curve=null_curve,
            error=error,
            rms=self._mean(error.square().sum(1, keepdim=True))[:, 0].sqrt(),
        )

    def _mean(self, values: Float[Tensor, "b c m k"]) -> Float[Tensor, "b c"]:
        """Mean with respect to arc length of Γ."""
        return (self.weights[:, None] * values).sum((-2, -1))

    def brought_nearer(self, placed: _Placed) -> _Placed:
        """The surfaces after Gauss-Newton steps in the powers of p and q that reduce the distance."""
        number, sampled = torch.arange(len(placed.rms), device=placed.rms.device), self
        while True:
            before = placed.at(number)
            nearer = sampled.placed(before.functions + sampled._gauss_newton_step(before), before)
            better = (nearer.rms < before.rms).nonzero()[:, 0]
            placed = placed.replaced(number[better], nearer.at(better))
            left = (nearer.rms <= WORTHWHILE * before.rms).nonzero()[:, 0]
            if not len(left):
                return placed
            number, sampled = number[left], sampled.at(left)

    def _gauss_newton_step(self, placed: _Placed) -> Complex[Tensor, "b 2 m t"]:
        """The Gauss-Newton step of p and q, in low powers, for the errors normal to Γ at the nodes."""
        nodes, dz = (..., slice(None, None, _EACH)), self.dz[..., ::_EACH]
        spinors, moves = placed.spinors[nodes], self.traces.powers_at_nodes * dz
        by_p, by_q = (self.traces.integral(spinors[:, i, None] * moves).flatten(2) for i in (0, 1))
        root, error = self.weights[nodes].flatten(1)[:, None].sqrt(), placed.error[nodes].flatten(2)
        rows, right = [], []
        for normal in normals_of(placed.tangent[nodes].flatten(2).mT):
            e = root * normal.mT
            rows.append(torch.cat([moves_by(e, by_p, by_q), e], dim=1))
            right.append(-(e * error).sum(1))
        matrix = torch.cat(rows, dim=2)
        gram = torch.stack([one @ one.T for one in matrix])
        diagonal = gram.diagonal(dim1=1, dim2=2)
        # the matrix is singular: conformal maps of Ω onto itself move the boundary along Γ
        diagonal.add_(len(diagonal[0]) * torch.finfo(gram.dtype).eps * diagonal.mean(-1, keepdim=True))
        wanted = (matrix * torch.cat(right, dim=1)[:, None]).sum(-1)
        if len(self.dz) == 1:
            x = _each_solved(gram, wanted)
        else:
            constraints = torch.nn.functional.pad(gap_rows(spinors, moves), (0, 0, 0, 3))
            solved = torch.linalg.solve(gram, torch.cat([wanted[..., None], constraints], dim=-1))
            free, response = solved[..., 0], solved[..., 1:]
            violation = (constraints.mT @ free[..., None])[..., 0] + gaps(placed.velocity)
            multipliers = torch.linalg.solve(constraints.mT @ response, violation)
            x = free - (response @ multipliers[..., None])[..., 0]
        return changes(x[:, :-3], self.traces.powers)

    def lifts(self, placed: _Placed, is_lifted: Bool[Tensor, " b"]) -> tuple[Lift | None, ...]:
        """The lift of each surface, or None."""
        r, slides, m = placed.null_curve.real, placed.slides.flatten(0, 1), len(self.dz)
        misfits = Misfit.each(
            r.movedim(1, -1).flatten(0, 1),
            slides,
            placed.error.square().sum(1).sqrt().flatten(0, 1),
            placed.tangent.square().sum(1).sqrt().flatten(0, 1),
            self.curves.local_edge(slides),
            alone=self.curves.alone,
        )
        areas = np.pi * (r * placed.velocity.imag).sum((1, 2, 3)) / self.dz.shape[-1]
        curvatures = curvature_within(placed.spinors.permute(2, 0, 3, 1).unbind())
        open_by = gaps(placed.velocity).reshape(len(r), 3, m - 1).norm(dim=1)
        periods = 2 * np.pi * torch.nn.functional.pad(open_by, (0, 1)).amax(-1)
        figures = torch.stack([areas, periods, *curvatures], dim=1).tolist()
        return tuple(
            Lift(
                traces=self.traces,
                functions=placed.functions[i],
                null_curve=placed.null_curve[i].movedim(0, -1),
                slides=placed.slides[i],
                misfit=Misfit.together(misfits[m * i : m * (i + 1)]),
                area=area,
                curvature=(curvature, error),
                period=period,
            )
            if lifted
            else None
            for i, (lifted, (area, period, curvature, error)) in enumerate(
                zip(is_lifted.tolist(), figures, strict=True)
            )
        )


def _each_solved(matrices: Float[Tensor, "b n n"], right: Float[Tensor, "b n"]) -> Float[Tensor, "b n"]:
    """Solutions of linear systems, on a CPU bit-equal to those of each alone; undefined for singular matrices."""
    solve: Callable[..., tuple[Tensor, Tensor]] = torch.linalg.solve_ex
    if matrices.is_cuda:
        return solve(matrices, right)[0]
    # cloned to an aligned address: LAPACK's rounding depends on alignment
    return torch.stack([solve(one.clone(), b)[0] for one, b in zip(matrices, right, strict=True)])


def _on(curves: CurveTensors, slides: Float[Tensor, "b m k"]) -> _OnCurves:
    parts = curves.point_and_derivatives(slides.flatten(0, 1))
    point, tangent, bend = (part.reshape(*slides.shape, 3).movedim(-1, 1) for part in parts)
    return _OnCurves(slides=slides, point=point, tangent=tangent, bend=bend)


def domain_of(lift: Lift, *boundaries: FourierBoundary) -> PlaneDomain:
    """Ω of a lift, the outer boundary first.

    Raises:
        DomainError: the polygon of the vertices is not simple.
    """
    if len(boundaries) == 1 and isinstance(lift.traces, OnCircles):
        return PlaneDomain.disk(n=len(boundaries[0].vertices))
    boundary, *holes = (_with_vertices(one, lift.slides.shape[1]) for one in boundaries)
    return PlaneDomain.inside(boundary, holes=tuple(holes))


def surface_of(lift: Lift, domain: PlaneDomain) -> Callable[[float, Vector], SpinorSurface]:
    """A function that makes the surface of a lift at a scale and translation; of the lift it keeps p and q only."""
    if domain.holes:
        root = lift.null_curve.new_tensor([domain.triangulation.points[domain.root]])
        with torch.no_grad():
            constant = null_vector(*lift.series.primitive(root).unbind(-1)).real[0] + lift.shift
    else:
        constant = (_at_root(domain, lift.slides.shape[1], lift.slides.device) @ lift.null_curve[0]).real
    # the model is made with the surface: many surfaces are never used
    return partial(_surface_at, lift.traces.model_of(lift.functions), domain, constant)


def _surface_at(
    model: Callable[[], torch.nn.Module],
    domain: PlaneDomain,
    constant: Float[Tensor, "3"],
    scale: float,
    translation: Vector,
) -> SpinorSurface:
    return SpinorSurface(model(), domain, constant).placed(scale, translation)


@lru_cache(maxsize=16)
def _at_root(domain: PlaneDomain, n: int, device: torch.device) -> Complex[Tensor, " n"]:
    """Weights of the values at n equal steps of ∂Ω that give the value at Ω's root, by Cauchy's formula."""
    assert isinstance(domain.boundary, FourierBoundary)
    z, dz = torch.tensor(domain.boundary.grid(n)[:2], device=device)
    unit = dz / (z - complex(domain.triangulation.points[domain.root]))
    weights: Tensor = unit / unit.sum()
    return weights


def circles_of(domain: CircularDomain, counts: Sequence[int]) -> list[FourierBoundary]:
    """The boundaries of a circular domain, with at least `counts` vertices and edges no longer than the gaps."""
    radii = [1.0, *domain.radii.tolist()]
    counts = [
        max(count, math.ceil(2 * math.pi * radius / gap))
        for count, radius, gap in zip(counts, radii, domain.clearances.tolist(), strict=True)
    ]
    holes = zip(domain.centres.tolist(), radii[1:], counts[1:], strict=True)
    return [
        FourierBoundary.circle(1.0, counts[0]),
        *(FourierBoundary.round_hole(radius, count, centre=centre) for centre, radius, count in holes),
    ]


def _with_vertices(boundary: FourierBoundary, most: int) -> FourierBoundary:
    """∂Ω with enough vertices that their polygon stays close to it: the model is undefined outside Ω."""
    tangent = boundary.grid(most)[1]
    turn = np.append(0.0, np.cumsum(np.abs(np.angle(np.roll(tangent, -1) / tangent))))
    count = len(boundary.vertices)
    while 2 * count <= most:
        at_vertices = np.interp(np.arange(count + 1) / count, np.arange(most + 1) / most, turn)
        if np.diff(at_vertices).max() <= _TURN_OF_AN_EDGE:
            break
        count *= 2
    return boundary if count == len(boundary.vertices) else FourierBoundary(boundary.coefficients, count)
