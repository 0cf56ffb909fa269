"""A report in Markdown as one page for a browser, its pictures inside."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from markdown_it import MarkdownIt
from markdown_it.token import Token

from spinor_geom.render.page import document, picture

_STYLE = "h2 { border-top: 1px solid var(--faint); padding-top: 1.5rem } img { display: block; max-height: 40rem }"


def page(markdown: str, folder: Path, *, title: str) -> str:
    """The page, which needs no other file.

    Args:
        markdown: the text; CommonMark with tables.
        folder: that the addresses of its pictures (PNG) start from.
        title: of the page.
    """
    converter = MarkdownIt("commonmark").enable("table")

    def embedded(_: Any, tokens: Sequence[Token], index: int, *__: Any) -> str:
        file = folder / unquote(str(tokens[index].attrs["src"]))
        return picture(file.read_bytes(), tokens[index].content)

    converter.add_render_rule("image", embedded)
    return document(title, [converter.render(markdown)], style=_STYLE)
