"""Tables of text, for Markdown, pages and terminals."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spinor_geom.render import page


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of text; cells may be bold, with Markdown's `**` around them."""

    title: str = ""  # The heading; none if empty
    columns: Sequence[str]  # The column names
    rows: Sequence[Sequence[str]]  # One text for each column
    note: str = ""  # A paragraph below the heading
    marked: frozenset[int] = frozenset()  # Indices of rows that a page shows in red

    @classmethod
    def of_records(cls, records: Sequence[Mapping[str, Any]]) -> Table:
        """One row for each record, one column for each name that any of them has."""
        columns = list(dict.fromkeys(name for record in records for name in record))
        return cls(columns=columns, rows=[[page.cell(record.get(name)) for name in columns] for record in records])

    @property
    def plain_rows(self) -> list[list[str]]:
        """The rows without `**`."""
        return [[text.strip("*") for text in row] for row in self.rows]

    def markdown(self) -> str:
        """The table in Markdown."""
        lines = [
            [text.replace("|", "\\|") for text in line]
            for line in (self.columns, ["---"] * len(self.columns), *self.rows)
        ]
        table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
        return "\n\n".join(filter(None, [self.title and f"### {self.title}", self.note, table]))

    def html(self) -> str:
        """The table as a part of a page."""
        heading = f"<h3>{html.escape(self.title)}</h3>" if self.title else ""
        note = f"<p>{html.escape(self.note)}</p>" if self.note else ""
        return f"{heading}{note}{page.table(self.columns, self.plain_rows, marked=self.marked)}"
