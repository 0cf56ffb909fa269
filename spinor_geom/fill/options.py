"""Options of fills and their checks, which batches have too; cheap to import."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from spinor_geom.errors import OptionError, require_positive

if TYPE_CHECKING:
    from spinor_geom.fill.loops import LoopChoice

Continuity: TypeAlias = Literal["C0", "C1"]  # the tangents turn at the rim, or continue
Islands: TypeAlias = Literal["join", "ignore"]

CONTINUITY: tuple[Continuity, ...] = get_args(Continuity)
ISLANDS: tuple[Islands, ...] = get_args(Islands)
TIME_LIMIT = 20.0  # seconds for the exact surface of a loop


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
        if self.bridge is not None and (isinstance(self.bridge, str) or not isinstance(self.bridge, Iterable)):
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
        """Whether loops were named; then the borders of sheets among them are filled too."""
        return not self._is_all or self.bridge is not None


def require_merge(merge: Any) -> None:
    """Raises an OptionError for what is neither a bool nor a distance."""
    is_number = isinstance(merge, Real)
    if not isinstance(merge, bool) and not (is_number and 0 <= merge < math.inf):
        raise OptionError(f"merge must be True, False or a distance from 0 on, not {merge!r}")
