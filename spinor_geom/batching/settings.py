"""Options of a batch and limits for each file. Importing takes little time. Processes that solve get them as JSON."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

from spinor_geom.errors import OptionError, require_positive
from spinor_geom.files import MESH_SUFFIXES
from spinor_geom.fill.fill_options import CLOSING, Choice, ContinuityName, PatchOptions, known_continuity, require_merge

What: TypeAlias = Literal["fill", "surface", "loops"]

WHAT: tuple[What, ...] = get_args(What)
FORMAT = (*(suffix[1:] for suffix in MESH_SUFFIXES), "npz")
CURVE_FORMATS = ("obj", "npz")


@dataclass(frozen=True, kw_only=True)
class BatchOptions(Choice, PatchOptions):
    """The options of `batch` that its results depend on. Raises OptionError."""

    what: What = "fill"
    format: str | None = None
    continuity: ContinuityName = "C0"
    merge: bool | float = False
    edge_length: float | Literal["auto"] = "auto"
    strict: bool = False
    closing: float = CLOSING
    compare: bool = False
    pictures: bool = False
    device: str | None = None

    def __post_init__(self) -> None:
        for name, known in (("what", WHAT), ("format", (*FORMAT, None))):
            if getattr(self, name) not in known:
                choices = ", ".join(map(str, known))
                raise OptionError(f"{name} must be one of {choices}, not {getattr(self, name)!r}")
        for name in ("loop", "bridge"):
            object.__setattr__(self, name, _as_json(name, getattr(self, name)))
        object.__setattr__(self, "continuity", known_continuity(self.continuity))
        Choice.__post_init__(self)
        PatchOptions.__post_init__(self)
        require_merge(self.merge)
        if self.what == "loops" and self.format not in (*CURVE_FORMATS, None):
            raise OptionError(f"{self.format} files cannot store curves; use {' or '.join(CURVE_FORMATS)} for loops")
        if self.what == "loops" and self.pictures:
            raise OptionError("pictures show filled meshes, and with what='loops' nothing is filled; leave them out")
        if self.edge_length != "auto":
            require_positive("edge_length", self.edge_length)
        if not 0 <= self.closing < math.inf:
            raise OptionError(f"closing must be a number of at least 0, not {self.closing!r}")


def _as_json(name: str, value: Any) -> Any:
    """One loop index as an int, several as a list of ints, bridges as lists of them, "all" and None unchanged."""
    if value is None or (isinstance(value, str) and value == "all"):
        return value
    try:
        is_one = isinstance(value, str) or not isinstance(value, Iterable)
        return operator.index(value) if is_one else [_as_json(name, part) for part in value]
    except TypeError:
        raise OptionError(f"{name} must be one or several loop indices, not {value!r}") from None


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of time, memory and retries for each file."""

    seconds: float  # between two reports of the process that solves
    memory: int  # of that process, in bytes
    retries: int  # how often a file is tried again after its process died
