"""Hooks of the site's build: pictures from the code of the pages, and formulas as MathML.

The Python blocks of every page that shows `pictures/NAME.png` run one after the other in an empty folder and write the
pictures there.
"""

from __future__ import annotations

import contextlib
import html
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File
from sybil import Sybil
from sybil.parsers.markdown import PythonCodeBlockParser

ROOT = Path(__file__).parents[1]
_PICTURE = re.compile(r"\]\((pictures/[\w.-]+\.png)\)")
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
# one white pixel, for builds that only check pages
_EMPTY = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c49444154789c63f8ffff3f0005fe02fe0def46b8"
    "0000000049454e44ae426082"
)


def pictures_of(page: Path) -> list[str]:
    """The pictures of a page that its code writes."""
    return _PICTURE.findall(page.read_text(encoding="utf-8"))


def run_blocks(page: Path) -> None:
    """Runs the Python blocks of a page in order, in the working directory."""
    document = Sybil(parsers=[PythonCodeBlockParser()]).parse(page)
    document.namespace["__name__"] = "__main__"
    for example in document.examples():
        example.evaluate()


@contextlib.contextmanager
def workplace() -> Iterator[Path]:
    """A temporary working directory with `data/`, `pictures/` and `out/`, as the code of the pages expects."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(ROOT / "data", folder / "data")  # some systems restrict links
        (folder / "pictures").mkdir()
        (folder / "out").mkdir()
        os.chdir(folder)
        try:
            yield folder
        finally:
            os.chdir(before)


def on_files(files: Any, config: Any) -> Any:
    """Adds the pictures to the site. With SPINOR_GEOM_PICTURES=none they are empty and no code runs."""
    target = Path(tempfile.mkdtemp())
    config.extra["made_pictures"] = str(target)
    (target / "pictures").mkdir()
    for page in sorted(Path(config.docs_dir).glob("*.md")):
        names = pictures_of(page)
        if not names:
            continue
        with workplace() as folder:
            if os.environ.get("SPINOR_GEOM_PICTURES") == "none":
                for name in names:
                    (folder / name).write_bytes(_EMPTY)
            else:
                run_blocks(page)
            for name in names:
                shutil.copy(folder / name, target / name)
                files.append(File(name, str(target), config.site_dir, use_directory_urls=False))
    return files


def on_page_content(content: str, **_: Any) -> str:
    """Converts the formulas to MathML."""
    return _FORMULA.sub(_mathml, content)


def on_post_build(config: Any) -> None:
    """Removes the temporary folder of the pictures."""
    shutil.rmtree(config.extra["made_pictures"])


def _mathml(match: re.Match[str]) -> str:
    return convert(html.unescape(match[2]), display="block" if match[1] == "div" else "inline")
