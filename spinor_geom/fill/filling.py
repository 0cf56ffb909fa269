"""Fills the chosen loops of one mesh. `fill_hole` and batches read the mesh and solve for the surfaces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from spinor_geom.adapters import MeshFile, extend
from spinor_geom.errors import SpinorGeomError
from spinor_geom.fill.borders import require_no_border
from spinor_geom.fill.bridges import fill_between, planned_joins
from spinor_geom.fill.fill_loop import fill_loop, unfilled
from spinor_geom.fill.fill_options import Choice, FillOptions
from spinor_geom.fill.fill_result import FillResult, LoopOutcome
from spinor_geom.fill.loop_choice import chosen_indices, reasons_to_leave_open
from spinor_geom.fill.mesh_notes import mesh_notes, useful_merging
from spinor_geom.fill.no_holes import require_hole, require_no_seams
from spinor_geom.fill.patched_mesh import LoopPatch, PatchedMesh, stitch
from spinor_geom.fill.solved_loops import SolvedLoop
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import Sheets, find_boundary_loops
from spinor_geom.mesh.topology import is_watertight_with
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.plateau.steps import Clock


class Filling:
    """The boundary loops of a mesh, and which of them are to be filled.

    Attributes:
        mesh: the mesh, which is not changed.
        loops: all of its boundary loops, longest perimeter first.
        mesh_notes: sentences on the whole mesh.
        patched: the mesh with the patches joined so far.
        left_open: outcomes of the loops that are not to be filled, by index.
        rims: the loops that are to be filled by films, without those of bridges, in order.
    """

    def __init__(self, mesh: TriangleMesh, choice: Choice, options: FillOptions) -> None:
        """Finds the loops; raises as `find_boundary_loops` and `chosen_indices`."""
        self.mesh, sheets = mesh, Sheets.of(mesh.vertices, mesh.faces)
        self.loops = find_boundary_loops(mesh, sheets)
        self._merging = useful_merging(mesh, self.loops)
        self.mesh_notes = mesh_notes(mesh, self.loops, sheets, self._merging)
        self._unclosed = sheets.unclosed(mesh.faces, len(mesh.vertices))
        self._options, self._names_loops = options, choice.names_loops
        chosen_indices(options.named_loops, self.loops)  # raises
        indices = chosen_indices(choice.loop if choice.bridge is None else choice.bridge, self.loops)
        reasons = reasons_to_leave_open(self.loops, indices, choice)
        if isinstance(choice.loop, BoundaryLoop):
            own, given = self.loops[indices[0]], choice.loop
            self.loops[indices[0]] = replace(
                own,
                points=given.points,
                vertex_ids=given.vertex_ids,
                corners=given.corners,
                corners_given=given.corners_given,
            )
        wanted = [index for index in range(len(self.loops)) if index not in reasons]
        self._joins, self._notes = planned_joins(mesh, sheets, self.loops, wanted, choice.islands, choice.bridge)
        joined = {index for first, others in self._joins.items() for index in (first, *others)}
        self.patched = PatchedMesh(mesh, self.loops)
        self.left_open = {index: unfilled(index, self.loops[index], reason) for index, reason in reasons.items()}
        alone = [index for index in wanted if index not in joined]
        for index in alone:
            if error := self._error_of(self.loops[index]):
                self.left_open[index] = unfilled(index, self.loops[index], error)
        self.rims = [self.loops[index] for index in alone if index not in self.left_open and self._is_film(index)]

    def _is_film(self, index: int) -> bool:
        return self._options.continuity_of(index) == "C0"

    def _error_of(self, loop: BoundaryLoop) -> SpinorGeomError | None:
        """The error of a loop that is not a hole, or None."""
        try:
            require_hole(loop, self.patched, self._merging)
            if not self._names_loops:
                require_no_seams(loop)
                require_no_border(self.patched, loop)
        except SpinorGeomError as error:
            return error
        return None

    def filled(
        self, solved: Iterator[SolvedLoop], on_loop: Callable[[LoopOutcome, int], None] | None = None
    ) -> tuple[list[LoopOutcome], list[LoopPatch]]:
        """Fills the loops: one outcome for every loop, and the patches; `solved` has one item for each of `rims`."""
        requested = len(self.loops) - sum(not _is_reported(outcome) for outcome in self.left_open.values())
        outcomes: dict[int, LoopOutcome] = {}
        patches: list[LoopPatch] = []
        for index, loop in enumerate(self.loops):
            if index in outcomes:
                continue
            patch: LoopPatch | None = None
            if index in self.left_open:
                done = [self.left_open[index]]
            elif index in self._joins:
                together = (index, *self._joins[index])
                done, patch = fill_between(self.patched, together, self.loops, self._options)
            else:
                exact = None
                if self._is_film(index):
                    self._options.on_stage(index, "exact surface")
                    exact = next(solved)
                outcome, patch = fill_loop(self.patched, index, loop, exact, self._options)
                done = [outcome]
            if index in self._notes and done[0].filled:
                done[0] = replace(done[0], remarks=(*done[0].remarks, self._notes[index]))
            if patch is not None:
                patches.append(patch)
            for outcome in done:
                outcomes[outcome.index] = outcome
                if on_loop is not None and _is_reported(outcome):
                    on_loop(outcome, requested)
        return [outcomes[index] for index in range(len(self.loops))], patches

    def result(
        self, source: Any, outcomes: Sequence[LoopOutcome], patches: Sequence[LoopPatch], clock: Clock
    ) -> FillResult:
        """The report, with the filled mesh in the type of `source`, from which the mesh was made."""
        extension = stitch(self.mesh, patches)
        mesh = extend(source, extension)
        watertight = is_watertight_with(self.mesh.faces, self._unclosed, extension.faces)
        clock.lap("stitch")
        return FillResult(
            mesh=mesh,
            original=self.mesh,
            extension=extension,
            loops=tuple(outcomes),
            notes=(*(source.notes if isinstance(source, MeshFile) else ()), *self.mesh_notes),
            watertight=watertight,
            timings=clock.with_total,
        )


def _is_reported(outcome: LoopOutcome) -> bool:
    return outcome.requested or outcome.is_border
