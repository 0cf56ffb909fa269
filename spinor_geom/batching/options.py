"""What every file of a batch is treated with, and what it may cost; cheap to import, JSON on its way to others."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

from spinor_geom.errors import OptionError, require_positive
from spinor_geom.files import MESH_SUFFIXES
from spinor_geom.fill.fill_options import CONTINUITY, TIME_LIMIT, Choice, Continuity, Islands, require_merge

What: TypeAlias = Literal["fill", "surface", "loops"]

WHAT: tuple[What, ...] = get_args(What)
FORMAT = (*(suffix[1:] for suffix in MESH_SUFFIXES), "npz")
OF_CURVES = ("obj", "npz")
HARDEST_LOOPS = 100  # a file with so many loops that take as long as they may is done to its end


@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """What the results depend on: options of `batch`, which says what they mean; raises OptionError."""

    what: What = "fill"
    format: str | None = None
    loop: Literal["all"] | int | Sequence[int] = "all"
    bridge: Sequence[int] | None = None
    islands: Islands = "ignore"
    merge: bool | float = False
    keep_largest: bool = False
    max_perimeter: float | None = None
    edge_length: float | Literal["auto"] = "auto"
    tolerance: float = 1e-3
    continuity: Continuity = "C0"
    time_limit: float = TIME_LIMIT
    strict: bool = False
    closing: float = 1e-3
    compare: bool = False
    device: str = "cpu"

    def __post_init__(self) -> None:
        for name, known in (("what", WHAT), ("format", (*FORMAT, None)), ("continuity", CONTINUITY)):
            if getattr(self, name) not in known:
                choices = ", ".join(map(str, known))
                raise OptionError(f"{name} must be one of {choices}, not {getattr(self, name)!r}")
        # lists of numbers, as JSON has them
        for name in ("loop", "bridge"):
            object.__setattr__(self, name, _places(name, getattr(self, name)))
        require_merge(self.merge)
        _ = self.choice
        if self.what == "loops" and self.format not in (*OF_CURVES, None):
            raise OptionError(f"{self.format} files hold no curves; use format {' or '.join(OF_CURVES)} for loops")
        if self.edge_length != "auto":
            require_positive("edge_length", self.edge_length)
        require_positive("tolerance", self.tolerance)
        require_positive("time_limit", self.time_limit, finite=False)
        if not 0 <= self.closing < math.inf:
            raise OptionError(f"closing must be a number from 0 on, not {self.closing!r}")

    @property
    def choice(self) -> Choice:
        """Which loops of each mesh are filled."""
        return Choice(
            loop=self.loop,
            bridge=self.bridge,
            islands=self.islands,
            keep_largest=self.keep_largest,
            max_perimeter=self.max_perimeter,
        )


def _places(name: str, value: Any) -> Any:
    """Places of loops as a list of numbers; one place and names as they are."""
    if value is None or (isinstance(value, str) and value == "all"):
        return value
    try:
        several = isinstance(value, Iterable)
        return [operator.index(place) for place in value] if several else operator.index(value)
    except TypeError:
        raise OptionError(f"{name} must name places of loops, not {value!r}") from None


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What one file may cost."""

    seconds: float  # without a sign of life of the process that solves; 100 times as long as a whole
    memory: int  # of the process that solves, in bytes
    retries: int  # how often a file is tried again after its process died

    @property
    def whole_seconds(self) -> float:
        """For a file, however many loops it has."""
        return HARDEST_LOOPS * self.seconds
