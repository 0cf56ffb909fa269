"""Plots of figures."""

from __future__ import annotations

import html
import io
from collections.abc import Mapping

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike


def log_log(
    lines: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    x: str,
    y: str,
    slopes: Mapping[str, int] | None = None,
    linear_x: bool = False,
) -> Figure:
    """Lines, (x, y) by label, on logarithmic axes.

    With slopes, by label of a line, a straight line for comparison goes through that line's first point, and the points
    of the first line are marked on the axis.
    """
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
