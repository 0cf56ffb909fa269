"""|H| on the four surfaces as the paper's quadrature draws them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.experiments.drawing import Drawn, surfaces
from spinor_geom.experiments.experiment import Experiment, Outcome
from spinor_geom.experiments.mean_curvature import by_rule, surface_size
from spinor_geom.experiments.paper_surfaces import reconstructed
from spinor_geom.plateau.training import LevenbergMarquardt
from spinor_geom.surface.radial import radial_mean_curvature

# largest |H| in 1/diagonal that counts as nearly zero: a sphere of that curvature has 200 times the diagonal
_NEARLY_ZERO = 1e-2


@dataclass(frozen=True, kw_only=True)
class HeatMapSettings:
    """How finely it is measured.

    Attributes:
        rim: vertices on the circle of the triangulation whose vertices are measured.
        steps: of the trapezoidal rule on each ray.
        network: the networks whose surfaces are measured.
    """

    rim: int
    steps: int
    network: LevenbergMarquardt


def measure(settings: HeatMapSettings) -> Outcome:
    """Measures |H| at the vertices of a triangulation of the disk."""
    domain = PlaneDomain.disk(n=settings.rim)
    z = domain.triangulation.points
    rows: list[dict[str, Any]] = []
    drawn, arrays = {}, {"z": z}
    for name, surface in reconstructed(settings.network).items():
        by_trapezoid = by_rule(surface, "trapezoid", settings.steps)
        curvature = np.abs(radial_mean_curvature(by_trapezoid, z))
        diagonal = surface_size(surface)
        rows.append(
            {
                "surface": name,
                "max |H|": float(np.nanmax(curvature)),
                "mean |H|": float(np.nanmean(curvature)),
                "max |H|·diagonal": float(np.nanmax(curvature) * diagonal),
            }
        )
        over_triangulation = Drawn.of(surface, domain)
        drawn[name] = replace(over_triangulation, value=curvature)
        arrays |= {f"{name}/H": curvature, f"{name}/r": over_triangulation.position}
    worst = max(rows, key=lambda row: row["max |H|·diagonal"])
    return Outcome(
        rows=rows,
        holds=worst["max |H|·diagonal"] < _NEARLY_ZERO,
        verdict=f"With {settings.steps} steps |H| times the diagonal is at most {worst['max |H|·diagonal']:.1e}, on "
        f"the surface of the {worst['surface']}.",
        arrays=arrays,
        pictures={"heat-maps": surfaces(drawn)},
    )


EXPERIMENT = Experiment(
    title="|H| on the four surfaces",
    paper="Four surfaces after training, trapezoidal rule with N = 100; |H| by automatic differentiation is nearly "
    "zero everywhere.",
    here="The same rule on four surfaces of the same kinds, their networks trained by Levenberg-Marquardt, at the "
    f"vertices of a triangulation. Seen means that |H| times the diagonal stays below {_NEARLY_ZERO:g}.",
    measure=measure,
    full=HeatMapSettings(rim=256, steps=100, network=LevenbergMarquardt(depth=10, tolerance=1e-4)),
    quick=HeatMapSettings(rim=32, steps=100, network=LevenbergMarquardt(tolerance=1e-4)),
)
