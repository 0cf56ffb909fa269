"""Gauss-Newton on the boundary residual, with the slide along Γ eliminated."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from spinor_geom.deadline import require_time
from spinor_geom.plateau.curve_tensors import normals_of
from spinor_geom.plateau.network.network_problem import NetworkProblem
from spinor_geom.plateau.steps import STALLED, Steps
from spinor_geom.plateau.vertices.through_points import gram

_FIRST_DAMPING = 1e-2  # damping of the first step, over the mean diagonal entry of the normal equations


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """The unknowns of a fit, and the residual at them."""

    readout: Complex[Tensor, "n 2"]  # read-outs of p and q
    constant: Float[Tensor, "3"]  # c: position at the start of the first panel
    slide: Float[Tensor, " nodes"]  # curve parameters of the nodes
    amounts: Float[Tensor, " k"]  # coefficients of the modulus fields that move Ω; in the error to first order
    error: Float[Tensor, "nodes 3"]  # r + c − Γ(slide)
    tangent: Float[Tensor, "nodes 3"]  # Γ′(slide)
    gap: Float[Tensor, "holes 3"]  # Re ∮ φ dz around each hole
    energy: float  # mean of |error|² by arc length of ∂Ω, plus the sum of |gap|²

    @classmethod
    def at(
        cls,
        problem: NetworkProblem,
        readout: Complex[Tensor, "n 2"],
        slide: Float[Tensor, " nodes"],
        constant: Float[Tensor, "3"] | None = None,
        amounts: Float[Tensor, " k"] | None = None,
    ) -> Fit:
        """The residual at given unknowns; by default with the best constant and a fixed Ω."""
        amounts = problem.weights.new_zeros(problem.fields.shape[1]) if amounts is None else amounts
        point, tangent = problem.point_and_derivative(slide)
        velocity, weights = problem.velocities(readout), problem.arc_weights
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
            energy=float(weights @ error.square().sum(1) + gap.square().sum()),
        )

    @property
    def residual(self) -> float:
        """RMS distance of r from Γ(slide) at the nodes, by arc length of ∂Ω."""
        return math.sqrt(self.energy)


def gauss_newton(
    problem: NetworkProblem,
    readout: Complex[Tensor, "n 2"],
    slide: Float[Tensor, " nodes"],
    *,
    allowed: float,
    steps: Steps,
) -> Fit:
    """Minimises ∮ |r − Γ(s)|² |dz| and the square of Re ∮ φ dz around a hole by Levenberg-Marquardt.

    The residual is projected on the two directions normal to Γ'(s), which eliminates s from the linear system; s is
    then updated along the tangent and projected onto increasing sequences. Below an RMS residual of `allowed` the
    iteration continues only while each step halves the energy.

    Raises:
        OutOfTimeError: time ran out.
    """
    fit = Fit.at(problem, readout, slide)
    damping = _FIRST_DAMPING
    linear, fresh = _Linear.at(problem, fit), True
    while steps.left:
        require_time()
        before = fit.energy
        fit, damping = _damped_step(problem, fit, linear, damping)
        if fit.energy < before:
            steps.take("Gauss-Newton", fit.residual)
        # the Jacobian costs many times as much as a step; an energy of 0 or infinity does not decrease
        if not fit.energy < before / 2:
            if fresh and (fit.energy <= allowed**2 or not fit.energy <= STALLED**2 * before):
                break
            linear, fresh = _Linear.at(problem, fit), True
        else:
            fresh = False
        damping = max(damping / 8, torch.finfo(torch.float64).eps)
    return fit


@dataclass(frozen=True, kw_only=True, eq=False)
class _Linear:
    """The linearised residual: its components normal to Γ (and along Γ' at `held` nodes), and the periods.

    Unknowns: real parts of the changes of both read-outs, their imaginary parts, the change of the constant, and of
    `amounts`.
    """

    rows: Tensor  # (equations, k)
    normal_matrix: Tensor  # (k, k), lower triangle
    held: Tensor  # indices of the nodes at a bound of the slide

    @classmethod
    def at(cls, problem: NetworkProblem, state: Fit) -> _Linear:
        root = problem.arc_weights.sqrt()[:, None]
        p, q = (problem.features @ state.readout).unbind(-1)
        slopes = [(2 * value * problem.dz)[:, None] * problem.features for value in (p, q)]
        parts = _in_parts(*map(problem.integrate, slopes))
        around = _in_parts(*map(problem.around_hole, slopes))
        moved = problem.moved(state.readout)
        # at nodes whose slide would cross a bound, the distance along Γ' is a residual too
        low, high = problem.slide_bounds.T
        beyond = (state.tangent * state.error).sum(1)
        held = (((state.slide <= low) & (beyond < 0)) | ((state.slide >= high) & (beyond > 0))).nonzero()[:, 0]
        directions = list(_directions(state.tangent, held))
        counts = [len(direction) for direction, _ in directions]
        n = 4 * parts.shape[2]
        # written in place, by real products: copying rows costs as much as computing them
        gaps = 3 * len(around)
        rows = parts.new_zeros(sum(counts) + gaps, n + 3 + moved.shape[2])
        for (direction, nodes), block in zip(directions, torch.split(rows[: sum(counts)], counts), strict=True):
            e = root[nodes] * direction
            block[:, :n] = (_by_spinors(e) @ parts[nodes]).flatten(1)
            block[:, n : n + 3] = e
            block[:, n + 3 :] = torch.einsum("mi,mik->mk", e, moved[nodes])
        if gaps:
            axes = torch.eye(3, dtype=rows.dtype, device=rows.device)
            rows[-gaps:, :n] = (_by_spinors(axes) @ around[:, None]).flatten(2).flatten(0, 1)
        return cls(rows=rows, normal_matrix=gram(rows), held=held)

    def gradient(self, problem: NetworkProblem, state: Fit) -> Float[Tensor, " k"]:
        root = problem.arc_weights.sqrt()[:, None]
        residual = [
            (root[nodes] * direction * state.error[nodes]).sum(1)
            for direction, nodes in _directions(state.tangent, self.held)
        ]
        return self.rows.T @ torch.cat([*residual, state.gap.flatten()])


def _in_parts(by_p: Complex[Tensor, "m n"], by_q: Complex[Tensor, "m n"]) -> Float[Tensor, "m 4 n"]:
    return torch.stack([by_p.real, by_p.imag, by_q.real, by_q.imag], dim=1)


def _by_spinors(e: Float[Tensor, "m 3"]) -> Float[Tensor, "m 4 4"]:
    """Matrices that map the parts of ∫ 2p f dz and ∫ 2q f dz to derivatives of e · Re ∫ φ dz.

    Rows: derivatives with respect to the real parts of δp and δq, then the imaginary parts, with
    δφ = (2pδp − 2qδq, −2i(pδp + qδq), 2(qδp + pδq)).
    """
    x, y, z = e.unbind(1)
    o = torch.zeros_like(x)
    rows = ((x, y, z, o), (z, o, -x, y), (y, -x, o, -z), (o, -z, y, x))
    return torch.stack([torch.stack(row, dim=1) for row in rows], dim=1)


def _directions(
    tangent: Float[Tensor, "nodes 3"], held: Int[Tensor, " k"]
) -> Iterator[tuple[Float[Tensor, "n 3"], Tensor | slice]]:
    """Directions on which the residual is projected, with their nodes: both normals; the tangent at held nodes."""
    for normal in normals_of(tangent):
        yield normal, slice(None)
    if len(held):
        yield torch.nn.functional.normalize(tangent[held], dim=1), held


def _damped_step(problem: NetworkProblem, state: Fit, linear: _Linear, damping: float) -> tuple[Fit, float]:
    """The fit after the first step, with increasing damping, that lowers the energy; unchanged if none does."""
    n = problem.features.shape[1]
    gradient = linear.gradient(problem, state)
    scale = linear.normal_matrix.diagonal().mean()
    speed2 = state.tangent.square().sum(1)
    while damping < 1 / torch.finfo(torch.float64).eps:
        shifted = linear.normal_matrix.clone()
        shifted.diagonal().add_(scale * damping)
        factor, info = torch.linalg.cholesky_ex(shifted)
        if int(info) == 0:
            step = -torch.cholesky_solve(gradient[:, None], factor)[:, 0]
            change = torch.complex(step[: 2 * n], step[2 * n : 4 * n]).reshape(2, n).T
            shift, amounts = step[4 * n : 4 * n + 3], step[4 * n + 3 :]
            unknowns = state.constant + shift, state.amounts + amounts
            error = Fit.at(problem, state.readout + change, state.slide, *unknowns).error
            # damped too: at sharp turns of Γ a full step along its tangent moves away from it
            along = (state.tangent * error).sum(1) / (speed2 * (1 + damping))
            slide = problem.increasing(state.slide + along, speed2)
            trial = Fit.at(problem, state.readout + change, slide, *unknowns)
            if trial.energy < state.energy:
                return trial, damping
        damping *= 5
    return state, damping
