"""What every route to a minimal surface returns: it at unit size, and how near to Γ it came."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.solution import Iteration, RouteName
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
    route: RouteName
    history: tuple[Iteration, ...]
    limit: str


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundBetween:
    """A minimal surface between two loops or more of common diagonal 1.

    Attributes:
        surface: the surface.
        order: the numbers of the loops, that of the outer boundary of Ω first.
        back: whether each, in that order, runs against the boundary of the surface.
        matchings: of all boundaries of Ω, as in `Found`.
        curves: Γ of each where it is the surface's own boundary between a loop's points; none for the loops' curves.
        misfit: distance of all from their curves.
        area: ½∮ r·Im(φ dz).
        modulus: see `capacity_path.mean_modulus`; none where Ω is no circular domain.
        antiperiodic: whether p and q change their sign around each hole.
        period: the largest |Re ∮ φ dz| around a hole.
        route: how it was found.
        limit: what keeps it from coming nearer, as the end of a sentence.
    """

    surface: SpinorSurface
    order: tuple[int, ...]
    back: tuple[bool, ...]
    matchings: tuple[Float[np.ndarray, "_ 2"], ...]
    misfit: Misfit
    area: float
    modulus: float | None
    antiperiodic: tuple[bool, ...]
    period: float
    route: RouteName
    limit: str
    curves: tuple[BoundaryCurve, ...] | None = None
