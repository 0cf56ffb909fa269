"""What was chosen for the loops of a mesh, the patches that this gives, and the command that makes the same mesh."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float

from spinor_geom.fill.fill_result import LoopOutcome
from spinor_geom.fill.patched_mesh import LoopPatch

Kind: TypeAlias = Literal["film", "smooth"]
Loops: TypeAlias = tuple[int, ...]  # of one patch, ascending: one, or those of a bridge

_NEXT: dict[Kind | None, Kind | None] = {None: "film", "film": "smooth", "smooth": None}


@dataclass(frozen=True, kw_only=True, eq=False)
class Preview:
    """The patch over a loop, or between several, as a fill makes it.

    Attributes:
        loops: the loops.
        chosen: the kind that was asked for.
        kind: that of the patch, as `LoopOutcome.kind`.
        area: of the surface, in squared mesh units.
        residual: RMS distance of an exact surface from the loop, in mean edges.
        intersections: pairs of intersecting faces, or None if the time limit ended the search for them.
        sentences: why it is open or not good, and remarks.
        patch: None if the loop stays open.
        reach: the box in which other patches change this one, low and high corner.
    """

    loops: Loops
    chosen: Kind
    kind: str | None = None
    area: float | None = None
    residual: float | None = None
    intersections: int | None = 0
    sentences: tuple[str, ...]
    patch: LoopPatch | None = None
    reach: Float[np.ndarray, "2 3"]

    @classmethod
    def of(
        cls, loops: Loops, chosen: Kind, outcome: LoopOutcome, patch: LoopPatch | None, reach: Float[np.ndarray, "2 3"]
    ) -> Preview:
        """The preview from the outcome of the first loop."""
        solution = outcome.solution if outcome.kind == "minimal" else None
        return cls(
            loops=loops,
            chosen=chosen,
            kind=outcome.kind,
            area=outcome.area if outcome.filled else None,
            residual=None if solution is None else float(solution.boundary_residual.rms_per_edge),
            intersections=outcome.intersections if outcome.is_searched else None,
            sentences=outcome.shortcomings,
            patch=patch,
            reach=reach,
        )

    @cached_property
    def box(self) -> Float[np.ndarray, "2 3"]:
        """The bounding box of the patch, low and high corner, or empty without one."""
        if self.patch is None:
            return np.array([[np.inf] * 3, [-np.inf] * 3])
        vertices = self.patch.patch.vertices
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)])

    def neighbours(self, before: _Patches) -> list[Preview]:
        """Those of the patches that have an effect on this one if they are joined to the mesh before."""
        boxes = before.boxes[: len(before.previews)]
        near = (boxes[:, 0] <= self.reach[1]).all(axis=1) & (boxes[:, 1] >= self.reach[0]).all(axis=1)
        return [before.previews[k] for k in np.flatnonzero(near)]


class _Patches:
    """Previews with a patch, and their boxes in one array with spare rows."""

    def __init__(self, size: int) -> None:
        self.previews: list[Preview] = []
        self.boxes = np.empty((size, 2, 3))

    def add(self, preview: Preview | None) -> None:
        if preview is not None and preview.patch is not None:
            self.boxes[len(self.previews)] = preview.box
            self.previews.append(preview)


@dataclass(frozen=True, kw_only=True)
class Job:
    """A preview to be computed, and the patches that are joined to the mesh before."""

    loops: Loops
    kind: Kind
    before: _Patches


class Session:
    """The choices of one person for one mesh, with undo.

    Attributes:
        holes: the loops that a fill of all holes fills.
        choices: the kind of patch by its loops. A loop in none stays open.
        jobs: what is being computed.
    """

    def __init__(self, holes: Sequence[int]) -> None:
        self.holes = holes
        self.choices: Mapping[Loops, Kind] = {}
        self.jobs: list[Job] = []
        self._past: list[Mapping[Loops, Kind]] = []
        # all previews of some loops and a kind, each with the neighbours that it was computed with, the latest last
        self._known: dict[tuple[Loops, Kind], list[tuple[Preview, list[Preview]]]] = {}

    def loops_with(self, index: int) -> Loops:
        """A loop, with the other loops of its bridge."""
        return next((loops for loops in self.choices if index in loops), (index,))

    def click(self, index: int) -> None:
        """Changes a loop, or its bridge, from open to a film, from a film to a smooth patch, and from that to open."""
        loops = self.loops_with(index)
        self._choose({loops: _NEXT[self.choices.get(loops)]})

    def join(self, one: int, other: int) -> None:
        """Joins two loops, and those that they are joined to already, by one patch of the first loop's kind."""
        first, second = self.loops_with(one), self.loops_with(other)
        if first != second:
            kind = self.choices.get(first, "film")
            self._choose({first: None, second: None, tuple(sorted({*first, *second})): kind})

    def click_all(self) -> None:
        """Gives each open hole a film. If none is open, makes all patches smooth. If all are smooth, opens all."""
        open_holes = [(index,) for index in self.holes if self.loops_with(index) not in self.choices]
        if open_holes:
            self._choose(dict.fromkeys(open_holes, "film"))
        else:
            is_smooth = all(kind == "smooth" for kind in self.choices.values())
            self._choose(dict.fromkeys(self.choices, None if is_smooth else "smooth"))

    def cancel(self) -> None:
        """Opens all loops without a patch that is up to date."""
        self._choose({loops: None for loops, (_, is_current) in self.previews().items() if not is_current})

    def undo(self) -> None:
        """Takes the last change back."""
        if self._past:
            self.choices = self._past.pop()

    def _choose(self, changes: Mapping[Loops, Kind | None]) -> None:
        if not changes:
            return
        self._past.append(self.choices)
        self.choices = {loops: kind for loops, kind in {**self.choices, **changes}.items() if kind is not None}

    def previews(self) -> dict[Loops, tuple[Preview | None, bool]]:
        """The latest preview of each choice, in the order of a fill, and whether it is what a fill makes now."""
        found: dict[Loops, tuple[Preview | None, bool]] = {}
        before = _Patches(len(self.choices))
        for loops, kind in sorted(self.choices.items()):
            latest, is_current = None, False
            for latest, neighbours in reversed(self._known.get((loops, kind), [])):
                if is_current := latest.neighbours(before) == neighbours:
                    break
            found[loops] = latest, is_current
            before.add(latest)
        return found

    def next_job(self) -> Job | None:
        """The first preview that is to be computed and is not yet. It counts as begun then."""
        before = _Patches(len(self.choices))
        for loops, (preview, is_current) in self.previews().items():
            kind = self.choices[loops]
            if not is_current and not any((job.loops, job.kind) == (loops, kind) for job in self.jobs):
                self.jobs.append(Job(loops=loops, kind=kind, before=before))
                return self.jobs[-1]
            before.add(preview)
        return None

    def is_wanted(self, job: Job) -> bool:
        """Whether the loops of a job still are to have a patch of its kind."""
        return self.choices.get(job.loops) == job.kind

    def finish(self, job: Job, preview: Preview | None) -> None:
        """Stores the preview of a job, which is None if the job was cancelled."""
        self.jobs.remove(job)
        if preview is not None:
            known = self._known.setdefault((job.loops, job.kind), [])
            known.append((preview, preview.neighbours(job.before)))

    @property
    def options(self) -> dict[str, Any]:
        """The arguments of `fill_hole` that make these patches."""
        return {
            "loop": [loops[0] for loops in self.choices if len(loops) == 1],
            "bridge": [loops for loops in self.choices if len(loops) > 1] or None,
            "continuity": {loops[0]: kind for loops, kind in self.choices.items()},
        }

    def command(self, start: Collection[str]) -> str:
        """The command that makes these patches. It begins with `start`."""
        words = [*start]
        for loops in sorted(self.choices):
            if len(loops) > 1:
                words += ["--bridge", ranges(loops)]
        for option, kind in (("--film", "film"), ("--smooth", "smooth")):
            # a bridge has the kind of its first loop, by default a film
            is_named = {loops: len(loops) == 1 or kind == "smooth" for loops in self.choices}
            if named := [loops[0] for loops, own in self.choices.items() if own == kind and is_named[loops]]:
                words += [option, ranges(named)]
        return shlex.join(words)


def ranges(numbers: Collection[int]) -> str:
    """Numbers as the command line takes them: 0,2-9."""
    found = []
    for _, run in groupby(enumerate(sorted(numbers)), lambda pair: pair[1] - pair[0]):
        own = [number for _, number in run]
        found.append(str(own[0]) if len(own) == 1 else f"{own[0]}-{own[-1]}")
    return ",".join(found)
