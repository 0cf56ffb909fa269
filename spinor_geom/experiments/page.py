"""A report in Markdown as one page for a browser, its pictures inside."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from markdown_it import MarkdownIt
from markdown_it.token import Token

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
body {{ max-width: 70rem; margin: 2rem auto; padding: 0 1rem; font: 1rem/1.5 system-ui, sans-serif; color: #222; }}
h2 {{ margin-top: 3rem; border-top: 1px solid #ccc; padding-top: 1.5rem; }}
table {{ border-collapse: collapse; display: block; overflow-x: auto; font-size: 0.85rem; }}
th, td {{ border: 1px solid #ccc; padding: 0.2rem 0.6rem; text-align: left; white-space: nowrap; }}
th {{ background: #f2f2f2; }}
img {{ display: block; max-width: 100%; max-height: 40rem; margin: 1rem auto; }}
</style>
</head>
<body>
{body}</body>
</html>
"""


def page(markdown: str, folder: Path, *, title: str) -> str:
    """The page, which needs no other file.

    Args:
        markdown: the text; CommonMark with tables.
        folder: that the addresses of its pictures (PNG) start from.
        title: of the page.
    """
    converter = MarkdownIt("commonmark").enable("table")

    def embedded(_: Any, tokens: Sequence[Token], index: int, *__: Any) -> str:
        picture = folder / unquote(str(tokens[index].attrs["src"]))
        data = base64.b64encode(picture.read_bytes()).decode("ascii")
        return f'<img alt="{escape(tokens[index].content)}" src="data:image/png;base64,{data}">'

    converter.add_render_rule("image", embedded)
    return _PAGE.format(title=escape(title), body=converter.render(markdown))
