"""The report of a fill as one page: the filled mesh, Ω and the Gauss map of each loop, p and q in colours, figures."""

import html
import io
import os
import shlex
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Complex
from scipy.spatial import cKDTree

from spinor_geom.adapters import MeshFile
from spinor_geom.comparison import Comparison
from spinor_geom.errors import require, require_type
from spinor_geom.files import write_text
from spinor_geom.fill.fill_result import FillResult, LoopOutcome
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import face_areas
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.render.domain_colours import domain_colours
from spinor_geom.render.fill_scene import (
    MOST_LABELS,
    hole_camera,
    loops_scene,
    mesh_layers,
    patch_labels,
    shown_loop,
    skin_of,
    up_of,
    used_vertices,
)
from spinor_geom.render.loop_views import (
    MEAN,
    SWITCHES,
    WIREFRAME,
    LoopViews,
    loop_views,
    mean_curvature_field,
    patch_faces,
)
from spinor_geom.render.page import Views, beside, cell, document, folded, panel, picture, require_html, table
from spinor_geom.render.scene import Scene
from spinor_geom.render.thinned import thinned

MOST_LOOPS = 8  # loops with exact surfaces, the longest first, whose Ω and functions are shown
MOST_FACES = 120_000  # triangles of the mesh that are shown: half of them as they are, near its loops
FEWER_FACES = 20_000  # the same for each mesh of a batch
_COARSER = 1.25  # factor of the cells of a mesh that has too many triangles
_KEYS = (
    "Drag to turn, with Shift to move, wheel or + and − to zoom, double click or 0 to reset. Numbers that would cover "
    "others appear when one zooms in."
)
_LISTED = ("loop", "points", "perimeter", "size", "centre", "remark")  # columns of the page of loops
_FILLED = ("loop", "patch", "points", "perimeter", "size", "area", "centre", "reason")  # of the pages of fills
_MOST_REMARKS = 3  # a longer list is collapsed
_PIXELS = 144  # of the longer side of a function's picture


def report(
    result: FillResult,
    path: str | os.PathLike[str] | None = None,
    *,
    comparisons: Mapping[int, Comparison] | None = None,
) -> str:
    """A self-contained HTML page about a fill.

    An interactive view shows the mesh with its patches. It has switches for wireframe, grid lines and normals, and for
    colours by |H|, by the distance to the discrete minimal surface and by Gauss curvature. For one selected loop at a
    time the page shows Ω with the poles of its network, the image of the Gauss map, and p, q, f and g in colours. The
    figures of the report follow. Lengths are in mesh units. Patches have the numbers of their loops. Very large meshes
    are shown coarser far from the loops, and only the longest loops have details. The page says so.

    Args:
        result: from `fill_hole(..., return_report=True)`.
        path: file to write, besides returning the page.
        comparisons: comparisons with discrete minimal surfaces, by loop index. The page shows their tables.

    Returns:
        The page.

    Raises:
        ArgumentTypeError: `result` is not the result of a fill.
        OptionError: `path` ends neither with .html nor with .htm.
        MissingPackageError: matplotlib is not installed.
        OSError: the file cannot be written.
    """
    require_type(result, FillResult, function="report", takes="the FillResult of fill_hole(mesh, return_report=True)")
    if path is not None:
        require_html(path)
    require("matplotlib", extra="render")
    exact = [outcome for outcome in result.loops if outcome.kind == "minimal" and outcome.patch is not None]
    details = [loop_views(outcome) for outcome in exact[:MOST_LOOPS]]
    views = Views()
    source = result.mesh.path if isinstance(result.mesh, MeshFile) else None
    text = _fill_page(
        result,
        "a mesh" if source is None else source.name,
        [] if source is None else [f"<p>{html.escape(str(source))}</p>"],
        [
            *_scenes(result, details, views, up=up_of(result), most_faces=MOST_FACES),
            *(_loop_section(one, (comparisons or {}).get(one.outcome.index)) for one in details),
        ],
        views.script(),
    )
    if path is not None:
        write_text(path, text)
    return text


def small_report(result: FillResult, *, name: str, up: Literal["y", "z"], program: str) -> str:
    """The report without the mathematics, of at most `FEWER_FACES` triangles. `program` is the address of its program.

    `name` is that of the mesh, and `up` its axis that is upwards.
    """
    views = Views()
    scenes = _scenes(result, [], views, up=up, most_faces=FEWER_FACES)
    return _fill_page(result, name, [], scenes, views.script(program))


def _fill_page(result: FillResult, name: str, head: Sequence[str], parts: Sequence[str], script: str) -> str:
    return document(
        f"spinor-geom fill: {name}",
        [
            f"<h1>Holes of {html.escape(name)}, {_how(result)}</h1>",
            *head,
            f"<p>{html.escape(_summary(result))}</p>",
            *_remarks(result.shortcomings),
            *parts,
            *_continuations(result.loops),
            folded("All figures of all loops", f'<div class="all">{_loop_table(result.loops)}</div>'),
            script,
        ],
    )


