"""The holes of one mesh, from the choice of loops to the result: what `fill_hole` and batches have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from spinor_geom.adapters import MeshFile, extend
from spinor_geom.errors import SpinorGeomError
from spinor_geom.fill.borders import refuse_border
from spinor_geom.fill.discrete_patch import refuse_seams, refuse_what_is_no_hole
from spinor_geom.fill.loops import chosen_places, reasons_to_leave_open
from spinor_geom.fill.many_loops import fill_loops, planned_joins
from spinor_geom.fill.mesh_notes import mesh_notes
from spinor_geom.fill.one_loop import Answer, Clock, FillOptions, unfilled
from spinor_geom.fill.options import Choice
from spinor_geom.fill.result import FillResult, LoopOutcome
from spinor_geom.fill.surroundings import LoopPatch, Surroundings, stitch
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import Sheets, find_boundary_loops
from spinor_geom.mesh.topology import is_watertight
from spinor_geom.mesh.triangle_mesh import TriangleMesh


class Filling:
    """The loops of a mesh: which are to be filled, and why the others are left open.

    Attributes:
        mesh: the mesh, which is not changed.
        loops: all of its boundary loops, longest perimeter first.
        mesh_notes: what is to be said of the whole mesh, a sentence each.
        surroundings: the mesh that patches are joined to, and those that were.
        left_open: the outcomes of the loops that nothing is tried for, by their places.
        rims: those that are to be solved, each by itself, in order.
    """

    def __init__(self, mesh: TriangleMesh, choice: Choice, options: FillOptions) -> None:
        """Finds the loops; raises as `find_boundary_loops` and `chosen_places`."""
        self.mesh, sheets = mesh, Sheets.of(mesh.vertices, mesh.faces)
        self.loops = find_boundary_loops(mesh, sheets)
        self.mesh_notes = mesh_notes(mesh, self.loops, sheets)
        self._options, self._names_loops = options, choice.names_loops
        places = chosen_places(choice.loop if choice.bridge is None else choice.bridge, self.loops)
        reasons = reasons_to_leave_open(
            self.loops, places, keep_largest=choice.keep_largest, max_perimeter=choice.max_perimeter
        )
        if isinstance(choice.loop, BoundaryLoop):
            own, given = self.loops[places[0]], choice.loop
            own = replace(own, points=given.points, vertex_ids=given.vertex_ids, corners=given.corners)
            self.loops[places[0]] = own
        wanted = [place for place in range(len(self.loops)) if place not in reasons]
        self._joins, self._notes = planned_joins(mesh, self.loops, wanted, choice.islands, choice.bridge)
        joined = {place for first, others in self._joins.items() for place in (first, *others)}
        self.surroundings = Surroundings(mesh, self.loops)
        self.left_open = {place: unfilled(place, self.loops[place], reason) for place, reason in reasons.items()}
        alone = [place for place in wanted if place not in joined]
        for place in alone:
            if error := self._refusal(self.loops[place]):
                self.left_open[place] = unfilled(place, self.loops[place], error)
        self.rims = [self.loops[place] for place in alone if place not in self.left_open]

    def _refusal(self, loop: BoundaryLoop) -> SpinorGeomError | None:
        """Why nothing is tried for a loop, or None."""
        try:
            refuse_what_is_no_hole(loop, self.surroundings)
            if not self._names_loops:
                refuse_seams(loop)
                refuse_border(self.surroundings, loop)
        except SpinorGeomError as error:
            return error
        return None

    def finished(
        self, answers: Iterator[Answer], on_loop: Callable[[LoopOutcome, int], None] | None = None
    ) -> tuple[list[LoopOutcome], list[LoopPatch]]:
        """One outcome for every loop, and the patches; the answers are those of `rims`, in order."""
        return fill_loops(
            self.surroundings,
            self.loops,
            answers,
            self._options,
            on_loop,
            left_open=self.left_open,
            joins=self._joins,
            notes=self._notes,
        )

    def result(
        self, source: Any, outcomes: Sequence[LoopOutcome], patches: Sequence[LoopPatch], clock: Clock
    ) -> FillResult:
        """The mesh in the type of the source that it was taken from, with its patches and what is to be said of it."""
        extension = stitch(self.mesh, patches)
        filled = extend(source, extension)
        watertight = is_watertight(np.concatenate([self.mesh.faces, extension.faces]))
        clock.lap("stitch")
        return FillResult(
            mesh=filled,
            original=self.mesh,
            extension=extension,
            loops=tuple(outcomes),
            notes=(*(source.notes if isinstance(source, MeshFile) else ()), *self.mesh_notes),
            watertight=watertight,
            timings=clock.laps(),
        )
