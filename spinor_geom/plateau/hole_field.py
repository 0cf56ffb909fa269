"""The modulus of an annular Ω: its hole grows or shrinks with the fit.

A harmonic surface between two rims is conformal for one modulus of Ω only. A domain flattened from a mesh has it to a
few digits. It is corrected with the fit: the hole's boundary is moved along its normals, farther where the annulus is
wide, so that it keeps its shape near to a level curve of the harmonic function between the boundaries.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.domain.panels import Panels
from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary

# One move changes the annulus' width by this share at most.
_LARGEST_MOVE = 0.2


@dataclass(frozen=True, kw_only=True, eq=False)
class HoleField:
    """A vector field on ∂Ω, 0 on the outer boundary, along which the hole grows.

    Attributes:
        nodes: (nodes, 1), at the nodes of the panels it was made with, in units of Ω.
        vertices: (n, 1), at the vertices of the hole's boundary.
    """

    nodes: Complex[np.ndarray, "nodes 1"]
    vertices: Complex[np.ndarray, "n 1"]

    @classmethod
    def of(cls, domain: PlaneDomain, panels: Panels) -> HoleField:
        """The field whose length is about the width of the annulus, and nowhere more than the hole's radius.

        Args:
            domain: Ω, with one hole.
            panels: on all of ∂Ω.
        """
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
        """Ω with its hole grown.

        Raises:
            DomainError: its boundaries cross then.
        """
        move = self.vertices @ np.clip(amounts, -_LARGEST_MOVE, _LARGEST_MOVE)
        hole = SplineBoundary.through(domain.holes[0].vertices + move)
        return PlaneDomain.inside(domain.boundary, domain.log_scale, holes=(hole,))
