"""The steps of all tries over a loop, and the time that their stages take."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Literal

from spinor_geom.deadline import is_out_of_time

# Share of the distance from Γ at which a step with a new linearisation is the last one: what is gained slower is not
# worth its cost.
STALLED = 0.98
SPENT = "the limit on steps or on time was reached"  # why a surface comes no nearer to Γ, as the end of a sentence

Method = Literal["Newton", "Gauss-Newton", "Douglas-Newton", "distillation", "polishing", "RMSprop"]


@dataclass(frozen=True, kw_only=True)
class Iteration:
    """One step of a solver.

    Attributes:
        index: from 1.
        method: of the step.
        residual: what the steps bring towards 0: Newton's RMS distance from the loop's points, in diagonals;
            Gauss-Newton's RMS distance from Γ at the nodes after it, in units of the loop's diagonal; Douglas-Newton's
            RMS gradient of the energy before it, relative to its two factors. In the training of a network: the RMS
            error of p and q ("distillation"), the RMS distance from Γ in diagonals ("polishing"), an epoch's mean loss
            ("RMSprop").
    """

    index: int
    method: Method
    residual: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """Steps in their order, and who hears of them."""

    limit: int  # on their number
    on_iteration: Callable[[Iteration], None] | None = None  # is called with each
    history: list[Iteration] = field(default_factory=list)  # those so far

    def take(self, method: Method, residual: float) -> None:
        """Takes down the next step and tells it; see `Iteration`."""
        step = Iteration(index=len(self.history) + 1, method=method, residual=residual)
        self.history.append(step)
        if self.on_iteration is not None:
            self.on_iteration(step)

    def copied(self) -> Steps:
        """As many more steps after those so far, which further ones of the other do not join."""
        return replace(self, history=[*self.history])

    @property
    def left(self) -> int:
        """How many more may be taken."""
        return max(0, self.limit - len(self.history))

    @property
    def are_spent(self) -> bool:
        """Whether steps or time are used up."""
        return not self.left or is_out_of_time()


class Clock:
    """Wall time of named stages; a stage that comes again adds up."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Counts the time of a `with` block for a stage, without that of other stages inside it."""
        start, others = time.perf_counter(), sum(self.seconds.values())
        try:
            yield
        finally:
            inside = sum(self.seconds.values()) - others
            self.add(name, time.perf_counter() - start - inside)

    def copied(self) -> Clock:
        """One that goes on from here by itself."""
        clock = Clock()
        clock.seconds.update(self.seconds)
        return clock

    def add(self, name: str, seconds: float) -> None:
        """Counts time that was measured elsewhere."""
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds
