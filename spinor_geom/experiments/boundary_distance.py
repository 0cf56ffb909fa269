"""Distance between the boundary of a surface and a curve."""

import numpy as np

from spinor_geom.arrays import NUMPY
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.surface.array_surface import ArraySurface

_MEASURED = 1024  # points of ∂Ω whose distance from Γ is measured


def boundary_distance(surface: ArraySurface, curve: BoundaryCurve) -> float:
    """The larger of the largest distances of the boundary from Γ and of Γ from the boundary."""
    r = surface.position(surface.domain.boundary.point(np.arange(_MEASURED) / _MEASURED))
    slide = np.unwrap(curve.nearest(r), period=1.0)
    return Misfit.of(r, slide, CurveTensors.of(curve, NUMPY)).max
