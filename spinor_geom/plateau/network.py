"""The network and the nodes of one round of a fit, its residual between them, and their refinement where that is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from spinor_geom.domain.panels import Panels
from spinor_geom.domain.plane_domain import PlaneDomain, panel_breaks
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.poles import Poles, corner_poles, edge_poles, place_poles, refining_poles
from spinor_geom.plateau.gauss_newton import Fit
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.moduli import CornerPairs, ModulusFields
from spinor_geom.plateau.problem import CurveTensors, PlateauProblem, TensorCurve

# Most features of p and q each, of four real unknowns: with 300 a step of the fit takes a quarter of a second, and its
# time grows with the cube.
_MAX_FEATURES = 420
# Gauss-Newton steps from a matched point of Γ to the nearest one: two or three are taken where they are not far apart.
_PROJECTIONS = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Discretisation:
    """Poles, panels and the network made from them."""

    domain: PlaneDomain  # Ω
    pairs: CornerPairs  # corners of Ω and Γ
    poles: Poles  # poles outside Ω
    degree: int  # of the polynomials
    at_corner: int  # number of poles that are clustered at each corner
    panels: Panels  # nodes on ∂Ω
    network: CauchyNetwork  # features orthonormal on the nodes
    problem: PlateauProblem  # the same as tensors, with Γ

    @classmethod
    def first(
        cls,
        domain: PlaneDomain,
        curves: tuple[CurveTensors, ...],
        pairs: CornerPairs,
        *,
        degree: int,
        offset: float,
        tolerance: float,
        branch: complex | None = None,
    ) -> Discretisation:
        """One pole a boundary vertex, panels between the vertices and halving towards corners.

        The offset of the poles is in local edges; corners take fewer poles for a loose tolerance, the RMS distance from
        Γ in mean edges. `branch` is a point in the hole around which p and q change their sign.
        """
        at_corner = corner_poles(tolerance)
        poles = place_poles(domain, offset=offset, at_corner=at_corner)
        breaks = tuple(map(panel_breaks, domain.boundaries))
        return cls._of(domain, curves, pairs, poles, breaks, degree, at_corner, branch)

    @classmethod
    def _of(
        cls,
        domain: PlaneDomain,
        curves: tuple[CurveTensors, ...],
        pairs: CornerPairs,
        poles: Poles,
        breaks: tuple[Float[np.ndarray, " _"], ...],
        degree: int,
        at_corner: int,
        branch: complex | None,
    ) -> Discretisation:
        device = curves[0].breaks.device
        unknowns = 4 * (degree + 1 + len(poles.positions))
        # four equations per unknown: with 1.5 the residual at the nodes of a rough loop can be a hundredth of that
        # between them, and the iteration wanders off
        order = int(np.ceil(4 * unknowns / (2 * sum(len(some) - 1 for some in breaks))))
        panels = Panels.around(domain, breaks, order)
        network = CauchyNetwork.orthonormal_on(
            torch.as_tensor(panels.z, device=device),
            torch.as_tensor(panels.arc_weights, device=device),
            poles=torch.as_tensor(poles.positions, device=device),
            scales=torch.as_tensor(poles.scales, device=device),
            degree=degree,
            branch=branch,
        )
        return cls(
            domain=domain,
            pairs=pairs,
            poles=poles,
            degree=degree,
            at_corner=at_corner,
            panels=panels,
            network=network,
            problem=PlateauProblem.on_panels(domain, panels, network, curves, pairs),
        )

    def refined(self, energy: Float[np.ndarray, " panels"], goal: float) -> Discretisation | None:
        """More poles and shorter panels where the residual is; None where nothing more may be added.

        The energy is the integral of the squared residual over each panel; those matter until the ones left out have
        less than half of goal² together.
        """
        order = np.argsort(energy)
        matter = np.empty(len(energy), dtype=bool)
        matter[order] = np.cumsum(energy[order]) > 0.5 * goal**2
        room = (_MAX_FEATURES - self.degree - len(self.poles.positions)) // 2
        if room <= 0 or not matter.any():
            return None
        matter[order[: max(0, len(energy) - room)]] = False
        chosen = self.panels.ends[matter]
        poles = self.poles + refining_poles(self.domain, chosen)
        middle = chosen.mean(axis=1)
        breaks = tuple(
            np.sort(np.concatenate([some, middle[middle // 2 == number] - 2 * number]))
            for number, some in enumerate(self.panels.rim_breaks)
        )
        return self._with(self.domain, self.pairs, poles, breaks)

    def _with(
        self, domain: PlaneDomain, pairs: CornerPairs, poles: Poles, breaks: tuple[Float[np.ndarray, " _"], ...]
    ) -> Discretisation:
        """The same curves on another Ω, or with other poles or panels."""
        return self._of(domain, self.problem.curves, pairs, poles, breaks, self.degree, self.at_corner, self.branch)

    @property
    def branch(self) -> complex | None:
        """The point in the hole around which p and q change their sign; none where they are single-valued."""
        return complex(self.network.branch[0]) if self.network.antiperiodic else None

    @property
    def is_full(self) -> bool:
        """Whether no more poles may be added."""
        return self.degree + len(self.poles.positions) + 2 > _MAX_FEATURES

    def share_at_corners(self, energy: Float[np.ndarray, " panels"]) -> float:
        """Share of a residual on the edges of ∂Ω that end at its corners."""
        middle = self.panels.ends.mean(axis=1)
        edge = np.searchsorted(self.domain.arcs[:, 0], middle, side="right") - 1
        corners = [boundary.corners for boundary in self.domain.boundaries]
        at_corner = np.concatenate([some | np.roll(some, -1) for some in corners])[edge]
        return float(energy[at_corner].sum() / energy.sum())

    @property
    def has_moduli(self) -> bool:
        """Whether Ω has a hole, or more corners than a conformal map can place where it wants."""
        return bool(self.domain.holes) or bool(np.count_nonzero(self.domain.boundary.corners) > 3)

    @cached_property
    def _modulus_fields(self) -> ModulusFields:
        if self.domain.holes:
            return ModulusFields.of_hole(self.domain, self.panels)
        # without the poles clustered at the corners: what they resolve, the moved boundary's spline would not
        poles = edge_poles(self.domain)
        smooth = CauchyNetwork.orthonormal_on(
            torch.as_tensor(self.panels.z),
            torch.as_tensor(self.panels.arc_weights),
            poles=torch.as_tensor(poles.positions),
            scales=torch.as_tensor(poles.scales),
            degree=self.degree,
        )
        return ModulusFields.of_corners(
            self.domain, self.panels, smooth.features(torch.as_tensor(self.panels.z)).numpy()
        )

    def flexible(self) -> Discretisation:
        """The same, with an unknown for each field along which Ω may move."""
        fields = torch.as_tensor(self._modulus_fields.nodes, device=self.problem.dz.device)
        return replace(self, problem=replace(self.problem, fields=fields))

    def length_of_move(self, fit: Fit) -> float:
        """Longest way of a vertex of ∂Ω when it moves as a fit asks."""
        return float(np.abs(self._modulus_fields.vertices @ fit.amounts.cpu().numpy()).max(initial=0.0))

    def moved(self, fit: Fit, *, offset: float) -> Discretisation:
        """The discretisation of Ω moved along its modulus fields as a fit asks, poles placed anew."""
        domain = self._modulus_fields.moved(self.domain, fit.amounts.cpu().numpy())
        rims = zip(self.panels.rim_breaks, self.domain.boundaries, domain.boundaries, strict=True)
        pairs = CornerPairs(t=domain.boundary.parameters[:-1][domain.boundary.corners], s=self.pairs.s)
        poles = place_poles(domain, offset=offset, at_corner=self.at_corner)
        breaks = tuple(np.interp(some, old.parameters, new.parameters) for some, old, new in rims)
        return self._with(domain, pairs, poles, breaks)

    def readout_of(self, spinors: Complex[Tensor, "nodes 2"]) -> Complex[Tensor, "n 2"]:
        """Least-squares read-outs of values of p and q at the nodes."""
        return self.problem.features[: self.problem.nodes].mH @ (self.problem.arc_weights[:, None] * spinors)

    def matchings(self, fit: Fit) -> tuple[Float[np.ndarray, "_ 2"], ...]:
        """Pairs (t, s) of a fit, increasing, of each boundary with its own t from 0 to 1."""
        slides = self.problem.by_rim(fit.slide.detach())
        return tuple(
            np.column_stack([t, slide.cpu().numpy()])
            for t, slide in zip(self.panels.own_parameters, slides, strict=True)
        )

    def matched(self, fit: Fit, panels: Panels) -> Float[np.ndarray, " k"]:
        """The parameters s that a fit gives to the nodes of other panels on ∂Ω."""
        pairs = zip(self.matchings(fit), panels.own_parameters, strict=True)
        return np.concatenate([interpolate_matching(matching, t) for matching, t in pairs])

    def transferred(self, other: Discretisation, fit: Fit) -> tuple[Complex[Tensor, "n 2"], Float[Tensor, " nodes"]]:
        """Read-outs and slide here of a fit made with another discretisation, of Ω or of a domain moved a little."""
        domains = zip(self.panels.own_parameters, self.domain.boundaries, other.domain.boundaries, strict=True)
        rims = [np.interp(t, here.parameters, there.parameters) for t, here, there in domains]
        points = [boundary.point(t) for boundary, t in zip(other.domain.boundaries, rims, strict=True)]
        z = torch.as_tensor(np.concatenate(points), device=fit.readout.device)
        with torch.no_grad():
            spinors = other.network.features(z) @ fit.readout
        slides = [interpolate_matching(matching, t) for matching, t in zip(other.matchings(fit), rims, strict=True)]
        return self.readout_of(spinors), torch.as_tensor(np.concatenate(slides), device=z.device)


def interpolate_matching(matching: Float[np.ndarray, "n 2"], t: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Curve parameters s at parameters t of ∂Ω, linear between the pairs and continued around the circle."""
    around = np.concatenate([matching[-1:] - 1, matching, matching[:1] + 1])
    return np.asarray(np.interp(t, around[:, 0], around[:, 1]))


