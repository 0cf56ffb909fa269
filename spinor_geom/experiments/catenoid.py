"""The catenoid by quadrature along rays, against its closed formula."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Complex, Float
from numpy.typing import ArrayLike

from spinor_geom.domain.quadrature import RuleName
from spinor_geom.experiments.experiment import Experiment, Outcome, fitted_slope
from spinor_geom.experiments.mean_curvature import ORDERS, by_rule
from spinor_geom.gallery import catenoid
from spinor_geom.render.plots import log_log
from spinor_geom.surface import SpinorSurface

_FLOOR = 1e-12


@dataclass(frozen=True, kw_only=True)
class CatenoidSettings:
    """How finely it is measured.

    Attributes:
        grid: points along [0, 2π] and along [−1, 1].
        steps: of the rules.
    """

    grid: tuple[int, int] = (120, 30)
    steps: tuple[int, ...] = (10, 20, 40, 80, 160, 320, 640)


def measure(settings: CatenoidSettings) -> Outcome:
    """Measures the distance from the exact points for every rule and number of steps."""
    # r = (cosh u cos v, cosh u sin v, u) over [−1, 1] × [0, 2π] has neck 1; the gallery's has rims of radius 1
    known, neck = catenoid(1 / math.cosh(1)), math.cosh(1)
    around, along = settings.grid
    z = np.linspace(-1, 1, along)[:, None] + 1j * np.linspace(0, 2 * np.pi, around)
    exact = known.position(z) - known.position(np.zeros(1, dtype=np.complex128))
    rows: list[dict[str, Any]] = []
    lines: dict[str, tuple[ArrayLike, ArrayLike]] = {}
    arrays = {}
    for rule_name, (order, allowed) in ORDERS.items():
        away = [neck * distance(known.surface, z, exact, rule_name, n) for n in settings.steps]
        largest = [float(d.max()) for d in away]
        slope = fitted_slope(settings.steps, largest, _FLOOR)
        lines[rule_name] = (settings.steps, largest)
        arrays[f"{rule_name} error"] = np.stack(away)
        rows += [
            {"rule": rule_name, "N": n, "max error": d.max().item(), "mean error": d.mean().item()}
            for n, d in zip(settings.steps, away, strict=True)
        ]
        rows.append({"rule": rule_name, "N": "slope", "max error": slope, "within": abs(slope - order) <= allowed})
    fits = [row for row in rows if row["N"] == "slope"]
    told = " and ".join(f"{row['max error']:.2f} for {row['rule']}" for row in fits)
    return Outcome(
        rows=rows,
        holds=all(bool(row["within"]) for row in fits),
        verdict=f"The fitted slopes of the largest error are {told}; the rules' orders are -2 and -4.",
        arrays={"z": z, "steps": np.array(settings.steps), **arrays},
        pictures={
            "catenoid": log_log(lines, x="steps N", y="largest distance", slopes={"trapezoid": -2, "simpson": -4})
        },
    )


def distance(
    surface: SpinorSurface,
    z: Complex[np.ndarray, "*pts"],
    exact: Float[np.ndarray, "*pts 3"],
    rule_name: RuleName,
    n: int,
) -> Float[np.ndarray, "*pts"]:
    """Distances of r(z) − r(0), by a rule with n steps on each ray, from exact ones."""
    moved = by_rule(surface, rule_name, n).integrate(np.zeros_like(z), z)
    return np.asarray(np.linalg.norm(moved - exact, axis=-1))


_FULL = CatenoidSettings()
EXPERIMENT = Experiment(
    title="quadrature error on the catenoid",
    paper="Trapezoidal rule against the catenoid's formula on [-1, 1] × [0, 2π], distances on a 120 × 30 grid, second "
    "order.",
    here="The same grid, trapezoidal and Simpson's rule, on rays from u = v = 0; neck of radius 1.",
    measure=measure,
    full=_FULL,
    quick=replace(_FULL, steps=(10, 20, 40, 80, 160)),
)
