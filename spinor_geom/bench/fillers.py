"""All hole fillers by name: ours and the peers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from spinor_geom.bench.holes import Hole
from spinor_geom.bench.peers import PEERS, Filled, Peer, ways_of
from spinor_geom.fill.continuity import Continuity
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.result import LoopOutcome

OURS, SMOOTH = "spinor-fill", "spinor-fill-c1"
OUR_FILLERS = (OURS, SMOOTH)
# those that are asked to continue the mesh smoothly, each in the ways that do it best, beside ours
SMOOTHEST = (
    *OUR_FILLERS,
    *("meshlib-nicely", "meshlib-nicely-fine", "meshlib-nicely-natural", "cgal-fair", "cgal-fair-2"),
    *("meshlab-close-smoothed", "pymeshfix-refined"),
)


def _prepare(hole: Hole) -> Any:
    if hole.facing:
        which = {"bridge": hole.places}
    else:
        # of a mesh all of whose loops are asked for, borders of sheets are left open as for any user
        which = {} if len(hole.places) == len(hole.loops) else {"loop": hole.places}
    return (hole.vertices, hole.faces), which


def _fill(state: Any, continuity: Continuity) -> Any:
    mesh, which = state
    return fill_hole(mesh, **which, islands="join", continuity=continuity, return_report=True)


def _finish(state: Any, answer: Any) -> Filled:
    (vertices, faces), report = answer
    requested = [outcome for outcome in report.loops if outcome.requested]
    said = [outcome.reason for outcome in requested if outcome.reason]
    said += [note for outcome in requested for note in outcome.notes]
    filled = sum(outcome.filled for outcome in requested)
    return Filled(
        vertices=vertices,
        faces=faces,
        told="; ".join([f"{filled} of {len(requested)} filled", *dict.fromkeys(said)]),
        succeeded=all(outcome.converged for outcome in requested) and report.intersection_free,
        # a surface between two rims counts once, at the rim that its faces are counted at
        area=sum(o.area for o in requested if o.area is not None and o.faces_added),
        figures=_own_figures(requested),
    )


def _own_figures(requested: Sequence[LoopOutcome]) -> dict[str, Any]:
    """What only ours tells: kinds of the patches, and root mean square residuals per mean edge of the exact ones."""
    kinds = [outcome.kind for outcome in requested if outcome.filled]
    residuals = [
        outcome.solution.boundary_residual.rms_per_edge
        for outcome in requested
        if outcome.filled and outcome.solution is not None
    ]
    return {
        **{kind: kinds.count(kind) for kind in ("minimal", "discrete", "smooth")},
        "requested": len(requested),
        "unexplained": sum(not outcome.filled and not outcome.reason for outcome in requested),
        "within_1e-2": sum(residual <= 1e-2 for residual in residuals),
        "within_1e-3": sum(residual <= 1e-3 for residual in residuals),
        "residual_per_edge": max(residuals, default=None),
    }


FILLERS: Mapping[str, Peer] = {
    peer.name: peer
    for peer in (
        *ways_of(
            *("spinor_geom", "spinor-geom", _prepare, _finish),
            {
                OURS: (
                    "fill_hole, islands joined, facing rims bridged; the whole of it is timed: finding loops, solving, "
                    "meshing, stitching",
                    partial(_fill, continuity="C0"),
                ),
                SMOOTH: ('the same with continuity="C1"', partial(_fill, continuity="C1")),
            },
        ),
        *PEERS,
    )
}
"""Ours first."""
