"""What every file of a batch is treated with, and what it may cost; cheap to import, JSON on its way to others."""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from spinor_geom.errors import OptionError, require_positive
from spinor_geom.fill.options import CONTINUITY, Continuity

What: TypeAlias = Literal["fill", "surface", "loops"]
Format: TypeAlias = Literal["obj", "ply", "glb", "npz"]

WHAT: tuple[What, ...] = get_args(What)
FORMAT: tuple[Format, ...] = get_args(Format)
OF_CURVES = ("obj", "npz")
HARDEST_LOOPS = 100  # a file with so many loops that take as long as they may is done to its end


@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """What the results depend on: options of `batch`, which says what they mean; raises OptionError."""

    what: What = "fill"
    format: Format = "obj"
    edge_length: float | Literal["auto"] = "auto"
    tolerance: float = 1e-3
    continuity: Continuity = "C0"
    closing: float = 1e-3
    compare: bool = False
    device: str = "cpu"

    def __post_init__(self) -> None:
        for name, known in (("what", WHAT), ("format", FORMAT), ("continuity", CONTINUITY)):
            if getattr(self, name) not in known:
                raise OptionError(f"{name} must be one of {', '.join(known)}, not {getattr(self, name)!r}")
        if self.what == "loops" and self.format not in OF_CURVES:
            raise OptionError(f"{self.format} files hold no curves; use format {' or '.join(OF_CURVES)} for loops")
        if self.edge_length != "auto":
            require_positive("edge_length", self.edge_length)
        require_positive("tolerance", self.tolerance)
        if not 0 <= self.closing < math.inf:
            raise OptionError(f"closing must be a number from 0 on, not {self.closing!r}")


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What one file may cost."""

    seconds: float  # for reading it, and for each of its loops; 100 times as long as a whole
    memory: int  # of the process that solves, in bytes
    retries: int  # how often a file is tried again after its process died

    @property
    def whole_seconds(self) -> float:
        """For a file, however many loops it has."""
        return HARDEST_LOOPS * self.seconds
