"""The surfaces of the gallery by their names on the command line."""

from collections.abc import Callable
from functools import partial

from spinor_geom.errors import OptionError
from spinor_geom.gallery import curves, schwarz, surfaces
from spinor_geom.gallery.known import KnownCurve, KnownPatch, KnownSurface
from spinor_geom.plateau.solve import solve_plateau
from spinor_geom.surface.array_surface import ArraySurface

_POINTS = 96  # on a boundary with corners

SURFACES: dict[str, Callable[[], KnownSurface | KnownCurve | KnownPatch]] = {
    "associate": surfaces.associate,
    "catenoid": surfaces.catenoid,
    "ellipse": partial(curves.ellipse, 2.0, 0.3),
    "enneper": surfaces.enneper,
    "helicoid": partial(surfaces.helicoid, both_sides=True),
    "henneberg": surfaces.henneberg,
    "horseshoe": curves.horseshoe,
    "l-shape": partial(curves.l_shape, 0.5),
    "random-polynomial": partial(surfaces.random_polynomial, 1),
    "scherk": curves.scherk,
    "schwarz-d-hexagon": schwarz.schwarz_d_hexagon,
    "schwarz-d-quadrilateral": schwarz.schwarz_d_quadrilateral,
    "schwarz-h": schwarz.schwarz_h,
    "schwarz-p-hexagon": schwarz.schwarz_p_hexagon,
    "schwarz-p-quadrilateral": schwarz.schwarz_p_quadrilateral,
    "schwarz-prism": schwarz.schwarz_prism,
    "tennis-seam": curves.tennis_seam,
    "twisted-circle": curves.twisted_circle,
}


def named_surface(name: str) -> ArraySurface:
    """A surface of the gallery: from formulas of p and q if known, else the solution for its boundary.

    Raises OptionError for a name that is not in `SURFACES`.
    """
    if name not in SURFACES:
        raise OptionError(f"there is no surface {name!r} in the gallery; it has {', '.join(SURFACES)}")
    known = SURFACES[name]()
    if isinstance(known, KnownSurface):
        return known.surface
    if isinstance(known, KnownPatch):
        return solve_plateau(known.rim(_POINTS)).array_surface
    return solve_plateau(known.sample(_POINTS) if known.corners else known).array_surface
