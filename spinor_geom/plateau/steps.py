"""The steps of a solve, and the time of its stages."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

from spinor_geom.deadline import is_out_of_time

# A solve ends if a step with a new Jacobian leaves more than this share of the distance. With 0.5 six of
# sixty solves through points end too early.
STALLED = 0.98
SPENT = "the limit on steps or on time was reached"  # a reason, as the end of a sentence

Method = Literal["Newton", "Gauss-Newton", "Douglas-Newton", "distillation", "polishing", "RMSprop"]


@dataclass(frozen=True, kw_only=True)
class Iteration:
    """One step of a solver.

    Attributes:
        index: number of the step, from 1.
        method: the solver.
        residual: the quantity that the solver reduces. "Newton": RMS distance from the loop's points, in diagonals.
            "Gauss-Newton": RMS distance from Γ at the nodes after the step, in diagonals. "Douglas-Newton": relative
            RMS gradient of the energy before the step. "distillation": RMS error of p and q. "polishing": RMS distance
            from Γ, in diagonals. "RMSprop": mean loss of an epoch.
    """

    index: int
    method: Method
    residual: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """The steps so far, and their limit."""

    limit: int  # largest number of steps
    on_iteration: Callable[[Iteration], None] | None = None  # called with each step
    history: list[Iteration] = field(default_factory=list)

    def take(self, method: Method, residual: float) -> None:
        """Records a step (see `Iteration`)."""
        step = Iteration(index=len(self.history) + 1, method=method, residual=residual)
        self.history.append(step)
        if self.on_iteration is not None:
            self.on_iteration(step)

    def copied(self) -> Steps:
        """A copy with a history of its own."""
        return replace(self, history=[*self.history])

    @property
    def left(self) -> int:
        """Number of steps left."""
        return max(0, self.limit - len(self.history))

    @property
    def are_spent(self) -> bool:
        """Whether no steps or no time are left."""
        return not self.left or is_out_of_time()


class Clock:
    """Wall time of named stages, added up, in `seconds`."""

    def __init__(self, before: Mapping[str, float] = MappingProxyType({})) -> None:
        """Starts with the seconds `before`."""
        self.seconds, self._last = dict(before), time.perf_counter()

    def lap(self, name: str) -> None:
        """Adds the time since the last call to a stage."""
        now = time.perf_counter()
        self.add(name, now - self._last)
        self._last = now

    @property
    def with_total(self) -> dict[str, float]:
        """Seconds by stage, and their "total"."""
        return {**self.seconds, "total": sum(self.seconds.values())}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time of a `with` block to a stage, without the time of stages inside it."""
        start, others = time.perf_counter(), sum(self.seconds.values())
        try:
            yield
        finally:
            inside = sum(self.seconds.values()) - others
            self.add(name, time.perf_counter() - start - inside)

    def copied(self) -> Clock:
        """A copy."""
        return Clock(self.seconds)

    def add(self, name: str, seconds: float) -> None:
        """Adds time to a stage."""
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds
