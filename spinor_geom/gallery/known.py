"""What a known answer is: a surface or a closed curve with exact figures and their source."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.interpolate import CubicSpline

from spinor_geom.errors import OptionError, require_positive
from spinor_geom.gallery.chart import Chart, SurfaceFunction, null_tangents
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.shown import shortened
from spinor_geom.surface import SpinorSurface

_LENGTH_POINTS = 1 << 9  # points of a side that its length is measured by
_DENSE = 1 << 14  # steps that the length of a curve is measured by
_OUTLINE = 512  # vertices of a chart's outline


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownDisk:
    """A minimal disk that a curve is known to bound."""

    area: float
    stable: bool | None = None  # whether it is a local minimum of the area; None where that is not known
    relative_error: float = 1e-15  # how far off `area` may be, relative to it


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownCurve(ClosedCurve):
    """A closed curve in exact formulas, with what is known of it."""

    name: str  # for tables and messages
    disks: tuple[KnownDisk, ...] = ()  # the minimal disks it is known to bound, smallest area first
    source: str  # where curve and areas come from
    chart: Chart | None = None  # the first of those disks in exact formulas, where there are some

    def __repr__(self) -> str:
        areas = ", ".join(f"{disk.area:.6g}" for disk in self.disks)
        return shortened(f"KnownCurve({self.name!r}{f', disks of area {areas}' if areas else ''})")

    def sample(self, n: int, *, grading: float = 1.0) -> BoundaryLoop:
        """A loop of n points of the curve, its corners among them.

        A grading of 1 spaces the points of each side equally in t; larger values move them towards its corners. An n
        below 3 or the number of corners, or a grading that is not positive, is an OptionError.
        """
        t, corners = sample_parameters(n, self.corners, grading=grading)
        return BoundaryLoop.from_points(self.point(t), corners=corners.tolist())


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownSurface:
    """A minimal surface in exact formulas."""

    name: str  # for tables and messages
    surface: SpinorSurface
    position: SurfaceFunction  # closed formula of r(z)
    area: float  # exact
    source: str  # where surface and area come from

    def __repr__(self) -> str:
        return shortened(f"KnownSurface({self.name!r}, area {self.area:.6g})")

    def rim(self, n: int, *, grading: float = 1.0) -> BoundaryLoop:
        """A loop of n points of its boundary r(∂Ω), the corners of Ω among them; see `KnownCurve.sample`."""
        boundary = self.surface.domain.boundary
        at_corners = boundary.parameters[:-1][boundary.corners]
        t, corners = sample_parameters(n, at_corners.tolist(), grading=grading)
        return BoundaryLoop.from_points(self.position(boundary.point(t)), corners=corners.tolist())

    @cached_property
    def chart(self) -> Chart:
        """The surface as a ruler; its tangents are those of the spinors."""
        return surface_chart(self.surface, self.position)


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownPatch:
    """A minimal disk in exact formulas that is bounded by sides in its chart's plane."""

    name: str  # for tables and messages
    chart: Chart
    # from corner to corner, each a function of t in [0, 1]
    sides: tuple[Callable[[Float[np.ndarray, " n"]], Complex[np.ndarray, " n"]], ...]
    area: float  # exact
    source: str  # where surface and area come from

    def __repr__(self) -> str:
        return shortened(f"KnownPatch({self.name!r}, area {self.area:.6g})")

    def rim(self, n: int, *, grading: float = 1.0) -> BoundaryLoop:
        """A loop of n points of its boundary, almost equally far apart on every side; see `KnownCurve.sample`."""
        # denser at the ends of a side, where it may start like a square root
        t = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, _LENGTH_POINTS))
        lengths = [_lengths(self.chart.position(side(t))) for side in self.sides]
        ends = np.cumsum([length[-1] for length in lengths])
        starts = np.append(0.0, ends[:-1]) / ends[-1]
        parameters, corners = sample_parameters(n, starts.tolist(), grading=grading)
        owner = np.searchsorted(starts, parameters, side="right") - 1
        along = (parameters - starts[owner]) * ends[-1]
        points = np.empty((n, 3))
        for k, (side, length) in enumerate(zip(self.sides, lengths, strict=True)):
            points[owner == k] = self.chart.position(side(np.interp(along[owner == k], length, t)))
        return BoundaryLoop.from_points(points, corners=corners.tolist())


