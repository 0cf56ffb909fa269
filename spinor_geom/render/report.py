"""The report of a fill as one page: the mesh to turn, Ω and the Gauss map beside it, p and q in colours, figures."""

import html
import io
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Complex
from matplotlib.image import imsave

from spinor_geom.adapters import MeshFile
from spinor_geom.comparison import Comparison
from spinor_geom.errors import require_type
from spinor_geom.files import write_text
from spinor_geom.fill.fill_result import FillResult, LoopOutcome
from spinor_geom.render.layers import Faces, Scale
from spinor_geom.render.loop_views import COLOURS, SWITCHES, LoopViews, loop_views, patch_faces, surroundings
from spinor_geom.render.page import Scene, Views, cell, document, panel, picture, table
from spinor_geom.render.plots import domain_colours, inline_svg, log_log
from spinor_geom.render.portrait import camera_on, shown_loop, used_vertices

MOST_LOOPS = 8  # of how many filled loops, the longest first, Ω and its functions are shown
_KEYS = "Drag to turn, with Shift to move, wheel or + and − to zoom, double click or 0 to start again."
_MOST_SAID = 3  # remarks that are not folded
_TOLD_ALREADY = ("residual_rms_per_edge", "residual_max_per_edge")  # the solution's own figures say them too
_PIXELS = 144  # of the longer side of a function's picture
_PAGE_STYLE = """body { max-width: 90rem; margin: 1rem auto } h1 { font-size: 1.5rem; margin: 1rem 0 .5rem }
.beside { display: grid; grid-template-columns: minmax(0, 9fr) minmax(0, 4fr) }
@media (max-width: 50rem) { .beside { display: block } }
.refused { background: var(--alert); padding: .5rem 1rem; border-radius: 4px; margin: .5rem 0 }
.all { max-height: 40rem; overflow: auto } .all th { white-space: normal } .functions img { width: 13rem }
.plot svg { max-width: 44rem; width: 100%; height: auto } [hidden] { display: none }"""


def report(
    result: FillResult,
    path: str | os.PathLike[str] | None = None,
    *,
    comparisons: Mapping[int, Comparison] | None = None,
) -> str:
    """A page about a fill, in one file that loads nothing: open it in any browser.

    It shows the mesh with its patches, to turn and to zoom, with switches for wireframe, grid lines and normals, and
    for colours by |H|, by the distance to the discrete minimal surface and by Gauss curvature; beside it, for one loop
    at a time, Ω with the poles of its network, the image of the Gauss map, p, q, f and g in colours; and the report's
    figures. Lengths are in the mesh's own units. Of very large meshes the part near the loops is shown, of many loops
    the details of the longest; the page says so.

    Args:
        result: from `fill_hole(..., return_report=True)`.
        path: where to write it as well.
        comparisons: of loops with discrete minimal surfaces, by the loops' places, where some were made. Their figures
            are shown too, and |H| of these loops' surfaces as a colour, measured by automatic differentiation, which
            takes seconds; without, |H| is that of the patches' triangles.

    Returns:
        The page.

    Raises:
        ArgumentTypeError: `result` is not the result of a fill.
        MissingPackageError: matplotlib is not installed.
        OSError: the file cannot be written.
    """
    require_type(result, FillResult, function="report", takes="the FillResult of fill_hole(mesh, return_report=True)")
    exact = [outcome for outcome in result.loops if outcome.kind == "minimal" and outcome.patch is not None]
    compared = comparisons or {}
    details = [loop_views(outcome, exact=outcome.index in compared) for outcome in exact[:MOST_LOOPS]]
    views = Views()
    source = result.mesh.path if isinstance(result.mesh, MeshFile) else None
    name = "a mesh" if source is None else source.name
    text = document(
        f"spinor-geom fill: {name}",
        [
            f"<h1>Holes of {html.escape(name)}, {_how(result)}</h1>",
            *([] if source is None else [f"<p>{html.escape(str(source))}</p>"]),
            f"<p>{html.escape(_summary(result))}</p>",
            *_left_open(result.loops),
            *_pictures(result, details, views),
            *(_loop_section(one, compared.get(one.outcome.index)) for one in details),
            *_continuations(result.loops),
            *_convergence(exact[:MOST_LOOPS]),
            "<h2>All loops</h2>",
            f'<div class="all">{_loop_table(result.loops)}</div>',
            views.script(),
        ],
        style=_PAGE_STYLE,
    )
    if path is not None:
        write_text(path, text)
    return text


def _how(result: FillResult) -> str:
    kinds = {outcome.kind for outcome in result.loops if outcome.filled}
    surfaces = {"minimal": "minimal surfaces", "discrete": "discrete surfaces", "smooth": "smooth continuations"}
    named = [text for kind, text in surfaces.items() if kind in kinds]
    return f"filled with {' and '.join(named)}" if named else "left open"


