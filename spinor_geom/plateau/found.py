"""What every route to a minimal surface returns: it at unit size, and how near to Γ it came."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.solution import Iteration, Route
from spinor_geom.surface.spinor_surface import SpinorSurface


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A minimal disk over a loop of diagonal 1 and centroid 0.

    Attributes:
        surface: the surface.
        curve: Γ.
        matching: (n, 2), increasing pairs (t, s): parameters of ∂Ω and of Γ.
        misfit: distance between its boundary and Γ.
        area: ½∮ r·Im(φ dz).
        route: how it was found.
        history: all steps so far, those of tries before it included.
        limit: what keeps it from coming nearer to Γ, as the end of a sentence.
    """

    surface: SpinorSurface
    curve: BoundaryCurve
    matching: Float[np.ndarray, "n 2"]
    misfit: Misfit
    area: float
    route: Route
    history: tuple[Iteration, ...]
    limit: str


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundAnnulus:
    """A minimal annulus between two loops of common diagonal 1.

    Attributes:
        surface: the surface.
        order: the numbers of the loops, that of the outer boundary of Ω first.
        reverse: whether the second loop runs against the boundary of the surface.
        matchings: of both boundaries of Ω, as in `Found`.
        misfit: distance of both from their curves.
        area: ½∮ r·Im(φ dz).
        modulus: logarithm of the ratio of the radii; none where Ω is no round annulus.
        spin: whether p and q come back to themselves around the hole.
        period: |Re ∮ φ dz| around it.
        route: how it was found.
        limit: what keeps it from coming nearer, as the end of a sentence.
    """

    surface: SpinorSurface
    order: tuple[int, int]
    reverse: bool
    matchings: tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "o 2"]]
    misfit: Misfit
    area: float
    modulus: float | None
    spin: Literal["periodic", "antiperiodic"]
    period: float
    route: Route
    limit: str
