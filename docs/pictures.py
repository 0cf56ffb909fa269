"""Makes the README's pictures anew: `python docs/pictures.py`, from a clone, with the extra `dev` installed.

The first is what the README's first command leaves; the others are pictures of the site, made by the code on its pages.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import hooks
from PIL import Image

DOCS = Path(__file__).parent
FILL, ERROR, GALLERY = "demosthenes.png", "error.png", "gallery.png"
WIDTH = 1200
_ACROSS = 6
_COLOURS = 128


def gallery_strip(pictures: Sequence[Path]) -> Image.Image:
    """Pictures of one size, six in a row."""
    shown = [Image.open(picture).convert("RGB") for picture in pictures]
    width = WIDTH // _ACROSS
    height = width * shown[0].height // shown[0].width
    strip = Image.new("RGB", (WIDTH, height * -(-len(shown) // _ACROSS)), "white")
    for k, picture in enumerate(shown):
        place = (k % _ACROSS * width, k // _ACROSS * height)
        strip.paste(picture.resize((width, height), Image.Resampling.LANCZOS), place)
    return strip


def fill_picture(picture: Path) -> Image.Image:
    """The picture of a fill, as wide as the README."""
    image = Image.open(picture).convert("RGB")
    return image.resize((WIDTH, WIDTH * image.height // image.width), Image.Resampling.LANCZOS)


def main() -> None:
    """Writes all three."""
    from spinor_geom.cli.main import main as spinor_geom

    with hooks.workplace() as folder:
        spinor_geom(["fill", "data/demosthenes_low_res.obj", "-o", "out/filled.obj", "--picture", "out/picture.png"])
        _save(fill_picture(folder / "out/picture.png"), FILL)
    with hooks.workplace() as folder:
        hooks.run_blocks(DOCS / "plateau.md")
        shutil.copy(folder / "pictures" / ERROR, DOCS / ERROR)
    page = DOCS / "gallery.md"
    with hooks.workplace() as folder:
        hooks.run_blocks(page)
        _save(gallery_strip([folder / name for name in hooks.pictures_of(page)]), GALLERY)


def _save(picture: Image.Image, name: str) -> None:
    picture.quantize(_COLOURS, dither=Image.Dither.NONE).save(DOCS / name, optimize=True)


if __name__ == "__main__":
    sys.exit(main())
