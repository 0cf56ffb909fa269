"""Figures by matplotlib: logarithmic plots, complex functions as colours, and rows of drawn surfaces."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Complex, Float
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.image import imread
from numpy.typing import ArrayLike

from spinor_geom.mesh.curve import CurveFunction
from spinor_geom.render.png import drawn
from spinor_geom.render.portrait import Portrait, closed_line

# largest chroma in OKLCH, and its slopes at black and at white, so that all hues lie inside sRGB
_CHROMA, _RISE, _FALL = 0.125, 0.25, 0.5
_RINGS = 0.08  # relative step of the lightness at powers of two
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
_SIZE, _SIDE = 4.0, 640  # inches and pixels of a side of a surface's picture
_PHASE, _PIXELS = 2.2, 160  # inches and pixels of a side of a function's picture

HolomorphicFunction = Callable[[Complex[np.ndarray, " n"]], Complex[np.ndarray, " n"]]


def log_log(
    lines: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    x: str,
    y: str,
    slopes: Mapping[str, int] | None = None,
    linear_x: bool = False,
) -> Figure:
    """Lines (x, y) by label on logarithmic axes; `slopes` adds lines of given slope through their first points."""
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


def domain_colours(value: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
    """Colours in sRGB, 0 to 1: red for positive numbers, blue-green for negative ones, black at 0, white at ∞.

    The lightness grows with the modulus, with a small step back at every power of two; equal steps of the argument
    look equally large. NaN is white.
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


def surfaces(
    portraits: Mapping[str, Portrait], *, curves: Mapping[str, CurveFunction] | None = None, across: int = 4
) -> Figure:
    """Surfaces by title, `across` in a row, with a scale for the first field of each.

    Args:
        portraits: the surfaces with their boundaries.
        curves: Γ(t) for each, on which its boundary should lie; drawn in red.
        across: pictures in a row.

    Raises:
        MissingPackageError: pyvista is not installed.
        RenderError: the drawing failed.
    """
    scenes = []
    for title, portrait in portraits.items():
        layers = portrait.layers
        if curves is not None:
            layers += (closed_line(curves[title](np.linspace(0, 1, 400)), colour="#d62728", width=1.5),)
        scenes.append(Portrait(layers=layers).scene(size=(1, 1)))
    with drawn(scenes, size=(_SIDE * len(scenes), _SIDE)) as (path,):
        pictures = np.split(imread(path), len(scenes), axis=1)
    across = min(across, len(scenes))
    down = -(-len(scenes) // across)
    figure = Figure(figsize=(_SIZE * across, _SIZE * down), layout="constrained")
    for place, (title, scene, picture) in enumerate(zip(portraits, scenes, pictures, strict=True)):
        axes = figure.add_subplot(down, across, place + 1, title=title)
        axes.imshow(picture)
        axes.set_axis_off()
        for scale in scene.colour_scales.values():
            figure.colorbar(ScalarMappable(Normalize(scale.low, scale.high), "viridis"), ax=axes, shrink=0.5)
    return figure


def phases(rows: Mapping[str, Mapping[str, HolomorphicFunction]]) -> Figure:
    """Functions on the unit disk by `domain_colours`: by name, in rows by title."""
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
