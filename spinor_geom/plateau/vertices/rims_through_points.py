"""Surfaces through the points of several rough rims, near smooth ones over averages of the rims."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import Array, Place, namespace, place_of, square, to_numpy
from spinor_geom.deadline import is_out_of_time
from spinor_geom.domain.plane_domain import Boundary, PlaneDomain
from spinor_geom.domain.quadrature import path_to
from spinor_geom.errors import DomainError, SurfaceError
from spinor_geom.holomorphic.poles import Poles, polygon_poles
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.newton import STEPS_TO_ROUNDING
from spinor_geom.plateau.rim_match import RimMatch
from spinor_geom.plateau.route_result import RimsResult, RouteResult
from spinor_geom.plateau.steps import Steps
from spinor_geom.plateau.vertices.edge_features import nodes_on_edges
from spinor_geom.plateau.vertices.through_points import NODES, Basis, Passing, nearest_through
from spinor_geom.plateau.vertices.vertex_route import passed, polygon_through
from spinor_geom.surface.array_surface import ArraySurface


@dataclass(frozen=True, kw_only=True, eq=False)
class SmoothSurface:
    """A minimal surface over averages of rims, on the unit disk less round holes."""

    surface: ArraySurface
    centres: Complex[np.ndarray, " holes"]
    radii: Float[np.ndarray, " holes"]
    branches: Complex[np.ndarray, " b"]  # the centres of holes around which p and q change their sign
    # the part of p and q at points that is singular in one hole, or outside the disk for 0, without the factor that
    # changes sign
    part: Callable[[Complex[np.ndarray, "n g"], int], Complex[Array, "n g 2"]]
    boundaries: Sequence[Boundary]  # the circles, in the direction of ∂Ω, with those below
    averages: Sequence[BoundaryCurve]
    matchings: Sequence[Float[np.ndarray, "_ 2"]]
    rims_result: RimsResult

    @property
    def place(self) -> Place:
        """The place of its arrays."""
        return place_of(self.surface.constant)

    def within(self, z: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        """The nearest points of the closed disk outside of the holes: p and q may have poles beyond."""
        z = z / np.maximum(np.abs(z), 1.0)
        for centre, radius in zip(self.centres, self.radii, strict=True):
            away = z - centre
            z = np.where(np.abs(away) < radius, centre + radius * np.exp(1j * np.angle(away)), z)
        return z

    def feet(self, loop: BoundaryLoop, number: int) -> Complex[np.ndarray, " n"]:
        """Points of the plane where the surface, continued linearly from Ω, is nearest to the points of a rim."""
        match = RimMatch(
            loop=loop, curve=self.averages[number], boundary=self.boundaries[number], matching=self.matchings[number]
        )
        z = match.points_in_domain()
        for _ in range(STEPS_TO_ROUNDING):
            near = self.within(z)
            velocity = self.surface.null_curve(near)
            away = loop.points - self.surface.position(near) - (velocity * (z - near)[:, None]).real
            z = z + 2 * (away * velocity.conj()).sum(-1) / square(velocity).sum(-1)
        return z


def surface_through(
    smooth: SmoothSurface, loops: Sequence[BoundaryLoop], *, allowed: float, steps: Steps
) -> RouteResult:
    """The surface through the points of rims that is nearest to a smooth one over averages of them.

    Args:
        smooth: the smooth surface.
        loops: the rims, in the order and direction of its boundaries.
        allowed: RMS distance from the points.
        steps: the steps of the solve.

    Raises:
        DomainError: a hole is too narrow for the teeth of its rim.
        SurfaceError: the surface is not finite.
    """
    points, place = [loop.points for loop in loops], smooth.place
    outer, *holes = (polygon_through(smooth.feet(loop, number)) for number, loop in enumerate(loops))
    domain = PlaneDomain.inside(outer, holes=tuple(holes))
    raw: Complex[Array, "k 2"] | None = None
    for nodes in (NODES, 2 * NODES):  # as for one rim
        basis, start = _basis_around(domain, smooth, nodes)
        readout = start if raw is None else basis.readout(raw)
        here = Passing(basis=basis, points=tuple(map(place.put, points)), raw=basis.raw(readout))
        readout = nearest_through(here, readout, start=start, allowed=allowed, steps=steps)
        here = here.at(readout)
        raw = here.raw
        if here.distance <= allowed or is_out_of_time():
            break
    here = here.at(here.closed(readout))
    if not np.isfinite(here.distance):
        raise SurfaceError("p and q of the surface over averages of the rims overflow near their points")
    surface = ArraySurface(basis.network(here.raw), domain)
    # differences from the points, by integrals along ∂Ω with twice as many nodes
    rims = surface.rim_primitives(2 * nodes)
    places = surface.position(np.array([boundary.vertices[0] for boundary in domain.boundaries]))
    off = [at + rim.at_breaks[:-1].real - each for at, rim, each in zip(places, rims, points, strict=True)]
    mean = np.concatenate(off).mean(axis=0)
    surface = ArraySurface(surface.model, domain, -mean)
    area = sum(rim.area + 0.5 * float(at @ rim.at_breaks[-1].imag) for at, rim in zip(places, rims, strict=True))
    return passed(surface, rims, points, [each - mean for each in off], area=area, near="that over averages")


def _basis_around(domain: PlaneDomain, smooth: SmoothSurface, nodes: int) -> tuple[Basis, Complex[Array, "k 2"]]:
    """The features on the rims of Ω, and the orthonormal read-outs of the smooth surface."""
    place = smooth.place
    poles = [polygon_poles(boundary.vertices) for boundary in domain.boundaries]
    if domain.contains(smooth.centres).any():
        raise DomainError("a hole of Ω is too narrow for the teeth of its rim", vertices=len(domain.vertices))
    for number, centre in enumerate(smooth.centres.tolist(), 1):
        # halfway to its centre, for low frequencies around the hole, as many poles as polynomials
        turn = np.exp(2j * np.pi * np.arange(NODES + 1) / (NODES + 1))
        radius = np.abs(domain.boundaries[number].vertices - centre).min() / 2
        poles[number] += Poles(positions=centre + radius * turn, scales=np.full(NODES + 1, radius))
    sizes = [len(boundary.vertices) for boundary in domain.boundaries]
    firsts = [sum(sizes[:number]) for number in range(len(sizes))]
    basis = Basis.on(
        [place.put(boundary.vertices) for boundary in domain.boundaries],
        poles,
        nodes=nodes,
        paths=[path_to(domain, first, nodes) for first in firsts],
        branches=place.put(smooth.branches),
    )
    parts = []
    for number, rim in enumerate(basis.rims):
        z = to_numpy(nodes_on_edges(rim.polygon, nodes))
        near = smooth.within(z)
        # continued linearly from Ω, from values inside
        parts.append(rim.nearest(2 * smooth.part(near, number) - smooth.part(smooth.within(2 * near - z), number)))
    return basis, namespace(smooth.surface.constant).concat(parts)
