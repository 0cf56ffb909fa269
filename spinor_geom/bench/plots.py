"""Plots of a run, each with the table of its data."""

from __future__ import annotations

import html
import io
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from spinor_geom.bench.cases import REFERENCE_CASE
from spinor_geom.bench.fillers import LOOP_METHODS
from spinor_geom.bench.machine import Record
from spinor_geom.bench.promises import is_whole, names
from spinor_geom.render.page import Table, cell, folded, picture

_SAMPLINGS = {"": "equal steps of the parameter", "even": "equal edges", "uneven": "edges of random lengths"}
_LIMIT = "limit of the points"
_LEAST, _LEAST_DISTANCE = 1e-16, 1e-7  # zeros and smaller values are drawn here
_RESOLUTION = 90  # dots per inch
_QUANTILES = {"least": 0.0, "10 %": 0.1, "median": 0.5, "90 %": 0.9, "largest": 1.0}

Lines = Mapping[str, Mapping[int, float]]  # values by label and number of points
Content = TypeVar("Content")


@dataclass(frozen=True, kw_only=True, eq=False)
class Plot:
    """A figure, what it shows, and the table of its data."""

    name: str  # of its file
    title: str
    note: str
    figure: Figure
    data: Table

    def png(self) -> bytes:
        """The figure as a PNG file."""
        buffer = io.BytesIO()
        self.figure.savefig(buffer, format="png", dpi=_RESOLUTION)
        return buffer.getvalue()

    def html(self) -> str:
        """The plot as a part of a page, with its data folded."""
        title, note = html.escape(self.title), html.escape(self.note.replace("`", ""))
        return f"<h3>{title}</h3><p>{note}</p>{picture(self.png(), self.title)}{folded('Data', self.data.html())}"

    def markdown(self, folder: str) -> str:
        """The same in Markdown, with the figure in a file of a folder."""
        data = f'<details markdown="1">\n<summary>Data</summary>\n\n{self.data.markdown()}\n\n</details>'
        return "\n\n".join([f"### {self.title}", self.note, f"![{self.title}]({folder}/{self.name}.png)", data])


def plots(records: Sequence[Record]) -> list[Plot]:
    """The plots for which there are records."""
    done = [r for r in records if r["status"] == "done"]
    return [plot for plot in (*_disks(done), _seconds(done), _cut_outs(done), _meshes(done)) if plot.data.rows]


def _disks(done: Sequence[Record]) -> Iterator[Plot]:
    """Errors, distances and curvature of disks by sampling."""
    disks = [r for r in done if r["suite"] == "disks"]
    about = "Medians over the curves of the suite `disks`, by the sampling of their points."
    for name, title, label, of_surface, of_mesh, note in (
        (
            *("area", "Area error", "relative error of the area", "area_error", "mesh_area_error"),
            "The dashed line is the limit error: how well the points determine their curve.",
        ),
        (
            *("distance", "Distance from the exact surface", "largest distance / diameter"),
            *("surface_distance_max", "distance_max"),
            "Of the surface at its inner points; of meshes the symmetric Hausdorff distance.",
        ),
        (
            *("curvature", "Mean curvature", "mean curvature × diameter", "exact_curvature_median", "curvature_rms"),
            "Of the surface the median |H|; of meshes the root mean square of the discrete mean curvature, which is 0 "
            "by definition for discrete minimal surfaces.",
        ),
    ):
        panels: dict[str, Lines] = {}
        for sampling, panel in _SAMPLINGS.items():
            here = [r for r in disks if r["case"].partition("@")[2] == sampling]
            limit = {_LIMIT: _medians(here, "spinor", "limit_error")} if name == "area" else {}
            meshes = {f"{m}, mesh" if m == "spinor" else m: _medians(here, m, of_mesh) for m in LOOP_METHODS}
            panels[panel] = {"spinor, surface": _medians(here, "spinor", of_surface), **meshes, **limit}
        yield _line_plot(name, title, f"{about} {note}", label, panels)


def _seconds(done: Sequence[Record]) -> Plot:
    """Seconds of disks and of whole fills."""
    disks = [r for r in done if r["suite"] == "disks"]
    fills = [r for r in done if r["suite"] == "fills" and r["case"] == REFERENCE_CASE]
    panels = {
        "surface and mesh": {m: _medians(disks, m, "seconds") for m in names(disks, "method")},
        f"fills of {REFERENCE_CASE}": {m: _medians(fills, m, "seconds") for m in names(fills, "method")},
    }
    note = "Left: medians over the curves of the suite `disks`. Right: whole fills of one rim by each tool."
    return _line_plot("seconds", "Seconds", note, "seconds", panels)


