"""The kinds of pictures that experiments leave: surfaces in space, and functions on the unit disk."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Complex, Float, Int
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import proj3d

from spinor_geom.mesh.curve import CurveFunction
from spinor_geom.render.domain_colouring import domain_colours
from spinor_geom.surface import SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface

_SIZE = 4.0  # inches, of one surface
_LOW, _BAR = 0.85, 0.2  # of that, the height of a row, and what a scale of colours takes beside it
_FILLED, _FILLED_UP = 0.95, 0.7  # of a surface's square, the title above it
_RIM = 400  # points of a boundary
_GRID = (16, 96)  # circles and points on each, of a surface over the unit disk
_PHASE, _PIXELS = 2.2, 160  # inches and points of a side of a function's picture

HolomorphicFunction = Callable[[Complex[np.ndarray, " n"]], Complex[np.ndarray, " n"]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """A surface as triangles.

    Attributes:
        position: of the vertices.
        faces: the triangles.
        rim: closed sequence of points of its boundary.
        value: what the colour of each vertex tells; one colour for all without.
        marks: points that are marked by a cross.
    """

    position: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    rim: Float[np.ndarray, "m 3"]
    value: Float[np.ndarray, " n"] | None = None
    marks: Float[np.ndarray, "k 3"] = field(default_factory=lambda: np.zeros((0, 3)))

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
    place = 1 + np.arange(circles * around).reshape(circles, around)
    here, beside = place, np.roll(place, -1, axis=1)
    middle = np.stack([np.zeros_like(here[0]), here[0], beside[0]], axis=-1)
    first = np.stack([here[:-1], here[1:], beside[1:]], axis=-1).reshape(-1, 3)
    second = np.stack([here[:-1], beside[1:], beside[:-1]], axis=-1).reshape(-1, 3)
    return z, np.concatenate([middle, first, second])


def surfaces(
    drawn: Mapping[str, Drawn], *, curves: Mapping[str, CurveFunction] | None = None, across: int = 4
) -> Figure:
    """Surfaces side by side, their boundaries in black.

    Args:
        drawn: by title.
        curves: Γ(t) that each should have as its boundary, in red; surfaces are then drawn at the scale of the curves.
        across: surfaces in a row.
    """
    across = min(across, len(drawn))
    down = -(-len(drawn) // across)
    wide = _SIZE * (1 + (_BAR if any(one.value is not None for one in drawn.values()) else 0))
    figure = Figure(figsize=(wide * across, _LOW * _SIZE * down))
    width, height = _SIZE / (wide * across), 1 / (_LOW * down)
    for place, (title, one) in enumerate(drawn.items()):
        row, column = divmod(place, across)
        left, middle = column / across, 1 - (row + 0.5) / down
        # squares that overlap above and below, where surfaces leave them empty
        axes: Any = figure.add_axes((left, middle - height / 2, width, height), projection="3d", proj_type="ortho")
        axes.patch.set_visible(False)
        # without smooth edges, which would leave a pale seam between any two triangles
        look = {"color": "#8fb3d9", "linewidth": 0, "antialiased": False}
        mesh = axes.plot_trisurf(*one.position.T, triangles=one.faces, **look)
        if one.value is not None:
            mesh.set_array(one.value[one.faces].mean(axis=1))
            mesh.set_cmap("viridis")
            bar = figure.add_axes((left + 1.02 * width, middle - 0.25 / down, 0.04 * width, 0.5 / down))
            figure.colorbar(mesh, cax=bar)
        axes.plot(*np.append(one.rim, one.rim[:1], axis=0).T, color="black", linewidth=1)
        shown = one.rim
        if curves is not None:
            shown = curves[title](np.linspace(0, 1, _RIM))
            axes.plot(*shown.T, color="red", linewidth=1)
        _fit(axes, shown, one.rim)
        # on the figure and not in space, where the surface might hide them
        x, y = figure.transFigure.inverted().transform(_on_screen(axes, one.marks)).T
        crosses = Line2D(x, y, marker="x", markersize=9, markeredgewidth=2, color="black", linestyle="none")
        crosses.set_transform(figure.transFigure)
        figure.add_artist(crosses)
        figure.text(left + width / 2, 1 - row / down, title, ha="center", va="top", fontsize="medium")
    return figure


def _fit(axes: Any, shown: Float[np.ndarray, "n 3"], rim: Float[np.ndarray, "m 3"]) -> None:
    """Equal scales, with the box of some points as the axes' and those of the boundary just inside the picture."""
    low, high = shown.min(axis=0), shown.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_axis_off()
    axes.set_box_aspect(high - low)
    inside = axes.transAxes.inverted().transform(_on_screen(axes, np.concatenate([shown, rim])))
    across, up = 2 * np.abs(inside - 0.5).max(axis=0)
    axes.set_box_aspect(high - low, zoom=min(_FILLED / across, _FILLED_UP / up))


def _on_screen(axes: Any, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    x, y, _ = proj3d.proj_transform(*points.T, axes.get_proj())
    return np.asarray(axes.transData.transform(np.stack([x, y], axis=-1)))


def phases(rows: Mapping[str, Mapping[str, HolomorphicFunction]]) -> Figure:
    """Functions on the unit disk in the colours of `domain_colours`.

    Args:
        rows: functions by name, by title of their row.
    """
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
