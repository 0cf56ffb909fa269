"""Where the poles of a Cauchy network go: outside Ω, an edge away from each boundary vertex, clustered at corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.domain.delaunay import Lengths, Places
from spinor_geom.domain.plane_domain import PlaneDomain

# A pole in a narrow gap outside Ω moves back until no part of ∂Ω is nearer than this share of its offset.
_FREE_SHARE = 0.6
_HALVINGS = 5
# Distances, in edges, at which a pole beside a rim's polygon is tried, and that which every edge keeps from it, in its
# own lengths: nearer poles take more quadrature nodes, farther ones miss sharp teeth.
_RIM_OFFSETS, _RIM_CLEARANCE = (0.5, 0.7, 1.0, 1.4), 0.35
_BENT = np.radians(45.0)  # turn from which a vertex gets a pole of its own: elsewhere those of its edges are enough
_ROWS = 512  # rows of a table of distances made at once
# Poles at a corner for a distance from Γ, in edges: the fewest are enough for the looser, the most for the tighter one.
_CORNER_POLES = (9, 16)
_CORNER_TOLERANCE = (1e-3, 1e-4)
# Decay of the distances to a corner, L·exp(−σ(√n − √k)): root-exponential convergence at corner singularities.
_CORNER_DECAY = 4.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Poles:
    """Poles ζ_k outside Ω and the scales d_k of their units d_k/(z − ζ_k)."""

    positions: Places
    scales: Lengths

    def __add__(self, other: Poles) -> Poles:
        """Both sets."""
        return Poles(
            positions=np.concatenate([self.positions, other.positions]),
            scales=np.concatenate([self.scales, other.scales]),
        )


def corner_poles(tolerance: float) -> int:
    """Number of poles in a corner's cluster that a distance from Γ, in mean edges, takes."""
    return int(np.interp(-np.log10(tolerance), -np.log10(_CORNER_TOLERANCE), _CORNER_POLES))


def place_poles(domain: PlaneDomain, *, offset: float = 1.0, at_corner: int = _CORNER_POLES[-1]) -> Poles:
    """One pole beside each boundary vertex that is no corner, and a cluster on the outer bisector of each corner.

    The offset is in local edge lengths of ∂Ω, along the outward normal; `corner_poles` tells the number in a cluster.

    Source: Gopal & Trefethen, "Solving Laplace problems with corner singularities via rational functions", SIAM J.
    Numer. Anal. 57 (2019), for the clusters.
    """
    poles, root = edge_poles(domain, offset=offset), np.sqrt(np.arange(1, at_corner + 1))
    for boundary in domain.boundaries:
        w, corners = boundary.vertices, np.flatnonzero(boundary.corners)
        if not len(corners):
            continue
        along = np.concatenate([[0.0], np.cumsum(np.abs(np.roll(w, -1) - w))])
        side = np.diff(np.append(along[corners], along[-1] + along[corners[0]]))
        reach = np.minimum(side, np.roll(side, 1)) / 2
        distance = (reach[:, None] * np.exp(-_CORNER_DECAY * (root[-1] - root))).ravel()
        foot, direction = np.repeat(w[corners], at_corner), np.repeat(_outward(w)[corners], at_corner)
        poles += _cleared(domain, foot, direction, distance)
    return poles


def edge_poles(domain: PlaneDomain, *, offset: float = 1.0) -> Poles:
    """One pole beside each boundary vertex that is no corner, along the outward normal; see `place_poles`."""
    polygons = [boundary.vertices for boundary in domain.boundaries]
    local = np.concatenate([(np.abs(np.roll(w, -1) - w) + np.abs(w - np.roll(w, 1))) / 2 for w in polygons])
    outward = np.concatenate([_outward(w) for w in polygons])
    plain = ~domain.corners
    return _cleared(domain, domain.vertices[plain], outward[plain], offset * local[plain])


