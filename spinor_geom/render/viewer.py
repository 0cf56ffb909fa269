"""Rotating views of coloured meshes in a page of its own: the data and the script are in the page."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files

import numpy as np
from jaxtyping import Float, Int

# share of the values that the ends of a colour scale leave out, so that one vertex does not make the rest one colour
_TAIL = 0.01

STYLE = """body { font: 15px/1.45 system-ui, sans-serif; max-width: 76rem; margin: 2rem auto; padding: 0 1rem;
color: #222 }
table { border-collapse: collapse; margin: 1rem 0; font-size: 13px; display: block; overflow-x: auto }
th, td { padding: .2rem .6rem; border-bottom: 1px solid #ddd; text-align: left; white-space: nowrap }
td.long { white-space: normal; min-width: 22rem } tr.missed td { background: #fdecea }
figure { display: inline-block; margin: .5rem; vertical-align: top } img { max-width: 100% }
figure.view { width: 282px }
canvas { width: 280px; height: 280px; border: 1px solid #ddd; display: block; touch-action: none }
figcaption { font-size: 13px; max-width: 560px } select, span { font-size: 12px }"""


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshView:
    """A mesh to be looked at.

    Attributes:
        title: below which it stands.
        vertices: positions.
        faces: triangles.
        fields: values at the vertices that it may be coloured by, by name; NaN is grey. The first is shown first.
        edges: whether the triangles' edges are drawn.
        conjugate: positions on the conjugate surface; with them a slider turns through the associate family, cos θ of
            the vertices and sin θ of these, both from the middle of the vertices.
    """

    title: str
    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    fields: Mapping[str, Float[np.ndarray, " n"]] = field(default_factory=dict)
    edges: bool = True
    conjugate: Float[np.ndarray, "n 3"] | None = None


class Views:
    """The views of one page: `figure` where each is to stand, `script` once at the page's end."""

    def __init__(self) -> None:
        """No views yet."""
        self._views: list[str] = []

    def figure(self, view: MeshView) -> str:
        """The element in which the view will stand."""
        place = f"view-{len(self._views)}"
        data = {
            "place": place,
            "title": view.title,
            "vertices": _base64(np.asarray(view.vertices, dtype="<f4")),
            "faces": _base64(np.asarray(view.faces, dtype="<u4")),
            "fields": {name: _field(values) for name, values in view.fields.items()},
            "edges": view.edges,
            "conjugate": None if view.conjugate is None else _base64(np.asarray(view.conjugate, dtype="<f4")),
        }
        self._views.append(json.dumps(data))
        return f'<figure class="view" id="{place}"></figure>'

    def script(self) -> str:
        """The data of all views and the program that shows them."""
        # "</" would end the script element
        data = ("[" + ",".join(self._views) + "]").replace("</", "<\\/")
        program = files("spinor_geom.render").joinpath("viewer.js").read_text(encoding="utf-8")
        return f'<script type="application/json" id="views">{data}</script>\n<script>{program}</script>'


def page(title: str, body: Sequence[str], views: Views) -> str:
    """A whole page that needs nothing from elsewhere.

    Args:
        title: of the page; a browser shows "ready: " before it once all views stand.
        body: pieces of HTML.
        views: whose figures stand in the body.
    """
    return "\n".join(
        [
            "<!doctype html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>',
            f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head><body>',
            *body,
            views.script(),
            "</body></html>",
            "",
        ]
    )


def picture(data: bytes, alt: str) -> str:
    """A PNG inside the page."""
    return f'<img alt="{html.escape(alt)}" src="data:image/png;base64,{base64.b64encode(data).decode()}">'


def _field(values: Float[np.ndarray, " n"]) -> dict[str, object]:
    known = values[np.isfinite(values)]
    low, high = np.quantile(known, [_TAIL, 1 - _TAIL]).tolist() if len(known) else (0.0, 1.0)
    return {"values": _base64(np.asarray(values, dtype="<f4")), "low": low, "high": high}


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
