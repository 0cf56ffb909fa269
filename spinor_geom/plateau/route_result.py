"""The result of a route to a minimal surface, and the errors of routes that find none."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import DomainError, FirstFillError, SingularMatrixError, SurfaceError, UnsolvableError
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.solution import RouteName
from spinor_geom.plateau.stability import Curvature
from spinor_geom.surface.array_surface import ArraySurface, Vector

# The errors of a route that finds no surface.
FAILURES = (DomainError, FirstFillError, SingularMatrixError, SurfaceError)


@dataclass(frozen=True, kw_only=True)
class RimsResult:
    """Properties of a surface between several loops."""

    order: tuple[int, ...]  # numbers of the loops in the order of the boundaries of Ω, the outer boundary first
    backward: tuple[bool, ...]  # in that order: whether the loop's direction is opposite to the boundary's
    antiperiodic: tuple[bool, ...]  # for each hole: whether p and q change sign around it
    period: float  # the largest |Re ∮ φ dz| around a hole
    modulus: float | None = None  # see `capacity_path.mean_modulus`, or None if Ω is not a circular domain


@dataclass(frozen=True, kw_only=True, eq=False)
class RouteResult:
    """A minimal surface over loops whose common diagonal is 1 and whose common centre is 0."""

    domain: PlaneDomain  # Ω
    surface_at: Callable[[float, Vector], ArraySurface]  # the surface, scaled and then moved
    curves: tuple[BoundaryCurve, ...]  # Γ on each boundary of Ω, in its direction
    matchings: tuple[Float[np.ndarray, "_ 2"], ...]  # see `RimMatch.matching`
    misfit: Misfit  # distance of the surface's boundary from Γ
    area: float  # ½∮ r·Im(φ dz)
    route: RouteName
    limit: str  # why the distance from Γ was not reduced further, as the end of a sentence
    curvature: Curvature | None = None  # total curvature of the surface, if the route computes it
    rims_result: RimsResult | None = None  # None for a disk
    resume: Callable[[Any], RouteResult] | None = None  # goes on from here, for a problem with another tolerance

    @property
    def surface(self) -> ArraySurface:
        """The surface at unit size."""
        return self.surface_at(1.0, np.zeros(3))


COLLAPSED = "the energy of surfaces between the rims decreases from every start until the surface degenerates"


class NoConnectedSurfaceError(Exception):
    """No connected minimal surface spans several loops. The message gives the reason."""


@contextmanager
def typed_failures() -> Iterator[None]:
    """Raises an UnsolvableError in place of the LinAlgError of numpy, scipy or torch."""
    try:
        yield
    except (np.linalg.LinAlgError, RuntimeError) as error:
        # that of torch, which need not be imported, is a RuntimeError
        if not type(error).__name__.endswith("LinAlgError"):
            raise
        raise UnsolvableError(reason=str(error).splitlines()[0].rstrip(".")) from error
