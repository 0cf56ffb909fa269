"""Hooks of the site's build: docstrings in the reference, and formulas as MathML."""

from __future__ import annotations

import html
import re
from typing import Any

from latex2mathml.converter import convert

_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)

# a name of the reference, with a link to its source, and the first sentence of its docstring
_NAME = re.compile(r"^### \[(\w+)\]\(\.\./(spinor_geom/[\w/]+)\.py\)\n\n.+$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replaces the names of the reference by their docstrings."""
    return _NAME.sub(lambda match: f"::: {match[2].replace('/', '.')}.{match[1]}", markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Converts the formulas to MathML."""
    return _FORMULA.sub(_mathml, content)


def _mathml(match: re.Match[str]) -> str:
    return convert(html.unescape(match[2]), display="block" if match[1] == "div" else "inline")
