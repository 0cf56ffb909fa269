"""What is measured on: loops whose minimal surface is known, the loops of mesh files, and odd rims."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from spinor_geom import gallery
from spinor_geom.errors import OptionError
from spinor_geom.gallery.chart import Chart, null_tangents
from spinor_geom.gallery.known import KnownCurve, KnownPatch, KnownSurface
from spinor_geom.mesh.boundary_loop import BoundaryLoop

Kind = Literal["smooth", "corners", "plane"]
Resampling = Literal["formula", "even", "uneven"]
_DIAMETER_POINTS = 512


@dataclass(frozen=True, kw_only=True)
class Variation:
    """What is done to a known loop before it is handed out.

    Attributes:
        turn: seed of a random rotation; none without.
        scale: factor of all lengths.
        noise: deviation of the points' moves in each coordinate, in mean edges; then no answer is known.
        sampling: "formula" as the formula's parameter runs, "even" and "uneven" along the curve; loops without
            corners only, the others keep their own.
        seed: of the noise and of uneven edges.
    """

    turn: int | None = None
    scale: float = 1.0
    noise: float = 0.0
    sampling: Resampling = "formula"
    seed: int = 0

    def __post_init__(self) -> None:
        """Raises OptionError where a value is out of range."""
        if not (0 < self.scale < math.inf and 0 <= self.noise < 1):
            raise OptionError(f"a variation needs scale > 0 and noise in [0, 1), got {self.scale} and {self.noise}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A known minimal disk and its boundary.

    Attributes:
        name: on the command line and in tables.
        kind: "smooth" loops have no corners; "plane" ones lie in a plane.
        known: the answer.
        variation: what is done to it.
    """

    name: str
    kind: Kind
    known: KnownCurve | KnownSurface | KnownPatch
    variation: Variation = Variation()

    @property
    def source(self) -> str:
        """Where the answer comes from."""
        return self.known.source

    @property
    def area(self) -> float | None:
        """The exact area; None with noise."""
        if self.variation.noise:
            return None
        known = self.known
        area = known.disks[0].area if isinstance(known, KnownCurve) else known.area
        return area * self.variation.scale**2

    def loop(self, n: int) -> BoundaryLoop:
        """A loop of n points."""
        how, known = self.variation, self.known
        loop = known.sample(n) if isinstance(known, KnownCurve) else known.rim(n)
        if how.sampling != "formula" and not isinstance(known, KnownPatch) and not loop.corners.any():
            even = how.sampling == "even"
            loop = gallery.evenly_sampled(known, n) if even else gallery.unevenly_sampled(known, n, seed=how.seed)
        corners = np.flatnonzero(loop.corners).tolist()
        if how.turn is not None or how.scale != 1:
            loop = BoundaryLoop.from_points(how.scale * loop.points @ self._rotation.T, corners=corners)
        return gallery.noisy_loop(loop, how.noise, seed=how.seed) if how.noise else loop

    @cached_property
    def chart(self) -> Chart | None:
        """The exact surface; None with noise.

        Curves of which only the area is known have a converged solution in the place of a formula: Douglas's problem on
        the curve's own formula, by power series to round-off.
        """
        if self.variation.noise:
            return None
        chart = (
            _solved(self.known) if isinstance(self.known, KnownCurve) and self.known.chart is None else self.known.chart
        )
        assert chart is not None
        matrix = self.variation.scale * self._rotation
        inner = chart.position, chart.tangents
        return replace(
            chart,
            position=lambda z: inner[0](z) @ matrix.T,
            tangents=lambda z: inner[1](z) @ matrix.T,
            symmetries=tuple(self._rotation @ m @ self._rotation.T for m in chart.symmetries),
        )

    @property
    def chart_is_formula(self) -> bool:
        """Whether the chart is a closed formula, and not a converged solution."""
        return not isinstance(self.known, KnownCurve) or self.known.chart is not None

    @cached_property
    def diameter(self) -> float:
        """Largest distance of two points of the loop."""
        return diameter_of(self.loop(_DIAMETER_POINTS))

    @cached_property
    def _rotation(self) -> np.ndarray:
        if self.variation.turn is None:
            return np.eye(3)
        return Rotation.random(random_state=np.random.default_rng(self.variation.turn)).as_matrix()


def diameter_of(loop: BoundaryLoop) -> float:
    """Largest distance of two points of a loop, of 512 of them where it has more."""
    points = loop.points[:: -(-len(loop) // _DIAMETER_POINTS)]
    return float(pdist(points).max())


def _solved(curve: KnownCurve) -> Chart:
    from spinor_geom.plateau.solve import solve_plateau

    solution = solve_plateau(curve, model="series")
    surface = solution.surface

    def tangents(z: np.ndarray) -> np.ndarray:
        p, q = np.moveaxis(np.asarray(surface.spinors(z)), -1, 0)
        return null_tangents(np.stack([p**2 - q**2, -1j * (p**2 + q**2), 2 * p * q], axis=-1))

    return Chart(
        position=lambda z: np.asarray(surface.position(z)),
        tangents=tangents,
        outline=solution.domain.boundary.point(np.arange(512) / 512),
    )


_STAR = np.exp(2j * np.pi * np.arange(10) / 10) * np.where(np.arange(10) % 2, 0.45, 1.0)

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
    "plane-star": (
        "plane",
        lambda: gallery.plane_polygon([(z.real, z.imag) for z in _STAR.tolist()], name="plane star"),
    ),
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
"""The cases with a known answer; "random-SEED" makes more, of degree 4."""

SAMPLED = tuple(
    f"{name}@{sampling}" for name, (kind, _) in KNOWN.items() if kind == "smooth" for sampling in ("even", "uneven")
)
"""The smooth ones with points that a formula's parameter does not favour."""


def base_name(name: str) -> str:
    """The name of a case without its sampling."""
    return name.partition("@")[0]


def known_case(name: str, variation: Variation = Variation()) -> Case:
    """The case of a name; "NAME@even" and "NAME@uneven" are smooth ones in that sampling.

    Raises:
        OptionError: there is none.
    """
    base, at, sampling = name.partition("@")
    kind = KNOWN[base][0] if base in KNOWN else "smooth"
    for other in ("even", "uneven"):
        if at and sampling == other and kind == "smooth":
            return replace(known_case(base, replace(variation, sampling=other)), name=name)
    if name in KNOWN:
        return Case(name=name, kind=kind, known=KNOWN[name][1](), variation=variation)
    head, _, seed = name.partition("-")
    if head == "random" and seed.isdigit():
        return Case(name=name, kind="smooth", known=gallery.random_polynomial(int(seed)), variation=variation)
    raise OptionError(f"there is no case {name!r}; choose from: {', '.join(KNOWN)}, random-SEED")
