"""The network route to a minimal disk: Gauss-Newton for a Cauchy network on an Ω flattened from a discrete disk.

It takes every loop, with corners or without, and goes to the minimal disk nearest to where it starts, saddles of the
area included.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from spinor_geom.discrete.area_descent import Disk
from spinor_geom.discrete.minimal_surface import finer_disk
from spinor_geom.domain.flattening import flatten
from spinor_geom.domain.panels import Panels
from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary, panel_breaks, sampled
from spinor_geom.errors import DomainError, OptionError, SingularMatrixError
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.corners import CornerPairs
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.gauss_newton import Fit, gauss_newton
from spinor_geom.plateau.network import Discretisation
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.residual import Residual, independent_residual
from spinor_geom.plateau.roughness import roughness
from spinor_geom.plateau.start import images_in_plane, lifted_spinors
from spinor_geom.plateau.steps import Steps
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.spinor_surface import SpinorSurface

# Longer loops are thinned to this many points for the first fill, Ω and the poles; Γ still passes through all points.
_LONGEST_RIM = 240
# Quadrature nodes on each piece of a path in Ω, times the number of rounds: each brings poles nearer to ∂Ω.
_PATH_ORDER = 16


@dataclass(frozen=True, kw_only=True)
class Cauchy:
    """Options of the Cauchy network.

    Attributes:
        degree: highest degree of the polynomials; loops of fewer than 20 points take less.
        pole_offset: distance of the poles from ∂Ω, in local edge lengths.
    """

    degree: int = 40
    pole_offset: float = 1.0

    def __post_init__(self) -> None:
        """Checks the options.

        Raises:
            OptionError: a negative degree or an offset that is not positive.
        """
        if self.degree < 1 or not self.pole_offset > 0:
            raise OptionError(f"a Cauchy network needs degree ≥ 1 and pole_offset > 0, got {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class NetworkSolver:
    """One loop on the network route.

    Attributes:
        loop: the loop at unit size.
        rim: indices of its points that stand for it in discrete disks.
        curve: Γ.
        options: of the network.
        budget: what a fit may cost.
        device: where the linear algebra runs.
        clock: of the stages.
    """

    loop: BoundaryLoop
    rim: Int[np.ndarray, " k"]
    curve: BoundaryCurve
    options: Cauchy
    budget: Budget
    device: torch.device
    clock: Clock

    def found_from(self, disk: Disk) -> Found:
        """The minimal disk that a discrete one leads to.

        Raises:
            DomainError: its flattening gives no simple domain.
            SingularMatrixError: the discrete disk or the fit is degenerate.
        """
        fitted = self._fitted_from(disk)
        missed = self.budget.excess(fitted.residual) > 1
        # another start does not help where one point of a loop in ten turns by more
        if missed and self._turning <= np.radians(60) and not self.budget.steps.are_spent:
            fitted = self._improved(fitted, disk)
        with self.clock.stage("surface"):
            surface, astray = fitted_surface(fitted)
            area = surface.area()
        return Found(
            curves=(self.curve,),
            surface=surface,
            matchings=(fitted.stage.matchings(fitted.fit)[0],),
            misfit=fitted.residual.misfit.and_astray(astray),
            area=area,
            route="network",
            limit=limit_of(fitted, self.budget, self._turning),
        )

    @property
    def _turning(self) -> float:
        return roughness(self.loop)

    def _improved(self, fitted: Fitted, disk: Disk) -> Fitted:
        """The better of a fit and one that starts from a finer disk; the fit itself where that disk cannot be made."""
        try:
            with self.clock.stage("first fill"):
                finer = finer_disk(disk, len(self.rim))
            again = self._fitted_from(finer)
        except (DomainError, SingularMatrixError):  # what a second try fails at must not cost the first one's result
            return fitted
        return again if again.residual.misfit.rms < fitted.residual.misfit.rms else fitted

    def _fitted_from(self, disk: Disk) -> Fitted:
        """The fit that starts from a discrete disk: its flattening gives Ω, its frames p and q."""
        rim, curve, device = self.rim, self.curve, self.device
        with self.clock.stage("flattening"):
            corners = self.loop.corners[rim]
            flat = flatten(
                disk.vertices,
                disk.faces,
                len(rim),
                drawn=lambda rims: (sampled(SplineBoundary.through(rims[0], corners), each=4),),
            )
            domain = PlaneDomain.from_boundary(flat.boundary, corners, flat.log_scale)
        with self.clock.stage("features"):
            pairs = CornerPairs(t=domain.boundary.parameters[:-1][corners], s=curve.breaks[rim[corners]])
            stage = Discretisation.first(
                domain,
                (CurveTensors.of(curve, device),),
                pairs,
                degree=self.options.degree,
                offset=self.budget.offset,
                tolerance=self.budget.allowed / self.loop.mean_edge_length,
            )
        with self.clock.stage("fit"):
            images = images_in_plane(disk.vertices, disk.faces, flat.boundary)
            spinors = lifted_spinors(disk.vertices, disk.faces, images, len(rim), device)
            edge = np.searchsorted(domain.boundary.parameters, stage.panels.t, side="right") - 1
            readout = stage.readout_of(spinors[torch.as_tensor(edge, device=device)])
            knots = np.append(curve.breaks[rim], curve.breaks[rim[0]] + 1)
            slide = torch.as_tensor(np.interp(stage.panels.t, domain.boundary.parameters, knots), device=device)
            return fit_and_refine(stage, readout, slide, self.budget)


def rim_indices(loop: BoundaryLoop) -> Int[np.ndarray, " k"]:
    """Indices of the points that stand for the loop in the first fill, in Ω and for the poles; corners stay."""
    if len(loop) <= _LONGEST_RIM:
        return np.arange(len(loop))
    along = np.concatenate([[0.0], np.cumsum(loop.edge_lengths)[:-1]])
    wanted = np.searchsorted(along, np.arange(_LONGEST_RIM) * (loop.perimeter / _LONGEST_RIM))
    return np.unique(np.concatenate([[0], wanted.clip(0, len(loop) - 1), np.flatnonzero(loop.corners)]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """The best round: its discretisation, its fit, its residual at unit size, and its number.

    `folds` says that Ω would fold if it moved to the conformal moduli that a fit asked for.
    """

    stage: Discretisation
    fit: Fit
    residual: Residual
    rounds: int
    folds: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Budget:
    """What a fit may cost, and how near it shall come.

    Attributes:
        allowed: RMS distance at unit size.
        tolerance: that in mean edges.
        points: of all loops.
        offset: of the poles, in local edges.
        steps: all that are taken, and their limit.
    """

    allowed: float
    tolerance: float
    points: int
    offset: float
    steps: Steps

    def fit(self, stage: Discretisation, readout: Complex[Tensor, "n 2"], slide: Float[Tensor, " nodes"]) -> Fit:
        """Gauss-Newton with what is left of the steps."""
        # while it converges fast, steps cost little and every digit is real
        goal = 1e-6 * self.allowed
        return gauss_newton(
            stage.problem, readout, slide, goal=goal, allowed=self.allowed, steps=self.steps, stall=0.05
        )

    def excess(self, residual: Residual) -> float:
        """How many times farther from Γ than it may be: 1 or less where the tolerance is met."""
        return residual.misfit.excess(allowed=self.allowed, tolerance=self.tolerance)


def limit_of(fitted: Fitted, budget: Budget, turning: float) -> str:
    """What keeps a fit from coming nearer to Γ, as the end of a sentence.

    Args:
        fitted: the fit.
        budget: what it might cost.
        turning: angle that nine in ten of the points of Γ do not exceed.
    """
    stage = fitted.stage
    features = stage.network.mixing.shape[1]
    if budget.steps.are_spent:
        return "the limit on steps or on time was reached"
    if fitted.folds:
        return (
            "the domain would fold if its corners moved to where conformal moduli let them meet the loop's; "
            f"its network of {features} features follows the boundary no better"
        )
    at_corners = stage.share_at_corners(fitted.residual.energy)
    if at_corners > 0.5:
        where = f"{at_corners:.0%} of the squared distance lies within an edge of the loop's corners"
    elif turning > np.radians(25.0):  # beyond the turns of round loops of some 30 points
        where = f"the loop is rough: one point in ten turns by more than {np.degrees(turning):.0f}°"
    else:
        where = "more units bring it no nearer"
    if stage.is_full:
        return f"the network has as many features as it may have, {features}, and {where}"
    return f"a network of {features} features follows the boundary no better: {where}"


def fit_and_refine(
    stage: Discretisation, readout: Complex[Tensor, "n 2"], slide: Float[Tensor, " nodes"], budget: Budget
) -> Fitted:
    """Rounds of Gauss-Newton, each with more units where the residual of the last one was."""
    best: Fitted | None = None
    folds = False
    if stage.domain.holes:
        # the modulus of a mesh is never quite right
        first = _with_right_moduli(stage, readout, slide, budget)
        stage, folds, readout, slide = first.stage, first.folds, first.fit.readout, first.fit.slide
    for number in range(1, 4):
        fit = budget.fit(stage, readout, slide)
        residual = independent_residual(stage, fit, points=budget.points)
        # with the wrong moduli a fit can be near to Γ at its nodes and nowhere else
        if best is None and residual.misfit.rms > budget.allowed and stage.has_moduli and not stage.domain.holes:
            corrected = _with_right_moduli(stage, readout, slide, budget)
            folds = corrected.folds
            if corrected.residual.misfit.rms < residual.misfit.rms:
                stage, fit, residual = corrected.stage, corrected.fit, corrected.residual
        if best is not None and residual.misfit.rms >= best.residual.misfit.rms:
            break
        best = Fitted(stage=stage, fit=fit, residual=residual, rounds=number, folds=folds)
        excess = budget.excess(residual)
        if excess <= 1 or budget.steps.are_spent:
            break
        finer = stage.refined(residual.energy, residual.misfit.rms / excess)
        if finer is None:
            break
        readout, slide = finer.transferred(stage, fit)
        stage = finer
    assert best is not None
    return best


def _with_right_moduli(
    stage: Discretisation, readout: Complex[Tensor, "n 2"], slide: Float[Tensor, " nodes"], budget: Budget
) -> Fitted:
    """A fit in which Ω may move, so that its corners can meet Γ's; the moves are made, and it is fitted again."""
    last, folds = np.inf, False
    while True:
        fit = budget.fit(stage.flexible(), readout, slide)
        readout, slide = fit.readout, fit.slide
        # a shorter move changes nothing: Ω's scale is near to 1
        if stage.length_of_move(fit) < 0.01 * fit.residual:
            break
        try:
            moved = stage.moved(fit, offset=budget.offset)
        except DomainError:  # what is fitted so far stands
            folds = True
            break
        readout, slide = moved.transferred(stage, fit)
        stage = moved  # whatever the fit gained by the move, it is lost without it
        if fit.residual > last / 2 or budget.steps.are_spent:
            break
        last = fit.residual
    fit = budget.fit(stage, readout, slide)
    residual = independent_residual(stage, fit, points=budget.points)
    return Fitted(stage=stage, fit=fit, residual=residual, rounds=1, folds=folds)


