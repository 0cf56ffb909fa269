"""Figures of the experiments: logarithmic plots, functions on the unit disk, and surfaces over it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Complex, Float, Int
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.image import imread
from numpy.typing import ArrayLike
from scipy.spatial import Delaunay

from spinor_geom.domain.delaunay import rim_edges
from spinor_geom.mesh.curve import CurveFunction
from spinor_geom.render.domain_colours import domain_colours
from spinor_geom.render.png import drawn
from spinor_geom.render.portrait import Portrait
from spinor_geom.render.scene import RIM_COLOUR, Faces, Lines
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface

_SIZE, _SIDE = 4.0, 640  # inches and pixels of a side of a surface's picture
_PHASE, _PIXELS = 2.2, 160  # inches and pixels of a side of a function's picture

HolomorphicFunction = Callable[[Complex[np.ndarray, " n"]], Complex[np.ndarray, " n"]]


def log_log(
    lines: Mapping[str, tuple[ArrayLike, ArrayLike]], *, x: str, y: str, slopes: Mapping[str, int] | None = None
) -> Figure:
    """Lines (x, y) by label over a logarithmic y axis.

    With `slopes` x is logarithmic too, and there are lines of given slope through the first points of some lines.
    """
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.add_subplot()
    for label, (at, value) in lines.items():
        axes.plot(np.atleast_1d(at), np.atleast_1d(value), marker="o", markersize=3, label=label)
    for (label, slope), style in zip((slopes or {}).items(), (":", "--"), strict=False):
        at, value = (np.asarray(v, dtype=np.float64) for v in lines[label])
        axes.plot(at, value[0] * (at / at[0]) ** slope, f"k{style}", linewidth=1, label=f"slope {slope}")
    axes.set_yscale("log")
    if slopes:
        axes.set_xscale("log")
        ticks = np.atleast_1d(next(iter(lines.values()))[0])
        axes.set_xticks(ticks, labels=[f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(visible=True, which="both", alpha=0.2)
    figure.legend(loc="outside right upper", fontsize="small")
    return figure


def surfaces(
    portraits: Mapping[str, Portrait], *, curves: Mapping[str, CurveFunction] | None = None, across: int = 4
) -> Figure:
    """Pictures of surfaces by title, `across` in a row, with a colour bar for the first field of each.

    `curves` has Γ(t) for each, on which its boundary should lie, drawn in red. Raises as `drawn`.
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


def over_disk(
    surface: SpinorSurface | WeierstrassSurface,
    *,
    grid: tuple[int, int] = (16, 96),
    fields: Mapping[str, Float[np.ndarray, " n"]] | None = None,
) -> Portrait:
    """A surface over the unit disk and its boundary. Fields have their values on `disk_grid(*grid)`."""
    z, faces = disk_grid(*grid)
    rim = surface.position(np.exp(2j * np.pi * np.arange(400) / 400))
    return Portrait(layers=(Faces(vertices=surface.position(z), faces=faces, fields=fields or {}), closed_line(rim)))


def closed_line(points: Float[np.ndarray, "n 3"], *, colour: str = RIM_COLOUR, width: float = 2.5) -> Lines:
    """A closed line through points."""
    return Lines(vertices=points, edges=rim_edges((len(points),)), colour=colour, width=width)


def disk_grid(circles: int, around: int) -> tuple[Complex[np.ndarray, " n"], Int[np.ndarray, "f 3"]]:
    """Points of the unit disk on circles of equally spaced radii, its centre first, and triangles between them."""
    turns = np.arange(around) / around
    z = np.concatenate([[0], (np.arange(1, circles + 1)[:, None] / circles * np.exp(2j * np.pi * turns)).ravel()])
    return z, np.asarray(Delaunay(np.column_stack([z.real, z.imag])).simplices, dtype=np.int64)


def phases(rows: Mapping[str, Mapping[str, HolomorphicFunction]]) -> Figure:
    """Domain colourings of functions on the unit disk, one row for each title, one column for each name."""
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
