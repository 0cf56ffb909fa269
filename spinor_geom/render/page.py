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
from spinor_geom.render.layers import UNKNOWN_COLOUR, VIRIDIS, Camera, Faces, Layer, Lines, Scale

_LONG = 60  # letters, from which on the text of a cell is broken into lines
_LESS = "\\u003c"  # "<" in JSON


def _file(name: str) -> str:
    return files("spinor_geom.render").joinpath(name).read_text(encoding="utf-8")


def document(title: str, body: Sequence[str], *, style: str = "") -> str:
    """A whole page of pieces of HTML; the style is CSS of this page, after that of all pages."""
    return "\n".join(
        [
            "<!doctype html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>',
            '<meta name="viewport" content="width=device-width">',
            f"<style>{_file('page.css')}{style}</style></head><body>",
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
        self._places: dict[str, int] = {}  # each array once, however many layers have it

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
            "cameras": {
                loop: {"focus": camera.focus.tolist(), "frame": camera.frame.tolist(), "radius": camera.radius}
                for loop, camera in scene.cameras.items()
            },
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
        return "\n".join(
            [
                # "</script" would end the script element, "<!--" with a "<script" after it hide its end
                *(
                    f'<script type="application/json" id="{name}">{json.dumps(value).replace("<", _LESS)}</script>'
                    for name, value in data.items()
                ),
                f"<script>{three_js()}</script>",
                f"<script>{_file('viewer.js')}</script>",
            ]
        )

    def _layer(self, layer: Layer) -> dict[str, object]:
        """A layer in JSON's types; arrays as their places among all."""
        data: dict[str, object] = {"kind": type(layer).__name__.lower(), **vars(layer)}
        if isinstance(layer, Faces):
            fields = {name: self._array(values) for name, values in layer.fields.items()}
            data |= {"elements": data.pop("faces"), "fields": fields}
        elif isinstance(layer, Lines):
            data["elements"] = data.pop("edges")
        return {k: self._array(v) if isinstance(v, np.ndarray) else v for k, v in data.items() if v is not None}

    def _array(self, values: np.ndarray) -> int:
        """The place of an array: its little-endian bytes in base 64."""
        kind = "<u4" if values.dtype.kind == "i" else "<f4"
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
