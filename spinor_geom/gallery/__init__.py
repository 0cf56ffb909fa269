"""Known answers: surfaces and closed curves in exact formulas, with exact areas and sources.

It stands above the solvers, so that no solver can look at an answer.
"""

from spinor_geom.gallery.curves import (
    ellipse,
    polygon,
    scherk,
    schwarz_d_hexagon,
    schwarz_d_quadrilateral,
    schwarz_p_hexagon,
    schwarz_p_quadrilateral,
    tennis_seam,
    twisted_circle,
)
from spinor_geom.gallery.known import KnownCurve, KnownDisk, KnownSurface
from spinor_geom.gallery.surfaces import catenoid, enneper, helicoid, plane_disk, polynomial

__all__ = [
    "KnownCurve",
    "KnownDisk",
    "KnownSurface",
    "catenoid",
    "ellipse",
    "enneper",
    "helicoid",
    "plane_disk",
    "polygon",
    "polynomial",
    "scherk",
    "schwarz_d_hexagon",
    "schwarz_d_quadrilateral",
    "schwarz_p_hexagon",
    "schwarz_p_quadrilateral",
    "tennis_seam",
    "twisted_circle",
]
