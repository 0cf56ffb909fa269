"""What training returns: a surface, how near its boundary came, and every step on the way."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.route_result import RouteResult
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface

Status = Literal["converged", "finished", "stopped", "diverged"]


@dataclass(frozen=True, kw_only=True)
class TrainingStep:
    """One epoch of RMSprop, or one step of Levenberg-Marquardt.

    Attributes:
        index: from 1.
        method: "RMSprop"; "distillation" of given p and q; "polishing" of the distance from Γ.
        loss: the mean of an epoch's losses; RMS error of p and q, or RMS distance from Γ, at the nodes after the step.
        boundary_error: largest distance of the boundary from Γ, measured on many more points than are trained on, in
            units of space; None where it was not measured.
        seconds: of training since its start; measuring an epoch's `boundary_error` and saving its state are left out.
    """

    index: int
    method: Literal["RMSprop", "distillation", "polishing"]
    loss: float
    boundary_error: float | None
    seconds: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Trained:
    """A surface from training.

    Attributes:
        surface: the surface; a `WeierstrassSurface` only where that was asked for. After a divergence it is that of the
            last good epoch.
        matching: (n, 2), increasing pairs (t, s): parameters of ∂Ω and of Γ.
        misfit: distance between its boundary and Γ, on points that were not trained on.
        diagonal: of the bounding box of Γ.
        history: the steps.
        status: "converged": the tolerance was met; "finished": all steps were done; "stopped": steps helped no more, or
            the time was up; "diverged": losses became infinite, NaN or far larger than at the start.
        reason: the same in one sentence, with figures.
        seconds: of training in all.
    """

    surface: SpinorSurface | WeierstrassSurface
    matching: Float[np.ndarray, "n 2"]
    misfit: Misfit
    diagonal: float
    history: tuple[TrainingStep, ...]
    status: Status
    reason: str
    seconds: float

    @property
    def max_per_diagonal(self) -> float:
        """Largest distance in diagonals of Γ."""
        return self.misfit.max / self.diagonal

    @property
    def rms_per_diagonal(self) -> float:
        """RMS distance in diagonals of Γ."""
        return self.misfit.rms / self.diagonal

    def as_disk(self, curve: BoundaryCurve, *, scale: float = 1.0) -> RouteResult:
        """The disk over a curve at unit size; Γ was the curve divided by the scale."""
        assert isinstance(self.surface, SpinorSurface)  # the other representation is refused with the options
        surface = self.surface.transform(scale=scale)
        return RouteResult(
            domain=surface.domain,
            surface_at=surface.placed,
            curves=(curve,),
            matchings=(self.matching,),
            misfit=self.misfit.enlarged(scale),
            area=float(surface.area()),
            route="trained",
            limit=self.reason,
        )
