"""The holes of one mesh, from the choice of loops to their patches: what `fill_hole` and batches have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from spinor_geom.errors import OptionError, SpinorGeomError, require_positive
from spinor_geom.fill.borders import refuse_border
from spinor_geom.fill.discrete_patch import refuse_seams, refuse_what_is_no_hole
from spinor_geom.fill.loops import LoopChoice, chosen_places, reasons_to_leave_open
from spinor_geom.fill.many_loops import fill_loops, planned_joins
from spinor_geom.fill.mesh_notes import mesh_notes
from spinor_geom.fill.one_loop import Answer, FillOptions, unfilled
from spinor_geom.fill.options import ISLANDS, Islands
from spinor_geom.fill.result import LoopOutcome
from spinor_geom.fill.surroundings import LoopPatch, Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.loops import Sheets, find_boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Which loops of a mesh are filled: options of `fill_hole`, with an OptionError for what is none."""

    loop: LoopChoice = "all"
    bridge: Sequence[int] | None = None
    islands: Islands = "ignore"
    keep_largest: bool = False
    max_perimeter: float | None = None

    def __post_init__(self) -> None:
        if self.islands not in ISLANDS:
            raise OptionError(f"islands must be 'join' or 'ignore', not {self.islands!r}")
        if self.max_perimeter is not None:
            require_positive("max_perimeter", self.max_perimeter)
        if isinstance(self.bridge, (int, np.integer, str)):
            raise OptionError(f"bridge must be several places, such as (0, 1), not {self.bridge!r}")
        if self.bridge is not None and not self._is_all:
            raise OptionError(
                "bridge and loop exclude each other: a bridge fills no other loop; call again for the others"
            )

    @property
    def _is_all(self) -> bool:
        return isinstance(self.loop, str) and self.loop == "all"

    @property
    def names_loops(self) -> bool:
        """Whether loops were named; then the borders of sheets and the seams among them are filled too."""
        return not self._is_all or self.bridge is not None

    def places(self, loops: Sequence[BoundaryLoop]) -> list[int]:
        """The places of the loops that it names, ascending; raises as `chosen_places`."""
        return chosen_places(self.loop if self.bridge is None else self.bridge, loops)


class Filling:
    """The loops of a mesh: which are to be filled, and why the others are left open.

    Attributes:
        mesh: the mesh, which is not changed.
        loops: all of its boundary loops, longest perimeter first.
        mesh_notes: what is to be said of the whole mesh, a sentence each.
        rims: those that are to be solved, each by itself, in order.
    """

    def __init__(self, mesh: TriangleMesh, choice: Choice, options: FillOptions) -> None:
        """Finds the loops; raises as `find_boundary_loops` and `Choice.places`."""
        self.mesh, sheets = mesh, Sheets.of(mesh.vertices, mesh.faces)
        self.loops = find_boundary_loops(mesh, sheets)
        self.mesh_notes = mesh_notes(mesh, self.loops, sheets)
        self._options, self._names_loops = options, choice.names_loops
        places = choice.places(self.loops)
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
        self._surroundings = Surroundings(mesh, self.loops)
        self._left_open = {place: unfilled(place, self.loops[place], reason) for place, reason in reasons.items()}
        alone = [place for place in wanted if place not in joined]
        for place in alone:
            if error := self._refusal(self.loops[place]):
                self._left_open[place] = unfilled(place, self.loops[place], error)
        self.rims = [self.loops[place] for place in alone if place not in self._left_open]

    def _refusal(self, loop: BoundaryLoop) -> SpinorGeomError | None:
        """Why nothing is tried for a loop, or None."""
        try:
            refuse_what_is_no_hole(loop, self._surroundings)
            if not self._names_loops:
                refuse_seams(loop)
                refuse_border(self._surroundings, loop)
        except SpinorGeomError as error:
            return error
        return None

    def finished(
        self, answers: Iterator[Answer], on_loop: Callable[[LoopOutcome, int], None] | None = None
    ) -> tuple[list[LoopOutcome], list[LoopPatch]]:
        """One outcome for every loop, and the patches; the answers are those of `rims`, in order."""
        return fill_loops(
            self._surroundings,
            self.loops,
            answers,
            self._options,
            on_loop,
            left_open=self._left_open,
            joins=self._joins,
            notes=self._notes,
        )
