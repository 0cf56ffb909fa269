"""Quadrature along the rims of a surface: nodes on ∂Ω, the nearest points of Γ, and the outer conormal there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import modulo_one, shifted
from spinor_geom.domain.plane_domain import FourierBoundary, panel_breaks
from spinor_geom.domain.quadrature import Panels, rule
from spinor_geom.mesh.interpolation import EQUAL
from spinor_geom.mesh.piece_polynomials import ANALYTIC_DEGREE
from spinor_geom.plateau.harmonic.douglas import resampled
from spinor_geom.plateau.rim_match import RimMatch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.surface.array_surface import ArraySurface

# Gauss-Legendre nodes between neighbouring points of the loop or of ∂Ω. Networks over folded curves have poles near ∂Ω:
# their gradients are off by 1e-2 with 5 nodes, by 1e-3 with 8, and by less than the boundary with 12.
_ORDER = 12
# Fewest steps of ∂Ω between points of the loop. The trapezoidal rule converges with the power d + 1 of the step
# for Γ of degree d, and geometrically if Γ is analytic: half as many steps give gradients that are off by 6e-4 for
# splines of degree 7, and by 3e-5 for cubic ones.
_STEPS = {3: 16, 5: 8, 7: 4, ANALYTIC_DEGREE: 1}
# Alternating updates of c in r = c + Re ∫ φ dz and of the nearest points of Γ. More change gradients by 1e-8.
_PLACINGS = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class RimNodes:
    """Quadrature nodes along a rim of a surface, in the direction of ∂Ω.

    They are at equal steps where ∂Ω is analytic, and on panels where it is a spline.
    """

    z: Complex[np.ndarray, " k"]  # the nodes
    steps: Complex[np.ndarray, " k"]  # weights of ∮ f dz
    panels: Panels | None  # None at equal steps
    velocity: Complex[np.ndarray, "k 3"]  # φ dz, with the weights
    places: Float[np.ndarray, " k"]  # parameters of the nearest points of Γ

    @classmethod
    def all_of(cls, solution: PlateauSolution) -> list[RimNodes]:
        """The nodes of all rims of a solution, in order."""
        return [cls.along(rim, solution.array_surface) for rim in solution.rims]

    @classmethod
    def along(cls, rim: RimMatch, surface: ArraySurface) -> RimNodes:
        """The nodes of one rim."""
        boundary, curve = rim.boundary, rim.curve
        panels: Panels | None = None
        low: Float[np.ndarray, " k"] | float = -np.inf
        high: Float[np.ndarray, " k"] | float = np.inf
        if isinstance(boundary, FourierBoundary):
            s = _even_places(rim, boundary)
            z, dz, _ = boundary.grid(len(s))
            steps = dz / len(s)
        else:
            panels = Panels.on(boundary, _breaks(rim), _ORDER)
            z, steps = panels.z, panels.weights * panels.dz
            s = rim.places(panels.t)
            low, high = _ends_of_sides(rim, panels.t)
        velocity = surface.null_curve(z) * steps[:, None]
        r = _integral(velocity, panels)[0].real
        for _ in range(_PLACINGS):
            s = np.clip(s, low, high)
            point, tangent = curve.point(s), curve.derivative(s)
            r = r + (point - r).mean(axis=0)
            s = s + ((r - point) * tangent).sum(axis=1) / (tangent * tangent).sum(axis=1)
        return cls(z=z, steps=steps, panels=panels, velocity=velocity, places=np.clip(s, low, high))

    @property
    def conormal(self) -> Float[np.ndarray, "k 3"]:
        """ν ds at the nodes, with weights: when Γ moves, the area changes by Σ conormal·δΓ(places).

        ν is the unit vector tangent to the surface and normal to its rim that points away from the surface.
        """
        # since Ω is to the left of dz
        return self.velocity.imag

    def integral(self, f: Complex[np.ndarray, "k c"]) -> tuple[Complex[np.ndarray, "k c"], Complex[np.ndarray, " c"]]:
        """∫ f dz from the start of the rim to the nodes, and ∮ f dz."""
        return _integral(f * self.steps[:, None], self.panels)


def _integral(
    df: Complex[np.ndarray, "k c"], panels: Panels | None
) -> tuple[Complex[np.ndarray, "k c"], Complex[np.ndarray, " c"]]:
    """`RimNodes.integral`, from f dz with the weights."""
    if panels is not None:
        by_panel = df.reshape(-1, _ORDER, df.shape[1])
        total = by_panel.sum(axis=1)
        ends = np.cumsum(total, axis=0)
        inner = (panels.cumulative / rule("gauss", _ORDER).weights) @ by_panel
        return (inner + (ends - total)[:, None]).reshape(df.shape), ends[-1]
    n = len(df)
    spectrum = np.fft.fft(df, axis=0)
    total, k = spectrum[0].copy(), np.fft.fftfreq(n, 1 / n)
    k[0] = math.inf
    primitive = np.fft.ifft(spectrum * (-0.5j * n / np.pi * (1 / k))[:, None], axis=0)
    return primitive - primitive[0] + total * (np.arange(n) / n)[:, None], total


def _even_places(rim: RimMatch, boundary: FourierBoundary) -> Float[np.ndarray, " k"]:
    """Parameters of Γ that are matched to equal steps of ∂Ω, small enough to resolve ∂Ω and Γ."""
    t, s = rim.matching.T
    n = max(len(t), len(boundary.coefficients) + 1)
    if n > len(t) or np.abs(len(t) * t - np.arange(len(t))).max() > EQUAL:
        s = rim.places(np.arange(n) / n)
    # equal steps of ∂Ω may be long on Γ
    m = len(rim.curve.breaks) - 1
    pieces = np.interp(modulo_one(s), rim.curve.breaks, np.arange(m + 1))
    longest = np.abs(np.mod(shifted(pieces, -1) - pieces + m / 2, m) - m / 2).max()
    return np.asarray(resampled(s, n * math.ceil(_STEPS[rim.curve.degree] * longest)))


def _breaks(rim: RimMatch) -> Float[np.ndarray, " b"]:
    """Ends of panels: at the points of the loop, between which Γ is smooth, and at vertices of ∂Ω."""
    own = np.sort(np.mod(rim.parameters(rim.curve.breaks[:-1]), 1.0))
    return np.union1d(own, panel_breaks(rim.boundary))


def _ends_of_sides(
    rim: RimMatch, t: Float[np.ndarray, " k"]
) -> tuple[Float[np.ndarray, " k"] | float, Float[np.ndarray, " k"] | float]:
    """For each parameter of ∂Ω, the range of Γ's parameters on its side."""
    if not rim.boundary.corners.any():
        return -np.inf, np.inf
    at = rim.curve.breaks[:-1][rim.curve.corners]
    ends = np.concatenate([at[-1:] - 1, at, at[:1] + 1])
    side = np.searchsorted(rim.boundary.parameters[:-1][rim.boundary.corners], t, side="right")
    # strictly inside, because Γ′ at a corner is that of the next side
    return ends[side], np.nextafter(ends[side + 1], -np.inf)
