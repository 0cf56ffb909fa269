"""Integrals of φ to points inside Ω, by Cauchy's formula on ∂Ω or along segments from vertices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.deadline import seconds_left
from spinor_geom.domain.delaunay import flat_coordinates, plane_coordinates
from spinor_geom.domain.plane_domain import Boundary, PlaneDomain, panel_breaks
from spinor_geom.domain.quadrature import Panels, through_gauss_nodes
from spinor_geom.errors import DomainError
from spinor_geom.holomorphic.cauchy_sums import cauchy_sums
from spinor_geom.mesh.operators import nearest_on_mesh

Places = Complex[np.ndarray, " k"]
Breaks = Float[np.ndarray, " b"]
NullCurve = Callable[[Complex[np.ndarray, " n"]], Complex[np.ndarray, "n 3"]]  # φ

# Gauss-Legendre nodes on a panel, and the error of Cauchy's formula
ORDER, _ERROR = 16, 1e-10
_SAMPLES = np.linspace(0.0, 1.0, 5)  # parameters on a panel at which the distance of the points is measured
_HALVINGS = 40  # most halvings of a panel: a point may be on ∂Ω up to rounding
_SECONDS_PER_NODE = 4e-5  # and per point, that the integrals take: measured are 3e-5


@dataclass(frozen=True, kw_only=True, eq=False)
class RimPrimitive:
    """∫ φ dz along one boundary of Ω."""

    panels: Panels  # on the boundary
    velocity: Complex[np.ndarray, "n 3"]  # φ dz/dt at the nodes of the panels
    primitive: Complex[np.ndarray, "n 3"]  # ∫ φ dz from the start of the boundary to the nodes
    at_breaks: Complex[np.ndarray, "b 3"]  # the same to the ends of the panels. The last is ∮ φ dz

    @classmethod
    def along(cls, boundary: Boundary, phi: NullCurve, order: int, breaks: Breaks | None = None) -> RimPrimitive:
        """The integral of a function φ by panels of `order` nodes between breaks, by default `panel_breaks`."""
        panels = Panels.on(boundary, panel_breaks(boundary) if breaks is None else breaks, order)
        velocity = phi(panels.z) * panels.dz[:, None]
        by_panel = velocity.reshape(-1, order, 3)
        total = (panels.weights.reshape(-1, order, 1) * by_panel).sum(axis=1)
        at_breaks = np.concatenate([np.zeros((1, 3)), np.cumsum(total, axis=0)])
        inner = np.diff(panels.breaks)[:, None, None] * (panels.cumulative @ by_panel)
        primitive = (at_breaks[:-1, None] + inner).reshape(-1, 3)
        return cls(panels=panels, velocity=velocity, primitive=primitive, at_breaks=at_breaks)

    @property
    def area(self) -> float:
        """½∮ r·Im(φ dz) with r = 0 at the start."""
        return 0.5 * float(np.einsum("n,nk,nk->", self.panels.weights, self.primitive.real, self.velocity.imag))

    def at(self, t: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Displacements Re ∫ φ dz from the start to parameters in [0, 1], and their derivatives in t."""
        order, breaks = self.panels.order, self.panels.breaks
        panel = np.clip(np.searchsorted(breaks, t, side="right") - 1, 0, len(breaks) - 2)
        width = np.diff(breaks)[panel]
        velocity = self.velocity.real.reshape(-1, order, 3)[panel]
        values, integrals = (
            np.einsum("ng,ngk->nk", rows, velocity) for rows in through_gauss_nodes(order, (t - breaks[panel]) / width)
        )
        return self.at_breaks[panel].real + width[:, None] * integrals, values

    def scaled(self, factor: float) -> RimPrimitive:
        """The integral of the same function times a factor."""
        parts = {name: factor * getattr(self, name) for name in ("velocity", "primitive", "at_breaks")}
        return replace(self, **parts)

    def resolves(self, boundary: Boundary, z: Places) -> bool:
        """Whether `inside` is accurate at points inside the boundary."""
        tree = cKDTree(plane_coordinates(z))
        return not _are_long(boundary, self.panels.breaks, tree, self.panels.order).any()

    def inside(self, z: Places) -> Complex[np.ndarray, "k 3"]:
        """∫ φ dz from the start to points inside a boundary without holes."""
        # divided by Cauchy's integral of 1, which has nearly the same relative error near ∂Ω
        strengths = np.column_stack([self.primitive, np.ones(len(self.primitive))])
        strengths *= (self.panels.weights * self.panels.dz)[:, None]
        sums = cauchy_sums(self.panels.z, strengths, z)
        return np.asarray(sums[:, :3] / sums[:, 3:])


def breaks_for(boundary: Boundary, z: Places) -> tuple[Breaks, bool]:
    """Breaks of panels on a boundary, and whether they are short enough for Cauchy's formula at points inside it.

    They are longer if the time limit leaves too little time for so many panels.
    """
    tree = cKDTree(plane_coordinates(z))
    breaks = panel_breaks(boundary)
    for _ in range(_HALVINGS):
        long = _are_long(boundary, breaks, tree, ORDER)
        if not long.any():
            return breaks, True
        if _SECONDS_PER_NODE * (ORDER * (len(breaks) + np.count_nonzero(long)) + len(z)) > seconds_left():
            break
        breaks = np.sort(np.append(breaks, ((breaks[1:] + breaks[:-1]) / 2)[long]))
    return breaks, False


def _are_long(boundary: Boundary, breaks: Breaks, points: cKDTree, order: int) -> Bool[np.ndarray, " p"]:
    """Which panels with `order` nodes are too long for Cauchy's formula at points inside the boundary."""
    # the error at a distance d from a panel of length 2a falls like ρ^(−2·order), d/a = (ρ − 1/ρ)/2
    rho = _ERROR ** (-1 / (2 * order))
    t = breaks[:-1, None] + np.diff(breaks)[:, None] * _SAMPLES
    places = boundary.point(t.ravel())
    nearest = np.asarray(points.query(plane_coordinates(places))[0]).reshape(t.shape).min(axis=1)
    length = np.abs(np.diff(places.reshape(t.shape), axis=1)).sum(axis=1)
    return np.asarray(length > 4 / (rho - 1 / rho) * nearest)


def require_finite(z: Complex[np.ndarray, "*pts"]) -> None:
    """Raises a DomainError with the index of the first point that is NaN or infinite."""
    if not np.isfinite(z).all():
        raise DomainError(f"points of Ω must be finite, point {int(np.argmin(np.isfinite(z)))} is not")


def find_anchors(z: Places, domain: PlaneDomain) -> Int[np.ndarray, " k"]:
    """For each point of Ω a vertex of the triangulation such that the segment between them lies in Ω.

    It is the nearest corner of the triangle that contains the point, or of the nearest triangle. Inner corners come
    before those on ∂Ω, near which p and q have poles. A point that is not finite raises a DomainError.
    """
    require_finite(z)
    mesh = domain.triangulation
    _, face, _ = nearest_on_mesh(flat_coordinates(z), flat_coordinates(mesh.points), mesh.faces)
    corners = mesh.faces[face]
    distance = np.abs(mesh.points[corners] - z[:, None])
    on_boundary = corners < mesh.boundary_size
    closest = np.where(on_boundary, distance + 2 * distance.max(initial=0.0), distance).argmin(axis=1)
    return np.asarray(np.take_along_axis(corners, closest[:, None], axis=1)[:, 0])
