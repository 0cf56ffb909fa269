"""HTML pages in one file: text, tables, pictures, and scenes to rotate, in light and dark mode."""

from __future__ import annotations

import base64
import html
import io
import json
import math
import os
import zlib
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from spinor_geom.errors import OptionError
from spinor_geom.render.scene import UNKNOWN_COLOUR, VIRIDIS, Faces, Layer, Lines, Scene, overview

_LONG = 60  # cells with more characters wrap
# unpacks the data and the program of a page, and starts the program. A module runs when the whole page has been read
_START = """<script type="module">
  const program = document.createElement("script"), packed = document.getElementById("program");
  async function unpacked(element) {
    const bytes = Uint8Array.from(atob(element.textContent), (letter) => letter.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).text();
  }
  const data = document.getElementById("data");
  data.textContent = await unpacked(data);
  if (packed.dataset.address) program.src = packed.dataset.address;
  else program.textContent = await unpacked(packed);
  document.body.append(program);
</script>"""


def _file(name: str) -> str:
    return files("spinor_geom.render").joinpath(name).read_text(encoding="utf-8")


@cache
def viewer_program() -> str:
    """three.js and the viewer, the program of pages with scenes."""
    return f"{_file('three.min.js')}\n{_file('viewer.js')}"


@cache
def _packed_program() -> str:
    return _packed(viewer_program())


def _packed(text: str) -> str:
    """A text compressed (deflate), in base 64."""
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()


def document(title: str, body: Sequence[str], *, style: str = "") -> str:
    """A whole page from pieces of HTML. `style` is CSS added to page.css."""
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


def require_html(path: str | os.PathLike[str]) -> None:
    """Raises an OptionError unless a path has the suffix of a page."""
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise OptionError(f"{os.fspath(path)}: a page has the suffix .html, not '{Path(path).suffix}'; print it as PDF")


def table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, marked: Container[int] = (), by_loop: bool = False
) -> str:
    """An HTML table of plain text. The marked rows are highlighted.

    With `by_loop` the first cells are numbers of loops: a row and the layers of its loop in the views are linked.
    """
    head = "".join(f'<th scope="col">{html.escape(column)}</th>' for column in columns)
    links = [f' data-row="{html.escape(row[0])}" tabindex="0"' if by_loop else "" for row in rows]
    lines = (
        f"<tr{' class=missed' * (k in marked)}{links[k]}>"
        + "".join(f"<td{' class=long' * (len(text) > _LONG)}>{html.escape(text)}</td>" for text in row)
        + "</tr>"
        for k, row in enumerate(rows)
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of text. Cells may be bold, with Markdown's `**` around them."""

    title: str = ""  # The heading, none if empty
    columns: Sequence[str]  # The column names
    rows: Sequence[Sequence[str]]  # One text for each column
    note: str = ""  # A paragraph below the heading
    marked: frozenset[int] = frozenset()  # Indices of rows that a page shows in red

    @classmethod
    def of_records(cls, records: Sequence[Mapping[str, Any]]) -> Table:
        """One row for each record, one column for each name that any of them has."""
        columns = list(dict.fromkeys(name for record in records for name in record))
        return cls(columns=columns, rows=[[cell(record.get(name)) for name in columns] for record in records])

    @property
    def plain_rows(self) -> list[list[str]]:
        """The rows without `**`."""
        return [[text.strip("*") for text in row] for row in self.rows]

    def markdown(self) -> str:
        """The table in Markdown."""
        lines = [
            [text.replace("|", "\\|") for text in line]
            for line in (self.columns, ["---"] * len(self.columns), *self.rows)
        ]
        lined = "\n".join(f"| {' | '.join(line)} |" for line in lines)
        return "\n\n".join(filter(None, [self.title and f"### {self.title}", self.note, lined]))

    def html(self) -> str:
        """The table as a part of a page."""
        heading = f"<h3>{html.escape(self.title)}</h3>" if self.title else ""
        note = f"<p>{html.escape(self.note)}</p>" if self.note else ""
        return f"{heading}{note}{table(self.columns, self.plain_rows, marked=self.marked)}"


def beside(figure: str, *parts: str) -> str:
    """A picture with other pieces of HTML beside it."""
    return f'<div class="beside">{figure}<div>{"".join(parts)}</div></div>'


def folded(title: str, *parts: str, is_open: bool = False) -> str:
    """Pieces of HTML below a title that opens and closes them."""
    return f"<details{' open' * is_open}><summary>{html.escape(title)}</summary>{''.join(parts)}</details>"


def cell(value: Any, digits: int = 4) -> str:
    """The text of a value in a table, empty for None and NaN."""
    if value is None or isinstance(value, bool):
        return {None: "", True: "yes", False: "no"}[value]
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.{digits}g}"
    return str(value)


def picture(data: bytes, alt: str) -> str:
    """A PNG as an `img` element that contains the data."""
    return f'<img alt="{html.escape(alt)}" src="data:image/png;base64,{base64.b64encode(data).decode()}">'


def _address(image: UInt8[np.ndarray, "h w 3"]) -> str:
    """An image as an address that contains it."""
    from PIL import Image  # of the extra `render`

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="jpeg", quality=90)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode()}"


