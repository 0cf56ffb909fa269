"""The one way to write a page for a browser: one file with all it needs, in light and in dark, surfaces to turn."""

import base64
import html
import json
import math
import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

import numpy as np

from spinor_geom.errors import RenderError
from spinor_geom.render.layers import UNKNOWN_COLOUR, VIRIDIS, Camera, Dots, Faces, Layer, Lines, Scale

_LONG = 60  # letters, from which on the text of a cell is broken into lines

STYLE = """:root { color-scheme: light dark; --paper: #fff; --ink: #222; --faint: #ddd; --alert: #fdecea;
--link: #1f5fa8 }
@media (prefers-color-scheme: dark) { :root { --paper: #16181c; --ink: #e4e4e2; --faint: #3a3d43; --alert: #48201d;
--link: #8fbdf0 } }
body { font: 15px/1.45 system-ui, sans-serif; max-width: 76rem; margin: 2rem auto; padding: 0 1rem; color: var(--ink);
background: var(--paper) }
a { color: var(--link) } h2 { margin-top: 2.5rem }
table { border-collapse: collapse; margin: 1rem 0; font-size: 13px; display: block; overflow-x: auto }
th, td { padding: .2rem .6rem; border-bottom: 1px solid var(--faint); text-align: left; white-space: nowrap;
vertical-align: top }
td.long { white-space: normal; min-width: 22rem } tr.missed td { background: var(--alert) }
figure { display: inline-block; margin: .5rem; vertical-align: top } img { max-width: 100% }
figcaption { font-size: 13px; max-width: 560px }
figure.view { width: 282px }
figure.view canvas { width: 280px; height: 280px; border: 1px solid var(--faint); display: block; touch-action: none }
figure.view select, figure.view span { font-size: 12px } figure.view input[type=range] { width: 100% }
figure.wide, figure.square { width: auto; display: block }
figure.wide canvas { width: 100%; height: 36rem } figure.square canvas { width: 100%; height: 16.4rem }
.stage { position: relative } .ruler { position: absolute; left: .7rem; bottom: .7rem; font-size: 12px;
pointer-events: none; color: var(--ink) }
.ruler i { display: block; height: 4px; border: solid currentColor; border-width: 0 1px 1px }
.bar i { display: block; height: 12px; border: 1px solid var(--faint) }
.bar { font-size: 12px; display: block } .bar b { font-weight: normal; float: right }
form.panel { font-size: 13px; display: flex; flex-wrap: wrap; gap: .5rem 1rem; align-items: flex-start }
form.panel fieldset { border: 1px solid var(--faint); border-radius: 4px } form.panel label { display: block }
form.panel output { width: 16rem; min-height: 2.2rem } canvas:focus-visible,
form.panel :focus-visible { outline: 2px solid var(--link) }"""

_LESS = "\\u003c"  # "<" in JSON


def document(title: str, body: Sequence[str], *, style: str = "") -> str:
    """A whole page of pieces of HTML; the style is CSS of this page, after that of all pages."""
    return "\n".join(
        [
            "<!doctype html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>',
            f'<meta name="viewport" content="width=device-width"><style>{STYLE}\n{style}</style></head><body>',
            *body,
            "</body></html>",
            "",
        ]
    )


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, marked: Container[int] = ()) -> str:
    """A table of plain text; the marked rows miss what was asked for."""
    head = "".join(f'<th scope="col">{html.escape(column)}</th>' for column in columns)
    lines = (
        f"<tr{' class=missed' * (k in marked)}>"
        + "".join(f"<td{' class=long' * (len(text) > _LONG)}>{html.escape(text)}</td>" for text in row)
        + "</tr>"
        for k, row in enumerate(rows)
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def cell(value: Any, digits: int = 4) -> str:
    """The text of a figure in a table, nothing for what there is not."""
    if value is None or isinstance(value, bool):
        return {None: "", True: "yes", False: "no"}[value]
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.{digits}g}"
    return str(value)


def markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The same table in markdown, one text per column."""
    lines = [[text.replace("|", "\\|") for text in line] for line in (columns, ["---"] * len(columns), *rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def picture(data: bytes, alt: str) -> str:
    """A PNG inside the page."""
    return f'<img alt="{html.escape(alt)}" src="data:image/png;base64,{base64.b64encode(data).decode()}">'


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Surfaces, lines and points to be looked at together.

    Without the panel the view has a list of the scales of the layers' fields, the first shown first.
    """

    title: str
    layers: Sequence[Layer]
    scales: Mapping[str, Scale] = field(default_factory=dict)
    panel: bool = False  # whether it follows the page's controls, see `panel`
    cameras: Mapping[str, Camera] = field(default_factory=dict)  # at first, by loop of the panel; `ALWAYS` for others
    unit: str | None = None  # of lengths, for the ruler; none is drawn without
    flat: bool = False  # whether it lies in the plane of the picture, and is moved and not turned
    spins: bool = False  # whether it turns by itself until it is touched
    shape: str = ""  # "" (small), "square" or "wide"


