"""Fills holes of meshes and solves Plateau's problem with exact minimal surfaces from two holomorphic functions.

The public names are imported on first use, so that `import spinor_geom` is fast.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from spinor_geom.adapters import MeshFile as MeshFile
    from spinor_geom.adapters import read_mesh as read_mesh
    from spinor_geom.batching.engine import BatchProgress as BatchProgress
    from spinor_geom.batching.engine import BatchResult as BatchResult
    from spinor_geom.batching.engine import batch as batch
    from spinor_geom.comparison import Comparison as Comparison
    from spinor_geom.comparison import compare as compare
    from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface as DiscreteMinimalSurface
    from spinor_geom.discrete.minimal_surface import discrete_minimal_surface as discrete_minimal_surface
    from spinor_geom.domain.plane_domain import PlaneDomain as PlaneDomain
    from spinor_geom.errors import SpinorGeomError as SpinorGeomError
    from spinor_geom.fill.continuation import Continuation as Continuation
    from spinor_geom.fill.fill_hole import fill_hole as fill_hole
    from spinor_geom.fill.fill_result import FillResult as FillResult
    from spinor_geom.fill.fill_result import LoopOutcome as LoopOutcome
    from spinor_geom.fill.loop_choice import boundary_loops as boundary_loops
    from spinor_geom.holomorphic.cauchy import CauchyNetwork as CauchyNetwork
    from spinor_geom.holomorphic.laurent import LaurentSeries as LaurentSeries
    from spinor_geom.holomorphic.mlp import ComplexMLP as ComplexMLP
    from spinor_geom.holomorphic.series import PowerSeries as PowerSeries
    from spinor_geom.mesh.boundary_loop import BoundaryLoop as BoundaryLoop
    from spinor_geom.mesh.curve import BoundaryCurve as BoundaryCurve
    from spinor_geom.mesh.curve import ClosedCurve as ClosedCurve
    from spinor_geom.mesh.triangle_mesh import TriangleMesh as TriangleMesh
    from spinor_geom.meshing.embed import Patch as Patch
    from spinor_geom.meshing.embed import mesh_patch as mesh_patch
    from spinor_geom.nurbs.nurbs_surface import NurbsSurface as NurbsSurface
    from spinor_geom.plateau.solution import NoConnectedSurface as NoConnectedSurface
    from spinor_geom.plateau.solution import PlateauSolution as PlateauSolution
    from spinor_geom.plateau.solve import solve_plateau as solve_plateau
    from spinor_geom.plateau.solve import solve_plateau_batch as solve_plateau_batch
    from spinor_geom.render.report import report as report
    from spinor_geom.surface.spinor_surface import SpinorSurface as SpinorSurface

_NAMES = {
    "adapters": "MeshFile read_mesh",
    "batching.engine": "BatchProgress BatchResult batch",
    "comparison": "Comparison compare",
    "discrete.minimal_surface": "DiscreteMinimalSurface discrete_minimal_surface",
    "domain.plane_domain": "PlaneDomain",
    "errors": "SpinorGeomError",
    "fill.continuation": "Continuation",
    "fill.fill_hole": "fill_hole",
    "fill.loop_choice": "boundary_loops",
    "fill.fill_result": "FillResult LoopOutcome",
    "holomorphic.cauchy": "CauchyNetwork",
    "holomorphic.laurent": "LaurentSeries",
    "holomorphic.mlp": "ComplexMLP",
    "holomorphic.series": "PowerSeries",
    "mesh.boundary_loop": "BoundaryLoop",
    "mesh.curve": "BoundaryCurve ClosedCurve",
    "mesh.triangle_mesh": "TriangleMesh",
    "meshing.embed": "Patch mesh_patch",
    "nurbs.nurbs_surface": "NurbsSurface",
    "plateau.solution": "NoConnectedSurface PlateauSolution",
    "plateau.solve": "solve_plateau solve_plateau_batch",
    "render.report": "report",
    "surface.spinor_surface": "SpinorSurface",
}
_MODULES = {name: f"spinor_geom.{module}" for module, names in _NAMES.items() for name in names.split()}

__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """Imports a public name from its module on first use."""
    try:
        module = _MODULES[name]
    except KeyError:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
    value = getattr(importlib.import_module(module), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, imported or not."""
    return sorted({*globals(), *_MODULES})
