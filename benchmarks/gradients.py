"""Prints what derivatives cost beside the solve: ratios of CPU time, as a Markdown table.

Positions include the check of stability.

Usage: OMP_NUM_THREADS=1 python benchmarks/gradients.py
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from spinor_geom import BoundaryLoop, gallery, solve_plateau
from spinor_geom.gradients.area import area_gradient
from spinor_geom.gradients.minimal_surface import position_gradient
from spinor_geom.meshing.embed import mesh_patch

REPEATS = 15


def ring(radius: float, height: float, n: int = 64, x: float = 0.0) -> np.ndarray:
    """A circle about a vertical axis."""
    t = 2 * np.pi * np.arange(n) / n
    return np.stack([x + radius * np.cos(t), radius * np.sin(t), np.full(n, height)], axis=1)


CASES: dict[str, tuple[list[Any], dict[str, Any]]] = {
    "tennis seam, 128 points": ([gallery.tennis_seam(0.8).sample(128)], {}),
    "tennis seam, 40 uneven points": ([gallery.unevenly_sampled(gallery.tennis_seam(0.8), 40, seed=0, spread=0.3)], {}),
    "tennis seam, 300 uneven points": ([gallery.unevenly_sampled(gallery.tennis_seam(0.8), 300, seed=0)], {}),
    "ellipse 8:1, 128 points": ([gallery.ellipse(8.0, 0.3).sample(128)], {}),
    "square with raised corners": ([gallery.schwarz_d_quadrilateral().sample(32)], {"tolerance": 1e-4}),
    "20 % noise, 64 points": ([gallery.noisy_loop(gallery.ellipse(2.0, 0.3).sample(64), 0.2, seed=0)], {}),
    "two rings": ([ring(1, 0.4), ring(1, -0.4)], {}),
    "three rings": ([ring(3, 0.0), ring(0.6, 0.3, x=1), ring(0.6, 0.3, x=-1)], {}),
}


def seconds(call: Callable[[], Any]) -> float:
    """The least CPU time of several calls."""
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return min(times)


def main() -> None:
    """Measures all cases."""
    print(
        "| case | route | solve, ms | area / solve | positions / solve | positions / (solve + mesh) | inner vertices |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name, (rims, options) in CASES.items():
        loops = [rim if isinstance(rim, BoundaryLoop) else BoundaryLoop.from_points(rim) for rim in rims]

        def solve(loops: list[BoundaryLoop] = loops, options: dict[str, Any] = options) -> Any:
            return solve_plateau(loops, between="smooth", **options)

        solution = solve()
        patch = mesh_patch(solution)
        z = patch.points[patch.boundary_size :]
        weights = np.random.default_rng(0).normal(size=(len(z), 3))

        def positions_and_stability(solution: Any = solution, z: Any = z, weights: Any = weights) -> Any:
            vars(solution.evidence).pop("stability", None)  # kept otherwise
            return position_gradient(solution, z, weights)

        area = seconds(lambda solution=solution: area_gradient(solution))
        positions = seconds(positions_and_stability)
        whole, mesh = seconds(solve), seconds(lambda solution=solution: mesh_patch(solution))
        shares = f"{area / whole:.2f} | {positions / whole:.2f} | {positions / (whole + mesh):.2f}"
        print(f"| {name} | {solution.route} | {1e3 * whole:.0f} | {shares} | {len(z)} |", flush=True)


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