def polygon_poles(vertices: Complex[np.ndarray, " n"]) -> Poles:
    """Poles for p and q that are smooth on a polygon's edges: beside each edge's middle, and at bent vertices.

    The polygon is simple, with Ω on its left. Each is at the first of some distances along the outer normal or
    bisector, in edges, where every edge is at least 0.35 of its own length away; in notches too narrow for that there
    is none. Vertices that turn by less than 45° have none of their own. The scale of a pole's unit is its distance from
    the polygon.
    """
    step = np.roll(vertices, -1) - vertices
    edge = np.abs(step)
    bent = np.flatnonzero(np.abs(np.angle(step / np.roll(step, 1))) > _BENT)
    foot = np.concatenate([vertices + step / 2, vertices[bent]])
    direction = np.concatenate([-1j * step / edge, _outward(vertices)[bent]])
    local = np.concatenate([edge, ((edge + np.roll(edge, 1)) / 2)[bent]])
    positions, scales = [], []
    for offset in _RIM_OFFSETS:
        position = foot + offset * local * direction
        distance, in_edges = _distance_outside(vertices, position)
        free = in_edges >= _RIM_CLEARANCE
        positions.append(position[free])
        scales.append(distance[free])
        foot, direction, local = foot[~free], direction[~free], local[~free]
    return Poles(positions=np.concatenate(positions), scales=np.concatenate(scales))


def _distance_outside(vertices: Complex[np.ndarray, " n"], z: Places) -> tuple[Lengths, Lengths]:
    """Distance of points from a polygon, and that from the edge that is nearest by its own length; negative in Ω."""
    step = np.roll(vertices, -1) - vertices
    inward = np.sign((np.conj(vertices) * step).imag.sum())
    edge = np.abs(step)
    nearest, in_edges = np.empty(len(z)), np.empty(len(z))
    for start in range(0, len(z), _ROWS):
        rows = slice(start, start + _ROWS)
        from_start = z[rows, None] - vertices
        share = np.clip((from_start * np.conj(step)).real / edge**2, 0, 1)
        distance = np.abs(from_start - share * step)
        # a ray to the right crosses an odd number of edges from inside
        above, left = from_start.imag > 0, (np.conj(step) * from_start).imag > 0
        crosses = (above != np.roll(above, -1, axis=1)) & (left == (step.imag > 0))
        sign = np.where(np.count_nonzero(crosses, axis=1) % 2, -inward, inward)
        nearest[rows], in_edges[rows] = sign * distance.min(axis=1), sign * (distance / edge).min(axis=1)
    return nearest, in_edges


def refining_poles(domain: PlaneDomain, panels: Float[np.ndarray, "k 2"]) -> Poles:
    """Poles that resolve panels of ∂Ω with given ends: half a length outside the middle, a third outside the ends."""
    start, end = panels.T
    length = np.abs(domain.point(end) - domain.point(start))
    both = np.concatenate([start, end])
    # the end of each boundary is its start
    ends, owner = np.unique(np.where(both % 2 == 1, both - 1, both), return_inverse=True)
    end_length = np.full(len(ends), np.inf)
    np.minimum.at(end_length, owner, np.concatenate([length, length]))
    t = np.concatenate([(start + end) / 2, ends])
    tangent = domain.derivative(t)
    distance = np.concatenate([length / 2, end_length / 3])
    return _cleared(domain, domain.point(t), -1j * tangent / np.abs(tangent), distance)


def _cleared(domain: PlaneDomain, foot: Places, direction: Places, distance: Lengths) -> Poles:
    """Poles at most `distance` out that keep clear of the rest of ∂Ω; those with no room are dropped."""
    distance = distance.copy()
    good = np.zeros(len(foot), dtype=bool)
    for _ in range(_HALVINGS + 1):
        open_ = np.flatnonzero(~good)
        position = foot[open_] + direction[open_] * distance[open_]
        good[open_] = domain.distance_outside(position) >= _FREE_SHARE * distance[open_]
        if good.all():
            break
        distance[~good] /= 2
    return Poles(positions=(foot + direction * distance)[good], scales=distance[good])


def _outward(w: Complex[np.ndarray, " m"]) -> Complex[np.ndarray, " m"]:
    """Outward bisectors at the vertices of a polygon, of length 1."""
    ahead, back = np.roll(w, -1) - w, w - np.roll(w, 1)
    tangent = ahead / np.abs(ahead) + back / np.abs(back)
    return np.asarray(-1j * tangent / np.maximum(np.abs(tangent), 1e-12))