def _summary(result: FillResult) -> str:
    count, filled = len(result.loops), sum(outcome.filled for outcome in result.loops)
    if not count:
        return "The mesh has no boundary loops: nothing to fill."
    crossings = sum(outcome.intersections for outcome in result.loops)
    return (
        f"{filled} of {count} loops filled; {len(result.original.vertices)} vertices and {len(result.original.faces)} "
        f"triangles before, {len(result.extension.vertices)} and {len(result.extension.faces)} added. The filled mesh "
        f"is {'watertight' if result.watertight else 'not watertight'}; "
        f"{f'patches cross something in {crossings} pairs of faces' if crossings else 'no patch crosses anything'}. "
        f"{result.timings['total']:.2g} s. {' '.join(f'{note}.' for note in result.notes)}"
    )


def _left_open(outcomes: Sequence[LoopOutcome]) -> list[str]:
    said = [f"{line[0].upper()}{line[1:]}" for outcome in outcomes for line in outcome.shortcomings]
    if not said:
        return []
    lines = "".join(f"<li>{html.escape(line)}</li>" for line in said)
    return [
        f'<details class="refused"{" open" * (len(said) <= _MOST_SAID)}><summary>{len(said)} '
        f"{'remark' if len(said) == 1 else 'remarks'}: loops that were left open or deserve a look</summary>"
        f"<ul>{lines}</ul></details>"
    ]


def _pictures(result: FillResult, details: Sequence[LoopViews], views: Views) -> list[str]:
    used = used_vertices(result.original)
    patches = {outcome.index: outcome.patch for outcome in result.loops if outcome.patch is not None}
    shown = {one.outcome.index: one for one in details}
    layers, left_out = surroundings(result)
    for index, patch in patches.items():
        layers += shown[index].in_space() if index in shown else [patch_faces(patch, measured=True)]
    fields = [layer.fields for layer in layers if isinstance(layer, Faces)]
    known = {name: [own[name] for own in fields if name in own] for name in COLOURS}
    scales = {name: Scale.of(np.concatenate(values), COLOURS[name][1]) for name, values in known.items() if values}
    cameras = {"": camera_on(used, shown_loop(result.loops))} | {
        str(i): camera_on(used, result.loops[i]) for i in patches
    }
    follow: dict[str, Any] = {"scales": scales, "panel": True}
    scene = Scene(
        title="The filled mesh: patches orange, loops blue",
        layers=layers,
        cameras=cameras,
        unit="mesh units",
        shape="wide",
        **follow,
    )
    plane = Scene(
        title="Ω and its grid; poles of the network violet, zeros of p black, of q white",
        layers=[layer for one in details for layer in one.in_plane()],
        cameras={str(one.outcome.index): one.plane_camera for one in details},
        unit="units of Ω",
        flat=True,
        shape="square",
        **follow,
    )
    sphere = Scene(
        title="The Gauss map: normals of the patch on the unit sphere",
        layers=[layer for one in details for layer in one.on_sphere()],
        cameras={str(one.outcome.index): one.sphere_camera for one in details},
        shape="square",
        **follow,
    )
    controls = panel(
        colours={"": "one colour"} | {name: COLOURS[name][0] for name in scales},
        switches=SWITCHES if details else SWITCHES[:1],
        loops={str(o.index): f"loop {o.index}: {len(o.loop)} vertices" for o in (one.outcome for one in details)},
    )
    parts = [controls, f"<p><small>{_KEYS}</small></p>"]
    if left_out:
        parts.append(f"<p>{left_out} triangles of the mesh that are far from its loops are not shown.</p>")
    if details and len(patches) > len(details):
        parts.append(
            f"<p>Ω, functions, colours and switches are of the {len(details)} longest loops with exact surfaces.</p>"
        )
    beside = f"<div>{views.figure(plane)}{views.figure(sphere)}</div>" if details else ""
    return [*parts, f'<div class="beside">{views.figure(scene)}{beside}</div>']


def _loop_table(outcomes: Sequence[LoopOutcome]) -> str:
    rows = [_loop_row(outcome) for outcome in outcomes]
    # of columns that say something
    names = [name for name in rows[0] if any(row[name] is not None for row in rows)] if rows else []
    cells = [[cell(row[name], digits=6) for name in names] for row in rows]
    marked = [k for k, outcome in enumerate(outcomes) if not outcome.converged]
    return table(names, cells, marked=marked)


