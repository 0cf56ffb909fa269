"""The lift: the minimal surface of p and q near a harmonic surface X, and the distance of its boundary from Γ.

φ = 2∂X/∂z on ∂Ω follows from X and its conjugate. Its spinors p and q there are continued into Ω, as one power series
per circle or by Cauchy's formula. Where X is not exactly conformal, φ is not exactly null and the surface of p and q
differs from X. While its boundary is too far from Γ, Gauss-Newton steps in low powers of p and q remove the low
frequencies of the error. The remaining error is subtracted from X before the next lift. The smallest change of the
same powers makes Re ∮ φ dz = 0 around holes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Complex, Float, Int, Shaped

from spinor_geom.arrays import (
    EPS,
    NUMPY,
    Array,
    add_to_diagonal,
    closed_steps,
    contiguous,
    indices,
    namespace,
    norm,
    padded,
    place_of,
    replaced,
    shifted,
    square,
)
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
from spinor_geom.plateau.newton import SMALL
from spinor_geom.plateau.stability import Curvature, curvature_within
from spinor_geom.surface.formulas import null_vector
from spinor_geom.surface.frames import signs_close_up, spinors_from_phi

# Steps for the constant and the closest points. With one the distance from folded curves is 2 % too large.
_PLACING_STEPS = 2
WORTHWHILE = 0.5  # a new lift, a Gauss-Newton step or more nodes must reduce the distance by this factor
_EACH = 3  # sample points per node. With three the mean squared distance is exact


_Points = TypeVar("_Points", bound="_OnCurves")


@dataclass(frozen=True, kw_only=True, eq=False)
class Lift:
    """A minimal surface over Ω, and its boundary at three points per node."""

    traces: OnCircles | OnCurve  # discretisation on ∂Ω
    functions: Complex[Array, "2 m t"]  # p and q in that discretisation
    # ∫ φ dz along each rim at equal steps, with log |z − c| for log(z − c). Its real part is the boundary
    null_curve: Complex[Array, "m k 3"]
    slides: Float[Array, "m k"]  # parameters of the closest points of Γ
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
    def shift(self) -> Float[Array, "3"]:
        """The constant to add to Re ∫ φ dz in closed form, over several rims."""
        start = self.series.primitive(namespace(self.null_curve).ones_like(self.null_curve[0, 0, :1]))
        return self.null_curve[0, 0].real - null_vector(*start[0]).real


def lifted_between(
    domain: CircularDomain,
    points: Float[Array, "m n 3"],
    slides: Float[Array, "m n"],
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
    (lift,) = _lifted(traces, form, points[None], slides[None], curves, place_of(slides).put(np.array([allowed])))
    if lift is None:
        raise SurfaceError(
            "the harmonic surface between the rims has a branch point of odd order, p and q change sign around an odd "
            "number of rims; no immersed minimal surface was found near it"
        )
    return lift


def lifted_together(
    disks: Sequence[HarmonicDisk], form: DirichletForm, curves: CurveTensors, *, allowed: Sequence[float]
) -> tuple[Lift | None, ...]:
    """The minimal surfaces near harmonic disks on one Ω, or None where p and q change sign around a branch point.

    The disks have the same number of nodes and are independent. `allowed` is as for `lifted_between`, for each.
    """
    xp = namespace(disks[0].slide)
    slides, points = xp.stack([disk.slide for disk in disks]), xp.stack([disk.points for disk in disks])
    slides, points, n = slides[:, None], points[:, None], slides.shape[1]
    traces: OnCircles | OnCurve
    if form.kernel is None:
        none = slides.reshape(-1)[:0]
        traces = OnCircles(domain=CircularDomain(centres=none + 0j, log_radii=none), nodes=n)
    else:
        traces = OnCurve(boundary=form.boundary, kernel=form.kernel, nodes=n)
    return _lifted(traces, form, points, slides, curves, place_of(slides).put(np.array(allowed)))


def _lifted(
    traces: OnCircles | OnCurve,
    form: CirclesForm | DirichletForm,
    points: Float[Array, "b m n 3"],
    slides: Float[Array, "b m n"],
    curves: CurveTensors,
    allowed: Float[Array, " b"],
) -> tuple[Lift | None, ...]:
    every = sampled = _SampledBoundary.of(traces, form, slides, curves)
    xp, place = namespace(slides), place_of(slides)
    number, is_lifted = place.put(np.arange(len(slides))), place.put(np.zeros(len(slides), dtype=bool))
    best: _Positioned | None = None
    while True:
        spinors, better = sampled.spinors(points)
        positioned = sampled.positioned(spinors, sampled.start)
        far = indices(better & (positioned.rms > allowed[number]))
        if len(far):
            positioned = positioned.replaced(far, sampled.at(far).brought_nearer(positioned.at(far)))
        if best is None:
            best = positioned
        else:
            better = better & (positioned.rms < WORTHWHILE * best.rms[number])
            best = best.replaced(number[better], positioned.at(indices(better)))
        is_lifted[number[better]] = True
        left = indices(better & (positioned.rms > allowed[number]))
        if not len(left):
            return every.lifts(best, is_lifted)
        points = points[left] - xp.moveaxis(positioned.error[left][..., ::_EACH], 1, -1)
        number, sampled = number[left], sampled.at(left)


@dataclass(frozen=True, kw_only=True, eq=False)
class _OnCurves:
    """Points of Γ for b surfaces, k on each of m rims."""

    slides: Array  # (b, m, k)
    point: Array  # (b, 3, m, k), Γ(slide)
    tangent: Array  # (b, 3, m, k), Γ'(slide)
    bend: Array  # (b, 3, m, k), Γ"(slide)

    def at(self: _Points, which: Int[Array, " j"]) -> _Points:
        return type(self)(**{field.name: getattr(self, field.name)[which] for field in fields(self)})

    def moved(self, by: Float[Array, "b m k"]) -> _OnCurves:
        """The points moved along Γ by changes of the slides, to second order."""
        along = by[:, None]
        return _OnCurves(
            slides=self.slides + by,
            point=self.point + along * (self.tangent + along / 2 * self.bend),
            tangent=self.tangent + along * self.bend,
            bend=self.bend,
        )

    def replaced(self: _Points, which: Int[Array, " j"], other: _Points) -> _Points:
        """The points with those of some surfaces replaced."""
        copied = {
            field.name: replaced(getattr(self, field.name), which, getattr(other, field.name)) for field in fields(self)
        }
        return type(self)(**copied)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Positioned(_OnCurves):
    """Surfaces with given p and q and the best constants, and the closest points of Γ."""

    functions: Array  # (b, 2, m, terms), p and q
    spinors: Array  # (b, 2, m, k), their values
    velocity: Array  # (b, 3, m, k), φ dz/dτ
    null_curve: Array  # (b, 3, m, k)
    error: Array  # (b, 3, m, k), r − Γ(slide)
    rms: Array  # (b,)


@dataclass(frozen=True, kw_only=True, eq=False)
class _SampledBoundary:
    """∂Ω at k points of each rim (the n nodes and points between them), for b surfaces."""

    traces: OnCircles | OnCurve
    form: CirclesForm | DirichletForm
    curves: CurveTensors  # b m of them
    dz: Array  # (m, k), the weights of φ
    start: _OnCurves  # points of Γ at the slides of the harmonic surfaces
    weights: Array  # (b, m, k), share of the arc length of Γ around each

    @classmethod
    def of(
        cls,
        traces: OnCircles | OnCurve,
        form: CirclesForm | DirichletForm,
        nodes: Float[Array, "b m n"],
        curves: CurveTensors,
    ) -> _SampledBoundary:
        slides = resampled(nodes, _EACH * nodes.shape[-1])
        start = _on(curves, slides)
        step, xp = closed_steps(start.slides), namespace(slides)
        weights = (step + shifted(step, 1)) * xp.sqrt(square(start.tangent).sum(1))
        weights = weights / weights.sum((1, 2))[:, None, None]
        return cls(
            traces=traces, form=form, curves=curves, dz=traces.weights(slides.shape[-1]), start=start, weights=weights
        )

    def at(self, which: Int[Array, " j"]) -> _SampledBoundary:
        """The boundaries of the selected surfaces. Several surfaces have one rim each."""
        if len(which) == len(self.weights):
            return self
        return replace(self, curves=self.curves.at(which), start=self.start.at(which), weights=self.weights[which])

    def spinors(self, points: Float[Array, "b m n 3"]) -> tuple[Complex[Array, "b 2 m t"], Bool[Array, " b"]]:
        """Functions p and q of harmonic surfaces, from values at the nodes, and whether their signs close up."""
        p, q = spinors_from_phi(slopes(self.form, points) * (1 / self.dz[:, ::_EACH, None]))
        return self.traces.functions(namespace(p).stack([p, q], axis=1)), signs_close_up(p, q).all(-1)

    def positioned(self, functions: Complex[Array, "b 2 m t"], near: _OnCurves) -> _Positioned:
        """The surfaces with given p and q, corrected to close around holes, and the closest points of Γ.

        The constant minimises the mean squared distance. Newton's method finds the closest points.
        """
        functions, spinors, velocity = closed(self.traces, functions, self.dz)
        null_curve, most, xp = self.traces.integral(velocity), 1 / self.dz.shape[1], namespace(velocity)
        start = near.slides
        for _ in range(_PLACING_STEPS):
            null_curve = null_curve - self._mean(null_curve.real - near.point)[..., None, None]
            error, speed2 = null_curve.real - near.point, square(near.tangent).sum(1)
            move = (error * near.tangent).sum(1) / xp.maximum(speed2 - (error * near.bend).sum(1), speed2 / 2)
            near = near.moved(xp.clip(move, -most, most))
        # after shorter movements the Taylor polynomial of second order is exact to rounding
        far = indices(xp.max(abs(near.slides - start), axis=(1, 2)) > SMALL)
        if len(far):
            near = near.replaced(far, _on(self.at(far).curves, near.slides[far]))
        error = null_curve.real - near.point
        return _Positioned(
            slides=near.slides,
            point=near.point,
            tangent=near.tangent,
            bend=near.bend,
            functions=functions,
            spinors=spinors,
            velocity=velocity,
            null_curve=null_curve,
            error=error,
            rms=xp.sqrt(self._mean(square(error).sum(1)[:, None])[:, 0]),
        )

    def _mean(self, values: Float[Array, "b c m k"]) -> Float[Array, "b c"]:
        """Mean with respect to arc length of Γ."""
        return (self.weights[:, None] * values).sum((-2, -1))

    def brought_nearer(self, positioned: _Positioned) -> _Positioned:
        """The surfaces after Gauss-Newton steps in the powers of p and q that reduce the distance."""
        number, sampled = place_of(positioned.rms).put(np.arange(len(positioned.rms))), self
        while True:
            before = positioned.at(number)
            nearer = sampled.positioned(before.functions + sampled._gauss_newton_step(before), before)
            better = indices(nearer.rms < before.rms)
            positioned = positioned.replaced(number[better], nearer.at(better))
            left = indices(nearer.rms <= WORTHWHILE * before.rms)
            if not len(left):
                return positioned
            number, sampled = number[left], sampled.at(left)

    def _gauss_newton_step(self, positioned: _Positioned) -> Complex[Array, "b 2 m t"]:
        """The Gauss-Newton step of p and q, in low powers, for the errors normal to Γ at the nodes."""
        nodes, dz = (..., slice(None, None, _EACH)), self.dz[..., ::_EACH]
        spinors, moves = positioned.spinors[nodes], self.traces.powers_at_nodes * dz
        xp, b = namespace(spinors), len(spinors)
        by_p, by_q = (_side_by_side(self.traces.integral(spinors[:, i, None] * moves)) for i in (0, 1))
        root, error = xp.sqrt(self.weights[nodes].reshape(b, 1, -1)), _side_by_side(positioned.error[nodes])
        rows, right = [], []
        for normal in normals_of(_side_by_side(positioned.tangent[nodes]).mT):
            e = root * normal.mT
            rows.append(xp.concat([moves_by(e, by_p, by_q), e], axis=1))
            right.append(-(e * error).sum(1))
        matrix = xp.concat(rows, axis=2)
        gram = xp.stack([one @ one.mT for one in matrix])
        own = xp.arange(gram.shape[1])
        # the matrix is singular, because conformal maps of Ω onto itself move the boundary along Γ
        add_to_diagonal(gram, len(own) * EPS * gram[:, own, own].mean(-1)[:, None])
        wanted = (matrix * xp.concat(right, axis=1)[:, None]).sum(-1)
        if len(self.dz) == 1:
            x = _each_solved(gram, wanted)
        else:
            constraints = padded(gap_rows(spinors, moves).mT, 0, 3).mT
            solved = xp.linalg.solve(gram, xp.concat([wanted[..., None], constraints], axis=-1))
            free, response = solved[..., 0], solved[..., 1:]
            violation = constraints.mT @ free[..., None] + gaps(positioned.velocity)[..., None]
            multipliers = xp.linalg.solve(constraints.mT @ response, violation)
            x = free - (response @ multipliers)[..., 0]
        return changes(x[:, :-3], self.traces.powers)

    def lifts(self, positioned: _Positioned, is_lifted: Bool[Array, " b"]) -> tuple[Lift | None, ...]:
        """The lift of each surface, or None."""
        r, m, xp = positioned.null_curve.real, len(self.dz), namespace(positioned.rms)
        slides, points, errors, tangents = (
            part.reshape(-1, *part.shape[2:])
            for part in (
                positioned.slides,
                *(xp.moveaxis(part, 1, -1) for part in (r, positioned.error, positioned.tangent)),
            )
        )
        misfits = Misfit.each(
            points, slides, norm(errors), norm(tangents), self.curves.local_edge(slides), alone=self.curves.alone
        )
        areas = np.pi * (r * positioned.velocity.imag).sum((1, 2, 3)) / self.dz.shape[-1]
        curvatures = curvature_within([*xp.permute_dims(positioned.spinors, (2, 0, 3, 1))])
        open_by = norm(gaps(positioned.velocity).reshape(len(r), 3, m - 1).mT)
        periods = 2 * np.pi * xp.max(padded(open_by, 0, 1), axis=-1)
        figures = xp.stack([areas, periods, *curvatures], axis=1).tolist()
        return tuple(
            Lift(
                traces=self.traces,
                functions=positioned.functions[i],
                # contiguous, because the rounding of products depends on strides, which depend on the batch
                null_curve=contiguous(xp.moveaxis(positioned.null_curve[i], 0, -1)),
                slides=positioned.slides[i],
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


def _each_solved(matrices: Float[Array, "b n n"], right: Float[Array, "b n"]) -> Float[Array, "b n"]:
    """Solutions of linear systems, on a CPU bit for bit those of single systems. Undefined for singular matrices."""
    if place_of(matrices) == NUMPY:
        solved, solve = [np.full_like(b, np.nan) for b in right], np.linalg.solve
        for x, one, b in zip(solved, matrices, right, strict=True):
            with suppress(np.linalg.LinAlgError):
                # copied to an aligned address, because LAPACK's rounding depends on alignment
                x[:] = solve(one.copy(), b)
        return np.stack(solved)
    import torch

    solve_ex: Callable[..., tuple[Array, Array]] = torch.linalg.solve_ex
    if matrices.is_cuda:
        return solve_ex(matrices, right)[0]
    return torch.stack([solve_ex(one.clone(), b)[0] for one, b in zip(matrices, right, strict=True)])


def _side_by_side(values: Shaped[Array, "b c m n"]) -> Shaped[Array, "b c mn"]:
    """Values on all rims in one row."""
    return values.reshape(*values.shape[:2], -1)


def _on(curves: CurveTensors, slides: Float[Array, "b m k"]) -> _OnCurves:
    parts = curves.point_and_derivatives(slides.reshape(-1, slides.shape[-1]))
    point, tangent, bend = (namespace(part).moveaxis(part.reshape(*slides.shape, 3), -1, 1) for part in parts)
    return _OnCurves(slides=slides, point=point, tangent=tangent, bend=bend)
