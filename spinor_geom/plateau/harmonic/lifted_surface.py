"""The domain Ω of a lift, and the surface of its p and q over it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache, partial

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import Array, Place, place_of
from spinor_geom.domain.plane_domain import FourierBoundary, PlaneDomain
from spinor_geom.holomorphic.array_model import ArrayModel
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.plateau.harmonic.lift import Lift
from spinor_geom.plateau.harmonic.traces import OnCircles
from spinor_geom.surface.array_surface import ArraySurface, Vector
from spinor_geom.surface.formulas import null_vector

# Largest turn of ∂Ω between neighbouring vertices, in radians. With twice or half of it areas by quadrature are equal
# to 4e-6. Without a limit that of a rim cut along triangles is off by 6e-3.
TURN_OF_AN_EDGE = np.radians(20.0)


def domain_of(lift: Lift, *boundaries: FourierBoundary) -> PlaneDomain:
    """Ω of a lift, the outer boundary first.

    Raises:
        DomainError: the polygon of the vertices is not simple.
    """
    if len(boundaries) == 1 and isinstance(lift.traces, OnCircles):
        return PlaneDomain.disk(n=len(boundaries[0].vertices))
    boundary, *holes = (_with_vertices(one, lift.slides.shape[1]) for one in boundaries)
    return PlaneDomain.inside(boundary, holes=tuple(holes))


def surface_of(lift: Lift, domain: PlaneDomain) -> Callable[[float, Vector], ArraySurface]:
    """A function that makes the surface of a lift at a scale and translation. It stores p and q only."""
    if domain.holes:
        root = place_of(lift.null_curve).put(domain.triangulation.points[[domain.root]])
        constant = null_vector(*lift.series.primitive(root)[0]).real + lift.shift
    else:
        constant = (_at_root(domain, lift.slides.shape[1], place_of(lift.slides)) @ lift.null_curve[0]).real
    # the model is made with the surface: many surfaces are never used
    return partial(_surface_at, lift.traces.model_of(lift.functions), domain, constant)


def _surface_at(
    model: Callable[[], ArrayModel], domain: PlaneDomain, constant: Float[Array, "3"], scale: float, translation: Vector
) -> ArraySurface:
    return ArraySurface(model(), domain, constant).placed(scale, translation)


@lru_cache(maxsize=16)
def _at_root(domain: PlaneDomain, n: int, place: Place) -> Complex[Array, " n"]:
    """Weights of the values at n equal steps of ∂Ω that give the value at Ω's root, by Cauchy's formula."""
    assert isinstance(domain.boundary, FourierBoundary)
    z, dz, _ = domain.boundary.grid(n)
    unit = dz / (z - domain.triangulation.points[domain.root])
    return place.put(unit / unit.sum())


def circles_of(domain: CircularDomain, counts: Sequence[int]) -> list[FourierBoundary]:
    """The boundaries of a circular domain, with at least `counts` vertices and edges no longer than the gaps."""
    radii = [1.0, *domain.radii.tolist()]
    counts = [
        max(count, math.ceil(2 * math.pi * radius / gap))
        for count, radius, gap in zip(counts, radii, domain.clearances.tolist(), strict=True)
    ]
    holes = zip(domain.centres.tolist(), radii[1:], counts[1:], strict=True)
    return [
        FourierBoundary.circle(1.0, counts[0]),
        *(FourierBoundary.round_hole(radius, count, centre=centre) for centre, radius, count in holes),
    ]


def _with_vertices(boundary: FourierBoundary, most: int) -> FourierBoundary:
    """∂Ω with enough vertices for a polygon close to ∂Ω, because the model is undefined outside Ω."""
    tangent = boundary.grid(most)[1]
    turn = np.append(0.0, np.cumsum(np.abs(np.angle(np.roll(tangent, -1) / tangent))))
    count = len(boundary.vertices)
    while 2 * count <= most:
        at_vertices = np.interp(np.arange(count + 1) / count, np.arange(most + 1) / most, turn)
        if np.diff(at_vertices).max() <= TURN_OF_AN_EDGE:
            break
        count *= 2
    return boundary if count == len(boundary.vertices) else FourierBoundary(boundary.coefficients, count)
