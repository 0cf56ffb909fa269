"""|H| against the number of quadrature steps: networks are exactly minimal but for the rule along each ray."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Complex, Float

from spinor_geom.domain.quadrature import RuleName
from spinor_geom.experiments.experiment import Experiment, Outcome, fitted_slope
from spinor_geom.experiments.paper_surfaces import reconstructed
from spinor_geom.render.plots import log_log
from spinor_geom.surface import SpinorSurface
from spinor_geom.surface.curvature import mean_curvature_of_integrals
from spinor_geom.training import LevenbergMarquardt

ORDERS: dict[RuleName, tuple[int, float]] = {"trapezoid": (-2, 0.1), "simpson": (-4, 0.2)}
# mean curvatures in 1/diagonal below which rounding shows: second derivatives lose half the digits of sums
_FLOOR = 1e-11


@dataclass(frozen=True, kw_only=True)
class MeanCurvatureSettings:
    """How finely it is measured.

    Attributes:
        grid: points along each side of [−1, 1]²; those inside the disk are used.
        steps: of the rules.
        network: the networks whose surfaces are measured.
    """

    grid: int
    steps: tuple[int, ...]
    network: LevenbergMarquardt


def measure(settings: MeanCurvatureSettings) -> Outcome:
    """Measures max |H| for every surface, rule and number of steps."""
    z = grid_points(settings.grid)
    rows: list[dict[str, Any]] = []
    lines = {}
    for name, surface in reconstructed(settings.network).items():
        for rule_name, (order, allowed) in ORDERS.items():
            largest = [max_mean_curvature(surface, z, rule_name, n) for n in settings.steps]
            slope = fitted_slope(settings.steps, largest, _FLOOR / surface_size(surface))
            lines[f"{name}, {rule_name}"] = (settings.steps, largest)
            rows.append(
                {
                    "surface": name,
                    "rule": rule_name,
                    **{f"max abs H at N={n}": h for n, h in zip(settings.steps, largest, strict=True)},
                    "slope": slope,
                    "within": abs(slope - order) <= allowed,
                }
            )
    off = [f"{row['surface']} by {row['rule']} {row['slope']:.2f}" for row in rows if not row["within"]]
    slopes = {name: [row["slope"] for row in rows if row["rule"] == name] for name in ORDERS}
    told = " and ".join(f"{min(s):.2f} to {max(s):.2f} for {name}" for name, s in slopes.items())
    return Outcome(
        rows=rows,
        holds=not off,
        verdict=f"Fitted slopes are {told}; the rules' orders are -2 and -4."
        + (f" Farther off than 0.1 and 0.2: {'; '.join(off)}." if off else ""),
        arrays={"z": z, "steps": np.array(settings.steps), **{name: np.array(h) for name, (_, h) in lines.items()}},
        pictures={
            "mean-curvature": log_log(
                lines,
                x="steps N",
                y="max |H|",
                slopes={f"{rows[0]['surface']}, {name}": n for name, (n, _) in ORDERS.items()},
            )
        },
    )


def grid_points(grid: int) -> Complex[np.ndarray, " n"]:
    """The points of a square grid over [−1, 1]² that lie inside the unit disk."""
    side = np.linspace(-1, 1, grid)
    z = (side[:, None] + 1j * side).ravel()
    return z[np.abs(z) < 1]


def max_mean_curvature(surface: SpinorSurface, z: Complex[np.ndarray, " n"], rule_name: RuleName, n: int) -> float:
    """Largest |H| at given points of the surface that a rule with n steps on each ray draws."""
    return float(np.nanmax(np.abs(radial_mean_curvature(by_rule(surface, rule_name, n), z))))


def radial_mean_curvature(surface: SpinorSurface, z: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts"]:
    """H of the surface that its own rule draws along the whole ray from 0 to each point; NaN at branch points.

    p and q are exactly holomorphic, so the rule is all that keeps it from 0.
    """
    end = torch.tensor(z, device=surface.spinor_map.device).reshape(-1)
    with torch.no_grad():
        mean = mean_curvature_of_integrals(surface.integrate, torch.zeros_like(end), end, order=surface.order)
    return np.asarray(mean.cpu().numpy()).reshape(np.shape(z))


def by_rule(surface: SpinorSurface, rule_name: RuleName, n: int) -> SpinorSurface:
    """The same p and q, integrated by another rule."""
    return SpinorSurface(
        surface.model,
        surface.domain,
        surface.constant.detach(),
        spinor_map=surface.spinor_map.detach(),
        quadrature=rule_name,
        order=n,
    )


def surface_size(surface: SpinorSurface) -> float:
    """Diagonal of the bounding box of the boundary."""
    return float(np.linalg.norm(np.ptp(surface.position(surface.domain.boundary.vertices), axis=0)))


EXPERIMENT = Experiment(
    title="max |H| against the number of quadrature steps",
    paper="Four surfaces, networks of 10 layers of 20 units; trapezoidal rule; points of a 200 × 200 grid on [-1, 1]² "
    "inside the disk; second order is seen (-2 in a log-log plot), fourth is said to be Simpson's.",
    here="Both rules on four surfaces of the same kinds, their networks trained by Levenberg-Marquardt; H by automatic "
    "differentiation, twice, of the position.",
    measure=measure,
    full=MeanCurvatureSettings(grid=200, steps=(20, 40, 80, 160), network=LevenbergMarquardt(depth=10, tolerance=1e-4)),
    quick=MeanCurvatureSettings(grid=16, steps=(20, 40, 80), network=LevenbergMarquardt(tolerance=1e-4)),
)
