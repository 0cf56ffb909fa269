"""What every route to a minimal surface returns: it at unit size, and how near to Γ it came."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import DomainError, FirstFillError, SingularMatrixError, SurfaceError, UnsolvableError
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.solution import RouteName
from spinor_geom.plateau.stability import Curvature
from spinor_geom.surface.spinor_surface import SpinorSurface, Vector

# What a way to a surface may fail at.
FAILURES = (DomainError, FirstFillError, SingularMatrixError, SurfaceError)


@contextmanager
def typed_failures() -> Iterator[None]:
    """Raises an UnsolvableError for what numpy, scipy and torch raise where equations cannot be solved."""
    try:
        yield
    except (np.linalg.LinAlgError, torch.linalg.LinAlgError) as error:  # type: ignore[attr-defined]
        raise UnsolvableError(reason=str(error).splitlines()[0].rstrip(".")) from error


@dataclass(frozen=True, kw_only=True)
class Between:
    """What is found of a surface between several loops beside what a disk has."""

    order: tuple[int, ...]  # the numbers of the loops, that of the outer boundary of Ω first
    back: tuple[bool, ...]  # whether each, in that order, runs against the boundary of the surface
    antiperiodic: tuple[bool, ...]  # whether p and q change their sign around each hole
    period: float  # the largest |Re ∮ φ dz| around a hole
    modulus: float | None = None  # see `capacity_path.mean_modulus`; none where Ω is no circular domain


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A minimal surface over loops of common diagonal 1 and centre 0."""

    domain: PlaneDomain  # Ω
    surface_at: Callable[[float, Vector], SpinorSurface]  # makes the surface, enlarged and moved
    curves: tuple[BoundaryCurve, ...]  # Γ on each boundary of Ω, as that runs
    # of each, (n, 2), increasing pairs (t, s): parameters of ∂Ω and of Γ
    matchings: tuple[Float[np.ndarray, "_ 2"], ...]
    misfit: Misfit  # distance between its boundary and Γ
    area: float  # ½∮ r·Im(φ dz)
    route: RouteName  # how it was found
    limit: str  # what keeps it from coming nearer to Γ, as the end of a sentence
    curvature: Curvature | None = None  # total, of the surface, where the route knows it
    between: Between | None = None  # of several loops; none for a disk

    @property
    def surface(self) -> SpinorSurface:
        """The surface, made anew."""
        return self.surface_at(1.0, np.zeros(3))


class NoneBetweenError(Exception):
    """The verdict that no minimal surface of one piece spans several loops; its text says how it is known."""
