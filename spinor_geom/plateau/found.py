"""What every route to a minimal surface returns: it at unit size, and how near to Γ it came."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinor_geom.errors import DomainError, FirstFillError, SingularMatrixError, SurfaceError
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.solution import RouteName
from spinor_geom.surface.spinor_surface import SpinorSurface

# What a way to a surface may fail at.
FAILURES = (DomainError, FirstFillError, SingularMatrixError, SurfaceError)


@dataclass(frozen=True, kw_only=True)
class Between:
    """What is found of a surface between several loops beside what a disk has.

    Attributes:
        order: the numbers of the loops, that of the outer boundary of Ω first.
        back: whether each, in that order, runs against the boundary of the surface.
        modulus: see `capacity_path.mean_modulus`; none where Ω is no circular domain.
        antiperiodic: whether p and q change their sign around each hole.
        period: the largest |Re ∮ φ dz| around a hole.
    """

    order: tuple[int, ...]
    back: tuple[bool, ...]
    modulus: float | None
    antiperiodic: tuple[bool, ...]
    period: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A minimal surface over loops of common diagonal 1 and centre 0.

    Attributes:
        surface: the surface.
        curves: Γ on each boundary of Ω, as that runs.
        matchings: of each, (n, 2), increasing pairs (t, s): parameters of ∂Ω and of Γ.
        misfit: distance between its boundary and Γ.
        area: ½∮ r·Im(φ dz).
        route: how it was found.
        limit: what keeps it from coming nearer to Γ, as the end of a sentence.
        between: of several loops; none for a disk.
    """

    surface: SpinorSurface
    curves: tuple[BoundaryCurve, ...]
    matchings: tuple[Float[np.ndarray, "_ 2"], ...]
    misfit: Misfit
    area: float
    route: RouteName
    limit: str
    between: Between | None = None


class NoneBetweenError(Exception):
    """The verdict that no minimal surface of one piece spans several loops; its text says how it is known."""
