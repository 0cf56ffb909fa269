"""What every route to a minimal disk returns: a surface at unit size and how near to Γ it came."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinor_geom.plateau.solution import Iteration, Route
from spinor_geom.surface.spinor_surface import SpinorSurface


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A minimal disk over a loop of diagonal 1 and centroid 0.

    Attributes:
        surface: the surface.
        matching: (n, 2), increasing pairs (t, s): parameters of ∂Ω and of Γ.
        rms: root of the mean squared distance of its boundary from Γ.
        max: largest distance.
        area: ½∮ r·Im(φ dz).
        route: how it was found.
        history: all steps so far, those of tries before it included.
        limit: what keeps it from coming nearer to Γ, as the end of a sentence.
    """

    surface: SpinorSurface
    matching: Float[np.ndarray, "n 2"]
    rms: float
    max: float
    area: float
    route: Route
    history: tuple[Iteration, ...]
    limit: str
