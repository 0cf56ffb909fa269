"""The one way to write a page for a browser: one file that needs nothing from elsewhere, in light and in dark."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Container, Sequence
from typing import Any

_LONG = 60  # letters, from which on the text of a cell is broken into lines

STYLE = """:root { color-scheme: light dark; --paper: #fff; --ink: #222; --faint: #ddd; --alert: #fdecea;
--link: #1f5fa8 }
@media (prefers-color-scheme: dark) { :root { --paper: #16181c; --ink: #e4e4e2; --faint: #3a3d43; --alert: #48201d;
--link: #8fbdf0 } }
body { font: 15px/1.45 system-ui, sans-serif; max-width: 76rem; margin: 2rem auto; padding: 0 1rem; color: var(--ink);
background: var(--paper) }
a { color: var(--link) } h2 { margin-top: 2.5rem }
table { border-collapse: collapse; margin: 1rem 0; font-size: 13px; display: block; overflow-x: auto }
th, td { padding: .2rem .6rem; border-bottom: 1px solid var(--faint); text-align: left; white-space: nowrap;
vertical-align: top }
td.long { white-space: normal; min-width: 22rem } tr.missed td { background: var(--alert) }
figure { display: inline-block; margin: .5rem; vertical-align: top } img { max-width: 100% }
figcaption { font-size: 13px; max-width: 560px }"""


def document(title: str, body: Sequence[str], *, style: str = "") -> str:
    """A whole page.

    Args:
        title: of the page.
        body: pieces of HTML.
        style: CSS of this page, after that of all pages.
    """
    return "\n".join(
        [
            "<!doctype html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>',
            f'<meta name="viewport" content="width=device-width"><style>{STYLE}\n{style}</style></head><body>',
            *body,
            "</body></html>",
            "",
        ]
    )


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, marked: Container[int] = ()) -> str:
    """A table of plain text.

    Args:
        columns: the headers.
        rows: one text per column.
        marked: rows that miss what was asked for.
    """
    head = "".join(f'<th scope="col">{html.escape(column)}</th>' for column in columns)
    lines = (
        f"<tr{' class=missed' * (k in marked)}>"
        + "".join(f"<td{' class=long' * (len(text) > _LONG)}>{html.escape(text)}</td>" for text in row)
        + "</tr>"
        for k, row in enumerate(rows)
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def cell(value: Any, digits: int = 4) -> str:
    """The text of a figure in a table, nothing for what there is not."""
    if value is None or isinstance(value, bool):
        return {None: "", True: "yes", False: "no"}[value]
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.{digits}g}"
    return str(value)


def markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The same table in markdown, one text per column."""
    lines = [[text.replace("|", "\\|") for text in line] for line in (columns, ["---"] * len(columns), *rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def picture(data: bytes, alt: str) -> str:
    """A PNG inside the page."""
    return f'<img alt="{html.escape(alt)}" src="data:image/png;base64,{base64.b64encode(data).decode()}">'
