"""Gauss-Newton on the boundary residual, with the slide along Γ eliminated."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.arrays import (
    EPS,
    Array,
    add_to_diagonal,
    cholesky,
    cholesky_solve,
    complex_of,
    gram,
    indices,
    namespace,
    place_of,
    square,
    unit,
    zeros,
)
from spinor_geom.deadline import require_time
from spinor_geom.holomorphic.cauchy import FACTOR_SECONDS
from spinor_geom.plateau.curve_tensors import normals_of
from spinor_geom.plateau.network.network_problem import NetworkProblem
from spinor_geom.plateau.newton import LEAST_DAMPING
from spinor_geom.plateau.steps import STALLED, Steps


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """The unknowns of a fit, and the residual at them."""

    readout: Complex[Array, "n 2"]  # read-outs of p and q
    constant: Float[Array, "3"]  # c: position at the start of the first panel
    slide: Float[Array, " nodes"]  # curve parameters of the nodes
    # coefficients of the modulus fields that move Ω. `error` includes their effect to first order
    amounts: Float[Array, " k"]
    error: Float[Array, "nodes 3"]  # r + c − Γ(slide)
    tangent: Float[Array, "nodes 3"]  # Γ′(slide)
    gap: Float[Array, "holes 3"]  # Re ∮ φ dz around each hole
    energy: float  # mean of |error|² by `fit_weights`, plus the sum of |gap|²

    @classmethod
    def at(
        cls,
        problem: NetworkProblem,
        readout: Complex[Array, "n 2"],
        slide: Float[Array, " nodes"],
        constant: Float[Array, "3"] | None = None,
        amounts: Float[Array, " k"] | None = None,
    ) -> Fit:
        """The residual at given unknowns, by default with the best constant and a fixed Ω."""
        amounts = zeros((problem.fields.shape[1],), problem.weights) if amounts is None else amounts
        point, tangent = problem.point_and_derivative(slide)
        velocity, weights = problem.velocities(readout), problem.fit_weights
        error = problem.integrate(velocity).real - point + problem.moved(readout) @ amounts
        constant = -weights @ error if constant is None else constant
        error = error + constant
        gap = problem.around_hole(velocity).real
        return cls(
            readout=readout,
            constant=constant,
            slide=slide,
            amounts=amounts,
            error=error,
            tangent=tangent,
            gap=gap,
            energy=float(weights @ square(error).sum(1) + square(gap).sum()),
        )

    @property
    def residual(self) -> float:
        """RMS distance of r from Γ(slide) at the nodes, by `fit_weights`."""
        return math.sqrt(self.energy)


def gauss_newton(
    problem: NetworkProblem,
    readout: Complex[Array, "n 2"],
    slide: Float[Array, " nodes"],
    *,
    allowed: float,
    steps: Steps,
    near: bool = False,
    power: float = 1.0,
) -> Fit:
    """Minimises ∮ |r − Γ(s)|² |dz| and the square of Re ∮ φ dz around a hole by Levenberg-Marquardt.

    The residual is projected on the two directions normal to Γ'(s), which eliminates s from the linear system. Then s
    is updated along the tangent and projected onto increasing sequences. Below an RMS residual of `allowed` the
    iteration continues only while each step halves the energy. From a start that is `near`, such as a fit with fewer
    features, the first step is damped less, and the iteration also ends if a step with a new Jacobian is so short that
    twenty more like it would not meet `allowed`.

    The weight of a panel is a `power` of its length. With 1, by arc length, corners, beside which panels are short, may
    be missed by several hundred times the residual. With less, corners of Ω beside those of Γ are not seen.

    Raises:
        OutOfTimeError: time ran out.
    """
    problem = replace(problem, power=power)
    fit = Fit.at(problem, readout, slide)
    # over the mean diagonal entry of the normal equations. From 1 fits take a sixth more steps. Fits with more features
    # take half as many from a tenth of the least damping, and others are farther from Γ then
    damping = LEAST_DAMPING * (0.1 if near else 10)
    linear, fresh = _Linear.at(problem, fit), True
    while steps.left:
        require_time()
        before = fit.energy
        fit, damping = _damped_step(problem, fit, linear, damping)
        if fit.energy < before:
            steps.take("Gauss-Newton", fit.residual)
        # a Jacobian takes many times as long as a step. Energies of 0 and infinity do not decrease
        if not fit.energy < before / 2:
            if fresh and (fit.energy <= allowed**2 or not fit.energy <= STALLED**2 * before):
                break
            if fresh and near and fit.energy > allowed**2 * (before / fit.energy) ** 20:
                break
            linear, fresh = _Linear.at(problem, fit), True
        else:
            fresh = False
        damping = max(damping / 8, EPS)
    return fit


@dataclass(frozen=True, kw_only=True, eq=False)
class _Linear:
    """The linearised residual: its components normal to Γ (and along Γ' at `held` nodes), and the periods.

    Unknowns: real parts of the changes of both read-outs, their imaginary parts, the change of the constant, and of
    `amounts`.
    """

    rows: Array  # (equations, k)
    normal_matrix: Array  # (k, k), lower triangle
    held: Array  # indices of the nodes at a bound of the slide

    @classmethod
    def at(cls, problem: NetworkProblem, state: Fit) -> _Linear:
        require_time(FACTOR_SECONDS * problem.features.shape[0] * problem.features.shape[1] ** 2)
        xp = namespace(problem.fit_weights)
        root = xp.sqrt(problem.fit_weights)[:, None]
        p, q = (problem.features @ state.readout).mT
        slopes = [(2 * value * problem.dz)[:, None] * problem.features for value in (p, q)]
        parts = _in_parts(*map(problem.integrate, slopes))
        around = _in_parts(*map(problem.around_hole, slopes))
        moved = problem.moved(state.readout)
        # at nodes whose slide would cross a bound, the distance along Γ' is a residual too
        low, high = problem.slide_bounds.mT
        beyond = (state.tangent * state.error).sum(1)
        held = indices(((state.slide <= low) & (beyond < 0)) | ((state.slide >= high) & (beyond > 0)))
        directions = list(_directions(state.tangent, held))
        counts = [len(direction) for direction, _ in directions]
        n = 4 * parts.shape[2]
        # written in place, by real products, because copying rows takes as long as computing them
        gaps = 3 * len(around)
        rows, end = zeros((sum(counts) + gaps, n + 3 + moved.shape[2]), parts), 0
        for (direction, nodes), count in zip(directions, counts, strict=True):
            block, end = rows[end : end + count], end + count
            e = root[nodes] * direction
            block[:, :n] = (_by_spinors(e) @ parts[nodes]).reshape(count, -1)
            block[:, n : n + 3] = e
            block[:, n + 3 :] = (e[:, None] @ moved[nodes])[:, 0]
        if gaps:
            rows[-gaps:, :n] = (_by_spinors(place_of(rows).put(np.eye(3))) @ around[:, None]).reshape(gaps, -1)
        return cls(rows=rows, normal_matrix=gram(rows), held=held)

    def gradient(self, problem: NetworkProblem, state: Fit) -> Float[Array, " k"]:
        xp = namespace(problem.fit_weights)
        root = xp.sqrt(problem.fit_weights)[:, None]
        residual = [
            (root[nodes] * direction * state.error[nodes]).sum(1)
            for direction, nodes in _directions(state.tangent, self.held)
        ]
        return self.rows.mT @ xp.concat([*residual, state.gap.reshape(-1)])


def _in_parts(by_p: Complex[Array, "m n"], by_q: Complex[Array, "m n"]) -> Float[Array, "m 4 n"]:
    return namespace(by_p).stack([by_p.real, by_p.imag, by_q.real, by_q.imag], axis=1)


def _by_spinors(e: Float[Array, "m 3"]) -> Float[Array, "m 4 4"]:
    """Matrices that map the parts of ∫ 2p f dz and ∫ 2q f dz to derivatives of e · Re ∫ φ dz.

    Rows: derivatives with respect to the real parts of δp and δq, then the imaginary parts, with
    δφ = (2pδp − 2qδq, −2i(pδp + qδq), 2(qδp + pδq)).
    """
    (x, y, z), xp = e.mT, namespace(e)
    o = xp.zeros_like(x)
    rows = [x, y, z, o, z, o, -x, y, y, -x, o, -z, o, -z, y, x]
    return xp.stack(rows, axis=1).reshape(-1, 4, 4)


def _directions(
    tangent: Float[Array, "nodes 3"], held: Int[Array, " k"]
) -> Iterator[tuple[Float[Array, "n 3"], Array | slice]]:
    """Directions to project the residual on: two normals at every node, plus the tangent at held nodes."""
    for normal in normals_of(tangent):
        yield normal, slice(None)
    if len(held):
        yield unit(tangent[held]), held


def _damped_step(problem: NetworkProblem, state: Fit, linear: _Linear, damping: float) -> tuple[Fit, float]:
    """The fit after the first step, with increasing damping, that lowers the energy, or the fit itself if none does."""
    n = problem.features.shape[1]
    gradient = linear.gradient(problem, state)
    xp, own = namespace(gradient), namespace(gradient).arange(len(gradient))
    scale = linear.normal_matrix[own, own].mean()
    speed2 = square(state.tangent).sum(1)
    while damping < 1 / EPS:
        shifted = xp.asarray(linear.normal_matrix, copy=True)
        add_to_diagonal(shifted, scale * damping)
        factor = cholesky(shifted)
        if factor is not None:
            step = -cholesky_solve(factor, gradient[:, None])[:, 0]
            change = complex_of(step[: 2 * n], step[2 * n : 4 * n]).reshape(2, n).mT
            shift, amounts = step[4 * n : 4 * n + 3], step[4 * n + 3 :]
            unknowns = state.constant + shift, state.amounts + amounts
            error = Fit.at(problem, state.readout + change, state.slide, *unknowns).error
            # damped too, because at sharp turns of Γ a full step along the tangent increases the distance
            along = (state.tangent * error).sum(1) / (speed2 * (1 + damping))
            slide = problem.increasing(state.slide + along, speed2)
            trial = Fit.at(problem, state.readout + change, slide, *unknowns)
            if trial.energy < state.energy:
                return trial, damping
        damping *= 5
    return state, damping
