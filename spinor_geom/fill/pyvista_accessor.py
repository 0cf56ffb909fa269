"""`mesh.spinor.fill_hole()` on PyVista's meshes: PyVista (0.48 or newer) finds this module by its entry point."""

from collections.abc import Callable
from functools import partial
from typing import Any

import pyvista

from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.loop_choice import boundary_loops
from spinor_geom.mesh.boundary_loop import BoundaryLoop


@pyvista.register_dataset_accessor("spinor", pyvista.UnstructuredGrid)
@pyvista.register_dataset_accessor("spinor", pyvista.PolyData)
class SpinorAccessor:
    """Methods of PyVista's meshes."""

    def __init__(self, mesh: Any) -> None:
        self._mesh = mesh

    @property
    def fill_hole(self) -> Callable[..., Any]:
        """`spinor_geom.fill_hole` of this mesh, with all its options."""
        return partial(fill_hole, self._mesh)

    def boundary_loops(self) -> list[BoundaryLoop]:
        """`spinor_geom.boundary_loops` of this mesh."""
        return boundary_loops(self._mesh)
