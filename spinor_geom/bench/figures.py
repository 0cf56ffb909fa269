"""What is promised beside what was measured, in one form for all suites."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

Kind = Literal["accuracy", "time"]


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A promise and what became of it.

    Attributes:
        suite: of the records that it was judged by.
        case: on which.
        text: the promise.
        measured: what was measured.
        met: whether it is kept.
        kind: "accuracy" holds on any machine; "time" is told and never checked.
    """

    suite: str
    case: str
    text: str
    measured: str
    met: bool
    kind: Kind = "accuracy"


@dataclass(frozen=True)
class Limit:
    """What a field of a record has to be.

    Attributes:
        field: its name.
        name: of the field, for readers.
        value: the most that it may be, or what it has to be equal to.
        kind: as of a `Figure`.
    """

    field: str
    name: str
    value: float | str | bool
    kind: Kind = "accuracy"

    @property
    def text(self) -> str:
        """The promise."""
        if isinstance(self.value, str | bool):
            return self.name if self.value is True else f"{self.name}: {self.value}"
        return f"{self.name} at most {self.value:g}"

    def of(self, record: Mapping[str, Any]) -> Figure:
        """The figure of a record; what was not measured, or is not a number, misses it."""
        found = record.get(self.field) if record["status"] == "done" else record["status"]
        if isinstance(self.value, str | bool) or found is None or isinstance(found, str):
            met, measured = found == self.value, {True: "yes", False: "no", None: "not measured"}.get(found, str(found))
        else:
            met = bool(found <= self.value)
            measured = f"{found:.3g}"
        return Figure(
            suite=record["suite"], case=record["case"], text=self.text, measured=measured, met=met, kind=self.kind
        )
