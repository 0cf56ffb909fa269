"""The result of training: a surface, the distance of its boundary from Γ, and the history of steps."""

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
        method: "RMSprop", "distillation" of given p and q, or "polishing" of the distance from Γ.
        loss: the mean loss of the epoch, or the RMS error of p and q, or the RMS distance from Γ, after the step.
        boundary_error: largest distance of the boundary from Γ, in units of space, or None if it was not measured.
        seconds: of training since the start, without the time for `boundary_error`.
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
        surface: the surface, a `WeierstrassSurface` for that representation. If training diverged, that of the epoch
            before.
        matching: (n, 2), increasing pairs (t, s) of parameters of ∂Ω and of Γ.
        misfit: distance between the boundary and Γ, at points that were not used in training.
        diagonal: diagonal of the bounding box of Γ.
        history: the steps.
        status: "converged": the distance is within the tolerance. "finished": all epochs are done. "stopped": no more
            progress, or the time limit. "diverged": the loss became infinite, NaN or far larger than at the start.
        reason: the status as a sentence with figures.
        seconds: time of training.
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
        """The surface scaled by `scale` as the result for a curve at unit size."""
        assert isinstance(self.surface, SpinorSurface)  # the options exclude the other representation
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
