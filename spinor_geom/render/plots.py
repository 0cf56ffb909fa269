"""Plots: figures on logarithmic axes, surfaces in space, and functions in the colours of complex numbers."""

from __future__ import annotations

import html
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Complex, Float, Int
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from numpy.typing import ArrayLike

from spinor_geom.mesh.curve import CurveFunction
from spinor_geom.surface import SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface

# largest chroma in OKLCH, and how it rises from black and falls to white: inside sRGB for every hue
_CHROMA, _RISE, _FALL = 0.125, 0.25, 0.5
_RINGS = 0.08  # of lightness, between one power of two of the modulus and the next
# Source: Ottosson, "A perceptual color space for image processing" (2020).
_TO_LMS = np.array(
    [[1.0, 0.3963377774, 0.2158037573], [1.0, -0.1055613458, -0.0638541728], [1.0, -0.0894841775, -1.2914855480]]
)
_TO_RGB = np.array(
    [
        [4.0767416621, -3.3077115913, 0.2309699292],
        [-1.2684380046, 2.6097574011, -0.3413193965],
        [-0.0041960863, -0.7034186147, 1.7076147010],
    ]
)
_SIZE = 4.0  # inches, of a side of the square for a surface
_ZOOM = 1.2  # by which axes in space are enlarged, which leave room for what they do not have here
_RIM = 400  # points of a boundary
_GRID = (16, 96)  # circles and points on each, of a surface over the unit disk
_PHASE, _PIXELS = 2.2, 160  # inches and points of a side of a function's picture

HolomorphicFunction = Callable[[Complex[np.ndarray, " n"]], Complex[np.ndarray, " n"]]


