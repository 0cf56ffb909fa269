"""|H| on the four surfaces as the paper's quadrature draws them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spinor_geom.experiments.drawing import Drawn, disk_grid, surfaces
from spinor_geom.experiments.experiment import Experiment, Outcome
from spinor_geom.experiments.mean_curvature import by_rule, radial_mean_curvature, surface_size
from spinor_geom.experiments.paper_surfaces import reconstructed
from spinor_geom.training import LevenbergMarquardt

# largest |H| in 1/diagonal that counts as nearly zero: a sphere of that curvature has 200 times the diagonal
_NEARLY_ZERO = 1e-2


@dataclass(frozen=True, kw_only=True)
class HeatMapSettings:
    """How finely it is measured.

    Attributes:
        grid: circles around the middle of the disk, and points on each.
        steps: of the trapezoidal rule on each ray.
        network: the networks whose surfaces are measured.
    """

    grid: tuple[int, int]
    steps: int
    network: LevenbergMarquardt


def measure(settings: HeatMapSettings) -> Outcome:
    """Measures |H| at points of the disk."""
    z, _ = disk_grid(*settings.grid)
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
        drawn[name] = replace(Drawn.of(surface, settings.grid), value=curvature)
        arrays |= {f"{name}/H": curvature, f"{name}/r": drawn[name].position}
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
    here="The same rule on four surfaces of the same kinds, their networks trained by Levenberg-Marquardt, at points "
    f"on circles. Seen means that |H| times the diagonal stays below {_NEARLY_ZERO:g}.",
    measure=measure,
    full=HeatMapSettings(grid=(32, 192), steps=100, network=LevenbergMarquardt(depth=10, tolerance=1e-4)),
    quick=HeatMapSettings(grid=(12, 60), steps=100, network=LevenbergMarquardt(tolerance=1e-4)),
)
