"""A page about a membrane: the film with its cables and the forces of its supports, and their figures."""

from __future__ import annotations

import html

import numpy as np
from jaxtyping import Float

from spinor_geom.membrane.membrane import Membrane
from spinor_geom.render.page import Views, beside, document, table
from spinor_geom.render.portrait import Portrait
from spinor_geom.render.scene import Lines, Scene

_ALONG = np.linspace(0, 1, 65)  # of a cable
_LONGEST = 0.3  # force, in the diagonal of the supports
_CABLE, _FORCE = "#7a3e00", "#c00000"


def membrane_page(membrane: Membrane, *, name: str) -> str:
    """A page in one file. Forces are drawn as lines that start at the supports. Free ends of cables have none."""
    views, title = Views(), html.escape(f"Membrane {name}")
    lines = [_line(cable.point(_ALONG), _CABLE) for cable in membrane.cables]
    largest = np.linalg.norm(membrane.forces, axis=1).max(initial=0.0)
    if largest > 0:
        scale = _LONGEST * np.linalg.norm(np.ptp(membrane.supports, axis=0)) / largest
        ends = np.stack([membrane.supports, membrane.supports + scale * membrane.forces], axis=1)
        lines += [_line(pair, _FORCE) for pair in ends[~membrane.is_free]]
    scene = Scene(
        title="The film, its cables (brown), and the forces of the supports (red)",
        layers=[*Portrait.of(membrane.film).layers, *lines],
        labels=[(point, str(number)) for number, point in enumerate(membrane.supports)],
        unit="mesh units",
    )
    forces = [
        [f"support {number}{' (free)' * bool(free)}", *_cells(force)]
        for number, (free, force) in enumerate(zip(membrane.is_free, membrane.forces, strict=True))
    ]
    forces += [
        [f"edge {name}", *_cells(one)]
        for name, one in zip(membrane.edge_names, membrane.edge_forces, strict=True)
        if one.any()
    ]
    forces.append(["sum", *_cells(membrane.total_force)])
    cables = [
        [str(number), f"{cable.tension:.9g}", f"{cable.length:.9g}"] for number, cable in enumerate(membrane.cables)
    ]
    body = [
        f"<h1>{title}</h1>",
        f"<p>Area {membrane.film.area:.9g}. Forces are in units of the surface tension times mesh units.</p>",
        beside(
            views.figure(scene),
            table(("force of", "x", "y", "z"), forces),
            *([table(("cable", "tension", "length"), cables)] if cables else []),
        ),
        views.script(),
    ]
    return document(title, body)


def _line(points: Float[np.ndarray, "n 3"], colour: str) -> Lines:
    first = np.arange(len(points) - 1)
    return Lines(vertices=points, edges=np.stack([first, first + 1], axis=1), colour=colour, width=3.0)


def _cells(force: Float[np.ndarray, "3"]) -> list[str]:
    return [f"{x:.6g}" if abs(x) > 1e-12 else "0" for x in force.tolist()]
