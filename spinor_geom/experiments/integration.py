"""Quadrature along rays from the centre of the disk: its error on the catenoid, and |H| of the computed surface."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Complex, Float
from numpy.typing import ArrayLike

from spinor_geom.domain.quadrature import RuleName
from spinor_geom.experiments.experiment import Experiment, Outcome
from spinor_geom.experiments.figures import disk_grid, log_log, over_disk, surfaces
from spinor_geom.experiments.paper_surfaces import reconstructed
from spinor_geom.gallery import catenoid
from spinor_geom.mesh.boundary_loop import diagonals
from spinor_geom.surface.curvature import mean_curvature_of_integrals
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.torch_extra import torch
from spinor_geom.training import LevenbergMarquardt

ORDERS: dict[RuleName, tuple[int, float]] = {"trapezoid": (-2, 0.1), "simpson": (-4, 0.2)}  # slopes and tolerances
_SLOPES: dict[str, int] = {name: slope for name, (slope, _) in ORDERS.items()}
# errors below these are rounding: distances, and |H| in 1/diagonal
_DISTANCE_FLOOR, _CURVATURE_FLOOR = 1e-12, 1e-11
_NEARLY_ZERO = 1e-2  # |H| in 1/diagonal, as of a sphere with a radius of 100 diagonals


def catenoid_error(*, grid: tuple[int, int], steps: Sequence[int]) -> Outcome:
    """Measures distances from the catenoid for every rule and number of steps, on a grid of its rectangle."""
    # r = (cosh u cos v, cosh u sin v, u) over [−1, 1] × [0, 2π] has neck 1. The gallery's has rims of radius 1
    known, neck = catenoid(1 / math.cosh(1)), math.cosh(1)
    around, along = grid
    z = np.linspace(-1, 1, along)[:, None] + 1j * np.linspace(0, 2 * np.pi, around)
    exact = known.position(z) - known.position(np.zeros(1, dtype=np.complex128))
    rows: list[dict[str, Any]] = []
    lines: dict[str, tuple[ArrayLike, ArrayLike]] = {}
    slopes = {}
    for name, (order, allowed) in ORDERS.items():
        positions = (by_rule(SpinorSurface.of(known.surface), name, n).integrate(np.zeros_like(z), z) for n in steps)
        distances = [neck * np.linalg.norm(position - exact, axis=-1) for position in positions]
        largest = [float(d.max()) for d in distances]
        slopes[name] = fitted_slope(steps, largest, _DISTANCE_FLOOR)
        lines[name] = (steps, largest)
        rows += [
            {"rule": name, "N": n, "max error": d.max().item(), "mean error": d.mean().item()}
            for n, d in zip(steps, distances, strict=True)
        ]
        within = abs(slopes[name] - order) <= allowed
        rows.append({"rule": name, "N": "slope", "max error": slopes[name], "within": within})
    fitted = " and ".join(f"{slope:.2f} for {name}" for name, slope in slopes.items())
    return Outcome(
        rows=rows,
        reproduced=all(row.get("within", True) for row in rows),
        verdict=f"The fitted slopes of the largest error are {fitted}; the rules' orders are -2 and -4.",
        pictures={"catenoid": log_log(lines, x="steps N", y="largest distance", slopes=_SLOPES)},
    )


def mean_curvature(*, grid: int, steps: Sequence[int], network: LevenbergMarquardt) -> Outcome:
    """Measures max |H| for every surface, rule and number of steps, on the points of a grid inside the disk."""
    side = np.linspace(-1, 1, grid)
    z = (side[:, None] + 1j * side).ravel()
    z = z[np.abs(z) < 1]
    rows: list[dict[str, Any]] = []
    lines = {}
    for name, surface in reconstructed(network).items():
        for rule_name, (order, allowed) in ORDERS.items():
            curvature = (radial_mean_curvature(by_rule(surface, rule_name, n), z) for n in steps)
            largest = [float(np.nanmax(np.abs(h))) for h in curvature]
            slope = fitted_slope(steps, largest, _CURVATURE_FLOOR / surface_size(surface))
            lines[f"{name}, {rule_name}"] = (steps, largest)
            by_steps = {f"max abs H at N={n}": h for n, h in zip(steps, largest, strict=True)}
            within = abs(slope - order) <= allowed
            rows.append({"surface": name, "rule": rule_name, **by_steps, "slope": slope, "within": within})
    fits = {name: [row["slope"] for row in rows if row["rule"] == name] for name in ORDERS}
    fitted = " and ".join(f"{min(s):.2f} to {max(s):.2f} for {name}" for name, s in fits.items())
    slopes = {f"{rows[0]['surface']}, {name}": slope for name, slope in _SLOPES.items()}
    return Outcome(
        rows=rows,
        reproduced=all(row["within"] for row in rows),
        verdict=f"The fitted slopes are {fitted}; the rules' orders are -2 and -4.",
        pictures={"mean-curvature": log_log(lines, x="steps N", y="max |H|", slopes=slopes)},
    )


def heat_maps(*, grid: tuple[int, int], steps: int, network: LevenbergMarquardt) -> Outcome:
    """Measures |H| by the trapezoidal rule on circles in the disk. The grid is their number and points on each."""
    z, _ = disk_grid(*grid)
    rows: list[dict[str, Any]] = []
    drawn = {}
    for name, surface in reconstructed(network).items():
        curvature = np.abs(radial_mean_curvature(by_rule(surface, "trapezoid", steps), z))
        largest, mean = float(np.nanmax(curvature)), float(np.nanmean(curvature))
        scaled = largest * surface_size(surface)
        rows.append({"surface": name, "max |H|": largest, "mean |H|": mean, "max |H|·diagonal": scaled})
        drawn[name] = over_disk(surface, grid=grid, fields={"|H|": curvature})
    worst = max(row["max |H|·diagonal"] for row in rows)
    return Outcome(
        rows=rows,
        reproduced=worst < _NEARLY_ZERO,
        verdict=f"With {steps} steps |H| times the diagonal is at most {worst:.1e}.",
        pictures={"heat-maps": surfaces(drawn)},
    )


def fitted_slope(steps: Sequence[int], errors: Sequence[float], floor: float) -> float:
    """Slope of log(error) against log(steps), for errors above a floor, NaN for fewer than two such errors."""
    above = [(n, e) for n, e in zip(steps, errors, strict=True) if e > floor]
    if len(above) < 2:
        return float("nan")
    n, e = np.log(np.array(above)).T
    return float(np.polyfit(n, e, 1)[0])


def by_rule(surface: SpinorSurface, rule_name: RuleName, n: int) -> SpinorSurface:
    """The surface of the same p and q with another quadrature rule."""
    constant, spinor_map = surface.constant.detach(), surface.spinor_map.detach()
    return SpinorSurface(surface.model, surface.domain, constant, spinor_map=spinor_map, quadrature=rule_name, order=n)


def surface_size(surface: SpinorSurface) -> float:
    """Diagonal of the bounding box of the boundary."""
    return float(diagonals(surface.position(surface.domain.boundary.vertices)))


def radial_mean_curvature(surface: SpinorSurface, z: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts"]:
    """H of the positions by the surface's quadrature rule on the ray from 0 to each point, NaN at branch points."""
    end = torch.tensor(z, device=surface.spinor_map.device).reshape(-1)
    with torch.no_grad():
        mean = mean_curvature_of_integrals(surface.integrate, torch.zeros_like(end), end, order=surface.order)
    return np.asarray(mean.cpu().numpy()).reshape(np.shape(z))