class Views:
    """The scenes of one page: `figure` adds one, `script` returns their data and program for the end of the page."""

    def __init__(self) -> None:
        self._views: list[dict[str, object]] = []
        self._arrays: dict[str, int] = {}  # the index of each array. Arrays that layers share are stored once

    def figure(self, scene: Scene) -> str:
        """Adds a scene and returns its HTML element."""
        place = f"view-{len(self._views)}"
        points = np.concatenate([layer.vertices for layer in scene.layers])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        reach = max(farthest(layer, middle) for layer in scene.layers) or 1.0

        def scaled(points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
            """Points scaled to the unit ball, so that single precision suffices at any position of the scene."""
            return np.asarray((points - middle) / reach)

        cameras = {"": scene.camera or overview(scene.layers), **scene.loop_cameras}
        self._views.append(
            {
                **{name: getattr(scene, name) for name in ("title", "panel", "unit", "flat")},
                "place": place,
                "reach": reach,
                "labels": [(scaled(at).tolist(), text) for at, text in scene.labels],
                "layers": [self._layer(layer, scaled) for layer in scene.layers],
                "scales": {name: vars(scale) for name, scale in scene.colour_scales.items()},
                "cameras": {
                    loop: {
                        "focus": scaled(camera.focus).tolist(),
                        "frame": camera.frame.tolist(),
                        "radius": camera.radius / reach,
                    }
                    for loop, camera in cameras.items()
                },
            }
        )
        return f'<figure class="view {scene.shape}" id="{place}"></figure>'

    def script(self, program: str | None = None) -> str:
        """The script elements: the data of all scenes, and the program or, if given, its address."""
        data = {
            "colours": {"stops": VIRIDIS, "unknown": UNKNOWN_COLOUR},
            "arrays": list(self._arrays),
            "views": self._views,
        }
        address = "" if program is None else f' data-address="{html.escape(program)}"'
        return (
            f'<script type="application/json" id="data">{_packed(json.dumps(data))}</script>\n'
            f'<script type="text/plain" id="program"{address}>{"" if address else _packed_program()}</script>\n{_START}'
        )

    def _layer(self, layer: Layer, scaled: Callable[[np.ndarray], np.ndarray]) -> dict[str, object]:
        """A layer in JSON's types, with arrays by index."""
        data: dict[str, object] = {"kind": type(layer).__name__.lower(), **vars(layer)}
        data["vertices"] = scaled(layer.vertices)
        data["conjugate"] = None if layer.conjugate is None else scaled(layer.conjugate)
        if isinstance(layer, Faces):
            fields = {name: self._array(values) for name, values in layer.fields.items()}
            data |= {"elements": data.pop("faces"), "fields": fields}
            data["image"] = None if layer.image is None else _address(layer.image)
        elif isinstance(layer, Lines):
            data["elements"] = data.pop("edges")
        return {k: self._array(v) if isinstance(v, np.ndarray) else v for k, v in data.items() if v is not None}

    def _array(self, values: np.ndarray) -> int:
        """The index of an array, which is stored in single precision or 32-bit integers, little-endian, base 64."""
        kind = "<u4" if values.dtype.kind == "i" else "<f4"
        text = base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()
        return self._arrays.setdefault(text, len(self._arrays))


def panel(*, colours: Iterable[str], switches: Iterable[str], loops: dict[str, str]) -> str:
    """Controls for the scenes with `panel` and for elements with `data-loop`: fields, check boxes, loops' labels.

    At first the patches have one colour, no box is checked and the first loop is selected.
    """
    radios = [_choice("radio", "colour", "", "one colour", checked=True)]
    radios += [_choice("radio", "colour", name, name) for name in colours]
    boxes = [_choice("checkbox", "show", switch, switch) for switch in switches]
    options = (f'<option value="{html.escape(loop)}">{html.escape(label)}</option>' for loop, label in loops.items())
    choice = f'<legend>Loop</legend><select name="loop" aria-label="loop">{"".join(options)}</select>'
    return (
        f'<form class="panel" autocomplete="off">{f"<fieldset>{choice}</fieldset>" if loops else ""}'
        f"<fieldset><legend>Colour of the patches</legend>{''.join(radios)}"
        f'<output class="bar" aria-live="polite"></output></fieldset>'
        f"<fieldset><legend>Show</legend>{''.join(boxes)}</fieldset></form>"
    )


def _choice(kind: str, name: str, value: str, label: str, *, checked: bool = False) -> str:
    return (
        f'<label><input type="{kind}" name="{name}" value="{html.escape(value)}"{" checked" * checked}> '
        f"{html.escape(label)}</label>"
    )


def farthest(layer: Layer, middle: np.ndarray) -> float:
    """The largest distance of a layer's vertices from a point, over the associate family: |cos t·a + sin t·b|."""
    a = layer.vertices - middle
    b = np.zeros_like(a) if layer.conjugate is None else layer.conjugate - middle
    aa, bb, ab = ((u * v).sum(axis=1) for u, v in ((a, a), (b, b), (a, b)))
    return float(np.sqrt(((aa + bb) / 2 + np.hypot((aa - bb) / 2, ab)).max(initial=0.0)))
