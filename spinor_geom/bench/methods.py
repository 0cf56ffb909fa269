"""Methods that span a bare loop by a disk: ours, and the discrete ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.discrete.minimal_surface import DiscreteMethod, discrete_minimal_surface
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.meshing.embed import mesh_patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau


@dataclass(frozen=True, kw_only=True, eq=False)
class Spanned:
    """A disk over a loop.

    Attributes:
        vertices: of its mesh, the loop's points first.
        faces: of its mesh.
        area: of what the method found: the surface itself, or the mesh where there is nothing else.
        solution: the surface, where it is ours.
        converged: whether the method says that it did.
        told: what else it says.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    area: float
    solution: PlateauSolution | None = None
    converged: bool
    told: str = ""


@dataclass(frozen=True)
class LoopMethod:
    """A way to span a loop.

    Attributes:
        options: what is asked for, for the documents.
        most_points: of a loop; more take minutes.
        span: the whole of it, mesh included.
    """

    options: str
    most_points: int
    span: Callable[[BoundaryLoop], Spanned]


def _spinor(loop: BoundaryLoop) -> Spanned:
    solution = solve_plateau(loop)
    patch = mesh_patch(solution)
    return Spanned(
        vertices=patch.vertices,
        faces=patch.faces,
        area=solution.area,
        solution=solution,
        converged=solution.converged,
        told=f"route {solution.route}; {solution.reason}",
    )


def _discrete(loop: BoundaryLoop, *, method: DiscreteMethod, uniform: bool = True) -> Spanned:
    found = discrete_minimal_surface(loop, method=method, target_edge_length=loop.mean_edge_length if uniform else None)
    return Spanned(vertices=found.vertices, faces=found.faces, area=found.area, converged=found.converged)


LOOP_METHODS: Mapping[str, LoopMethod] = {
    "spinor": LoopMethod("solve_plateau with its defaults, then mesh_patch with the loop's mean edge", 5000, _spinor),
    "libigl": LoopMethod(
        "discrete_minimal_surface with its defaults: edges as the loop's at the rim, longer inside",
        1024,
        partial(_discrete, method="libigl", uniform=False),
    ),
    "libigl-uniform": LoopMethod(
        "the same with the loop's mean edge everywhere", 512, partial(_discrete, method="libigl")
    ),
    "pymeshlab": LoopMethod(
        "discrete_minimal_surface(method='pymeshlab') with the loop's mean edge",
        128,
        partial(_discrete, method="pymeshlab"),
    ),
}
