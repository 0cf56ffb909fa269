"""Known minimal disks and their boundary loops."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Literal, cast

import numpy as np
from jaxtyping import Float
from scipy.interpolate import make_interp_spline
from scipy.spatial.distance import pdist

from spinor_geom import gallery
from spinor_geom.errors import OptionError, SpinorGeomError
from spinor_geom.gallery.chart import Chart
from spinor_geom.gallery.curves import trigonometric
from spinor_geom.gallery.known import KnownCurve, KnownPatch, KnownSurface, surface_chart
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.mesh.interpolation import by_arcs
from spinor_geom.plateau.solve import solve_plateau

Kind = Literal["smooth", "corners", "plane"]
Sampling = Literal["formula", "even", "uneven"]
_DIAMETER_POINTS = 512
REFERENCE_CASE = "enneper-0.8"  # filled with several numbers of points, and drawn
_ROUNDING = 1e-12  # relative area error below which no further interpolant is tried


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A known minimal disk. Its loop has equal steps of the formula's parameter, or equal or random edge lengths."""

    kind: Kind
    known: KnownCurve | KnownSurface | KnownPatch
    sampling: Sampling = "formula"

    @property
    def area(self) -> float:
        """The exact area."""
        return self.known.disks[0].area if isinstance(self.known, KnownCurve) else self.known.area

    def loop(self, n: int) -> BoundaryLoop:
        """The boundary loop with n points."""
        known = self.known
        if self.sampling == "formula" or isinstance(known, KnownPatch):
            return known.sample(n) if isinstance(known, KnownCurve) else known.rim(n)
        if self.sampling == "even":
            return gallery.evenly_sampled(known, n)
        return gallery.unevenly_sampled(known, n, seed=0)

    @cached_property
    def chart(self) -> Chart:
        """The exact surface. If only the area is known, the solution by power series over the curve's formula."""
        if self.known.chart is not None:
            return self.known.chart
        surface = solve_plateau(self.known, model="series").array_surface
        return surface_chart(surface, lambda z: np.asarray(surface.position(z)))

    @cached_property
    def diameter(self) -> float:
        """Largest distance of two points of the loop."""
        return float(pdist(self.loop(_DIAMETER_POINTS).points).max())


_STAR = np.exp(2j * np.pi * np.arange(10) / 10) * np.where(np.arange(10) % 2, 0.45, 1.0)
_STAR_CORNERS = np.stack([_STAR.real, _STAR.imag], axis=1)

KNOWN: Mapping[str, tuple[Kind, Callable[[], KnownCurve | KnownSurface | KnownPatch]]] = {
    "enneper-0.5": ("smooth", lambda: gallery.enneper(0.5)),
    "enneper-0.8": ("smooth", lambda: gallery.enneper(0.8)),
    "enneper-0.95": ("smooth", lambda: gallery.enneper(0.95)),
    "henneberg": ("smooth", gallery.henneberg),
    "random-0": ("smooth", lambda: gallery.random_polynomial(0)),
    "random-1": ("smooth", lambda: gallery.random_polynomial(1)),
    "random-2": ("smooth", lambda: gallery.random_polynomial(2, degree=6)),
    "twisted-circle": ("smooth", gallery.twisted_circle),
    "tennis-seam": ("smooth", lambda: gallery.tennis_seam(0.8)),
    "plane-ellipse": ("plane", lambda: gallery.ellipse(2.0)),
    "plane-square": ("plane", lambda: gallery.plane_polygon([(0, 0), (1, 0), (1, 1), (0, 1)], name="plane square")),
    "plane-l": ("plane", gallery.l_shape),
    "plane-star": ("plane", lambda: gallery.plane_polygon(_STAR_CORNERS, name="plane star")),
    "catenoid": ("corners", lambda: gallery.catenoid(0.5, turn=math.pi)),
    "helicoid": ("corners", lambda: gallery.helicoid(turn=math.pi)),
    "associate-45": ("corners", lambda: gallery.associate(math.pi / 4)),
    "scherk": ("corners", lambda: gallery.scherk(2.0)),
    "schwarz-d-quad": ("corners", gallery.schwarz_d_quadrilateral),
    "schwarz-d-hexagon": ("corners", gallery.schwarz_d_hexagon),
    "schwarz-p-quad": ("corners", gallery.schwarz_p_quadrilateral),
    "schwarz-p-hexagon": ("corners", gallery.schwarz_p_hexagon),
    "schwarz-prism": ("corners", lambda: gallery.schwarz_prism(0.7)),
    "schwarz-prism-tall": ("corners", lambda: gallery.schwarz_prism(1.5)),
    "schwarz-h": ("corners", lambda: gallery.schwarz_h(0.3)),
}
"""Kind and constructor of the known cases. "random-SEED" is a surface of random polynomials of degree 4."""

SMOOTH = tuple(name for name, (kind, _) in KNOWN.items() if kind == "smooth")
SAMPLED = tuple(f"{name}@{how}" for name in SMOOTH for how in ("even", "uneven"))
"""The smooth cases with equal and with random edge lengths."""


def known_kind(name: str) -> Kind:
    """Whether a known case is smooth, has corners or is plane."""
    base = name.partition("@")[0]
    return KNOWN[base][0] if base in KNOWN else "smooth"


@lru_cache(maxsize=4)
def known_case(name: str) -> Case:
    """A case by name. "NAME@even" and "NAME@uneven" for smooth ones. Raises OptionError for other names."""
    base, at, sampling = name.partition("@")
    head, _, seed = base.partition("-")
    if base in KNOWN:
        kind, make = KNOWN[base]
    elif head == "random" and seed.isdigit():
        kind, make = "smooth", partial(gallery.random_polynomial, int(seed))
    else:
        raise OptionError(f"there is no case {name!r}; choose from: {', '.join(KNOWN)}, random-SEED")
    if at and (sampling not in ("even", "uneven") or kind != "smooth"):
        raise OptionError(f"there is no case {name!r}; smooth cases have the samplings @even and @uneven")
    return Case(kind=kind, known=make(), sampling=cast(Sampling, sampling or "formula"))


def points_limit(case: Case, n: int) -> float | None:
    """Smallest relative area error of minimal surfaces over interpolants of a smooth case's points, if any is found.

    The interpolants are the trigonometric polynomial, if the points are equal steps of a parameter, and the periodic
    splines of degree 7 and 5 by arc length. Each is solved by power series.
    """
    errors: list[float] = []
    for curve in _interpolants(case.loop(n).points, equal_steps=case.sampling != "uneven"):
        with suppress(SpinorGeomError):  # the interpolant may oscillate too much between the points
            errors.append(abs(solve_plateau(curve, model="series").area / case.area - 1))
        if errors and errors[-1] < _ROUNDING:
            break
    return min(errors, default=None)


def _interpolants(points: Float[np.ndarray, "n 3"], *, equal_steps: bool) -> Iterator[ClosedCurve]:
    if equal_steps:
        yield trigonometric(points)
    around = np.vstack([points, points[:1]])
    for degree in (7, 5):
        spline = make_interp_spline(by_arcs(points), around, k=degree, bc_type="periodic")
        spline.extrapolate = "periodic"
        yield ClosedCurve(point=spline, derivative=spline.derivative(), second_derivative=spline.derivative(2))