def surface_chart(surface: SpinorSurface, position: SurfaceFunction) -> Chart:
    """A surface as a ruler: its position as a function, its tangents by p and q."""

    def tangents(z: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 2 3"]:
        p, q = np.moveaxis(np.asarray(surface.spinors(z)), -1, 0)
        return null_tangents(np.stack([p**2 - q**2, -1j * (p**2 + q**2), 2 * p * q], axis=-1))

    boundary = surface.domain.boundary
    t = np.union1d(np.arange(_OUTLINE) / _OUTLINE, boundary.parameters[:-1][boundary.corners])
    return Chart(position=position, tangents=tangents, outline=boundary.point(t))


def sample_parameters(
    n: int, corners: Sequence[float], *, grading: float = 1.0
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " c"]]:
    """Parameters of n points on a closed curve with corners at increasing parameters, and the places of those.

    Each side between two corners gets points in proportion to its share of [0, 1), and at least its first corner, with
    which the parameters begin. With a grading g > 0 the fraction u of a side becomes u^g/(u^g + (1 − u)^g). Other
    gradings, and an n below 3 or the number of corners, are an OptionError.
    """
    require_positive("grading", grading)
    if n < (least := max(3, len(corners))):
        raise OptionError(f"a closed curve with {len(corners)} corners needs at least {least} points, got {n}")
    if not corners:
        return np.arange(n) / n, np.empty(0, dtype=np.int64)
    start = np.asarray(corners, dtype=np.float64)
    share = np.diff(np.append(start, start[0] + 1))
    # one point each for the corners, the rest by the largest remainder
    wanted = share * (n - len(start))
    count = np.floor(wanted).astype(np.int64)
    count[np.argsort(count - wanted, kind="stable")[: n - len(start) - count.sum()]] += 1
    count += 1
    first = np.append(0, np.cumsum(count)[:-1])
    u = (np.arange(n) - np.repeat(first, count)) / np.repeat(count, count)
    graded = u**grading / (u**grading + (1 - u) ** grading)
    return np.mod(np.repeat(start, count) + graded * np.repeat(share, count), 1.0), first


def evenly_sampled(curve: ClosedCurve | KnownSurface, n: int) -> BoundaryLoop:
    """A loop of n points of a curve or a rim without corners, equally far apart along it; its corners are none."""
    return _at_shares(curve, np.arange(n) / n)


def unevenly_sampled(curve: ClosedCurve | KnownSurface, n: int, *, seed: int, spread: float = 0.8) -> BoundaryLoop:
    """A loop of n points of a curve or a rim without corners whose edges differ in length at random, without corners.

    They are in proportion to numbers uniform in [1 − spread, 1 + spread] (numpy's default generator), spread below 1.
    """
    edges = np.random.default_rng(seed).uniform(1 - spread, 1 + spread, n)
    return _at_shares(curve, (np.cumsum(edges) - edges) / edges.sum())


def noisy_loop(loop: BoundaryLoop, share: float, *, seed: int) -> BoundaryLoop:
    """A loop whose points are moved by isotropic normal vectors, `share` of its mean edge in each coordinate.

    Corners are left to the rule that finds them, which must not take noise for corners.
    """
    moves = share * loop.mean_edge_length * np.random.default_rng(seed).normal(size=loop.points.shape)
    return BoundaryLoop.from_points(loop.points + moves)


def _at_shares(curve: ClosedCurve | KnownSurface, shares: np.ndarray) -> BoundaryLoop:
    t = np.arange(_DENSE + 1) / _DENSE
    length = _lengths(_point(curve, t))
    parameters = CubicSpline(length / length[-1], t)(shares)
    return BoundaryLoop.from_points(_point(curve, parameters), corners=())


def _lengths(points: np.ndarray) -> np.ndarray:
    """Length of a chain of points up to each."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def _point(curve: ClosedCurve | KnownSurface, t: np.ndarray) -> np.ndarray:
    return curve.position(curve.surface.domain.boundary.point(t)) if isinstance(curve, KnownSurface) else curve.point(t)
