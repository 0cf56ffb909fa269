"""Closed curves in exact formulas, with the areas of minimal disks that they bound, if known."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Complex, Float
from numpy.typing import ArrayLike

from spinor_geom.arrays import modulo_one
from spinor_geom.errors import OptionError, require_positive
from spinor_geom.gallery.chart import Chart
from spinor_geom.gallery.known import KnownCurve, KnownDisk
from spinor_geom.mesh.curve import ClosedCurve, CurveFunction

_TENNIS_SEAM_DISKS = {  # area, whether it is stable, relative error
    0.8: [(4.36461878664500, True, 1e-14)],
    0.76: [(4.6084369275, True, 1e-10), (4.6085984535, False, 1e-10)],
    0.75: [(4.66497038914645, True, 1e-14), (4.66975749646780, False, 1e-14)],
    0.6: [(4.9899, True, 2e-5), (5.5971234813, False, 1e-10)],
}
# points and directions ↦ images, and their first and second derivatives in these directions
SmoothMap = Callable[[Float[np.ndarray, "*pts d"], Float[np.ndarray, "*pts d"]], Float[np.ndarray, "3 *pts 3"]]

_OUTLINE, _SIDE_POINTS = 400, 512  # vertices of a chart's outline, and points for the length of a side
_SCHERK_AREAS = {1.0: 1.08724596383763888, 2.0: 5.69751221158705744, 2.5: 11.4951537487130629, 3.0: 29.2319867716447538}


def twisted_circle(radius: float = 1.0, k: int = 3, amplitude: float = 0.2) -> KnownCurve:
    """The perturbed circle (R cos t, R sin t, α sin kt) of radius R, k waves and amplitude α."""
    require_positive("radius", radius)
    known = (radius, k, amplitude) == (1.0, 3, 0.2)
    return _fourier(
        (1, (radius, -1j * radius, 0)),
        (k, (0, 0, -1j * amplitude)),
        name=f"twisted circle R={radius:g} k={k} α={amplitude:g}",
        disks=(KnownDisk(area=3.32087142904707, relative_error=1e-13),) if known else (),
        source="Sun & Chern (2026), comparison of Plateau solvers; area by a converged Fourier solve",
    )


def tennis_seam(a: float = 0.8) -> KnownCurve:
    """The seam of a tennis ball on the unit sphere: (a cos t + b cos 3t, a sin t − b sin 3t, 2√(ab) sin 2t), b = 1 − a.

    The symmetric disk is stable down to a value of a between 0.78 and 0.76. Below it, two mirror images of smaller area
    are stable.
    """
    if not 0 < a < 1:
        raise OptionError(f"a tennis seam needs a in (0, 1), got {a}")
    b = 1 - a
    disks = (KnownDisk(area=s, stable=stable, relative_error=e) for s, stable, e in _TENNIS_SEAM_DISKS.get(a, ()))
    return _fourier(
        (1, (a, -1j * a, 0)),
        (2, (0, 0, -2j * math.sqrt(a * b))),
        (3, (b, 1j * b, 0)),
        name=f"tennis seam a={a:g}",
        disks=tuple(disks),
        source="the curve of a tennis ball; areas by converged Fourier solves of Douglas's problem",
    )


def ellipse(a: float = 2.0, height: float = 0.0) -> KnownCurve:
    """The ellipse (a cos t, sin t) with z = height·sin 2t: plane for height 0, else a saddle."""
    require_positive("a", a)
    t = 2 * np.pi * np.arange(_OUTLINE) / _OUTLINE
    region = plane_chart(a * np.cos(t) + 1j * np.sin(t))
    return _fourier(
        (1, (a, -1j, 0)),
        (2, (0, 0, -1j * height)),
        name=f"ellipse {a:g}:1 height {height:g}",
        disks=(KnownDisk(area=np.pi * a, stable=True),) if height == 0 else (),
        source="area πab of the plane ellipse",
        chart=region if height == 0 else None,
    )


def random_curve(seed: int) -> KnownCurve:
    """A random, strongly folded closed curve Σ a_k cos 2πkt + b_k sin 2πkt with 3 to 6 harmonics.

    The components of a_k and b_k are normal with standard deviation 1/k, so that all harmonics contribute equally to
    the tangent. Then x of the first harmonic is multiplied by an elongation uniform in [1, 10].
    """
    random = np.random.default_rng(seed)
    harmonics = int(random.integers(3, 7))
    elongation = float(random.uniform(1, 10))
    coefficients = random.normal(size=(2, harmonics, 3)) / np.arange(1, harmonics + 1)[:, None]
    coefficients[:, 0, 0] *= elongation
    name = f"random curve {seed}: {harmonics} harmonics, elongation {elongation:.1f}"
    waves = enumerate(coefficients[0] - 1j * coefficients[1], start=1)
    return _fourier(*waves, name=name, source="normal coefficients")


def plane_polygon(corners: ArrayLike, *, name: str) -> KnownCurve:
    """A simple polygon in the plane z = 0 with (k, 2) corners, counter-clockwise."""
    plane = np.asarray(corners, dtype=np.float64)
    outline = plane[:, 0] + 1j * plane[:, 1]
    area = 0.5 * float(np.imag(np.conj(outline) * np.roll(outline, -1)).sum())
    curve = polygon(np.column_stack([plane, np.zeros(len(plane))]), name=name, source="the shoelace formula")
    return replace(curve, disks=(KnownDisk(area=area, stable=True),), chart=plane_chart(outline))


def plane_chart(outline: Complex[np.ndarray, " m"]) -> Chart:
    """The region inside a simple polygon in the plane z = 0, counter-clockwise."""
    tangents = np.eye(3)[:2]
    return Chart(
        position=lambda z: np.stack([z.real, z.imag, np.zeros(np.shape(z))], axis=-1),
        tangents=lambda z: np.broadcast_to(tangents, (*np.shape(z), 2, 3)),
        outline=outline,
    )


def l_shape(rise: float = 0.0) -> KnownCurve:
    """The outline of an L of three unit squares, with its corners on the saddle z = rise·xy."""
    plane = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]])
    if rise == 0:
        return plane_polygon(plane, name="L-shape")
    vertices = np.column_stack([plane, rise * plane.prod(axis=1)])
    return polygon(vertices, name=f"L-shape on z = {rise:g}xy", source="three unit squares")


def scherk(side: float = 2.0) -> KnownCurve:
    """The boundary of Scherk's graph z = log(cos y/cos x) over a square about 0 of a side less than π."""
    if not 0 < side < np.pi:
        raise OptionError(f"Scherk's graph needs a side in (0, π), got {side}")
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * side / 2

    def over(xy: Float[np.ndarray, "*pts 2"], along: Float[np.ndarray, "*pts 2"]) -> Float[np.ndarray, "3 *pts 3"]:
        (x, y), (dx, dy) = np.moveaxis(xy, -1, 0), np.moveaxis(along, -1, 0)
        bend = (dx / np.cos(x)) ** 2 - (dy / np.cos(y)) ** 2
        slope = np.stack([dx, dy, dx * np.tan(x) - dy * np.tan(y)], axis=-1)
        return np.stack([graph(x + 1j * y), slope, np.stack([0 * dx, 0 * dy, bend], axis=-1)])

    def graph(z: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        return np.stack([z.real, z.imag, np.log(np.cos(z.imag) / np.cos(z.real))], axis=-1)

    def tangents(z: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 2 3"]:
        one, none = np.ones(np.shape(z)), np.zeros(np.shape(z))
        x = np.stack([one, none, np.tan(z.real)], axis=-1)
        return np.stack([x, np.stack([none, one, -np.tan(z.imag)], axis=-1)], axis=-2)

    share = np.linspace(0, 1, _OUTLINE // 4, endpoint=False)[:, None]
    outline = (square[:, None] + share * (np.roll(square, -1, axis=0) - square)[:, None]).reshape(-1, 2)
    area = _SCHERK_AREAS.get(side)
    source = "Scherk (1834), the graph is the only minimal disk over its convex square; areas by quadrature"
    return replace(
        image_of_polygon(square, over, name=f"Scherk side {side:g}", source=source),
        disks=() if area is None else (KnownDisk(area=area, stable=True),),
        chart=Chart(position=graph, tangents=tangents, outline=outline @ [1, 1j]),
    )


def polygon(vertices: ArrayLike, *, name: str = "polygon", source: str = "its vertices") -> KnownCurve:
    """The closed polygon through (k, 3) vertices, k ≥ 3, by arc length. The first vertex is not repeated."""
    corners = np.asarray(vertices, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) < 3:
        raise OptionError(f"a polygon needs vertices of shape (k, 3) with k at least 3, got {corners.shape}")
    return image_of_polygon(corners, lambda r, along: np.stack([r, along, 0 * along]), name=name, source=source)


def image_of_polygon(corners: Float[np.ndarray, "k d"], image: SmoothMap, *, name: str, source: str) -> KnownCurve:
    """The image of a closed polygon under a smooth map.

    The parameter is linear on each side of the polygon. The part of [0, 1) of a side is proportional to the length of
    its image.
    """
    sides, edges = len(corners), np.roll(corners, -1, axis=0) - corners

    def derivative(order: int, share: Float[np.ndarray, " k"]) -> CurveFunction:
        first = np.append(0.0, np.cumsum(share)[:-1])

        def at(t: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
            t = modulo_one(t)
            side = np.asarray(np.searchsorted(first, t, side="right") - 1)
            images = image(corners[side] + ((t - first[side]) / share[side])[..., None] * edges[side], edges[side])
            return np.asarray(images[order] / share[side][..., None] ** order)

        return at

    middles = (np.arange(sides * _SIDE_POINTS) + 0.5) / (sides * _SIDE_POINTS)
    speed = np.linalg.norm(derivative(1, np.full(sides, 1 / sides))(middles), axis=1)
    length = speed.reshape(sides, -1).mean(axis=1)
    share = length / length.sum()
    return KnownCurve(
        name=name,
        point=derivative(0, share),
        derivative=derivative(1, share),
        second_derivative=derivative(2, share),
        corners=(0.0, *np.cumsum(share)[:-1].tolist()),
        source=source,
    )


def slit(length: float = 50.0, width: float = math.sqrt(0.75), *, bend: float = 0.0) -> KnownCurve:
    """A rectangle, plane or with its longer sides rolled on a cylinder through an angle `bend` in radians.

    The default is the hole that a removed strip of 100 equilateral triangles of edge 1 leaves in a mesh.
    """
    require_positive("length", length)
    require_positive("width", width)
    if not 0 <= bend < 2 * math.pi:
        raise OptionError(f"a slit needs a bend in [0, 2π), got {bend}")
    if bend == 0:
        corners = [(0, 0), (length, 0), (length, width), (0, width)]
        return plane_polygon(corners, name=f"slit {length:g} × {width:.3g}")
    name = f"slit {length:g} × {width:.3g} bent by {math.degrees(bend):.0f}°"
    source = "a rectangle rolled on a cylinder"
    return _outline(length / bend, width / 2, bend, tilt=math.pi / 2, name=name, source=source)


def horseshoe(
    radius: float = 1.0, half_width: float = 0.25, *, turn: float = 1.5 * math.pi, twist: float = math.pi / 2
) -> KnownCurve:
    """The outline of a twisted strip around an arc of a circle.

    The strip starts in the plane of the circle, and makes an angle `twist` with it at the end of the arc, after an
    angle `turn` around the centre, in radians.
    """
    if not (0 < half_width < radius < math.inf and 0 < turn < 2 * math.pi):
        raise OptionError(
            f"a horseshoe needs 0 < half_width < radius and a turn in (0, 2π), got {half_width}, {radius}, {turn}"
        )
    name = f"horseshoe {math.degrees(turn):.0f}°, twisted by {math.degrees(twist):.0f}°"
    source = "a ruled strip along an arc of a circle"
    return _outline(radius, half_width, turn, twist=twist, name=name, source=source)


def _outline(
    radius: float, h: float, turn: float, *, tilt: float = 0.0, twist: float = 0.0, **known: str
) -> KnownCurve:
    """The outline of the strip x + iy = (R + v cos ψ)e^{iθ}, z = v sin ψ, −h ≤ v ≤ h, 0 ≤ u ≤ 1.

    θ = turn·u is the angle around the axis, ψ = tilt + twist·u the slope.
    """

    def strip(uv: Float[np.ndarray, "*pts 2"], along: Float[np.ndarray, "*pts 2"]) -> Float[np.ndarray, "3 *pts 3"]:
        (u, v), (du, dv) = np.moveaxis(uv, -1, 0), np.moveaxis(along, -1, 0)
        # v e^{iψ} and (R + v cos ψ)e^{iθ}, each with its derivatives
        slope, around, turned = np.exp(1j * (tilt + twist * u)), np.exp(1j * turn * u), 1j * turn * du
        across = [
            v * slope,
            (dv + 1j * twist * du * v) * slope,
            1j * twist * du * (2 * dv + 1j * twist * du * v) * slope,
        ]
        out, first, second = radius + across[0].real, across[1].real, across[2].real
        plane = [out, first + turned * out, second + 2 * turned * first + turned**2 * out]
        points = zip((one * around for one in plane), (one.imag for one in across), strict=True)
        return np.stack([np.stack([xy.real, xy.imag, z], axis=-1) for xy, z in points])

    return image_of_polygon(np.array([(0, h), (1, h), (1, -h), (0, -h)]), strip, **known)


def harmonics(coefficients: Complex[np.ndarray, "k 3"]) -> ClosedCurve:
    """The curve Re Σ_{k ≥ 0} c_k e^{2πikt}."""
    waves = 2j * np.pi * np.arange(len(coefficients))

    def derivative(order: int) -> CurveFunction:
        weighed = waves[:, None] ** order * coefficients
        return lambda t: np.asarray((np.exp(np.asarray(t)[..., None] * waves) @ weighed).real)

    return ClosedCurve(point=derivative(0), derivative=derivative(1), second_derivative=derivative(2))


def trigonometric(points: Float[np.ndarray, "n 3"]) -> ClosedCurve:
    """The trigonometric polynomial through points at equal steps of t."""
    series = 2 * np.fft.rfft(points, axis=0) / len(points)
    series[[0] if len(points) % 2 else [0, -1]] /= 2
    return harmonics(series)


def _fourier(*waves: tuple[int, ArrayLike], **known: Any) -> KnownCurve:
    """The curve Re Σ c_k e^{2πikt} of pairs k and c_k, with the other fields of a `KnownCurve`."""
    coefficients = np.zeros((1 + max(k for k, _ in waves), 3), dtype=np.complex128)
    for k, vector in waves:
        coefficients[k] += vector
    return KnownCurve(**{**vars(harmonics(coefficients)), **known})
