"""What is promised beside what was measured, in one form for all suites."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, Literal

Kind = Literal["accuracy", "time"]


@dataclass(frozen=True)
class Figure:
    """A promise and what became of it; "accuracy" holds on any machine, "time" is told and never checked."""

    suite: str
    case: str
    text: str
    measured: str
    met: bool
    kind: Kind = "accuracy"


@dataclass(frozen=True)
class Limit:
    """The most that a field of a record may be, or what it has to be equal to; the name is for readers."""

    field: str
    name: str
    value: float | str | bool
    kind: Kind = "accuracy"

    def of(self, record: Mapping[str, Any]) -> Figure:
        """The figure of a record; what was not measured, or is not a number, misses it."""
        exact = isinstance(self.value, str | bool)
        text = self.name if self.value is True else f"{self.name}: {self.value}"
        found = record.get(self.field) if record["status"] == "done" else record["status"]
        if exact or found is None or isinstance(found, str):
            met, measured = found == self.value, {True: "yes", False: "no", None: "not measured"}.get(found, str(found))
        else:
            met, measured = bool(found <= self.value), f"{found:.3g}"
        text = text if exact else f"{self.name} at most {self.value:g}"
        return Figure(record["suite"], record["case"], text, measured, met, self.kind)


def at_most(
    suite: str, case: str, text: str, values: Sequence[float], limit: float, kind: Kind = "accuracy"
) -> Iterator[Figure]:
    """A limit that all values have to keep; nothing where there is none."""
    if values:
        measured = f"{max(values):.3g}" + (f" at most, {median(values):.3g} in the median" if len(values) > 1 else "")
        yield Figure(suite, case, f"{text} at most {limit:.3g}", measured, max(values) <= limit, kind)


def share(suite: str, case: str, text: str, met: Sequence[bool], least: float = 1.0) -> Iterator[Figure]:
    """What has to be so of a share of things, or of all; nothing where there is none."""
    if met:
        text += "" if least == 1 else f", at least {least:.0%}"
        yield Figure(suite, case, text, f"{sum(met)} of {len(met)}", sum(met) >= least * len(met))
