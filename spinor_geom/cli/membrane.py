"""`spinor-geom membrane`: the film inside a frame of a file, and the forces on its supports."""

from __future__ import annotations

import argparse
import json
from typing import Any

import numpy as np

from spinor_geom.cli.console import ExitStatus, complain, progress, show_lines
from spinor_geom.cli.solve import film_writer
from spinor_geom.cli.source import require_writable
from spinor_geom.files import write_text
from spinor_geom.membrane.frame_file import read_frame
from spinor_geom.membrane.membrane import Membrane, solve_membrane
from spinor_geom.render.page import require_html

_BALANCED = 1e-8  # largest sum of forces, and force at a free corner, relative to the largest force or the size
_ALONG = np.linspace(0, 1, 65)  # of a cable


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Solves, writes the film and the page, and prints cables and forces as JSON."""
    write = film_writer(arguments)
    if arguments.html is not None:
        require_html(arguments.html)
        require_writable(arguments.html, arguments.input, arguments.output)
    edges = read_frame(arguments.input)
    with progress("solving") as bar:
        tolerance = arguments.tolerance or 1e-4
        membrane = solve_membrane(edges, tolerance=tolerance, time_limit=arguments.time_limit)
        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        bar.stage("film")
        facts, problem = write(membrane.film, arguments)
    if arguments.html is not None:
        from spinor_geom.render.membrane_page import membrane_page

        arguments.html.parent.mkdir(parents=True, exist_ok=True)
        write_text(arguments.html, membrane_page(membrane, name=arguments.input.name))
    show_lines(json.dumps(_json(membrane), indent=2), piped=True)
    show_lines(facts, piped=False)
    left = np.abs([membrane.total_force, *membrane.forces[membrane.is_free]]).max()
    problems = [problem] if problem else []
    # a flat film inside a ring alone has no forces
    if left > _BALANCED * max(np.abs([*membrane.forces, *membrane.edge_forces]).max(), membrane.film.diagonal):
        problems.append(f"the forces balance up to {left:.1e} only; lower --tolerance")
    for text in problems:
        complain(text)
    return ExitStatus.IMPERFECT if problems else ExitStatus.DONE


def _json(membrane: Membrane) -> dict[str, Any]:
    return {
        "area": membrane.film.area,
        "cables": [
            {"tension": one.tension, "length": one.length, "points": one.point(_ALONG).tolist()}
            for one in membrane.cables
        ],
        "supports": [
            {"point": point, "force": force, "is_free": free}
            for point, force, free in zip(
                *(x.tolist() for x in (membrane.supports, membrane.forces, membrane.is_free)), strict=True
            )
        ],
        "edge_forces": dict(zip(membrane.edge_names, membrane.edge_forces.tolist(), strict=True)),
        "ring_heights": membrane.heights.tolist(),
        "total_force": membrane.total_force.tolist(),
    }
