"""The fit of one round of Gauss-Newton, and its surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from spinor_geom.arrays import namespace, place_of, square
from spinor_geom.domain.plane_domain import PARTS, PlaneDomain, panel_breaks
from spinor_geom.domain.quadrature import Panels
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.network.discretisation import Discretisation
from spinor_geom.plateau.network.gauss_newton import Fit
from spinor_geom.plateau.vertices.point_equations import PointEquations
from spinor_geom.surface.array_surface import PATH_ORDER, ArraySurface
from spinor_geom.surface.formulas import phi


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """The fit of one round, with its measured residual."""

    stage: Discretisation
    fit: Fit
    misfit: Misfit  # at unit size
    energy: Float[np.ndarray, " panels"]  # squared distance from Γ on each panel
    rounds: int = 1  # number of rounds so far
    folds: bool = False  # whether Ω folds before it reaches the right conformal moduli

    @property
    def features(self) -> int:
        """Number of features of the network."""
        return int(self.stage.network.mixing.shape[1])


def fitted_surface(fitted: Fitted, *, allowed: float) -> tuple[ArraySurface, float]:
    """The fitted surface at unit size, and the RMS distance of its boundary from the fit's.

    The fit integrates φ along ∂Ω, the surface along paths in Ω. The results agree unless a path is too close to a pole.
    """
    stage, fit = fitted.stage, fitted.fit
    place, xp = place_of(fit.readout), namespace(fit.readout)
    network = replace(stage.network, readout=fit.readout)
    some = xp.arange(stage.panels.order // 2, len(stage.panels.t), stage.panels.order)
    weight = stage.problem.arc_weights.reshape(-1, stage.panels.order).sum(1)
    # at notches, edges of the polygon can be outside Ω and close to poles. A finer polygon avoids this
    for parts in (1, PARTS):
        domain = stage.domain if parts == 1 else stage.domain.divided(parts)
        order = PATH_ORDER * fitted.rounds
        if domain.holes:
            network = with_closed_period(network, domain, order)
        boundary = (stage.problem.positions(network.readout) + fit.constant)[some]
        offset = boundary - ArraySurface(network, domain, order=order).position(place.put(stage.panels.z)[some])
        # the median ignores paths that are too close to a pole
        constant = xp.sort(offset, axis=0)[(len(offset) - 1) // 2]
        rms_offset = float(weight @ square(offset - constant).sum(1)) ** 0.5
        if rms_offset <= max(fitted.misfit.rms, allowed):
            break
    return ArraySurface(network, domain, constant, order=order), rms_offset


def with_closed_period(network: CauchyNetwork, domain: PlaneDomain, order: int) -> CauchyNetwork:
    """A network with the least change of read-outs for which Re ∮ φ dz = 0 around each hole, by Newton's method."""
    put, xp, readout = place_of(network.readout).put, namespace(network.readout), network.readout
    parts = [Panels.on(hole, panel_breaks(hole), order) for hole in domain.holes]
    features = [network.features(put(panels.z)) for panels in parts]
    steps = [put(panels.dz * panels.weights)[:, None] for panels in parts]
    for _ in range(4):
        gaps, rows = [], []
        for own, step in zip(features, steps, strict=True):
            values = own @ readout
            gaps.append((step * phi(*values.mT)).sum(0).real)
            rows.append((2 * (step * values).mT @ own).conj())
        by_p, by_q = xp.stack(rows, axis=-1)
        readout = readout + PointEquations.of(by_p, by_q).step(xp.stack(gaps), None)
    return replace(network, readout=readout)
