"""Methods that span a bare loop by a disk: ours with each model, and the discrete ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.bench.cases import Case
from spinor_geom.discrete.minimal_surface import DiscreteMethod, discrete_minimal_surface
from spinor_geom.errors import OptionError
from spinor_geom.gallery.known import KnownCurve
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.meshing.embed import mesh_patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau
from spinor_geom.plateau.task import Model


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A loop to be spanned.

    Attributes:
        loop: its points.
        edge: edge length wanted inside; None for what each method takes by itself.
        case: the known answer, where there is one; only "spinor-formula" may look at its curve.
    """

    loop: BoundaryLoop
    edge: float | None = None
    case: Case | None = None


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


@dataclass(frozen=True, kw_only=True)
class LoopMethod:
    """A way to span a loop.

    Attributes:
        name: on the command line and in tables.
        options: what is asked for, for the documents.
        most_points: of a loop; more take minutes.
        span: the whole of it, mesh included.
    """

    name: str
    options: str
    most_points: int
    span: Callable[[Problem], Spanned]


def _spinor(model: Model, tolerance: float) -> Callable[[Problem], Spanned]:
    def span(problem: Problem) -> Spanned:
        return _meshed(solve_plateau(problem.loop, model=model, tolerance=tolerance), problem.edge)

    return span


def _formula(problem: Problem) -> Spanned:
    """The curve itself instead of its samples; the mesh has the edges of the samples."""
    case = problem.case
    if case is None or not isinstance(case.known, KnownCurve):
        raise OptionError("only a curve in formulas has no need of samples")
    return _meshed(solve_plateau(case.known, tolerance=1e-10), problem.edge or problem.loop.mean_edge_length)


def _meshed(solution: PlateauSolution, edge: float | None) -> Spanned:
    patch = mesh_patch(solution, "auto" if edge is None else edge)
    return Spanned(
        vertices=patch.vertices,
        faces=patch.faces,
        area=solution.area,
        solution=solution,
        converged=solution.converged,
        told=f"route {solution.route}; {solution.reason}",
    )


def _discrete(method: DiscreteMethod, inside: Literal["graded", "uniform"]) -> Callable[[Problem], Spanned]:
    def span(problem: Problem) -> Spanned:
        edge = problem.edge
        if edge is None and inside == "uniform":
            edge = problem.loop.mean_edge_length
        found = discrete_minimal_surface(problem.loop, method=method, target_edge_length=edge)
        return Spanned(vertices=found.vertices, faces=found.faces, area=found.area, converged=found.converged)

    return span


LOOP_METHODS: Mapping[str, LoopMethod] = {
    method.name: method
    for method in (
        LoopMethod(
            name="spinor",
            options="solve_plateau with its defaults, then mesh_patch with the loop's mean edge",
            most_points=5000,
            span=_spinor("auto", 1e-3),
        ),
        LoopMethod(
            name="spinor-cauchy",
            options="the same with model='cauchy', tolerance 1e-6",
            most_points=256,
            span=_spinor("cauchy", 1e-6),
        ),
        LoopMethod(
            name="spinor-series",
            options="the same with model='series'",
            most_points=5000,
            span=_spinor("series", 1e-3),
        ),
        LoopMethod(
            name="spinor-mlp",
            options="the same with model='mlp', by Levenberg-Marquardt, warm",
            most_points=256,
            span=_spinor("mlp", 1e-3),
        ),
        LoopMethod(
            name="spinor-formula",
            options="the same on the curve in formulas, without samples, tolerance 1e-10",
            most_points=256,
            span=_formula,
        ),
        LoopMethod(
            name="libigl",
            options="discrete_minimal_surface with its defaults: edges as the loop's at the rim, longer inside",
            most_points=1024,
            span=_discrete("libigl", "graded"),
        ),
        LoopMethod(
            name="libigl-uniform",
            options="the same with the loop's mean edge everywhere",
            most_points=512,
            span=_discrete("libigl", "uniform"),
        ),
        LoopMethod(
            name="pymeshlab",
            options="discrete_minimal_surface(method='pymeshlab') with the loop's mean edge",
            most_points=128,
            span=_discrete("pymeshlab", "uniform"),
        ),
    )
}
