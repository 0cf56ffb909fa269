"""Measured figures beside their targets, as markdown tables, and the place of those tables in a README."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import sys
from collections.abc import Iterable
from dataclasses import dataclass

import torch

BEGIN, END = "<!-- figures: begin (written by figures.py) -->", "<!-- figures: end -->"
PACKAGES = (
    "spinor-geom",
    "numpy",
    "scipy",
    "torch",
    "libigl",
    "pythoncdt",
    "trimesh",
    "pymeshlab",
    "meshlib",
    "pymeshfix",
)
REASON_LENGTH = 110


@dataclass(frozen=True, kw_only=True)
class Table:
    """A markdown table.

    Attributes:
        title: Its heading.
        columns: Names of the columns.
        rows: Cells, as many in a row as there are columns.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def __str__(self) -> str:
        """The heading and the table."""
        lines = [self.columns, ("---",) * len(self.columns), *self.rows]
        cells = [[cell.replace("|", "\\|") for cell in line] for line in lines]
        return "\n".join([f"### {self.title}", "", *(f"| {' | '.join(line)} |" for line in cells)])


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


def machine() -> str:
    """What the figures were measured with: cores, system, versions."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    busy = f", load {os.getloadavg()[0]:.1f} before the run" if hasattr(os, "getloadavg") else ""
    versions = ", ".join(f"{name} {_version(name)}" for name in PACKAGES)
    return (
        f"{cores} cores ({platform.machine()}, {platform.system()}), {torch.get_num_threads()} torch threads{busy}; "
        f"Python {platform.python_version()}, {versions}."
    )


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def replaced_section(text: str, section: str, *, begin: str = BEGIN, end: str = END) -> str:
    """A text with what stands between the two marker comments replaced.

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
