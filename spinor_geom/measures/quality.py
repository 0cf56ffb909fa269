"""How well shaped the triangles of a mesh are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.mesh.operators import internal_angles


@dataclass(frozen=True, kw_only=True, eq=False)
class TriangleQuality:
    """Smallest angles of a mesh's triangles, in degrees.

    Attributes:
        smallest_angles: One for each face; 0 for a face without area.
    """

    smallest_angles: Float[np.ndarray, " f"]

    @property
    def min(self) -> float:
        """The smallest angle of all."""
        return float(self.smallest_angles.min())

    @property
    def first_percentile(self) -> float:
        """99 % of the triangles have no smaller angle than this."""
        return float(np.percentile(self.smallest_angles, 1))


def triangle_quality(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> TriangleQuality:
    """Smallest angle of every triangle of a mesh with at least one face."""
    angles = np.degrees(internal_angles(vertices, faces))
    # two equal corners leave the angles undefined
    return TriangleQuality(smallest_angles=np.nan_to_num(angles, nan=0.0).min(axis=1))
