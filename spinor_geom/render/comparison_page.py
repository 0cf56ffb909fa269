"""A page of comparisons: their figures, and both meshes side by side, coloured by distance to the exact surface."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from spinor_geom.comparison import Comparison
from spinor_geom.measures import distances_to_mesh
from spinor_geom.render.page import Views, beside, document, table
from spinor_geom.render.scene import Faces, Scale, Scene, overview

_DISTANCE = "distance to the exact surface, mesh units"
_GAP = 1.15  # from one mesh to the next, in widths


def comparison_page(comparisons: Mapping[str, Comparison], *, title: str) -> str:
    """A page in one file with a view of both meshes and a table for each comparison, by name, such as "loop 0"."""
    views, body = Views(), [f"<h1>{html.escape(title)}</h1>"]
    for name, comparison in comparisons.items():
        (head, *rows), layers = comparison.rows(), _side_by_side(comparison)
        scene = Scene(
            title=f"{name}: left the exact surface's mesh, right the {comparison.method}",
            layers=layers,
            scales={_DISTANCE: Scale(low=0.0, high=max(float(one.fields[_DISTANCE].max()) for one in layers))},
            unit="mesh units",
        )
        summary = (
            f"On average the surface's mesh is {comparison.patch_to_surface.mean:.2g} from the exact surface, and the "
            f"{comparison.method} {comparison.baseline_to_surface.mean:.2g}."
        )
        body += [
            f"<h2>{html.escape(name)}</h2><p>{html.escape(summary)}</p>",
            beside(views.figure(scene), table(head, rows)),
        ]
    return document(title, [*body, views.script()])


def _side_by_side(comparison: Comparison) -> list[Faces]:
    """Both meshes, the second one to the right of the first one as they are seen at first."""
    fine = comparison.surface_mesh
    first, second = (
        Faces(
            vertices=vertices,
            faces=faces,
            fields={_DISTANCE: distances_to_mesh(vertices, fine.vertices, fine.faces)},
            edges=True,
        )
        for vertices, faces in (
            (comparison.patch.vertices, comparison.patch.faces),
            (comparison.baseline.vertices, comparison.baseline.faces),
        )
    )
    right = overview([first]).frame[0]
    seen = np.concatenate([first.vertices, second.vertices]) @ right
    return [first, replace(second, vertices=second.vertices + _GAP * np.ptp(seen) * right)]
