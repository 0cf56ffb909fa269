"""Smooth plane domains for a loop: an analytic curve fitted to a flattened disk's boundary, and its Λ."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.interpolate import CubicSpline

from spinor_geom.arrays import Place, shifted
from spinor_geom.deadline import require_time
from spinor_geom.domain.plane_domain import PARTS, FourierBoundary
from spinor_geom.domain.polygons import is_simple, near_vertices
from spinor_geom.errors import DomainError
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.harmonic.dirichlet import DirichletForm
from spinor_geom.plateau.misfit import TURNS_BACK

COARSE = 1e-4  # relative accuracy of Λ, and thus of coarse slides. With 1e-6 solves take 1.6 times as long
MOST_NODES = 4096  # largest number n of steps of ∂Ω: Λ takes 16·n² bytes
# Steps of ∂Ω per point, and width of the Gaussian that smooths ∂Ω, in points. The first pair that resolves ∂Ω is used.
# The first one closes narrow gaps. Without it smooth loops take twice as long. Without the last one random curve 22 has
# no Ω.
_SHAPES = ((4, 0.35), (8, 0.2), (12, 0.2))


class NodeDensity:
    """A parameter t of ∂Ω whose equal steps are denser at the vertices, bends and narrow places of a loop.

    t is the mean of three cumulative shares of the loop: of its length, its vertices, and its turning. In places that
    are narrower than the spacing of the points t increases faster. The result is smoothed, so that ∂Ω and the slide
    along it can be analytic. On a circle with equal edges t = s.

    Attributes:
        points: the number of points that define Ω, with those added in narrow places.
    """

    def __init__(self, curve: BoundaryCurve, points: int) -> None:
        """Computes t for Γ. `points` is without those added in narrow places."""
        self.curve = curve
        more, self.narrowest = _more_in_narrow_places(curve, points)
        total = 1 + float(more[-1])
        points = self.points = int(np.ceil(total * points))
        count = len(curve.breaks) - 1
        n = PARTS * max(count, points)
        s = np.arange(n + 1) / n
        tangent = curve.derivative(s)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        turning = np.cumsum(np.linalg.norm(np.diff(tangent, axis=0, prepend=tangent[:1]), axis=1))
        by_vertex = np.interp(s, curve.breaks, np.arange(count + 1) / count)
        share = (curve.length_share(s) + by_vertex + turning / turning[-1]) / 3
        share = (share + np.interp(s, np.arange(len(more)) / (len(more) - 1), more)) / total
        self._t = np.arange(n + 1) / n
        offset = np.fft.rfft(np.interp(self._t[:-1], share, s) - self._t[:-1])
        # smoothed over √2 points, so that it does not follow single edges
        offset *= np.exp(-((2 * np.pi * np.arange(len(offset)) / points) ** 2))
        smooth = np.fft.irfft(offset, n=n)
        # increasing: a smoothing of an increasing function by a positive kernel
        self._s = self._t + np.append(smooth, smooth[0]) - smooth[0]
        self._s_at_0 = smooth[0]

    @property
    def is_narrow(self) -> bool:
        """Whether a narrow place of the loop needs more than twice the usual density of nodes, and thus a fine ∂Ω."""
        return self.narrowest > 2

    def parameter(self, s: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts"]:
        """t(s), continued around the circle."""
        s = s - self._s_at_0
        whole = np.floor(s)
        return np.asarray(np.interp(s - whole, self._s, self._t) + whole)

    def slide(self, t: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts"]:
        """s(t), the inverse."""
        whole = np.floor(t)
        return np.asarray(np.interp(t - whole, self._t, self._s) + whole + self._s_at_0)


def _more_in_narrow_places(curve: BoundaryCurve, points: int) -> tuple[Float[np.ndarray, " n"], float]:
    """Cumulative number of additional nodes in narrow places, over the usual number, and the largest density.

    The width at a point is its distance from the part of Γ that faces it. The density is 1 in wide places.
    """
    n = PARTS * points
    s = np.arange(n + 1) / n
    p, along = curve.point(s[:-1]), curve.length_share(s)
    edge = curve.length() / points
    arc = np.abs(along[:-1, None] - along[:-1])
    arc = np.minimum(arc, 1 - arc) * curve.length()
    distance = np.linalg.norm(p[:, None] - p, axis=-1)
    width = np.where((arc > edge) & (TURNS_BACK * distance < arc), distance, np.inf).min(axis=1)
    density = np.clip(edge / width, 1, MOST_NODES / n)
    return np.append(0, np.cumsum((density - 1) * np.diff(along))), float(density.max())


@dataclass(frozen=True, kw_only=True, eq=False)
class DomainShape:
    """Parametrisation, resolution and smoothing of ∂Ω."""

    density: NodeDensity
    count: int  # number of vertices
    steps: int  # number of steps on ∂Ω
    width: float  # standard deviation of the smoothing Gaussian, as a share of ∂Ω


def resolved(
    polygon: Complex[np.ndarray, " k"],
    t: Float[np.ndarray, " k"],
    density: NodeDensity,
    is_fine: bool,
    *,
    count: int,
    most: int,
    place: Place,
    is_unknown: bool,
) -> tuple[DomainShape, DirichletForm]:
    """The smooth Ω fitted to a polygon with parameters t, with the fewest steps that resolve it, and its Λ.

    With `is_fine`, and for narrow loops, the coarsest steps are not tried. The finest ones take seconds. For others
    whose Γ between the points `is_unknown` they are not tried: the surface through the points takes a tenth of that.

    Raises:
        DomainError: no Ω is simple and resolved.
        OutOfTimeError: time ran out.
    """
    n = density.points
    shapes = _SHAPES[1:] if is_fine or density.is_narrow else _SHAPES[: len(_SHAPES) - is_unknown]
    for steps, rounding in shapes:
        shape = DomainShape(density=density, count=count, steps=steps * n, width=rounding / n)
        try:
            boundary = rounded_boundary(polygon, t, shape)
            return shape, resolved_form(boundary, shape.steps, place, most=min(most, MOST_NODES))
        except DomainError as error:
            failure = error
    raise failure


def rounded_boundary(
    polygon: Complex[np.ndarray, " k"], t: Float[np.ndarray, " k"], shape: DomainShape
) -> FourierBoundary:
    """An analytic curve near a polygon: a spline through its vertices at parameters t, smoothed by a Gaussian."""
    spline = CubicSpline(np.append(t, t[0] + 1), np.append(polygon, polygon[0]), bc_type="periodic")
    highest = shape.steps // 4
    n = 2 * PARTS * highest
    k = np.arange(-highest, highest + 1)
    coefficients = np.fft.fft(spline(np.arange(n) / n))[k] / n
    return FourierBoundary(coefficients * np.exp(-0.5 * (2 * np.pi * k * shape.width) ** 2), shape.count)


def resolved_form(boundary: FourierBoundary, n: int, place: Place, *, most: int = MOST_NODES) -> DirichletForm:
    """Λ on n steps of ∂Ω.

    Raises:
        DomainError: ∂Ω crosses itself, or n is too small to resolve it or larger than `most`.
        OutOfTimeError: time ran out.
    """
    if n > most:
        raise DomainError(
            f"the plane domain has a narrow place that needs {n} steps around it; at most {most} are tried",
            vertices=len(boundary.vertices),
        )
    polygon = boundary.grid(n)[0]
    # cheap tests first: Λ costs O(n³), and is not resolved where facing parts are within two steps
    require_time()
    form = DirichletForm.of(boundary, n, place) if _is_wide(polygon) and is_simple(polygon) else None
    if form is None or not form.error <= COARSE:
        raise DomainError(
            f"the plane domain crosses itself, or has a place that is too narrow for {n} steps around it",
            vertices=len(boundary.vertices),
        )
    return form


def _is_wide(polygon: Complex[np.ndarray, " n"]) -> bool:
    """Whether vertices of a closed polygon that face each other are more than two of their edges apart."""
    edge = np.abs(shifted(polygon, -1) - polygon)
    along = np.cumsum(edge) - edge
    i, j = near_vertices(polygon, 2 * np.maximum(edge, shifted(edge, 1)))
    arc = np.abs(along[i] - along[j])
    arc = np.minimum(arc, edge.sum() - arc)
    return not (arc > TURNS_BACK * np.abs(polygon[i] - polygon[j])).any()