_NETWORK = LevenbergMarquardt(depth=10, tolerance=1e-4)
EXPERIMENTS = {
    "catenoid": Experiment(
        title="quadrature error on the catenoid",
        paper="Trapezoidal rule against the catenoid's formula on [-1, 1] × [0, 2π], distances on a 120 × 30 grid, "
        "second order.",
        here="The same grid, trapezoidal and Simpson's rule, on rays from u = v = 0; neck of radius 1.",
        measure=catenoid_error,
        full={"grid": (120, 30), "steps": (10, 20, 40, 80, 160, 320, 640)},
        quick={"steps": (10, 20, 40, 80, 160)},
    ),
    "mean-curvature": Experiment(
        title="max |H| against the number of quadrature steps",
        paper="Four surfaces, networks of 10 layers of 20 units; trapezoidal rule; points of a 200 × 200 grid on "
        "[-1, 1]² inside the disk; second order is seen (-2 in a log-log plot); fourth order is stated for Simpson's.",
        here="Both rules on four surfaces of the same kinds, their networks trained by Levenberg-Marquardt; H by "
        "automatic differentiation, twice, of the position.",
        measure=mean_curvature,
        full={"grid": 200, "steps": (20, 40, 80, 160), "network": _NETWORK},
        quick={"grid": 16, "steps": (20, 40, 80), "network.depth": 3},
    ),
    "heat-maps": Experiment(
        title="|H| on the four surfaces",
        paper="Four surfaces after training, trapezoidal rule with N = 100; |H| by automatic differentiation is nearly "
        "zero everywhere.",
        here="The same rule on four surfaces of the same kinds, their networks trained by Levenberg-Marquardt, at "
        f"points on circles. Reproduced if |H| times the diagonal stays below {_NEARLY_ZERO:g}.",
        measure=heat_maps,
        full={"grid": (32, 192), "steps": 100, "network": _NETWORK},
        quick={"grid": (12, 60), "network.depth": 3},
    ),
}