def _loop_row(outcome: LoopOutcome) -> dict[str, Any]:
    """Figures of a loop; those of a minimal surface only where the patch is a mesh of it."""
    entry, continuation = outcome.to_dict(), outcome.continuation
    solution = outcome.solution if continuation is None else None
    stability = (entry["stability"] or {}) if solution is not None else {}
    said = "border" if outcome.is_border else "no" if outcome.requested else "left open"
    return {
        "loop": outcome.index,
        "vertices": len(outcome.loop),
        "perimeter": outcome.loop.perimeter,
        "filled": outcome.kind or said,
        "RMS residual/edge": None if solution is None else entry["residual_rms_per_edge"],
        "max residual/edge": None if solution is None else entry["residual_max_per_edge"],
        "bend of the film, °": None if continuation is None else continuation.before.rms,
        "bend, °": None if continuation is None else continuation.after.rms,
        "area": entry["area"],
        "stability": stability.get("verdict"),
        "Morse index": stability.get("index"),
        "route": None if solution is None else solution.route,
        "new vertices": outcome.vertices_added,
        "new faces": outcome.faces_added,
        "crossings": outcome.intersections,
        "seconds": outcome.timings.get("total"),
        "reason": outcome.reason or None,
    }


def _continuations(outcomes: Sequence[LoopOutcome]) -> list[str]:
    """The figures of the smooth patches, of the longest loops."""
    smooth = [outcome for outcome in outcomes if outcome.continuation is not None and outcome.faces_added]
    return [
        f"<h2>Loop {outcome.index}</h2><p>The patch continues the tangents and the curvature of the mesh around it.</p>"
        + table(("figure", "value"), _flat(outcome.continuation.to_dict()))
        for outcome in smooth[:MOST_LOOPS]
        if outcome.continuation is not None
    ]


def _convergence(outcomes: Sequence[LoopOutcome]) -> list[str]:
    lines = {}
    for outcome in outcomes:
        steps = () if outcome.solution is None else outcome.solution.history
        for method in dict.fromkeys(step.method for step in steps):
            own = [step for step in steps if step.method == method]
            lines[f"loop {outcome.index}, {method}"] = ([s.index for s in own], [s.residual for s in own])
    if not lines:
        return []
    figure = log_log(lines, x="step", y="what the steps bring towards 0", linear_x=True)
    # mathematical type for the ticks takes longer to set than everything else in the plot
    figure.axes[0].yaxis.set_major_formatter("{x:.0e}")
    return [
        "<h2>Convergence</h2><p>Gauss-Newton: RMS distance from the loop's curve at the nodes, in diagonals of the "
        "loop. Douglas-Newton: RMS gradient of the energy, relative to its two factors.</p>",
        f'<div class="plot">{inline_svg(figure, "residual after each step")}</div>',
    ]


def _loop_section(one: LoopViews, comparison: Comparison | None) -> str:
    outcome = one.outcome
    images = []
    for name, values in one.functions(_PIXELS).items():
        modulus = np.abs(values)
        known = modulus[np.isfinite(modulus)]
        middle = (float(np.median(known)) if len(known) else 0.0) or 1.0
        caption = f"{name}, median |{name}| = {middle:.3g}"
        images.append(
            f"<figure>{picture(_png(values, middle), f'{name} on Ω')}<figcaption>{caption}</figcaption></figure>"
        )
    figures: dict[str, Any] = {} if outcome.solution is None else outcome.solution.to_dict()
    figures |= {name: value for name, value in outcome.to_dict().items() if name not in (*figures, *_TOLD_ALREADY)}
    figures |= one.baseline_figures
    if comparison is not None:
        figures["comparison"] = comparison.to_dict()
    return (
        f'<section data-loop="{outcome.index}">'
        f"<h2>Loop {outcome.index}</h2><p>p, q, f = −2q² and g = −p/q on Ω. The hue is the argument (red: positive), "
        "the lightness the modulus beside its median: black is 0, white is infinite; it steps back at every power of "
        "two.</p>"
        f'<div class="functions">{"".join(images)}</div>'
        f"{table(('figure', 'value'), [(name, text) for name, text in _flat(figures)])}</section>"
    )


def _flat(figures: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested figures as lines of a table."""
    lines = []
    for name, value in figures.items():
        label = f"{prefix}{name.replace('_', ' ')}"
        if isinstance(value, Mapping):
            lines += _flat(value, f"{label}: ")
        elif value not in (None, "", []):
            lines.append((label, cell(value, digits=6)))
    return lines


def _png(values: Complex[np.ndarray, "h w"], middle: float) -> bytes:
    """A function's values on a grid, row after row upwards, as a PNG, by the modulus of middle lightness."""
    infinite = np.isinf(np.abs(values))
    scaled = np.where(infinite, np.inf, np.where(infinite, 0, values) / middle)
    pixels = np.concatenate([domain_colours(scaled), ~np.isnan(scaled)[..., None]], axis=-1)
    buffer = io.BytesIO()
    imsave(buffer, (255 * pixels[::-1]).round().astype(np.uint8), format="png")
    return buffer.getvalue()
