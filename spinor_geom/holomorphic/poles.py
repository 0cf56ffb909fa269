"""Poles of Cauchy networks: outside Ω, an edge away from each boundary vertex, and clustered at corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import shifted
from spinor_geom.domain.delaunay import Lengths, Places, plane_coordinates
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.mesh.operators import winding_numbers

# In a narrow gap the offset of a pole is halved until no part of ∂Ω is nearer than this share of it.
_FREE_SHARE = 0.6
_HALVINGS = 5
# Offsets, in edges, that are tried for a pole at an edge of a polygon, and its least distance from every edge, in
# lengths of that edge: nearer poles need more quadrature nodes, farther ones do not resolve sharp corners.
_EDGE_OFFSETS, _EDGE_CLEARANCE = (0.5, 0.7, 1.0, 1.4), 0.35
_BENT = np.radians(45.0)  # turning angle from which a vertex gets its own pole
_ROWS = 512  # rows of a table of distances
# Numbers of poles at a corner for two tolerances, distances from Γ in mean edges.
_CORNER_POLES, _CORNER_TOLERANCES = (9, 16), (1e-3, 1e-4)
# σ in the distances L·exp(−σ(√n − √k)) to a corner, for root-exponential convergence at corner singularities
_CORNER_DECAY = 4.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Poles:
    """Poles ζ_k outside Ω and the scales d_k of their units d_k/(z − ζ_k)."""

    positions: Places
    scales: Lengths

    def __add__(self, other: Poles) -> Poles:
        """The union of both sets."""
        return Poles(
            positions=np.concatenate([self.positions, other.positions]),
            scales=np.concatenate([self.scales, other.scales]),
        )


def corner_poles(tolerance: float) -> int:
    """Number of poles in a corner's cluster for a tolerance, the distance from Γ in mean edges."""
    return int(np.interp(-np.log10(tolerance), -np.log10(_CORNER_TOLERANCES), _CORNER_POLES))


def place_poles(domain: PlaneDomain, *, offset: float = 1.0, at_corner: int = _CORNER_POLES[-1]) -> Poles:
    """The poles of `edge_poles`, and a cluster of `at_corner` poles on the outer bisector of each corner.

    Source: Gopal & Trefethen, "Solving Laplace problems with corner singularities via rational functions", SIAM J.
    Numer. Anal. 57 (2019).
    """
    poles, root = edge_poles(domain, offset=offset), np.sqrt(np.arange(1, at_corner + 1))
    for boundary in domain.boundaries:
        w, corners = boundary.vertices, np.flatnonzero(boundary.corners)
        if not len(corners):
            continue
        along = np.concatenate([[0.0], np.cumsum(np.abs(shifted(w, -1) - w))])
        side = np.diff(np.append(along[corners], along[-1] + along[corners[0]]))
        reach = np.minimum(side, shifted(side, 1)) / 2
        distance = (reach[:, None] * np.exp(-_CORNER_DECAY * (root[-1] - root))).ravel()
        foot, direction = np.repeat(w[corners], at_corner), np.repeat(_outward(w)[corners], at_corner)
        # in a notch poles on the bisector are nearer to its sides than to the corner
        step = (shifted(w, -1)[corners] - w[corners]) / _outward(w)[corners]
        sine = np.where(step.real > 0, np.abs(step.imag) / np.abs(step), 1.0)
        poles += _cleared(domain, foot, direction, distance, np.repeat(sine, at_corner))
    return poles


def edge_poles(domain: PlaneDomain, *, offset: float = 1.0) -> Poles:
    """One pole for each boundary vertex that is not a corner, `offset` local edges away along the outward normal."""
    polygons = [boundary.vertices for boundary in domain.boundaries]
    local = np.concatenate([(np.abs(shifted(w, -1) - w) + np.abs(w - shifted(w, 1))) / 2 for w in polygons])
    outward = np.concatenate([_outward(w) for w in polygons])
    plain = ~domain.corners
    return _cleared(domain, domain.vertices[plain], outward[plain], offset * local[plain])