def loops_page(
    mesh: MeshFile,
    loops: Sequence[BoundaryLoop],
    rows: Sequence[Sequence[str]],
    *,
    left_open: Container[int],
    name: str,
    up: Literal["y", "z"],
) -> str:
    """A page with a mesh, its numbered loops, and a table whose head is the first of `rows`.

    `left_open` are the loops that a fill of all holes leaves open.
    """
    whole = mesh.mesh
    shown = _shown(whole, np.concatenate([loop.points for loop in loops] or [whole.vertices[:1]]), MOST_FACES)
    front, _ = loops_scene(whole, loops, up=up)
    scene = replace(
        front,
        title="The mesh and its loops with their numbers",
        layers=mesh_layers(shown, loops, skin=skin_of(mesh, whole) if shown is whole else {}, apart=True),
        loop_cameras={str(k): hole_camera(whole.vertices, loop, up) for k, loop in enumerate(loops)},
        labels=[(loop.points[0], str(number)) for number, loop in enumerate(loops[:MOST_LABELS])],
        unit="mesh units",
    )
    views, title = Views(), html.escape(f"Boundary loops of {name}")
    places = [rows[0].index(name) for name in _LISTED]
    listed_rows = [[row[place] for place in places] for row in rows[1:]]
    output, listed = f"filled{Path(name).suffix}", table(_LISTED, listed_rows, marked=left_open, by_loop=True)
    command = (
        '<p class="command"><code data-command="'
        + html.escape(f"spinor-geom fill {shlex.quote(name)} -o {output}")
        + '"></code><button type="button">Copy</button></p>'
    )
    body = [
        f"<h1>{title}</h1>",
        f"<p>{len(loops)} {'loop' if len(loops) == 1 else 'loops'}. Click a rim or its button to choose a film "
        "(orange), a smooth continuation (green), or to leave it open (blue). The button “all” leaves out red loops, "
        "as a fill of all holes does. The command fills what is chosen.</p>",
        command,
        beside(views.figure(scene), f'<div class="all">{listed}</div>'),
        f"<p><small>{_KEYS} A click on a row shows its loop.</small></p>",
        views.script(),
    ]
    return document(title, body)


def _how(result: FillResult) -> str:
    kinds = {outcome.kind for outcome in result.loops if outcome.filled}
    surfaces = {"minimal": "minimal surfaces", "discrete": "discrete surfaces", "smooth": "smooth continuations"}
    named = [text for kind, text in surfaces.items() if kind in kinds]
    return f"filled with {' and '.join(named)}" if named else "left open"


def _summary(result: FillResult) -> str:
    if not result.loops:
        return "The mesh has no boundary loops: nothing to fill."
    before = f"{len(result.original.vertices)} vertices and {len(result.original.faces)} triangles before"
    figures = f"{result.summary}, {before}, {result.timings['total']:.2g} s"
    return " ".join(f"{sentence}." for sentence in (figures, *result.notes))


def _remarks(remarks: Sequence[str]) -> list[str]:
    if not remarks:
        return []
    lines = "".join(f"<li>{html.escape(line[0].upper() + line[1:])}</li>" for line in remarks)
    listed = folded(f"Remarks: {len(remarks)}", f"<ul>{lines}</ul>", is_open=len(remarks) <= _MOST_REMARKS)
    return [f'<div class="remarks">{listed}</div>']


def _scenes(
    result: FillResult, details: Sequence[LoopViews], views: Views, *, up: Literal["y", "z"], most_faces: int
) -> list[str]:
    """The panel and the scenes that follow it: the filled mesh, Ω and the Gauss map."""
    patches = {outcome.index: outcome.patch for outcome in result.loops if outcome.patch is not None}
    shown = {one.outcome.index: one for one in details}
    loops = [outcome.loop for outcome in result.loops]
    near = np.concatenate([loop.points for loop in loops] or [result.original.vertices[:1]])
    mesh = _shown(result.original, near, most_faces)
    skin = skin_of(result.mesh, mesh) if mesh is result.original else {}  # a coarser mesh has other corners
    layers = mesh_layers(mesh, loops, edges=WIREFRAME, skin=skin)
    for index, patch in patches.items():
        if index in shown:
            layers += shown[index].in_space()
        else:
            layers.append(patch_faces(patch, {MEAN: mean_curvature_field(patch)}, index))
    used = used_vertices(result.original)
    scene = Scene(
        title="The filled mesh: patches orange with the numbers of their loops, loops blue",
        layers=layers,
        camera=hole_camera(used, shown_loop(result.loops), up),
        loop_cameras={str(index): hole_camera(used, result.loops[index].loop, up) for index in patches},
        labels=patch_labels(result),
        unit="mesh units",
        panel=True,
    )
    controls = panel(
        colours=scene.colour_scales,
        switches=SWITCHES if details else SWITCHES[:1],
        loops={str(o.index): f"loop {o.index}: {len(o.loop)} vertices" for o in (one.outcome for one in details)},
    )
    parts = [controls, f"<p><small>{_KEYS}</small></p>"]
    if len(mesh.faces) < len(result.original.faces):
        parts.append("<p>Far from its loops the mesh is shown coarser than it is.</p>")
    if 0 < len(details) < len(patches):
        parts.append(f"<p>Only the {len(details)} longest loops with exact surfaces have details.</p>")
    scales = scene.colour_scales
    main = views.figure(scene)
    planes = "".join(
        f'<div data-loop="{one.outcome.index}">{views.figure(one.plane_scene(scales))}'
        f"{views.figure(one.sphere_scene(scales))}</div>"
        for one in details
    )
    listed = f'<div class="all">{_short_table(result.loops)}</div>' if result.loops else ""
    mathematics = folded("Mathematics: Ω and the Gauss map", planes) if details else ""
    return [*parts, beside(main, listed, mathematics)]


