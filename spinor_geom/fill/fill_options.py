"""Options that fills, batches and the command line share; importing this module takes little time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from spinor_geom.errors import OptionError, require_positive

if TYPE_CHECKING:
    from spinor_geom.fill.loop_choice import LoopChoice
    from spinor_geom.plateau.options import Model

Continuity: TypeAlias = Literal["C0", "C1"]
Islands: TypeAlias = Literal["join", "ignore"]

CONTINUITY: tuple[Continuity, ...] = get_args(Continuity)
ISLANDS: tuple[Islands, ...] = get_args(Islands)
TIME_LIMIT = 20.0  # seconds for each stage of a loop, see `fill_hole`


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The options of `fill_hole` and `batch` that choose loops; raises OptionError."""

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
        if self.bridge is not None and (isinstance(self.bridge, str) or not isinstance(self.bridge, Iterable)):
            raise OptionError(f"bridge must be several loop indices, such as (0, 1), not {self.bridge!r}")
        if self.bridge is not None and not self._is_all:
            raise OptionError(
                "bridge and loop exclude each other: a bridge fills no other loop; fill the others in a second call"
            )

    @property
    def _is_all(self) -> bool:
        return isinstance(self.loop, str) and self.loop == "all"

    @property
    def names_loops(self) -> bool:
        """Whether loops are named; named seams and borders of sheets are filled, too."""
        return not self._is_all or self.bridge is not None


@dataclass(frozen=True, kw_only=True)
class PatchOptions:
    """The options of each patch that `fill_hole` and `batch` share; raises OptionError."""

    tolerance: float = 1e-3
    time_limit: float = TIME_LIMIT
    continuity: Continuity = "C0"

    def __post_init__(self) -> None:
        require_positive("tolerance", self.tolerance)
        require_positive("time_limit", self.time_limit, finite=False)
        if self.continuity not in CONTINUITY:
            raise OptionError(f"continuity must be 'C0' or 'C1', not {self.continuity!r}")


@dataclass(frozen=True, kw_only=True, eq=False)
class FillOptions(PatchOptions):
    """Options of `fill_hole` for every loop of one call; raises OptionError."""

    target_edge_length: float | Literal["auto"] = "auto"
    model: Model = "auto"
    on_stage: Callable[[int, str], None] = lambda index, stage: None

    def __post_init__(self) -> None:
        from spinor_geom.plateau.options import require_model  # imports numpy

        super().__post_init__()
        require_model(self.model)
        if not (isinstance(self.target_edge_length, str) and self.target_edge_length == "auto"):
            require_positive("target_edge_length", self.target_edge_length, instead="'auto' or ")


def require_merge(merge: Any) -> None:
    """Raises an OptionError unless `merge` is a bool or a distance."""
    is_number = isinstance(merge, Real)
    if not isinstance(merge, bool) and not (is_number and 0 <= merge < math.inf):
        raise OptionError(f"merge must be True, False or a distance of at least 0, not {merge!r}")
