"""The kinds of pictures: errors on logarithmic axes, and surfaces in space."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Complex, Float, Int
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.mesh.curve import CurveFunction
from spinor_geom.surface import SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface

_SIZE = 4.0  # inches, of one surface
_ACROSS = 4  # surfaces in a row
_ZOOM = 1.4  # of a surface in its square, whose margins are wide
_RIM = 400  # points of a boundary
_PHASE, _PIXELS = 2.2, 160  # inches and points of a side of a function's picture
_SATURATION, _HALF = 0.8, 0.5  # of its colours, and the modulus of middle brightness

HolomorphicFunction = Callable[[Complex[np.ndarray, " n"]], Complex[np.ndarray, " n"]]


def log_log(
    lines: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    x: str,
    y: str,
    slopes: Sequence[int] = (),
    linear_x: bool = False,
) -> Figure:
    """Lines on logarithmic axes.

    Args:
        lines: (x, y) by label.
        x: label of the axis.
        y: label of the axis.
        slopes: of straight lines for comparison, through the first point of the first line.
        linear_x: whether x is not logarithmic.
    """
    figure = Figure(figsize=(6, 4.5), layout="constrained")
    axes = figure.add_subplot()
    for label, (at, value) in lines.items():
        axes.plot(np.atleast_1d(at), np.atleast_1d(value), marker="o", markersize=3, label=label)
    if slopes:
        at, value = (np.asarray(v, dtype=np.float64) for v in next(iter(lines.values())))
        for slope in slopes:
            axes.plot(at, value[0] * (at / at[0]) ** slope, "k:", linewidth=1, label=f"slope {slope}")
    axes.set_yscale("log")
    if not linear_x:
        axes.set_xscale("log")
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(visible=True, which="both", alpha=0.2)
    axes.legend(fontsize="small")
    return figure


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """A surface as triangles.

    Attributes:
        position: of the vertices.
        faces: the triangles.
        rim: closed sequence of points of its boundary.
        value: what the colour of each vertex tells; one colour for all without.
    """

    position: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    rim: Float[np.ndarray, "m 3"]
    value: Float[np.ndarray, " n"] | None = None

    @classmethod
    def of(cls, surface: SpinorSurface | WeierstrassSurface, domain: PlaneDomain | None = None) -> Drawn:
        """A surface over a triangulation of its domain: its own, or that of the same domain elsewhere."""
        domain = domain or surface.domain
        mesh = domain.triangulation
        return cls(
            position=surface.position(mesh.points),
            faces=mesh.faces,
            rim=surface.position(domain.boundary.point(np.arange(_RIM) / _RIM)),
        )


def surfaces(drawn: Mapping[str, Drawn], *, curves: Mapping[str, CurveFunction] | None = None) -> Figure:
    """Surfaces side by side, their boundaries in black.

    Args:
        drawn: by title.
        curves: Γ(t) that each should have as its boundary, in red.
    """
    across = min(_ACROSS, len(drawn))
    down = -(-len(drawn) // across)
    figure = Figure(figsize=(_SIZE * across, _SIZE * down), layout="constrained")
    for place, (title, one) in enumerate(drawn.items(), start=1):
        axes: Any = figure.add_subplot(down, across, place, projection="3d")
        mesh = axes.plot_trisurf(*one.position.T, triangles=one.faces, color="#8fb3d9", linewidth=0, alpha=0.9)
        if one.value is not None:
            mesh.set_array(one.value[one.faces].mean(axis=1))
            mesh.set_cmap("viridis")
            figure.colorbar(mesh, ax=axes, shrink=0.6)
        axes.plot(*np.append(one.rim, one.rim[:1], axis=0).T, color="black", linewidth=1)
        if curves is not None:
            axes.plot(*curves[title](np.linspace(0, 1, _RIM)).T, color="red", linewidth=1)
        axes.set_title(title, fontsize="medium")
        spans = [high - low for low, high in (axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d())]
        axes.set_box_aspect(spans, zoom=_ZOOM)
        axes.set_axis_off()
    return figure


def phases(rows: Mapping[str, Mapping[str, HolomorphicFunction]]) -> Figure:
    """Functions on the unit disk: the hue is the argument, the brightness grows with the modulus, 0 is black.

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
            value = function(z[inside])
            picture = np.ones((*z.shape, 3))
            modulus = np.abs(value)
            hsv = [np.angle(value) / (2 * np.pi) % 1, np.full_like(modulus, _SATURATION), modulus / (_HALF + modulus)]
            picture[inside] = hsv_to_rgb(np.stack(hsv, axis=-1))
            one.imshow(picture, origin="lower", extent=(-1, 1, -1, 1))
            one.set_title(f"{name}, {title}", fontsize="small")
            one.set_axis_off()
    return figure
