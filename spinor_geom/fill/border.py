"""Tells the border of a sheet from the rim of a hole, before anything is solved."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from jaxtyping import Float

from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.errors import SheetBorderError, SpinorGeomError
from spinor_geom.fill.discrete_patch import over_disk
from spinor_geom.fill.stitch import RimEdges
from spinor_geom.fill.surroundings import Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import intrinsic_angles
from spinor_geom.mesh.triangle_mesh import TriangleMesh

# A patch that crosses the mesh and turns back over it, along so much of its rim, lies on it: the rim of a sheet.
MOST_FOLDED_BACK = 0.5
# A coarse disk crosses more than the exact patch: of its faces as many as this share of the rim's edges must cross.
# 0.3 and more do along borders of scans, 0.08 where the lid of a shallow bowl touches it.
_MOST_CROSSING = 0.15
# The patch itself tells of loops with fewer points: their surfaces take little longer than such a disk.
_LONG = 60


class LongBorders:
    """Finds the long loops of a mesh whose patches would lie on the mesh itself."""

    def __init__(self, mesh: TriangleMesh, taken: RimEdges) -> None:
        """Takes the mesh and its rim edges; nothing is computed yet."""
        self._mesh, self._taken = mesh, taken

    @cached_property
    def _angles(self) -> Float[np.ndarray, " n"]:
        """Sum of the angles of the faces at each vertex."""
        corner = self._mesh.vertices[self._mesh.faces]
        lengths = np.linalg.norm(np.roll(corner, -1, axis=1) - np.roll(corner, 1, axis=1), axis=2)
        return np.bincount(
            self._mesh.faces.ravel(), intrinsic_angles(lengths).ravel(), minlength=len(self._mesh.vertices)
        )

    @cached_property
    def _surroundings(self) -> Surroundings:
        return Surroundings(self._mesh)

    def error(self, loop: BoundaryLoop) -> SheetBorderError | None:
        """Why a loop is the border of a sheet, or None: a discrete disk over it tells."""
        # 2π around a flat sheet, −2π around a hole in one
        if len(loop) < _LONG or np.sum(np.pi - self._angles[loop.vertex_ids]) <= 0:
            return None
        try:
            disk = first_disk(loop.points)
            patch = over_disk(disk.vertices, disk.faces, len(loop))
        except SpinorGeomError:
            # nothing is known of its patch: it is solved as others are
            return None
        folded = self._taken.share_folded_back(self._mesh, loop.vertex_ids, patch)
        if folded <= MOST_FOLDED_BACK:
            return None
        pairs = self._surroundings.crossings(patch).mesh
        is_on_mesh = len(np.unique(pairs[:, 0])) > _MOST_CROSSING * len(loop)
        return SheetBorderError(folded=folded, crossed=len(pairs)) if is_on_mesh else None
