"""A page of comparisons: their figures, and both meshes side by side, coloured by distance to the exact surface."""

from __future__ import annotations

import html
import os
from collections.abc import Mapping

import numpy as np

from spinor_geom.comparison import Comparison
from spinor_geom.files import write_text
from spinor_geom.measures import distances_to_mesh
from spinor_geom.render.page import Views, document, require_html, table
from spinor_geom.render.scene import Faces, Scene

_DISTANCE = "distance to the exact surface, mesh units"
_GAP = 1.15  # from one mesh to the next, in widths


def comparison_page(
    comparisons: Mapping[str, Comparison], path: str | os.PathLike[str] | None = None, *, title: str
) -> str:
    """A page in one file with a table and a view of both meshes for each comparison, by name, such as "loop 0".

    The page is returned, and written to `path`; raises an OptionError for another suffix than .html,
    and an OSError if the file cannot be written.
    """
    if path is not None:
        require_html(path)
    views, body = Views(), [f"<h1>{html.escape(title)}</h1>"]
    for name, comparison in comparisons.items():
        head, *rows = comparison.rows()
        scene = Scene(
            title=f"{name}: the exact surface's mesh, then the {comparison.method}",
            layers=_side_by_side(comparison),
            unit="mesh units",
        )
        body += [f"<h2>{html.escape(name)}</h2>", table(head, rows), views.figure(scene)]
    text = document(title, [*body, views.script()])
    if path is not None:
        write_text(path, text)
    return text


def _side_by_side(comparison: Comparison) -> list[Faces]:
    """Both meshes, the second one moved along the longest side of their bounding box."""
    patch, baseline, fine = comparison.patch, comparison.baseline, comparison.surface_mesh
    meshes = (patch.vertices, patch.faces), (baseline.vertices, baseline.faces)
    extent = np.ptp(patch.vertices, axis=0)
    shift = np.where(np.arange(3) == np.argmax(extent), _GAP * extent, 0.0)
    return [
        Faces(
            vertices=vertices + k * shift,
            faces=faces,
            fields={_DISTANCE: distances_to_mesh(vertices, fine.vertices, fine.faces)},
            edges=True,
        )
        for k, (vertices, faces) in enumerate(meshes)
    ]
