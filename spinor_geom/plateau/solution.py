"""What a solved Plateau problem returns, with its evidence."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Complex, Float
from scipy.interpolate import PchipInterpolator

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.shown import Shown
from spinor_geom.surface.spinor_surface import SpinorSurface

Route = Literal["plane", "disk", "unfolded", "deformed", "flattened", "network", "trained"]


@dataclass(frozen=True, kw_only=True)
class Iteration:
    """One step of a solver.

    Attributes:
        index: from 1.
        method: of the step.
        residual: what the steps bring towards 0: Gauss-Newton's RMS distance from Γ at the nodes after it, in units of
            the loop's diagonal; Douglas-Newton's RMS gradient of the energy before it, relative to its two factors. In
            the training of a network: the RMS error of p and q ("distillation"), the RMS distance from Γ in diagonals
            ("polishing"), an epoch's mean loss ("RMSprop").
    """

    index: int
    method: Literal["Gauss-Newton", "Douglas-Newton", "distillation", "polishing", "RMSprop"]
    residual: float


@dataclass(frozen=True, kw_only=True)
class BoundaryResidual:
    """Distance between the surface's boundary and Γ, on points that are not the nodes of the fit; mesh units.

    Attributes:
        rms: root of the mean squared distance by arc length.
        max: largest distance.
        mean_edge: mean edge length of the loop.
        diagonal: diagonal of the loop's bounding box.
    """

    rms: float
    max: float
    mean_edge: float
    diagonal: float

    @property
    def rms_per_edge(self) -> float:
        """`rms` in mean loop edges."""
        return self.rms / self.mean_edge

    @property
    def max_per_edge(self) -> float:
        """`max` in mean loop edges."""
        return self.max / self.mean_edge

    @property
    def rms_per_diagonal(self) -> float:
        """`rms` in diagonals of the loop."""
        return self.rms / self.diagonal

    @property
    def max_per_diagonal(self) -> float:
        """`max` in diagonals of the loop."""
        return self.max / self.diagonal


@dataclass(frozen=True, kw_only=True)
class Stability:
    """Whether a minimal disk is a local minimiser of area.

    Attributes:
        verdict: "stable", "unstable", or "undecided" where the error of the computation leaves both possible.
        eigenvalue: the smallest μ of −Δu = μ|dn|²u with u = 0 on the boundary, n the Gauss map; above 1 the second
            variation of area is positive. None where the total curvature alone decides.
        index: Morse index, the number of μ below 1; None where the error leaves it open.
        total_curvature: ∫|K| dA; below 2π every disk is stable.

    Source: Barbosa & do Carmo, "On the size of a stable minimal surface in R³", Amer. J. Math. 98 (1976).
    """

    verdict: Literal["stable", "unstable", "undecided"]
    eigenvalue: float | None
    index: int | None
    total_curvature: float


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateauSolution(Shown):
    """A minimal disk over a loop.

    Attributes:
        surface: the surface, in the loop's own coordinates.
        loop: the loop.
        curve: Γ, through all of the loop's points.
        domain: Ω.
        matching: (n, 2), increasing pairs (t, s): the surface's boundary point at parameter t of ∂Ω is matched with
            Γ(s); it covers one turn of both, s may exceed [0, 1).
        boundary_residual: distance of the surface's boundary from Γ.
        area: ½∮ r·Im(φ dz), in squared mesh units.
        area_in_domain: the same by quadrature in Ω, a check of the first: see `area_in_domain`.
        self_intersections: pairs of triangles that cross in the surface's mesh over Ω's triangulation; 0 where it shows
            no crossing. Every disk over a knotted loop crosses itself.
        route: how it was found. "plane": Ω is the region inside the plane loop, p and q are constant. "disk",
            "unfolded", "deformed", "flattened": Douglas's slide on the unit disk, on the unfolded least-area
            triangulation, on a domain that grew with the loop from an average of it, or on a flattened discrete disk; p
            and q are a power series or Cauchy's formula. "network": Gauss-Newton for a Cauchy network. "trained":
            training of a complex-valued network.
        history: the steps.
        timings: wall time of each stage, in seconds.
        tolerance: RMS residual per mean edge that was asked for.
        converged: whether the residual is within the tolerance.
        reason: one sentence: why the solver stopped.
        stability: verdict of the second variation.
    """

    surface: SpinorSurface
    loop: BoundaryLoop
    curve: BoundaryCurve
    domain: PlaneDomain
    matching: Float[np.ndarray, "n 2"]
    boundary_residual: BoundaryResidual
    area: float
    area_in_domain: float
    self_intersections: int
    route: Route
    history: tuple[Iteration, ...]
    timings: dict[str, float]
    tolerance: float
    converged: bool
    reason: str
    stability: Stability

    def loop_points_in_domain(self) -> Complex[np.ndarray, " m"]:
        """The points of ∂Ω that the surface matches with the loop's points, in loop order, counter-clockwise."""
        t, s = self.matching.T
        # three turns, so that every vertex parameter lies well inside; equal s (nodes slid together) are one knot
        s = np.concatenate([s - 1, s, s + 1])
        t = np.concatenate([t - 1, t, t + 1])
        keep = np.append(True, np.diff(np.maximum.accumulate(s)) > 1e-12)
        return self.domain.boundary.point(PchipInterpolator(s[keep], t[keep])(self.curve.breaks[:-1]))

    def to_dict(self) -> dict[str, Any]:
        """The figures, JSON-ready."""
        residual = self.boundary_residual
        return {
            "vertices": len(self.loop),
            "area": self.area,
            "area_in_domain": self.area_in_domain,
            "self_intersections": self.self_intersections,
            "residual": {
                **asdict(residual),
                "rms_per_edge": residual.rms_per_edge,
                "max_per_edge": residual.max_per_edge,
                "rms_per_diagonal": residual.rms_per_diagonal,
                "max_per_diagonal": residual.max_per_diagonal,
            },
            "route": self.route,
            "iterations": len(self.history),
            "tolerance": self.tolerance,
            "converged": self.converged,
            "reason": self.reason,
            "stability": asdict(self.stability),
            "timings": dict(self.timings),
        }
