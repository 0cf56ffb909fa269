"""Known answers: surfaces and closed curves in exact formulas, with exact areas and sources.

It stands above the solvers, so that no solver can look at an answer.
"""

from spinor_geom.gallery.curves import (
    ellipse,
    l_shape,
    polygon,
    random_curve,
    scherk,
    schwarz_d_hexagon,
    schwarz_d_quadrilateral,
    schwarz_p_hexagon,
    schwarz_p_quadrilateral,
    tennis_seam,
    twisted_circle,
    zigzag_rim,
)
from spinor_geom.gallery.known import KnownCurve, KnownDisk, KnownSurface
from spinor_geom.gallery.strips import helical_ramp, horseshoe, slit
from spinor_geom.gallery.surfaces import catenoid, enneper, helicoid, plane_disk, polynomial

__all__ = [
    "KnownCurve",
    "KnownDisk",
    "KnownSurface",
    "catenoid",
    "ellipse",
    "enneper",
    "helical_ramp",
    "helicoid",
    "horseshoe",
    "l_shape",
    "plane_disk",
    "polygon",
    "polynomial",
    "random_curve",
    "scherk",
    "schwarz_d_hexagon",
    "schwarz_d_quadrilateral",
    "schwarz_p_hexagon",
    "schwarz_p_quadrilateral",
    "slit",
    "tennis_seam",
    "twisted_circle",
    "zigzag_rim",
]