def _cut_outs(done: Sequence[Record]) -> Plot:
    """Distances of the patches from what was removed, as strips."""
    whole = [r for r in done if r["suite"] == "cut-outs" and is_whole(r)]
    fillers = names(whole, "method")
    strips: dict[str, dict[str, list[float]]] = {"known surfaces": {}, "disks cut out of scans": {}}
    for r in whole:
        strips[list(strips)[r["kind"] == "scan"]].setdefault(r["method"], []).append(r["distance"])
    strips = {panel: rows for panel, rows in strips.items() if rows}

    def draw(axes: Axes, rows: Mapping[str, Sequence[float]]) -> None:
        for k, values in enumerate(np.maximum(rows.get(m, []), _LEAST_DISTANCE) for m in fillers):
            spread = np.linspace(-0.3, 0.3, 7)[np.arange(len(values)) % 7]
            axes.plot(values, k + spread, "o", markersize=3, alpha=0.5)
            axes.plot(np.median(values) if len(values) else np.nan, k, "k|", markersize=16)
        _name_rows(axes, fillers, "distance / diameter")

    rows = [
        (panel, m, str(len(values)), *(cell(float(np.quantile(values, q)), 3) for q in _QUANTILES.values()))
        for panel, here in strips.items()
        for m, values in here.items()
    ]
    return Plot(
        name="cut-outs",
        title="Distance from what was removed",
        note="Root mean square distance of each patch of the suite `cut-outs`, per diameter of its hole. The bar is "
        f"the median. Patches that leave edges open are left out; distances below {_LEAST_DISTANCE:g} are drawn there.",
        figure=_figure(strips, draw, height=1 + 0.35 * len(fillers)),
        data=Table(columns=("holes", "filler", "patches", *_QUANTILES), rows=rows),
    )


def _meshes(done: Sequence[Record]) -> Plot:
    """Seconds of whole meshes."""
    meshes = [r for r in done if r["suite"] == "meshes"]
    cases, fillers = names(meshes, "case"), names(meshes, "method")
    seconds = {(r["case"], r["method"]): r["seconds"] for r in meshes}
    files = [Path(case).name for case in cases]

    def draw(axes: Axes, _: None) -> None:
        for (marker, colour), m in zip(_styles(), fillers, strict=False):
            values = [seconds.get((case, m), np.nan) for case in cases]
            axes.plot(values, range(len(cases)), marker, color=colour, markersize=5, label=m)
        _name_rows(axes, files, "seconds")

    rows = [(file, *(cell(seconds.get((c, m)), 3) for m in fillers)) for file, c in zip(files, cases, strict=True)]
    return Plot(
        name="meshes",
        title="Seconds of whole meshes",
        note="All holes of each mesh of the suite `meshes` in one call.",
        figure=_figure({"": None} if cases else {}, draw, height=1 + 0.35 * len(cases)),
        data=Table(columns=("mesh", *fillers), rows=rows),
    )


def _medians(records: Sequence[Record], method: str, field: str) -> dict[int, float]:
    """The median of a field by number of points."""
    values: dict[int, list[float]] = {}
    for r in records:
        if r["method"] == method and r.get(field) is not None:
            values.setdefault(r["n"], []).append(r[field])
    return {n: median(values[n]) for n in sorted(values)}


def _line_plot(name: str, title: str, note: str, label: str, panels: Mapping[str, Lines]) -> Plot:
    """Lines over the number of points on logarithmic axes."""
    panels = {panel: {k: v for k, v in lines.items() if v} for panel, lines in panels.items() if any(lines.values())}
    labels = list(dict.fromkeys(itertools.chain(*panels.values())))
    styles = dict(zip(labels, _styles(), strict=False))
    styles[_LIMIT] = ("", "black")

    def draw(axes: Axes, lines: Lines) -> None:
        for line, values in lines.items():
            marker, colour = styles[line]
            y, style = np.maximum(list(values.values()), _LEAST), "-" if marker else "--"
            axes.loglog(list(values), y, style, marker=marker, color=colour, markersize=4, linewidth=1, label=line)
        ticks = sorted(set().union(*lines.values()))
        axes.set_xticks(ticks, labels=[str(n) for n in ticks])
        axes.minorticks_off()
        axes.set_xlabel("points")

    figure = _figure(panels, draw, height=4.5)
    if panels:
        figure.axes[0].set_ylabel(label)
    rows = [
        (panel, str(n), *(cell(lines.get(label, {}).get(n), 3) for label in labels))
        for panel, lines in panels.items()
        for n in sorted(set().union(*lines.values()))
    ]
    data = Table(columns=("curves", "points", *labels), rows=rows)
    return Plot(name=name, title=title, note=note, figure=figure, data=data)


def _figure(panels: Mapping[str, Content], draw: Callable[[Axes, Content], None], *, height: float) -> Figure:
    """One drawing for each panel, side by side, with common values on the y axis."""
    figure = Figure(figsize=(11, height), layout="constrained")
    if panels:
        drawings = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
        for axes, (title, content) in zip(drawings, panels.items(), strict=True):
            draw(axes, content)
            axes.set_title(title, fontsize="medium")
            axes.grid(visible=True, alpha=0.3)
        shown = {line.get_label(): line for axes in drawings for line in axes.get_legend_handles_labels()[0]}
        if shown:
            figure.legend(handles=list(shown.values()), loc="outside right upper", fontsize="small")
    return figure


def _styles() -> Iterator[tuple[str, str]]:
    """Markers and colours for thirty labels."""
    return itertools.product("osv", (f"C{k}" for k in range(10)))


def _name_rows(axes: Axes, rows: Sequence[str], x: str) -> None:
    """Names of the rows, the first one on top, over a logarithmic axis."""
    axes.set_xscale("log")
    axes.set_yticks(range(len(rows)), labels=rows)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlabel(x)
