"""What one input of a batch may cost."""

from __future__ import annotations

from dataclasses import dataclass

from spinor_geom.isolate import FaultError

# A file with so many loops that take as long as they may is done to its end.
HARDEST_LOOPS = 100
ADVICE = {"time": "; raise the limit", "memory": "; raise the limit, or split the file"}


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What one file may cost.

    Attributes:
        seconds: for reading it, and for each of its loops; 100 times as long as a whole.
        memory: of the process that solves, in bytes.
        retries: how often a file is tried again after its process died.
    """

    seconds: float
    memory: int
    retries: int

    @property
    def whole_seconds(self) -> float:
        """For a file, however many loops it has."""
        return HARDEST_LOOPS * self.seconds


def fault_reason(fault: FaultError) -> str:
    """What ended a process, and what to do."""
    return f"{fault}{ADVICE.get(fault.kind, '')}"
