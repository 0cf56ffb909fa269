"""Fills the chosen loops of one mesh. `fill_hole` and batches read the mesh and solve for the surfaces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from spinor_geom.adapters import MeshFile, extend
from spinor_geom.deadline import time_limit
from spinor_geom.errors import SpinorGeomError
from spinor_geom.fill.borders import require_no_border
from spinor_geom.fill.bridges import fill_between, planned_joins
from spinor_geom.fill.fill_loop import fill_loop, unfilled
from spinor_geom.fill.fill_options import LEAST_TIME, Choice, FillOptions
from spinor_geom.fill.fill_result import FillResult, LoopOutcome
from spinor_geom.fill.loop_choice import chosen_indices, reasons_to_leave_open
from spinor_geom.fill.mesh_notes import mesh_notes, useful_merging
from spinor_geom.fill.no_holes import require_hole, require_no_seams
from spinor_geom.fill.patched_mesh import LoopPatch, PatchedMesh, stitch
from spinor_geom.fill.solved_loops import SolvedLoop, solved_loops
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
        """Finds the loops. Raises as `find_boundary_loops` and `chosen_indices`."""
        self.mesh, sheets = mesh, Sheets.of(mesh.vertices, mesh.faces)
        self.loops = find_boundary_loops(mesh, sheets)
        self._merging = useful_merging(mesh, self.loops)
        self.mesh_notes = mesh_notes(mesh, self.loops, sheets, self._merging)
        self._unclosed = sheets.unclosed(mesh.faces, len(mesh.vertices))
        self._options = options
        chosen_indices(options.named_loops, self.loops)  # raises
        bridged = chosen_indices([index for bridge in choice.bridges for index in bridge], self.loops)
        indices = chosen_indices([] if bridged and choice.is_all else choice.loop, self.loops)
        reasons = reasons_to_leave_open(self.loops, indices, choice)
        reasons = {index: reason for index, reason in reasons.items() if index not in bridged}
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
        self._joins, self._notes = planned_joins(mesh, sheets, self.loops, wanted, choice.islands, choice.bridges)
        joined = {index for first, others in self._joins.items() for index in (first, *others)}
        self.patched = PatchedMesh(mesh, self.loops)
        self.left_open = {index: unfilled(index, self.loops[index], reason) for index, reason in reasons.items()}
        alone = [index for index in wanted if index not in joined]
        for index in alone:
            if error := self._error_of(self.loops[index], is_named=choice.names_loops):
                self.left_open[index] = unfilled(index, self.loops[index], error)
        self.rims = [
            self.loops[index] for index in alone if index not in self.left_open and options.continuity_of(index) == "C0"
        ]

    def _error_of(self, loop: BoundaryLoop, *, is_named: bool) -> SpinorGeomError | None:
        """The error of a loop that is not a hole, or None."""
        try:
            require_hole(loop, self.patched, self._merging)
            if not is_named:
                require_no_seams(loop)
                with time_limit(max(self._options.time_limit, LEAST_TIME)):
                    require_no_border(self.patched, loop)
        except SpinorGeomError as error:
            return error
        return None

    def filled(
        self, solved: Iterator[SolvedLoop], on_loop: Callable[[LoopOutcome, int], None] | None = None
    ) -> tuple[list[LoopOutcome], list[LoopPatch]]:
        """Fills the loops: one outcome for every loop, and the patches. `solved` has one item for each of `rims`."""
        requested = len(self.loops) - sum(not _is_reported(outcome) for outcome in self.left_open.values())
        outcomes: dict[int, LoopOutcome] = {}
        patches: list[LoopPatch] = []
        for index in range(len(self.loops)):
            if index in outcomes:
                continue
            patch: LoopPatch | None = None
            if index in self.left_open:
                done = [self.left_open[index]]
            else:
                done, patch = self._patch((index, *self._joins.get(index, ())), solved, self._options)
                done[0] = self._noted(done[0])
            if patch is not None:
                patches.append(patch)
            for outcome in done:
                outcomes[outcome.index] = outcome
                if on_loop is not None and _is_reported(outcome):
                    on_loop(outcome, requested)
        return [outcomes[index] for index in range(len(self.loops))], patches

    def _patch(
        self, loops: Sequence[int], solved: Iterator[SolvedLoop], options: FillOptions
    ) -> tuple[list[LoopOutcome], LoopPatch | None]:
        """The outcomes of a loop, or of several that are joined, and their patch or None."""
        if len(loops) > 1:
            return fill_between(self.patched, loops, self.loops, options)
        (index,), exact = loops, None
        if options.continuity_of(index) == "C0":
            options.on_stage(index, "exact surface")
            exact = next(solved)
        outcome, patch = fill_loop(self.patched, index, self.loops[index], exact, options)
        return [outcome], patch

    def _noted(self, outcome: LoopOutcome) -> LoopOutcome:
        """The outcome of a hole, with the remark on islands in it."""
        note = self._notes.get(outcome.index)
        return replace(outcome, remarks=(*outcome.remarks, note)) if note and outcome.filled else outcome

    def preview(
        self, loops: Sequence[int], before: Sequence[LoopPatch], options: FillOptions
    ) -> tuple[LoopOutcome, LoopPatch | None]:
        """The first outcome and the patch of named loops, as `filled` makes them after the patches `before`.

        No other patch within `patched.reach` has an effect on it.
        """
        self.patched.clear()
        for other in before:
            self.patched.join(other.patch, other.rim)
        first = self.loops[loops[0]]
        if len(loops) == 1 and (error := self._error_of(first, is_named=True)):
            return unfilled(loops[0], first, error), None
        (outcome, *_), patch = self._patch(loops, solved_loops([first], options), options)
        return (outcome if len(loops) > 1 else self._noted(outcome)), patch

    def result(
        self, source: Any, outcomes: Sequence[LoopOutcome], patches: Sequence[LoopPatch], clock: Clock
    ) -> FillResult:
        """The report, with the filled mesh in the type of `source`, from which the mesh was made."""
        extension = stitch(self.mesh, patches)
        watertight = is_watertight_with(self.mesh.faces, self._unclosed, extension.faces)
        mesh = extend(source, extension)
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
