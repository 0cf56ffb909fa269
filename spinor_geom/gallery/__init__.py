"""Known answers: surfaces and closed curves in exact formulas, with exact areas and sources.

It stands above the solvers, so that no solver can look at an answer.
"""

from spinor_geom.gallery.chart import Chart
from spinor_geom.gallery.curves import (
    ellipse,
    l_shape,
    plane_polygon,
    polygon,
    random_curve,
    scherk,
    tennis_seam,
    twisted_circle,
    zigzag_rim,
)
from spinor_geom.gallery.known import KnownCurve, KnownDisk, KnownPatch, KnownSurface
from spinor_geom.gallery.names import SURFACES, named_surface
from spinor_geom.gallery.perturb import evenly_sampled, noisy_loop, unevenly_sampled
from spinor_geom.gallery.schwarz import (
    schwarz_d_hexagon,
    schwarz_d_quadrilateral,
    schwarz_h,
    schwarz_p_hexagon,
    schwarz_p_quadrilateral,
    schwarz_prism,
)
from spinor_geom.gallery.strips import helical_ramp, horseshoe, slit
from spinor_geom.gallery.surfaces import (
    associate,
    catenoid,
    enneper,
    helicoid,
    henneberg,
    plane_disk,
    polynomial,
    random_polynomial,
)

__all__ = [
    "SURFACES",
    "Chart",
    "KnownCurve",
    "KnownDisk",
    "KnownPatch",
    "KnownSurface",
    "associate",
    "catenoid",
    "ellipse",
    "enneper",
    "evenly_sampled",
    "helical_ramp",
    "helicoid",
    "henneberg",
    "horseshoe",
    "l_shape",
    "named_surface",
    "noisy_loop",
    "plane_disk",
    "plane_polygon",
    "polygon",
    "polynomial",
    "random_curve",
    "random_polynomial",
    "scherk",
    "schwarz_d_hexagon",
    "schwarz_d_quadrilateral",
    "schwarz_h",
    "schwarz_p_hexagon",
    "schwarz_p_quadrilateral",
    "schwarz_prism",
    "slit",
    "tennis_seam",
    "twisted_circle",
    "unevenly_sampled",
    "zigzag_rim",
]
