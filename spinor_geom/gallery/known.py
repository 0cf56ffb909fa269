"""Types for curves and surfaces with exact formulas and areas, and boundary loops sampled from them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.interpolate import CubicSpline

from spinor_geom.errors import OptionError
from spinor_geom.gallery.chart import Chart, SurfaceFunction, null_tangents
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.shown import shortened
from spinor_geom.surface.array_surface import ArraySurface

_SIDE_POINTS, _CURVE_STEPS = 1 << 9, 1 << 14  # for the arc length of a side, and of a curve
_OUTLINE = 512  # vertices of a chart's outline


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownDisk:
    """Area and stability of a known minimal disk over a curve."""

    area: float
    stable: bool | None = None  # whether it is a local minimum of the area, None if not known
    relative_error: float = 1e-15  # of `area`


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownCurve(ClosedCurve):
    """A closed curve with an exact formula, and the known minimal disks that it bounds."""

    name: str  # for tables and messages
    disks: tuple[KnownDisk, ...] = ()  # the minimal disks it is known to bound, smallest area first
    source: str  # of the curve and the areas
    chart: Chart | None = None  # the first of those disks in exact formulas, if known

    def __repr__(self) -> str:
        areas = ", ".join(f"{disk.area:.6g}" for disk in self.disks)
        return shortened(f"KnownCurve({self.name!r}{f', disks of area {areas}' if areas else ''})")

    def sample(self, n: int) -> BoundaryLoop:
        """A loop of n points, with the corners, at equal steps of t on each side.

        Raises OptionError for n below 3 or the number of corners.
        """
        t, corners = sample_parameters(n, self.corners)
        return BoundaryLoop.from_points(self.point(t), corners=corners.tolist())


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownSurface:
    """A minimal surface with an exact formula."""

    name: str  # for tables and messages
    surface: ArraySurface
    position: SurfaceFunction  # r(z) in closed form
    area: float  # exact
    source: str  # of the surface and the area

    def __repr__(self) -> str:
        return shortened(f"KnownSurface({self.name!r}, area {self.area:.6g})")

    def point(self, t: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 3"]:
        """Points of the boundary r(∂Ω) at parameters of ∂Ω."""
        return self.position(self.surface.domain.boundary.point(t))

    def rim(self, n: int) -> BoundaryLoop:
        """A loop of n points of the boundary, with the corners of Ω, as by `KnownCurve.sample`."""
        boundary = self.surface.domain.boundary
        at_corners = boundary.parameters[:-1][boundary.corners]
        t, corners = sample_parameters(n, at_corners.tolist())
        return BoundaryLoop.from_points(self.point(t), corners=corners.tolist())

    @cached_property
    def chart(self) -> Chart:
        """The surface as a chart, for distances."""
        return surface_chart(self.surface, self.position)


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownPatch:
    """A minimal disk with an exact formula. The sides of its boundary are given in the plane of its chart."""

    name: str  # for tables and messages
    chart: Chart
    # from corner to corner, each a function of t in [0, 1]
    sides: tuple[Callable[[Float[np.ndarray, " n"]], Complex[np.ndarray, " n"]], ...]
    area: float  # exact
    source: str  # of the surface and the area

    def __repr__(self) -> str:
        return shortened(f"KnownPatch({self.name!r}, area {self.area:.6g})")

    def rim(self, n: int) -> BoundaryLoop:
        """A loop of n points of its boundary, almost equally far apart on every side, as by `KnownCurve.sample`."""
        # denser at the ends of a side, where it may behave like a square root
        t = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, _SIDE_POINTS))
        lengths = [_lengths(self.chart.position(side(t))) for side in self.sides]
        ends = np.cumsum([length[-1] for length in lengths])
        starts = np.append(0.0, ends[:-1]) / ends[-1]
        parameters, corners = sample_parameters(n, starts.tolist())
        owner = np.searchsorted(starts, parameters, side="right") - 1
        along = (parameters - starts[owner]) * ends[-1]
        points = np.empty((n, 3))
        for k, (side, length) in enumerate(zip(self.sides, lengths, strict=True)):
            points[owner == k] = self.chart.position(side(np.interp(along[owner == k], length, t)))
        return BoundaryLoop.from_points(points, corners=corners.tolist())


def surface_chart(surface: ArraySurface, position: SurfaceFunction) -> Chart:
    """A chart of a surface with a given position and the tangents of p and q."""

    def tangents(z: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 2 3"]:
        p, q = np.moveaxis(np.asarray(surface.spinors(z)), -1, 0)
        return null_tangents(np.stack([p**2 - q**2, -1j * (p**2 + q**2), 2 * p * q], axis=-1))

    boundary = surface.domain.boundary
    t = np.union1d(np.arange(_OUTLINE) / _OUTLINE, boundary.parameters[:-1][boundary.corners])
    return Chart(position=position, tangents=tangents, outline=boundary.point(t))


def sample_parameters(n: int, corners: Sequence[float]) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " c"]]:
    """Parameters of n points on a closed curve with corners at increasing parameters, and the indices of the corners.

    Each side has its first corner and a number of other points proportional to its length in [0, 1). The parameters
    begin at the first corner. Raises OptionError for n below 3 or the number of corners.
    """
    if n < (least := max(3, len(corners))):
        raise OptionError(f"a closed curve with {len(corners)} corners needs at least {least} points, got {n}")
    if not corners:
        return np.arange(n) / n, np.empty(0, dtype=np.int64)
    start = np.asarray(corners, dtype=np.float64)
    share = np.diff(np.append(start, start[0] + 1))
    # one point for each corner, the others by the largest remainders
    wanted = share * (n - len(start))
    count = np.floor(wanted).astype(np.int64)
    count[np.argsort(count - wanted, kind="stable")[: n - len(start) - count.sum()]] += 1
    count += 1
    first = np.append(0, np.cumsum(count)[:-1])
    u = (np.arange(n) - np.repeat(first, count)) / np.repeat(count, count)
    return np.mod(np.repeat(start, count) + u * np.repeat(share, count), 1.0), first


def evenly_sampled(curve: ClosedCurve | KnownSurface, n: int) -> BoundaryLoop:
    """A loop of n points, without corners, at equal steps of arc length along a smooth curve or rim."""
    return _at_shares(curve, np.arange(n) / n)


def unevenly_sampled(curve: ClosedCurve | KnownSurface, n: int, *, seed: int, spread: float = 0.8) -> BoundaryLoop:
    """A loop of n points, without corners, at random steps of arc length along a smooth curve or rim.

    The steps are proportional to numbers uniform in [1 − spread, 1 + spread], spread < 1.
    """
    edges = np.random.default_rng(seed).uniform(1 - spread, 1 + spread, n)
    return _at_shares(curve, (np.cumsum(edges) - edges) / edges.sum())


def noisy_loop(loop: BoundaryLoop, share: float, *, seed: int) -> BoundaryLoop:
    """A loop with points moved by normal random vectors of deviation `share` of the mean edge in each coordinate.

    Corners are detected again.
    """
    moves = share * loop.mean_edge_length * np.random.default_rng(seed).normal(size=loop.points.shape)
    return BoundaryLoop.from_points(loop.points + moves)


def _at_shares(curve: ClosedCurve | KnownSurface, shares: np.ndarray) -> BoundaryLoop:
    t = np.arange(_CURVE_STEPS + 1) / _CURVE_STEPS
    length = _lengths(curve.point(t))
    return BoundaryLoop.from_points(curve.point(CubicSpline(length / length[-1], t)(shares)), corners=())


def _lengths(points: np.ndarray) -> np.ndarray:
    """Arc length of a polyline up to each of its points."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
