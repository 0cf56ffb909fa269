"""Seconds by stage."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from time import perf_counter


class Clock:
    """A stop watch with named laps."""

    def __init__(self, before: Mapping[str, float] | None = None) -> None:
        """Starts it, with the laps that were run before."""
        self._last = perf_counter()
        self._laps = defaultdict(float, before or {})

    def lap(self, name: str) -> None:
        """Ends the lap that has run since the last call, under a name."""
        now = perf_counter()
        self._laps[name] += now - self._last
        self._last = now

    def laps(self) -> Mapping[str, float]:
        """Seconds by name, and "total" of all laps."""
        return {**self._laps, "total": sum(self._laps.values())}
