"""The kinds of pictures that experiments leave: surfaces in space, and functions on the unit disk."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Complex, Float, Int
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from spinor_geom.mesh.curve import CurveFunction
from spinor_geom.render.plots import domain_colours
from spinor_geom.surface import SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface

_SIZE = 4.0  # inches, of a side of the square for a surface
_ZOOM = 1.2  # by which axes in space are enlarged, which leave room for what they do not have here
_RIM = 400  # points of a boundary
_GRID = (16, 96)  # circles and points on each, of a surface over the unit disk
_PHASE, _PIXELS = 2.2, 160  # inches and points of a side of a function's picture

HolomorphicFunction = Callable[[Complex[np.ndarray, " n"]], Complex[np.ndarray, " n"]]


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
