"""Properties of surfaces between several rims, and surfaces over fewer of the rims."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from spinor_geom.deadline import require_time, time_limit
from spinor_geom.errors import OutOfTimeError
from spinor_geom.plateau.steps import Clock
from spinor_geom.plateau.threads import one_thread

if TYPE_CHECKING:
    from spinor_geom.mesh.boundary_loop import BoundaryLoop
    from spinor_geom.mesh.loop_frame import LoopFrame
    from spinor_geom.plateau.solution import PlateauSolution

Partition: TypeAlias = tuple[tuple[int, ...], ...]  # numbers of the rims of each surface

_MOST_FOR_ALL_PARTITIONS = 4  # rims up to which all partitions are computed: four rims have 14


def _placed_over(
    disks: RimDisks, frame: LoopFrame, loops: Sequence[BoundaryLoop], numbers: tuple[int, ...]
) -> PlateauSolution | None:
    surface = disks.surface_over(numbers)
    return None if surface is None else surface.placed_by(frame, *(loops[number] for number in numbers))


@dataclass(frozen=True, kw_only=True, eq=False)
class RimDisks:
    """Minimal surfaces over some of several rims, with which a surface between all rims is compared.

    Attributes:
        count: number of the rims.
        surface_over: returns the surface of least area over the rims of given numbers, or None if there is none.
        seconds: time limit of all disks, and of all other surfaces. If it ends them, they count as not found.
        clock: time of the stage "disks".
    """

    count: int
    surface_over: Callable[[tuple[int, ...]], PlateauSolution | None]
    seconds: float = math.inf
    clock: Clock = field(default_factory=Clock)

    def __repr__(self) -> str:
        return f"RimDisks({self.count} rims)"

    def placed_by(self, frame: LoopFrame, loops: Sequence[BoundaryLoop]) -> RimDisks:
        """The surfaces over some of given loops, from those in the coordinates of a frame."""
        return replace(self, surface_over=partial(_placed_over, self, frame, loops))

    @cached_property
    def all(self) -> tuple[PlateauSolution, ...] | None:
        """A disk over each rim, in the given order, or None if one was not found."""
        found = self._found([(number,) for number in range(self.count)])
        return None if found is None or len(found) < self.count else tuple(found.values())

    def _found(self, groups: Iterable[tuple[int, ...]]) -> dict[tuple[int, ...], PlateauSolution] | None:
        """The surfaces over groups of rims that have one, or None if time ran out."""
        with one_thread(), self.clock.stage("disks"):
            try:
                with time_limit(self.seconds):
                    return {group: surface for group in groups if (surface := self.surface_over(group)) is not None}
            except OutOfTimeError:
                require_time()  # the caller's own limit raises
        return None

    @cached_property
    def partitions(self) -> dict[Partition, float]:
        """Total areas of surfaces of fewer rims each that together bound all rims, by partition.

        For up to four rims these are all partitions that have surfaces. For more rims there are too many partitions,
        and only all disks, and each disk with a surface over the other rims, are compared.
        """
        if self.all is None:
            return {}
        areas: dict[tuple[int, ...], float] = {(number,): disk.area for number, disk in enumerate(self.all)}
        partitions = _partitions(len(areas))
        groups = {group for partition in partitions for group in partition if len(group) > 1}
        joined = self._found(sorted(groups))
        if joined is None:
            return {}
        areas.update({group: surface.area for group, surface in joined.items()})
        return {
            partition: sum(areas[group] for group in partition)
            for partition in partitions
            if all(group in areas for group in partition)
        }


def _partitions(count: int) -> list[Partition]:
    """The partitions of `RimDisks.partitions`."""
    if count > _MOST_FOR_ALL_PARTITIONS:
        one_apart = [((k,), tuple(j for j in range(count) if j != k)) for k in range(count)]
        return [tuple((k,) for k in range(count)), *one_apart]
    found: list[Partition] = [()]
    for number in range(count):
        found = [
            (*partition[:place], (*group, number), *partition[place + 1 :])
            for partition in found
            for place, group in enumerate((*partition, ()))
        ]
    return [partition for partition in found if len(partition) > 1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Annulus:
    """Properties of a surface between two rims or more.

    Attributes:
        modulus: logarithm of the ratio of the radii of the round annulus that Ω is conformal to. For m ≥ 3 rims the
            mean modulus 2πm/T, with T the sum of the capacities of the rims, each against all others. None if the
            route does not compute it.
        antiperiodic: for each hole of Ω, whether p and q change sign around it.
        period: the largest |Re ∮ φ dz| around a hole, in mesh units: the closing error of the surface there.
        backward: for each given loop, whether its direction is opposite to that of the surface's boundary. False for
            the first of two.
        order: the numbers of the given loops in the order of the rims.
        rim_disks: the minimal disks over the loops.
    """

    modulus: float | None
    antiperiodic: tuple[bool, ...]
    period: float
    backward: tuple[bool, ...]
    order: tuple[int, ...]
    rim_disks: RimDisks

    def __repr__(self) -> str:
        modulus = "" if self.modulus is None else f", modulus {self.modulus:.6g}"
        return f"Annulus({len(self.order)} rims{modulus}, {self.spin}, period {self.period:.1e})"

    def placed_by(self, frame: LoopFrame, loops: Sequence[BoundaryLoop]) -> Annulus:
        """The properties of the surface between given loops, from those in the coordinates of a frame."""
        return replace(self, period=self.period * frame.size, rim_disks=self.rim_disks.placed_by(frame, loops))

    @property
    def spin(self) -> Literal["periodic", "antiperiodic"]:
        """Whether p and q are periodic around all holes, or change sign around one."""
        return "antiperiodic" if any(self.antiperiodic) else "periodic"

    @property
    def reversed(self) -> bool:
        """Whether some but not all of the given loops have the direction of the surface's boundary."""
        return len(set(self.backward)) > 1

    @property
    def disks(self) -> tuple[PlateauSolution, ...] | None:
        """The minimal disks over the loops, in the order of the rims. None if one is missing. Solved on first use."""
        disks = self.rim_disks.all
        return None if disks is None else tuple(disks[number] for number in self.order)

    @property
    def disk_area(self) -> float | None:
        """Total area of the disks."""
        return None if self.disks is None else sum(disk.area for disk in self.disks)

    @property
    def partition_areas(self) -> dict[Partition, float]:
        """`RimDisks.partitions`: the areas of Douglas's condition."""
        return self.rim_disks.partitions

    def to_dict(self) -> dict[str, Any]:
        """The values as types that JSON supports."""
        return {
            "modulus": self.modulus,
            "spin": self.spin,
            "antiperiodic": list(self.antiperiodic),
            "period": self.period,
            "reversed": self.reversed,
            "disk_area": self.disk_area,
        }