def log_log(
    lines: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    x: str,
    y: str,
    slopes: Mapping[str, int] | None = None,
    linear_x: bool = False,
) -> Figure:
    """Lines, (x, y) by label, on logarithmic axes; with slopes, by label, lines of those through their first points."""
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.add_subplot()
    for label, (at, value) in lines.items():
        axes.plot(np.atleast_1d(at), np.atleast_1d(value), marker="o", markersize=3, label=label)
    for (label, slope), style in zip((slopes or {}).items(), (":", "--"), strict=False):
        at, value = (np.asarray(v, dtype=np.float64) for v in lines[label])
        axes.plot(at, value[0] * (at / at[0]) ** slope, f"k{style}", linewidth=1, label=f"slope {slope}")
    axes.set_yscale("log")
    if not linear_x:
        axes.set_xscale("log")
    if slopes:
        ticks = np.atleast_1d(next(iter(lines.values()))[0])
        axes.set_xticks(ticks, labels=[f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(visible=True, which="both", alpha=0.2)
    figure.legend(loc="outside right upper", fontsize="small")
    return figure


def inline_svg(figure: Figure, alt: str) -> str:
    """A figure as an `svg` element of a page, without a background, its black in the page's own colour of text."""
    for legend in figure.legends:
        legend.set_frame_on(False)
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": alt}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    drawing = buffer.getvalue()
    drawing = drawing[drawing.index("<svg") :].replace("#000000", "currentColor")
    return drawing.replace("<svg", f'<svg role="img" fill="currentColor" aria-label="{html.escape(alt)}"', 1)


def domain_colours(value: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
    """Colours in sRGB, 0 to 1: red for positive numbers, blue-green for negative ones, black at 0, white at ∞.

    The lightness grows with the modulus and steps back a little at every power of two, so that moduli can be counted
    like the rings of a map; equal steps of the argument look equally large. NaN is white.
    """
    modulus = np.abs(value)
    with np.errstate(divide="ignore", invalid="ignore"):
        octave = np.log2(modulus)
        share = modulus / (1 + modulus)
        ring = np.where(np.isfinite(octave), octave - np.floor(octave), 0.0)
    share = np.where(np.isinf(modulus), 1.0, share)
    lightness = share**0.7 * (1 - _RINGS * (1 - ring))
    chroma = np.minimum(_CHROMA, np.minimum(_RISE * lightness, _FALL * (1 - lightness)))
    hue = np.angle(value) + np.radians(25.0)  # red
    lab = np.stack([lightness, chroma * np.cos(hue), chroma * np.sin(hue)], axis=-1)
    linear = np.clip((lab @ _TO_LMS.T) ** 3 @ _TO_RGB.T, 0.0, 1.0)
    rgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.asarray(np.where(np.isnan(rgb), 1.0, rgb))


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """A surface as triangles."""

    position: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    rim: Float[np.ndarray, "m 3"]  # closed sequence of points of its boundary
    value: Float[np.ndarray, " n"] | None = None  # what the colour of each vertex tells; one colour for all without
    marks: Float[np.ndarray, "k 3"] = field(default_factory=lambda: np.zeros((0, 3)))  # with a cross

    @classmethod
    def of(cls, surface: SpinorSurface | WeierstrassSurface, grid: tuple[int, int] = _GRID) -> Drawn:
        """A surface over a grid on the unit disk: so many circles, and points on each; see `disk_grid`."""
        z, faces = disk_grid(*grid)
        rim = np.exp(2j * np.pi * np.arange(_RIM) / _RIM)
        return cls(position=surface.position(z), faces=faces, rim=surface.position(rim))


def disk_grid(circles: int, around: int) -> tuple[Complex[np.ndarray, " n"], Int[np.ndarray, "f 3"]]:
    """Points of the unit disk on circles of equally spaced radii, its centre first, and triangles between them."""
    turns = np.arange(around) / around
    z = np.concatenate([[0], (np.arange(1, circles + 1)[:, None] / circles * np.exp(2j * np.pi * turns)).ravel()])
    return z, np.asarray(Triangulation(z.real, z.imag).triangles, dtype=np.int64)


def surfaces(
    drawn: Mapping[str, Drawn], *, curves: Mapping[str, CurveFunction] | None = None, across: int = 4
) -> Figure:
    """Surfaces by title, so many in a row: their boundaries in black, in red the Γ(t) that they should have."""
    across = min(across, len(drawn))
    down = -(-len(drawn) // across)
    figure = Figure(figsize=(_SIZE * across, _SIZE * down), layout="constrained")
    for place, (title, one) in enumerate(drawn.items()):
        # lines and crosses over the triangles, which would hide them by halves
        axes: Any = figure.add_subplot(
            down, across, place + 1, projection="3d", proj_type="ortho", computed_zorder=False, title=title
        )
        # without smooth edges, which would leave a pale seam between any two triangles
        look = {"color": "#8fb3d9", "linewidth": 0, "antialiased": False}
        mesh = axes.plot_trisurf(*one.position.T, triangles=one.faces, **look)
        if one.value is not None:
            mesh.set_array(one.value[one.faces].mean(axis=1))
            mesh.set_cmap("viridis")
            figure.colorbar(mesh, ax=axes, shrink=0.5)
        lines = {"black": np.append(one.rim, one.rim[:1], axis=0)}
        if curves is not None:
            lines["red"] = curves[title](np.linspace(0, 1, _RIM))
        for colour, points in lines.items():
            axes.plot(*points.T, color=colour, linewidth=1)
        axes.plot(*one.marks.T, marker="x", markersize=9, markeredgewidth=2, color="black", linestyle="none")
        shown = np.concatenate(list(lines.values()))
        low, high = shown.min(axis=0), shown.max(axis=0)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axes.set_box_aspect(high - low, zoom=_ZOOM)
        axes.set_axis_off()
    return figure


def phases(rows: Mapping[str, Mapping[str, HolomorphicFunction]]) -> Figure:
    """Functions on the unit disk in the colours of `domain_colours`, by name in rows by title."""
    across = max(len(row) for row in rows.values())
    figure = Figure(figsize=(_PHASE * across, _PHASE * len(rows)), layout="constrained")
    axes = figure.subplots(len(rows), across, squeeze=False)
    side = np.linspace(-1, 1, _PIXELS)
    z = side + 1j * side[:, None]
    inside = np.abs(z) <= 1
    for (title, row), line in zip(rows.items(), axes, strict=True):
        for (name, function), one in zip(row.items(), line, strict=True):
            picture = np.ones((*z.shape, 3))
            picture[inside] = domain_colours(function(z[inside]))
            one.imshow(picture, origin="lower", extent=(-1, 1, -1, 1))
            one.set_title(f"{name}, {title}", fontsize="small")
            one.set_axis_off()
    return figure