def polygon_poles(vertices: Complex[np.ndarray, " n"]) -> Poles:
    """Poles outside a simple polygon with Ω on its left: for each edge, and each vertex that turns by more than 45°.

    A pole is on the outward normal of the edge's middle, or the bisector of the vertex, at the first of the offsets
    where every edge is at least 0.35 of its length away. Notches that are too narrow have none. The scale is the
    distance from the polygon.
    """
    step = shifted(vertices, -1) - vertices
    edge = np.abs(step)
    bent = np.flatnonzero(np.abs(np.angle(step / shifted(step, 1))) > _BENT)
    foot = np.concatenate([vertices + step / 2, vertices[bent]])
    direction = np.concatenate([-1j * step / edge, _outward(vertices)[bent]])
    local = np.concatenate([edge, ((edge + shifted(edge, 1)) / 2)[bent]])
    positions, scales = [], []
    for offset in _EDGE_OFFSETS:
        if not len(foot):
            break
        position = foot + offset * local * direction
        distance, in_edges = _distance_outside(vertices, position)
        free = in_edges >= _EDGE_CLEARANCE
        positions.append(position[free])
        scales.append(distance[free])
        foot, direction, local = foot[~free], direction[~free], local[~free]
    return Poles(positions=np.concatenate(positions), scales=np.concatenate(scales))


def _distance_outside(vertices: Complex[np.ndarray, " n"], z: Places) -> tuple[Lengths, Lengths]:
    """Smallest distances of points from a polygon's edges, absolute and in lengths of the edge, negative in Ω."""
    step = shifted(vertices, -1) - vertices
    edge = np.abs(step)
    is_clockwise = np.imag(np.conj(vertices) * step).sum() < 0  # around a hole of Ω
    winding = np.rint(winding_numbers(plane_coordinates(vertices), plane_coordinates(z)))
    sign = np.where(winding + is_clockwise > 0, -1, 1)
    nearest, in_edges = np.empty(len(z)), np.empty(len(z))
    for start in range(0, len(z), _ROWS):
        rows = slice(start, start + _ROWS)
        # along each edge and across it, in its lengths
        from_start = (z[rows, None] - vertices) / step
        from_start -= from_start.real.clip(0, 1)
        distance = np.abs(from_start)
        nearest[rows], in_edges[rows] = (distance * edge).min(axis=1), distance.min(axis=1)
    return sign * nearest, sign * in_edges


def refining_poles(domain: PlaneDomain, panels: Float[np.ndarray, "k 2"]) -> Poles:
    """Poles that resolve panels of ∂Ω: half a panel length outside their midpoints, a third outside their ends."""
    start, end = panels.T
    length = np.abs(domain.point(end) - domain.point(start))
    both = np.concatenate([start, end])
    # the end of each closed boundary is its start
    ends, owner = np.unique(np.where(both % 2 == 1, both - 1, both), return_inverse=True)
    end_length = np.full(len(ends), np.inf)
    np.minimum.at(end_length, owner, np.concatenate([length, length]))
    t = np.concatenate([(start + end) / 2, ends])
    tangent = domain.derivative(t)
    distance = np.concatenate([length / 2, end_length / 3])
    return _cleared(domain, domain.point(t), -1j * tangent / np.abs(tangent), distance)


def _cleared(
    domain: PlaneDomain, foot: Places, direction: Places, distance: Lengths, share: Lengths | float = 1.0
) -> Poles:
    """Poles at most `distance` from their feet on ∂Ω and clear of the rest of it. Those without room are dropped.

    `share` is that of the distance within which ∂Ω is straight.
    """
    distance = distance.copy()
    good = np.zeros(len(foot), dtype=bool)
    free = np.broadcast_to(_FREE_SHARE * share, foot.shape)
    for _ in range(_HALVINGS + 1):
        open_ = np.flatnonzero(~good)
        position = foot[open_] + direction[open_] * distance[open_]
        good[open_] = domain.distance_outside(position) >= free[open_] * distance[open_]
        if good.all():
            break
        distance[~good] /= 2
    return Poles(positions=(foot + direction * distance)[good], scales=distance[good])


def _outward(w: Complex[np.ndarray, " m"]) -> Complex[np.ndarray, " m"]:
    """Outward bisectors at the vertices of a polygon, of length 1."""
    ahead, back = shifted(w, -1) - w, w - shifted(w, 1)
    tangent = ahead / np.abs(ahead) + back / np.abs(back)
    return np.asarray(-1j * tangent / np.maximum(np.abs(tangent), 1e-12))
