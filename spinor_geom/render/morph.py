"""A surface turned through its associate family: an animation, or a page with a slider."""

import html
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spinor_geom.errors import OptionError, require
from spinor_geom.files import atomic_path, write_text
from spinor_geom.render.layers import Scale
from spinor_geom.render.page import Scene, Views, document
from spinor_geom.render.portrait import GAUSS, Portrait, associate_family
from spinor_geom.surface import SpinorSurface

SUFFIXES = (".gif", ".html", ".mp4")
FRAMES = 72
_PER_SECOND = 25
_SIZE = (640, 640)  # MPEG-4 wants multiples of 16
_COLOURS, _PAPER = 256, 240


def morph(surface: SpinorSurface, path: str | os.PathLike[str], *, frames: int = FRAMES) -> None:
    """Turns a surface through its associate family and writes what is seen.

    The members r_θ = Re ∫ e^{iθ}φ dz are isometric and have the same normals at the same points; θ = 90° is the
    conjugate surface, 180° the surface reflected in a point. An animation makes a whole turn and begins again; a page
    has a slider for θ.

    Args:
        surface: over a domain around which ∮ φ dz = 0.
        path: `.gif`, `.mp4` or `.html`, by the suffix; replaced as a whole.
        frames: pictures of an animation, at 25 a second.

    Raises:
        OptionError: another suffix, or no frame.
        PeriodError: the surface has no associate family on its domain.
        MissingPackageError: what draws or encodes an animation is not installed.
        RenderError: the drawing failed.
    """
    target = Path(path)
    suffix = checked_suffix(target)
    if frames < 1:
        raise OptionError(f"an animation needs at least one frame, got {frames}")
    if suffix == ".html":
        write_text(target, family_page(surface, title=f"associate family of {target.stem}"))
        return
    angles = (2 * np.pi * np.arange(frames) / frames).tolist()
    with atomic_path(target) as temporary, Portrait.of(surface).frames(angles, size=_SIZE) as pictures:
        (_write_gif if suffix == ".gif" else _write_mp4)(pictures, temporary)


def checked_suffix(path: Path) -> str:
    """The suffix of a file for a morph, in small letters, if there is such a format and what it takes is installed."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise OptionError(f"{path}: the format of a morph is told by its suffix, one of {', '.join(SUFFIXES)}")
    if suffix != ".html":
        require("pyvista", extra="render")
    if suffix == ".mp4":
        require("imageio_ffmpeg", extra="video")
    return suffix


def family_page(surface: SpinorSurface, *, title: str) -> str:
    """A page: the surface to turn, and a slider for θ; colours tell the Gauss curvature, which stays."""
    layers = associate_family(surface)
    view = Scene(
        title="Drag to turn, wheel to zoom, double click to set it spinning; the slider turns θ.",
        layers=layers,
        scales={GAUSS: Scale.of(layers[0].fields[GAUSS])},
        spins=True,
        shape="wide",
    )
    views = Views()
    return document(title, [f"<h1>{html.escape(title)}</h1>", views.figure(view), views.script()])


def _write_gif(pictures: Sequence[Path], path: Path) -> None:
    from PIL import Image

    frames = [Image.open(picture).convert("RGB") for picture in pictures]
    # one table of colours for all frames: a surface would flicker with one for each
    some = frames[:: -(-len(frames) // 8)]
    beside = Image.new("RGB", (_SIZE[0] * len(some), _SIZE[1]))
    for place, frame in enumerate(some):
        beside.paste(frame, (place * _SIZE[0], 0))
    table = beside.quantize(_COLOURS)
    # each is the middle of several, and those almost white would be taken for the white paper
    rows: list[list[int]] = np.reshape(table.getpalette() or [], (-1, 3)).tolist()
    table.putpalette([x for row in rows for x in (row if min(row) < _PAPER else [255, 255, 255])])
    few = [frame.quantize(palette=table, dither=Image.Dither.NONE) for frame in frames]
    few[0].save(path, save_all=True, append_images=few[1:], duration=1000 // _PER_SECOND, loop=0, optimize=True)


def _write_mp4(pictures: Sequence[Path], path: Path) -> None:
    import imageio_ffmpeg
    from PIL import Image

    writer = imageio_ffmpeg.write_frames(str(path), _SIZE, fps=_PER_SECOND, quality=8, macro_block_size=16)
    writer.send(None)
    try:
        for picture in pictures:
            writer.send(np.asarray(Image.open(picture).convert("RGB")).tobytes())
    finally:
        writer.close()
