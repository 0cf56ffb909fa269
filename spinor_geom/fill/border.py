"""Tells the border of a sheet from the rim of a hole."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.errors import SheetBorderError, SpinorGeomError
from spinor_geom.fill.discrete_patch import over_disk
from spinor_geom.fill.surroundings import Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.meshing.embed import Patch

# A patch that crosses the mesh and turns back over it, along so much of its rim, lies on it: the rim of a sheet.
_MOST_FOLDED_BACK = 0.5
# A coarse disk crosses more than the exact patch: of its faces as many as this share of the rim's edges must cross.
# 0.3 and more do along borders of scans, 0.08 where the lid of a shallow bowl touches it.
_MOST_CROSSING = 0.15
# The patch itself tells of loops with fewer points: their surfaces take little longer than such a disk.
_LONG = 60


def refuse_long_border(surroundings: Surroundings, loop: BoundaryLoop) -> None:
    """Checks, before anything is solved, that a discrete disk over a long loop does not lie on the mesh.

    Raises:
        SheetBorderError: it does.
    """
    # 2π around a flat sheet, −2π around a hole in one
    if len(loop) < _LONG or np.sum(np.pi - surroundings.angles[loop.vertex_ids]) <= 0:
        return
    try:
        disk = first_disk(loop.points)
        patch = over_disk(disk.vertices, disk.faces, len(loop))
    except SpinorGeomError:
        # nothing is known of its patch: it is solved as others are
        return
    refuse_border(surroundings, loop.vertex_ids, patch, most_crossing=_MOST_CROSSING * len(loop))


def refuse_border(
    surroundings: Surroundings, rim: Int[np.ndarray, " m"], patch: Patch, *, most_crossing: float = 0.0
) -> None:
    """Checks that a patch does not lie on the mesh.

    Args:
        surroundings: the mesh.
        rim: its vertices at the patch's boundary.
        patch: the patch.
        most_crossing: faces of the patch that may cross the mesh.

    Raises:
        SheetBorderError: it does.
    """
    folded = surroundings.taken.share_folded_back(surroundings.mesh, rim, patch)
    if folded > _MOST_FOLDED_BACK:
        pairs = surroundings.crossings(patch).mesh
        if len(np.unique(pairs[:, 0])) > most_crossing:
            raise SheetBorderError(folded=folded, crossed=len(pairs))