def _short_table(outcomes: Sequence[LoopOutcome]) -> str:
    """A list of the loops, whose rows select them in the view."""
    rows = []
    for outcome in outcomes:
        loop, centre = outcome.loop, " ".join(f"{x:.4g}" for x in outcome.loop.centroid.tolist())
        figures = [str(len(loop)), f"{loop.perimeter:.5g}", f"{loop.diagonal:.4g}", cell(outcome.area), centre]
        rows.append([str(outcome.index), outcome.state, *figures, outcome.reason])
    bad = [k for k, outcome in enumerate(outcomes) if outcome.requested and not outcome.converged]
    return table(_FILLED, rows, marked=bad, by_loop=True)


def _shown(mesh: TriangleMesh, points: np.ndarray, most: int) -> TriangleMesh:
    """A mesh of about at most `most` triangles: those nearest to some points, and a coarser mesh of the others."""
    faces = np.asarray(mesh.faces)
    if len(faces) <= most:
        return mesh
    distance = np.asarray(cKDTree(points).query(mesh.vertices[faces].mean(axis=1))[0])
    is_near = np.zeros(len(faces), dtype=bool)
    is_near[np.argpartition(distance, most // 2)[: most // 2]] = True
    is_kept = np.zeros(len(mesh.vertices), dtype=bool)
    is_kept[faces[is_near]] = True
    reach = float(distance.max())
    # a surface of area A has about 2A/h² triangles with edges of length h
    step = max(float(np.sqrt(2 * face_areas(mesh.vertices, faces[~is_near]).sum() / (most / 2))), 1e-3 * reach)
    while True:
        vertices, shown, _, _ = thinned(mesh.vertices, faces, is_kept, step)
        if len(shown) <= most or step >= reach:
            return TriangleMesh(vertices, shown)
        step *= _COARSER


def _loop_table(outcomes: Sequence[LoopOutcome]) -> str:
    figures = [o.to_dict() | {"timings": None, "seconds": o.timings.get("total")} for o in outcomes]
    rows = [dict(_flat(own)) for own in figures]
    names = list(dict.fromkeys(name for row in rows for name in row))
    cells = [[row.get(name, "") for name in names] for row in rows]
    return table(names, cells, marked=[k for k, outcome in enumerate(outcomes) if not outcome.converged])


def _continuations(outcomes: Sequence[LoopOutcome]) -> list[str]:
    smooth = [(o.index, o.continuation) for o in outcomes if o.continuation is not None and o.faces_added]
    return [
        folded(
            f"Loop {index}: how far the patch continues the tangents and the curvature of the mesh around it",
            _figure_table(continuation.to_dict()),
        )
        for index, continuation in smooth[:MOST_LOOPS]
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
    figures = outcome.to_dict() | figures | one.baseline_figures
    compared = ""
    if comparison is not None:
        head, *rows = comparison.rows()
        compared = f"<p>Comparison with the {comparison.method}:</p>{table(head, rows)}"
    mathematics = folded(
        "Mathematics: p, q, f, g, and all figures",
        "<p>p, q, f = −2q² and g = −p/q on Ω. The hue is the argument (red: positive), the lightness the modulus "
        "relative to its median: black is 0, white is infinite, with a step at every power of two.</p>",
        f'<div class="functions">{"".join(images)}</div>{_figure_table(figures)}',
    )
    return f'<section data-loop="{outcome.index}"><h2>Loop {outcome.index}</h2>{compared}{mathematics}</section>'


def _figure_table(figures: Mapping[str, Any]) -> str:
    return table(("figure", "value"), _flat(figures))


def _flat(figures: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested figures as rows of a table."""
    rows = []
    for name, value in figures.items():
        label = f"{prefix}{name.replace('_', ' ')}"
        if isinstance(value, Mapping):
            rows += _flat(value, f"{label}: ")
        elif value not in (None, "", []):
            rows.append((label, cell(value, digits=6)))
    return rows


def _png(values: Complex[np.ndarray, "h w"], middle: float) -> bytes:
    """A PNG of a function on a raster, first row at the bottom. `middle` is the modulus of middle lightness."""
    from matplotlib.image import imsave

    infinite = np.isinf(np.abs(values))
    scaled = np.where(infinite, np.inf, np.where(infinite, 0, values) / middle)
    pixels = np.concatenate([domain_colours(scaled), ~np.isnan(scaled)[..., None]], axis=-1)
    buffer = io.BytesIO()
    imsave(buffer, (255 * pixels[::-1]).round().astype(np.uint8), format="png")
    return buffer.getvalue()
