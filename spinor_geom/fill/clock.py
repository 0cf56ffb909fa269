"""Seconds by stage."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter


class Clock:
    """A stop watch with named laps."""

    def __init__(self) -> None:
        """Starts it."""
        self._start = self._last = perf_counter()
        self._laps: dict[str, float] = {}

    def lap(self, name: str) -> None:
        """Ends the lap that has run since the last call, under a name."""
        now = perf_counter()
        self._laps[name] = now - self._last
        self._last = now

    def laps(self) -> Mapping[str, float]:
        """Seconds by name, and "total" from the start to the end of the last lap."""
        return {**self._laps, "total": self._last - self._start}
