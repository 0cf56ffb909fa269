"""Writes the pictures of the pages and the README: `python docs/pictures.py`, in a clone with the extra `dev`.

The Python blocks of every page that shows `pictures/NAME.png` run one after the other and write the pictures. Of the
README's, one shows a film and a smooth continuation, the other the pictures of the gallery page.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image
from sybil import Sybil
from sybil.parsers.markdown import PythonCodeBlockParser

DOCS = Path(__file__).parent
CONTINUATION, GALLERY = "continuation.png", "gallery.png"
WIDTH = 1200
# the crown above this height is cut off; direction, radius and offset of the view
_CROWN, _EYE, _RADIUS, _BELOW = 1.93, np.array([-0.75, 0.35, 0.45]), 0.85, 0.28
_TITLES = 0.05  # share of a drawing's height
_ACROSS = 6
_COLOURS = 256
_PICTURE = re.compile(r"\]\((pictures/[\w.-]+\.png)\)")


def pictures_of(page: Path) -> list[str]:
    """The pictures of a page that its code writes."""
    return _PICTURE.findall(page.read_text(encoding="utf-8"))


@contextlib.contextmanager
def workplace() -> Iterator[Path]:
    """A temporary working directory with `data/`, `pictures/` and `out/`."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(DOCS.parent / "data", folder / "data")  # some systems restrict links
        (folder / "pictures").mkdir()
        (folder / "out").mkdir()
        os.chdir(folder)
        try:
            yield folder
        finally:
            os.chdir(before)


def gallery_strip(pictures: Sequence[Path]) -> Image.Image:
    """Pictures of equal size in rows of six."""
    shown = [Image.open(picture).convert("RGB") for picture in pictures]
    width = WIDTH // _ACROSS
    height = width * shown[0].height // shown[0].width
    strip = Image.new("RGB", (WIDTH, height * -(-len(shown) // _ACROSS)), "white")
    for k, picture in enumerate(shown):
        place = (k % _ACROSS * width, k // _ACROSS * height)
        strip.paste(picture.resize((width, height), Image.Resampling.LANCZOS), place)
    return strip


def continuation_picture(folder: Path) -> Image.Image:
    """A head without its crown: open, under a film, and smoothly continued."""
    import spinor_geom
    from spinor_geom.render.camera import Camera
    from spinor_geom.render.fill_scene import fill_scene
    from spinor_geom.render.png import write_png

    bust = spinor_geom.read_mesh(folder / "data/demosthenes_low_res.obj").mesh
    is_kept = bust.vertices[bust.faces][:, :, 1].min(axis=1) < _CROWN
    direction = _EYE / np.linalg.norm(_EYE)
    up = np.array([0.0, 1.0, 0.0]) - direction[1] * direction
    drawn = []
    for continuity in ("C0", "C1"):
        _, report = spinor_geom.fill_hole(
            (bust.vertices, bust.faces[is_kept]), 0, continuity=continuity, return_report=True
        )
        focus = report.loops[0].loop.centroid - np.array([0.0, _BELOW, 0.0])
        camera = Camera(focus=focus, direction=direction, up=up / np.linalg.norm(up), radius=_RADIUS)
        write_png([replace(view, camera=camera) for view in fill_scene(report)], folder / "drawn.png")
        drawn.append(Image.open(folder / "drawn.png").convert("RGB"))
    width, height = drawn[0].size
    top = int(_TITLES * height)
    parts = [drawn[0].crop((0, top, width, height)), drawn[1].crop((width // 2, top, width, height))]
    whole = Image.new("RGB", (width * 3 // 2, height - top), "white")
    for part, left in zip(parts, (0, width), strict=True):
        whole.paste(part, (left, 0))
    return whole.resize((WIDTH, WIDTH * whole.height // whole.width), Image.Resampling.LANCZOS)


def main() -> None:
    """Writes all pictures."""
    with workplace() as folder:
        _save(continuation_picture(folder), CONTINUATION)
    for page in sorted(DOCS.glob("*.md")):
        if names := pictures_of(page):
            with workplace() as folder:
                document = Sybil(parsers=[PythonCodeBlockParser()]).parse(page)
                document.namespace["__name__"] = "__main__"
                for example in document.examples():
                    example.evaluate()
                for name in names:
                    _save(Image.open(folder / name).convert("RGB"), name)
    _save(gallery_strip([DOCS / name for name in pictures_of(DOCS / "gallery.md")]), GALLERY)


def _save(picture: Image.Image, name: str) -> None:
    picture.quantize(_COLOURS, dither=Image.Dither.NONE).save(DOCS / name, optimize=True)


if __name__ == "__main__":
    sys.exit(main())
