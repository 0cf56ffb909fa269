"""Measured figures beside their targets, as markdown tables, and the place of those tables in a README."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass

from spinor_geom.bench.tables import Table

BEGIN, END = "<!-- figures: begin (written by figures.py) -->", "<!-- figures: end -->"
BENCH_BEGIN, BENCH_END = "<!-- bench: begin (written by figures.py --bench) -->", "<!-- bench: end -->"
CUT_OUTS_BEGIN, CUT_OUTS_END = "<!-- cut-outs: begin (written by figures.py --cut-outs) -->", "<!-- cut-outs: end -->"
REASON_LENGTH = 110


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One measured figure.

    Attributes:
        case: What it was measured on.
        name: What was measured.
        measured: Its value.
        target: What the value has to be; empty where nothing is promised.
        met: Whether it is; None where nothing is promised.
    """

    case: str
    name: str
    measured: str
    target: str = ""
    met: bool | None = None

    @classmethod
    def at_most(cls, case: str, name: str, value: float, limit: float) -> Figure:
        """A value with an upper limit; a value that is not a number misses it."""
        # seconds and shares are around 1, errors far below
        measured = f"{value:.3g}" if limit > 0.02 else f"{value:.1e}"
        return cls(case=case, name=name, measured=measured, target=f"≤ {limit:g}", met=bool(value <= limit))

    @classmethod
    def at_least(cls, case: str, name: str, value: float, limit: float) -> Figure:
        """A value with a lower limit; a value that is not a number misses it."""
        return cls(case=case, name=name, measured=f"{value:.2f}", target=f"≥ {limit:g}", met=bool(value >= limit))


def figure_table(title: str, figures: Iterable[Figure]) -> Table:
    """Figures as a table of one row each."""
    words = {None: "", True: "met", False: "**missed**"}
    rows = tuple((f.case, f.name, f.target, f.measured, words[f.met]) for f in figures)
    return Table(title=title, columns=("case", "figure", "target", "measured", "verdict"), rows=rows)


def short_reason(text: str) -> str:
    """The part of a reason that says what is wrong, without the advice and, where it is long, the explanation."""
    text = text.split("; ")[0]
    if len(text) > REASON_LENGTH:
        text = text.split(": ")[0]
    return text if len(text) <= REASON_LENGTH else text[: REASON_LENGTH - 1].rstrip() + "…"


def replaced_section(text: str, section: str, *, begin: str = BEGIN, end: str = END) -> str:
    """A text with what stands between two marker comments replaced.

    Raises:
        ValueError: the markers are not there, each once and in order.
    """
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise ValueError(f"the text needs the lines {begin!r} and {end!r} once each, in this order")
    before, after = text.split(begin)[0], text.split(end)[1]
    return f"{before}{begin}\n\n{section.strip()}\n\n{end}{after}"


def note(text: str) -> None:
    """Shows progress, on standard error."""
    print(text, file=sys.stderr, flush=True)