class Views:
    """The views of one page: `figure` where each is to stand, `script` once at the page's end."""

    def __init__(self) -> None:
        self._views: list[dict[str, object]] = []
        # each array once, however many layers have it
        self._places: dict[str, int] = {}

    def figure(self, scene: Scene) -> str:
        """The element in which the view will stand."""
        place = f"view-{len(self._views)}"
        points = np.concatenate([layer.vertices for layer in scene.layers])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        data = {
            **{name: getattr(scene, name) for name in ("title", "panel", "unit", "flat", "spins")},
            "place": place,
            "layers": [self._layer(layer) for layer in scene.layers],
            "middle": middle.tolist(),
            "reach": max(farthest(layer, middle) for layer in scene.layers) or 1.0,
            "scales": {name: vars(scale) for name, scale in scene.scales.items()},
            "cameras": {loop: _camera(camera) for loop, camera in scene.cameras.items()},
        }
        self._views.append(data)
        return f'<figure class="view {scene.shape}" id="{place}"></figure>'

    def script(self) -> str:
        """The data of all views and the program that shows them."""
        data = {
            "colours": {"stops": VIRIDIS, "unknown": UNKNOWN_COLOUR},
            "arrays": list(self._places),
            "views": self._views,
        }
        program = files("spinor_geom.render").joinpath("viewer.js").read_text(encoding="utf-8")
        return "\n".join(
            [
                # "</script" would end the script element, "<!--" with a "<script" after it hide its end
                *(
                    f'<script type="application/json" id="{name}">{json.dumps(value).replace("<", _LESS)}</script>'
                    for name, value in data.items()
                ),
                f"<script>{three_js()}</script>",
                f"<script>{program}</script>",
            ]
        )

    def _layer(self, layer: Layer) -> dict[str, object]:
        """A layer in JSON's types; arrays as their places among all."""
        data: dict[str, object] = {
            "kind": type(layer).__name__.lower(),
            "vertices": self._array(layer.vertices, "<f4"),
            "colour": layer.colour,
            "loop": layer.loop,
            "switch": layer.switch,
        }
        if layer.conjugate is not None:
            data["conjugate"] = self._array(layer.conjugate, "<f4")
        if isinstance(layer, Dots):
            data |= {"width": layer.size}
        elif isinstance(layer, Lines):
            data |= {"elements": self._array(layer.edges, "<u4"), "width": layer.width, "halo": layer.halo}
        elif isinstance(layer, Faces):
            fields = {name: self._array(values, "<f4") for name, values in layer.fields.items()}
            elements = self._array(layer.faces, "<u4")
            data |= {"elements": elements, "inside": layer.inside, "edges": layer.edges, "fields": fields}
        return data

    def _array(self, values: np.ndarray, kind: str) -> int:
        """The place of an array: its little-endian bytes in base 64."""
        text = base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()
        return self._places.setdefault(text, len(self._places))


def panel(*, colours: Mapping[str, str], switches: Sequence[str], loops: Mapping[str, str]) -> str:
    """Controls that scenes of a page follow, and its parts with `data-loop`; the first colour and loop are chosen.

    Colours and loops are labels by name of the field or loop; the switches are of layers that are not shown at first.
    """
    radios = (_choice("radio", "colour", field, label, k == 0) for k, (field, label) in enumerate(colours.items()))
    boxes = (_choice("checkbox", "show", switch, switch, False) for switch in switches)
    options = (f'<option value="{html.escape(loop)}">{html.escape(label)}</option>' for loop, label in loops.items())
    choice = f'<legend>Loop</legend><select name="loop" aria-label="loop">{"".join(options)}</select>'
    return (
        f'<form class="panel" autocomplete="off">{f"<fieldset>{choice}</fieldset>" if loops else ""}'
        f"<fieldset><legend>Colour of the patches</legend>{''.join(radios)}"
        f'<output class="bar" aria-live="polite"></output></fieldset>'
        f"<fieldset><legend>Show</legend>{''.join(boxes)}</fieldset></form>"
    )


def _choice(kind: str, name: str, value: str, label: str, checked: bool) -> str:
    return (
        f'<label><input type="{kind}" name="{name}" value="{html.escape(value)}"{" checked" * checked}> '
        f"{html.escape(label)}</label>"
    )


def three_js() -> str:
    """The library that draws, with its licence's notice, from the page in which trimesh shows its scenes."""
    import trimesh
    from trimesh.viewer import scene_to_html

    page = scene_to_html(trimesh.Scene(trimesh.creation.icosahedron()))
    found = re.search(r"/\*\*\n \* @license\n[^/]*Three\.js Authors[^/]*\*/\n!function[^\n]*", page)
    if found is None:
        raise RenderError(
            f"no page was made: three.js, which shows it, was not found in trimesh {trimesh.__version__}; "
            "install another version, such as 4.5"
        )
    return found.group()


def farthest(layer: Layer, middle: np.ndarray) -> float:
    """The largest distance of a layer's vertices from a point, for all members of its family: |cos t·a + sin t·b|."""
    a = layer.vertices - middle
    b = np.zeros_like(a) if layer.conjugate is None else layer.conjugate - middle
    aa, bb, ab = ((u * v).sum(axis=1) for u, v in ((a, a), (b, b), (a, b)))
    return float(np.sqrt(((aa + bb) / 2 + np.hypot((aa - bb) / 2, ab)).max(initial=0.0)))


def _camera(camera: Camera) -> dict[str, object]:
    right = np.cross(camera.up, camera.direction)
    frame = [axis.tolist() for axis in (right, camera.up, camera.direction)]
    return {"focus": camera.focus.tolist(), "frame": frame, "radius": camera.radius}
