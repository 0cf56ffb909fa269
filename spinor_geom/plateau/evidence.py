"""Checks of a solution that are independent of its solver, computed on first use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.domain.plane_domain import Boundary
from spinor_geom.domain.quadrature import rule
from spinor_geom.mesh.intersections import is_graph, self_intersections
from spinor_geom.mesh.loop_frame import LoopFrame
from spinor_geom.plateau.stability import Curvature, Stability, assess_stability, stable_by_curvature
from spinor_geom.plateau.steps import Clock
from spinor_geom.plateau.threads import one_thread
from spinor_geom.surface.array_surface import ArraySurface

# Gauss-Legendre nodes along the sides of triangles, boundary pieces, and paths. With 2 areas over smooth loops are off
# by 1e-4 instead of 2e-6.
_ORDER = 3


def _placed_surface(evidence: Evidence, frame: LoopFrame) -> ArraySurface:
    return evidence.surface.placed_by(frame)


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """A surface and its checks, each computed and timed on first use."""

    make: Callable[[], ArraySurface]  # makes the surface
    curvature: Curvature | None = None  # total curvature, if known
    is_plane: bool = False  # whether it is a plane region, which does not intersect itself
    clock: Clock = field(default_factory=Clock)  # stages "stability" and "certificates"

    def placed_by(self, frame: LoopFrame) -> Evidence:
        """The evidence of the surface in the coordinates outside a frame, with the checks computed so far."""
        placed = replace(self, make=partial(_placed_surface, self, frame))  # no lambda, which cannot be pickled
        known: dict[str, object] = {
            name: vars(self)[name] for name in ("stability", "self_intersections") if name in vars(self)
        }
        if "area_in_domain" in vars(self):
            known["area_in_domain"] = self.area_in_domain * frame.size**2
        vars(placed).update(known)
        return placed

    @cached_property
    def surface(self) -> ArraySurface:
        """The surface."""
        return self.make()

    @cached_property
    def stability(self) -> Stability:
        """Verdict of the second variation."""
        with self.clock.stage("stability"):
            if self.curvature and (stable := stable_by_curvature(self.curvature)):
                return stable
            with one_thread():
                return assess_stability(self.surface)

    @cached_property
    def area_in_domain(self) -> float:
        """The area by quadrature over Ω."""
        with one_thread(), self.clock.stage("certificates"):
            return area_in_domain(self.surface)

    @cached_property
    def self_intersections(self) -> int | None:
        """Pairs of intersecting triangles: see `crossing_faces`."""
        with one_thread(), self.clock.stage("certificates"):
            return 0 if self.is_plane else crossing_faces(self.surface)


def area_in_domain(surface: ArraySurface) -> float:
    """Area ∫_Ω λ² dx dy by quadrature over the triangles of Ω and the pieces between them and ∂Ω.

    It is independent of `ArraySurface.area`, an integral along ∂Ω. Near rough rims the triangles do not resolve λ.
    """
    mesh = surface.domain.triangulation
    parts = [_on_triangles(mesh.points[mesh.faces]), *map(_beside_rim, surface.domain.boundaries)]
    z, weights = map(np.concatenate, zip(*parts, strict=True))
    # weights beside the rims may be negative
    return max(float(weights @ surface.conformal_factor(z) ** 2), 0.0)


def crossing_faces(surface: ArraySurface) -> int | None:
    """Number of pairs of intersecting triangles in the surface's mesh over Ω's triangulation.

    None if the mesh has positions that are not finite.
    """
    mesh = surface.domain.triangulation
    # a low order suffices for intersections
    rough = ArraySurface(surface.model, surface.domain, surface.constant, spinor_map=surface.spinor_map, order=_ORDER)
    vertices = rough.position(mesh.points)
    if not np.isfinite(vertices).all():
        return None
    if not mesh.hole_sizes and is_graph(vertices, mesh.faces, mesh.boundary_size):
        return 0
    return len(self_intersections(vertices, mesh.faces))


def _on_triangles(corners: Complex[np.ndarray, "f 3"]) -> tuple[Complex[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Nodes and weights on triangles, by the Duffy transformation at the first corner."""
    gauss = rule("gauss", _ORDER)
    u, v = np.meshgrid(gauss.nodes, gauss.nodes, indexing="ij")
    folded = (gauss.weights[:, None] * gauss.weights * u).ravel()
    a, b, c = corners.T[:, :, None]
    z = a + u.ravel() * ((b - a) + v.ravel() * (c - b))
    weights = np.imag(np.conj(b - a) * (c - a)) * folded
    return z.ravel(), weights.ravel()


def _beside_rim(boundary: Boundary) -> tuple[Complex[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Nodes and signed weights between a boundary of Ω and the polygon of its vertices."""
    along = across = rule("gauss", _ORDER)
    t, width = boundary.parameters[:-1, None], np.diff(boundary.parameters)[:, None]
    arc, slope = boundary.point(t + width * along.nodes), width * boundary.derivative(t + width * along.nodes)
    side = (np.roll(boundary.vertices, -1) - boundary.vertices)[:, None]
    chord = boundary.vertices[:, None] + side * along.nodes
    v = across.nodes
    z = chord[..., None] + (arc - chord)[..., None] * v
    forwards = side[..., None] + (slope - side)[..., None] * v
    # Ω lies to the left
    density = -np.imag(np.conj(forwards) * (arc - chord)[..., None])
    weights = density * along.weights[:, None] * across.weights
    return z.ravel(), weights.ravel()
