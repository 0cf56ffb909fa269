"""The outer conormal of a surface along its rims, at quadrature nodes and their places on Γ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.interpolate import PchipInterpolator

from spinor_geom.domain.plane_domain import FourierBoundary, panel_breaks
from spinor_geom.domain.quadrature import Panels
from spinor_geom.plateau.rim_match import RimMatch
from spinor_geom.surface.array_surface import ArraySurface
from spinor_geom.surface.interior import RimPrimitive

# Gauss-Legendre nodes between neighbouring points of the loop or of ∂Ω; with 4 positions beside a rim are off by 6e-6,
# with 6 a fifth more time is spent
NODES = 5
_PLACINGS = 2  # steps of the constant and the nearest points of Γ; more change gradients by 1e-8


@dataclass(frozen=True, kw_only=True, eq=False)
class RimNodes:
    """Quadrature nodes along a rim of a surface, in the direction of ∂Ω.

    Attributes:
        panels: between neighbouring points of the loop and vertices of ∂Ω.
        velocity: φ dz/dt.
        places: parameters of the nearest points of Γ.
    """

    panels: Panels
    velocity: Complex[np.ndarray, "k 3"]
    places: Float[np.ndarray, " k"]

    @classmethod
    def along(cls, rim: RimMatch, surface: ArraySurface) -> RimNodes:
        """The nodes of one rim."""
        boundary, curve = rim.boundary, rim.curve
        primitive = RimPrimitive.along(boundary, surface.null_curve, NODES, _breaks(rim))
        r, t = primitive.primitive.real, primitive.panels.t
        pairs = np.concatenate([rim.matching - 1, rim.matching, rim.matching + 1])
        s = PchipInterpolator(*pairs.T)(t)
        low, high = _ends_of_sides(rim, t)
        for _ in range(_PLACINGS):
            s = np.clip(s, low, high)
            point, tangent = curve.point(s), curve.derivative(s)
            r = r + (point - r).mean(axis=0)
            s = s + ((r - point) * tangent).sum(axis=1) / (tangent * tangent).sum(axis=1)
        return cls(panels=primitive.panels, velocity=primitive.velocity, places=np.clip(s, low, high))

    @property
    def conormal(self) -> Float[np.ndarray, "k 3"]:
        """ν ds at the nodes, with weights: when Γ moves, the area changes by Σ conormal·δΓ(places).

        ν is the unit vector tangent to the surface and normal to its rim that points away from the surface.
        """
        # with Ω on the left
        return np.asarray(self.panels.weights[:, None] * self.velocity.imag)


def _breaks(rim: RimMatch) -> Float[np.ndarray, " b"]:
    """Ends of panels: at the points of the loop, between which Γ is smooth, and at vertices of ∂Ω."""
    own = np.sort(np.mod(rim.parameters(rim.curve.breaks[:-1]), 1.0))
    others = panel_breaks(rim.boundary)
    if isinstance(rim.boundary, FourierBoundary):
        # analytic: its vertices only limit the lengths of the panels
        place = np.searchsorted(own, others)
        gap = np.minimum(
            np.abs(np.append(own, own[0] + 1)[place] - others), np.abs(others - np.append(own[-1] - 1, own)[place])
        )
        others = others[(gap > 0.5 / (len(others) - 1)) | (others == 0) | (others == 1)]
    return np.union1d(own, others)


def _ends_of_sides(
    rim: RimMatch, t: Float[np.ndarray, " k"]
) -> tuple[Float[np.ndarray, " k"] | float, Float[np.ndarray, " k"] | float]:
    """Lowest and highest parameter of Γ on the side between corners of Ω that each parameter of ∂Ω belongs to."""
    if not rim.boundary.corners.any():
        return -np.inf, np.inf
    at = rim.curve.breaks[:-1][rim.curve.corners]
    ends = np.concatenate([at[-1:] - 1, at, at[:1] + 1])
    side = np.searchsorted(rim.boundary.parameters[:-1][rim.boundary.corners], t, side="right")
    # strictly inside, as Γ′ at a corner is that of the next side
    return ends[side], np.nextafter(ends[side + 1], -np.inf)
