"""Options that fills, batches and the command line share. Importing this module takes little time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, cast, get_args

from spinor_geom.errors import OptionError, require_positive

if TYPE_CHECKING:
    from spinor_geom.fill.loop_choice import LoopChoice
    from spinor_geom.plateau.options import Model

Continuity: TypeAlias = Literal["C0", "C1", "auto"]
ContinuityName: TypeAlias = Continuity | Literal["c0", "film", "c1", "smooth"]
LoopContinuity: TypeAlias = Mapping[int | Literal["default"], ContinuityName]
Islands: TypeAlias = Literal["join", "ignore"]
Bridge: TypeAlias = Sequence[int] | Sequence[Sequence[int]]

# the continuity of each spelling, in lower case
CONTINUITIES: dict[str, Continuity] = {"c0": "C0", "film": "C0", "c1": "C1", "smooth": "C1", "auto": "auto"}
ISLANDS: tuple[Islands, ...] = get_args(Islands)
TIME_LIMIT = 20.0  # seconds for each loop, see `fill_hole`
LEAST_TIME = 0.5  # seconds for each search about a loop, at least, where its time limit is shorter
CLOSING = 1e-3  # largest gap of a curve that is closed, in mean edges


def untold(index: int, stage: str) -> None:
    """The default of `on_stage`. Unlike a lambda it can be pickled."""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The options of `fill_hole` and `batch` that choose loops. Raises OptionError."""

    loop: LoopChoice = "all"
    bridge: Bridge | None = None
    islands: Islands = "ignore"
    keep_largest: bool = False
    max_perimeter: float | None = None

    def __post_init__(self) -> None:
        if self.islands not in ISLANDS:
            raise OptionError(f"islands must be 'join' or 'ignore', not {self.islands!r}")
        if self.max_perimeter is not None:
            require_positive("max_perimeter", self.max_perimeter)
        every = [index for loops in self.bridges for index in loops]
        if short := [loops for loops in self.bridges if len(loops) < 2]:
            raise OptionError(f"a bridge joins two or more loops, got {len(short[0])}; add a loop, or use loop=")
        if twice := [index for index in every if every.count(index) > 1]:
            raise OptionError(f"bridges join different loops, got loop {twice[0]} twice; remove one of them")

    @property
    def bridges(self) -> list[list[int]]:
        """The loops of each bridge."""
        if self.bridge is None:
            return []
        if isinstance(self.bridge, str) or not isinstance(self.bridge, Iterable):
            raise OptionError(f"bridge must be several loop indices, such as (0, 1), not {self.bridge!r}")
        own = [list(loops) if isinstance(loops, Iterable) else loops for loops in self.bridge]
        several = [loops for loops in own if isinstance(loops, list)]
        if several and len(several) < len(own):
            raise OptionError(f"bridge must be loop indices or several lists of them, not {self.bridge!r}")
        return several or [cast("list[int]", own)]

    @property
    def is_all(self) -> bool:
        """Whether all loops are chosen that are in no bridge. With a bridge, none is."""
        return isinstance(self.loop, str) and self.loop == "all"

    @property
    def names_loops(self) -> bool:
        """Whether loops are named. Named seams and borders of sheets are filled, too."""
        return not self.is_all or self.bridge is not None


@dataclass(frozen=True, kw_only=True)
class PatchOptions:
    """The options of each patch that `fill_hole` and `batch` share. Raises OptionError."""

    tolerance: float = 1e-3
    time_limit: float = TIME_LIMIT

    def __post_init__(self) -> None:
        require_positive("tolerance", self.tolerance)
        require_positive("time_limit", self.time_limit, finite=False)

    @property
    def seconds_to_solve(self) -> float:
        """The part of the time limit for the exact surface. The rest is for the patch."""
        return self.time_limit / 2


@dataclass(frozen=True, kw_only=True, eq=False)
class FillOptions(PatchOptions):
    """Options of `fill_hole` for every loop of one call. Raises OptionError."""

    target_edge_length: float | Literal["auto"] = "auto"
    model: Model = "auto"
    continuity: ContinuityName | LoopContinuity = "C0"
    on_stage: Callable[[int, str], None] = untold

    def __post_init__(self) -> None:
        from spinor_geom.plateau.options import require_model  # imports numpy

        super().__post_init__()
        require_model(self.model)
        if isinstance(self.continuity, Mapping):
            for index, name in self.continuity.items():
                known_continuity(name)
                if index != "default" and (isinstance(index, bool) or not isinstance(index, Integral)):
                    raise OptionError(f"continuity has loop indices and 'default' as keys, not {index!r}")
        else:
            known_continuity(self.continuity)
        if not (isinstance(self.target_edge_length, str) and self.target_edge_length == "auto"):
            require_positive("target_edge_length", self.target_edge_length, instead="'auto' or ")

    @property
    def named_loops(self) -> list[int]:
        """The loops with a continuity of their own."""
        return (
            [index for index in self.continuity if index != "default"] if isinstance(self.continuity, Mapping) else []
        )

    def continuity_of(self, *indices: int) -> Continuity:
        """The continuity of the patch over a loop, or between several: that of the first that has one of its own."""
        if not isinstance(self.continuity, Mapping):
            return known_continuity(self.continuity)
        named = [self.continuity[index] for index in indices if index in self.continuity]
        return known_continuity((*named, self.continuity.get("default", "C0"))[0])


def known_continuity(name: Any) -> Continuity:
    """The continuity with a name, in any case. Raises an OptionError for an unknown one."""
    if isinstance(name, str) and name.lower() in CONTINUITIES:
        return CONTINUITIES[name.lower()]
    raise OptionError(f"continuity must be 'C0' ('film'), 'C1' ('smooth') or 'auto', not {name!r}")


def require_merge(merge: Any) -> None:
    """Raises an OptionError unless `merge` is a bool or a distance."""
    is_number = isinstance(merge, Real)
    if not isinstance(merge, bool) and not (is_number and 0 <= merge < math.inf):
        raise OptionError(f"merge must be True, False or a distance of at least 0, not {merge!r}")