def independent_residual(
    stage: Discretisation, fit: Fit, *, points: int
) -> tuple[Misfit, Float[np.ndarray, " panels"]]:
    """Distance to Γ on panels of another order, that share no node with those of the fit.

    Each point is projected on Γ near its matched parameter, not on the nearest part of Γ: a boundary that lies on the
    wrong part of the curve is not excused.

    Returns:
        The misfit of all rims, and the integral of the squared distance over each panel by arc length of ∂Ω, which has
        length 1 there.
    """
    count = len(stage.panels.ends)
    order = max(stage.panels.order + 3, int(np.ceil(3 * points / count)))
    dense = Panels.around(stage.domain, stage.panels.rim_breaks, order)
    problem = PlateauProblem.on_panels(stage.domain, dense, stage.network, stage.problem.curves, stage.pairs)
    velocity = problem.velocities(fit.readout)
    r = problem.integrate(velocity).real + fit.constant
    slide = torch.as_tensor(stage.matched(fit, dense), device=r.device)
    squares, rims = [], []
    for position, parameter, curve in zip(problem.by_rim(r), problem.by_rim(slide), problem.curves, strict=True):
        parameter = projected(position, parameter, curve, limit=0.5 / len(stage.panels.t))
        squares.append((position - curve.point_and_derivative(parameter)[0]).square().sum(1))
        rims.append(Misfit.of(position, parameter, curve))
    misfit = Misfit.together(rims)
    # closing it moves the boundary by about as much
    gap = float(problem.around_hole(velocity).real.norm())
    energy = (problem.arc_weights * torch.cat(squares)).reshape(count, order).sum(1)
    return misfit.and_astray(gap), energy.cpu().numpy()


def projected(
    r: Float[Tensor, "n 3"], slide: Float[Tensor, " n"], curve: TensorCurve, *, limit: float
) -> Float[Tensor, " n"]:
    """Parameters of the points of Γ nearest to given points, by Gauss-Newton steps of at most `limit` from a start."""
    for _ in range(_PROJECTIONS):
        point, tangent = curve.point_and_derivative(slide)
        move = ((r - point) * tangent).sum(1) / tangent.square().sum(1)
        slide = slide + move.clamp(-limit, limit)
        if float(move.abs().max()) < torch.finfo(move.dtype).eps ** 0.5:  # nothing is left of the next step
            break
    return slide
