"""Corners of Γ: which nodes may go where; and the moduli that decide whether Ω's corners or rims can meet those of Γ.

A conformal map takes three boundary points where one wants; with n corners n − 3 moduli of Ω must be right before a
surface over Ω can have all its corners on Γ's. A domain flattened from a mesh has them to a few digits, and is moved
with the fit along fields v = conj(g), g holomorphic with g' = 0 at the corners: conformal there, so that the angles
stay, and undone by no holomorphic change of coordinates. Between two rims the hole grows or shrinks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.domain.panels import Panels
from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary


@dataclass(frozen=True, kw_only=True, eq=False)
class CornerPairs:
    """Corners of Ω and of Γ that belong together: parameters t of ∂Ω and s of Γ, both ascending in one turn."""

    t: Float[np.ndarray, " c"]
    s: Float[np.ndarray, " c"]

    def slide_bounds(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
        """Lowest and highest s for nodes at parameters t: each node stays on its own side."""
        if not len(self.t):
            return np.broadcast_to([-np.inf, np.inf], (len(t), 2))
        ends = np.concatenate([self.s[-1:] - 1, self.s, self.s[:1] + 1])
        side = np.searchsorted(self.t, t, side="right")
        # not quite the corner: Γ′ there is that of the next side
        return np.stack([ends[side] + 1e-13, ends[side + 1] - 1e-13], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModulusFields:
    """Vector fields on ∂Ω that change the moduli of Ω: conj(g), which keeps its corners' angles, or a hole's growth."""

    # at the nodes of the panels they were made with, one field a column, in units of Ω
    nodes: Complex[np.ndarray, "nodes k"]
    # at the vertices of ∂Ω, or of its hole; each field is as large as Ω's diameter at most
    vertices: Complex[np.ndarray, "m k"]

    @classmethod
    def of_corners(cls, domain: PlaneDomain, panels: Panels, features: Complex[np.ndarray, "nodes n"]) -> ModulusFields:
        """As many fields as a domain has moduli: three fewer than its corners, none where it has fewer than four.

        The moves of least strain that change the moduli have g' a quadratic differential of Ω: holomorphic, with g'dz²
        real along ∂Ω. Of all g' made of the features that vanish at the corners, those nearest to this are taken. On a
        strip they stretch it along its length, however it winds.

        Source: Ahlfors, "Lectures on quasiconformal mappings" (1966), chapter VI, for the pairing.
        """
        boundary = domain.boundary
        corner = boundary.vertices[boundary.corners]
        count = len(corner) - 3
        if count <= 0:
            return cls(
                nodes=np.zeros((len(panels.t), 0), dtype=np.complex128),
                vertices=np.zeros((len(boundary.vertices), 0), dtype=np.complex128),
            )
        still = np.prod((panels.z[:, None] - corner) / domain.diameter, axis=1)
        slopes = (still / np.abs(still).max())[:, None] * features
        g_slopes = slopes @ _nearest_to_real(slopes, panels, count) * panels.dz[:, None]
        by_panel = g_slopes.reshape(-1, panels.order, count)
        totals = (panels.weights.reshape(-1, panels.order, 1) * by_panel).sum(axis=1)
        start = np.concatenate([np.zeros((1, count)), np.cumsum(totals, axis=0)])
        width = np.diff(panels.breaks)[:, None, None]
        g = (start[:-1, None] + width * (panels.cumulative @ by_panel)).reshape(-1, count)
        at_vertex = np.abs(panels.breaks - boundary.parameters[:-1, None]).argmin(axis=1)
        middle = start[at_vertex].mean(axis=0)
        size = np.abs(start[at_vertex] - middle).max(axis=0) / domain.diameter
        return cls(nodes=np.conj((g - middle) / size), vertices=np.conj((start[at_vertex] - middle) / size))

    @classmethod
    def of_hole(cls, domain: PlaneDomain, panels: Panels) -> ModulusFields:
        """The field along the hole's normals: longer where there is room, it keeps it near to a level curve."""
        (hole,), outer = domain.holes, domain.boundary.vertices
        w = hole.vertices
        ahead, back = np.roll(w, -1) - w, w - np.roll(w, 1)
        gap, _ = cKDTree(plane_coordinates(outer)).query(plane_coordinates(w))
        radius = np.abs(w - w.mean()).mean()
        tangent = ahead / np.abs(ahead) + back / np.abs(back)
        tangent /= np.maximum(np.abs(tangent), np.finfo(np.float64).tiny)
        field = 1j * tangent / (1 / gap + 1 / radius)
        spline = CubicSpline(hole.parameters, np.append(field, field[0]), bc_type="periodic")
        split = panels.order * panels.rims[0]
        nodes = np.zeros(len(panels.t), dtype=np.complex128)
        nodes[split:] = spline(panels.t[split:] - 2)
        return cls(nodes=nodes[:, None], vertices=field[:, None])

    def moved(self, domain: PlaneDomain, amounts: Float[np.ndarray, " k"]) -> PlaneDomain:
        """Ω with its hole grown, or with its boundary's vertices moved, at most by a tenth of its diameter."""
        move = self.vertices @ amounts
        if domain.holes:
            hole = SplineBoundary.through(domain.holes[0].vertices + move)
            return PlaneDomain.inside(domain.boundary, domain.log_scale, holes=(hole,))
        move *= min(1.0, 0.1 * domain.diameter / np.abs(move).max(initial=1e-300))
        return PlaneDomain.from_boundary(domain.boundary.vertices + move, domain.boundary.corners, domain.log_scale)


def _nearest_to_real(f: Complex[np.ndarray, "nodes n"], panels: Panels, count: int) -> Complex[np.ndarray, "n {count}"]:
    """Coefficients of the combinations of functions f with the least ∮|Im f dz²/|dz|²|² |dz| for their ∮|f|² |dz|."""
    root = np.sqrt(panels.arc_weights)[:, None]
    along = root * (panels.dz / np.abs(panels.dz))[:, None] ** 2 * f
    imaginary = np.concatenate([along.imag, along.real], axis=1)
    real = np.concatenate([along.real, -along.imag], axis=1)
    unreal = imaginary.T @ imaginary
    whole = unreal + real.T @ real
    whole[np.diag_indices_from(whole)] *= 1 + 1e-10  # the functions are nearly dependent
    _, best = scipy.linalg.eigh(unreal, whole, subset_by_index=[0, count - 1])
    n = f.shape[1]
    return np.asarray(best[:n] + 1j * best[n:])