def fitted_surface(fitted: Fitted) -> tuple[SpinorSurface, float]:
    """The fitted surface at unit size, and the RMS distance of its boundary from the fit's.

    The fit integrates φ along ∂Ω, the surface along paths in Ω: they agree unless a path runs too near to a pole.
    """
    stage, fit = fitted.stage, fitted.fit
    network, device = stage.network, fit.readout.device
    with torch.no_grad():
        network.readout.copy_(fit.readout)
    surface = SpinorSurface(network, stage.domain, order=_PATH_ORDER * fitted.rounds).to(device)
    if stage.domain.holes:
        close_period(surface)
    some = torch.arange(stage.panels.order // 2, len(stage.panels.t), stage.panels.order, device=device)
    boundary = (stage.problem.positions(network.readout.detach()) + fit.constant)[some]
    with torch.no_grad():
        offset = boundary - surface.position(torch.as_tensor(stage.panels.z, device=device)[some])
        # the median: where a path is too near to a pole the others are still right
        constant = offset.median(0).values
        surface.constant.copy_(constant)
    weight = stage.problem.arc_weights.reshape(-1, stage.panels.order).sum(1)
    return surface, float(weight @ (offset - constant).square().sum(1)) ** 0.5


def close_period(surface: SpinorSurface) -> None:
    """The least change of a network's read-outs with which Re ∮ φ dz = 0 around the hole, by Newton's method."""
    network, (hole,) = surface.model, surface.domain.holes
    assert isinstance(network, CauchyNetwork)
    device = network.readout.device
    panels = Panels.on(hole, panel_breaks(hole), surface.order)
    with torch.no_grad():
        features = network.features(torch.as_tensor(panels.z, device=device))
        step = torch.as_tensor(panels.dz * panels.weights, device=device)[:, None]
        for _ in range(4):
            p, q = (features @ network.readout).unbind(-1)
            gap = (step * phi(p, q)).sum(0).real
            by_p, by_q = ((2 * value[:, None] * step * features).sum(0) for value in (p, q))
            # Re ∮ δφ dz by the changes of both read-outs
            rows = torch.stack([torch.cat([by_p, -by_q]), -1j * torch.cat([by_p, by_q]), torch.cat([by_q, by_p])])
            change = -rows.mH @ torch.linalg.solve((rows @ rows.mH).real, gap).to(rows.dtype)
            network.readout.add_(change.reshape(2, -1).T)
