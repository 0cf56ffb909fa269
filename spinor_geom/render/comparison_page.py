"""A page about comparisons: their figures, and both meshes side by side, coloured by distance to the exact surface."""

from __future__ import annotations

import html
import os
from collections.abc import Mapping

import numpy as np

from spinor_geom.comparison import Comparison
from spinor_geom.files import write_text
from spinor_geom.measures import distances_to_mesh
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch
from spinor_geom.render.layers import Faces, Scale
from spinor_geom.render.page import Scene, Views, document, table

DISTANCE = "distance to the exact surface, mesh units"
_GAP = 1.15  # widths from one mesh to the next


def comparison_page(
    comparisons: Mapping[str, Comparison], path: str | os.PathLike[str] | None = None, *, title: str
) -> str:
    """One file for any browser: for each comparison, by its name, a table and a view of its two meshes.

    Args:
        comparisons: by name, such as "loop 0".
        path: where to write the page as well.
        title: of the page.

    Raises:
        RenderError: the viewer's library was not found.
        OSError: the file cannot be written.
    """
    views, body = Views(), [f"<h1>{html.escape(title)}</h1>"]
    for name, comparison in comparisons.items():
        head, *rows = comparison.rows()
        layers = _side_by_side(comparison)
        values = np.concatenate([layer.fields[DISTANCE] for layer in layers])
        scene = Scene(
            title=f"{name}: the exact surface's mesh, then the {comparison.method}",
            layers=layers,
            scales={DISTANCE: Scale.of(values)},
            unit="mesh units",
            shape="wide",
        )
        body += [f"<h2>{html.escape(name)}</h2>", table(head, rows), views.figure(scene)]
    text = document(title, [*body, views.script()])
    if path is not None:
        write_text(path, text)
    return text


def _side_by_side(comparison: Comparison) -> list[Faces]:
    """Both meshes with the distance of their vertices, the second moved along the longest side of their box."""
    fine = comparison.surface_mesh
    meshes: tuple[Patch | TriangleMesh, ...] = (comparison.patch, comparison.baseline)
    extent = np.ptp(comparison.patch.vertices, axis=0)
    shift = np.where(np.arange(3) == np.argmax(extent), _GAP * extent, 0.0)
    return [
        Faces(
            vertices=mesh.vertices + k * shift,
            faces=mesh.faces,
            fields={DISTANCE: distances_to_mesh(mesh.vertices, fine.vertices, fine.faces)},
            edges=True,
        )
        for k, mesh in enumerate(meshes)
    ]
