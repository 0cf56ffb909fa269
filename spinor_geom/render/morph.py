"""The associate family of a surface as an animation or as a page with a slider."""

import html
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from spinor_geom.errors import OptionError, require
from spinor_geom.files import atomic_path, write_text
from spinor_geom.render.page import Views, document
from spinor_geom.render.png import drawn
from spinor_geom.render.portrait import surface_layers
from spinor_geom.render.scene import Scene
from spinor_geom.surface.array_surface import ArraySurface

SUFFIXES = (".gif", ".html", ".mp4")
FRAMES = 72
_PER_SECOND = 25
_WHITE = 240  # palette colours with all channels of at least this become white
_SIZE = (640, 640)  # MPEG-4 requires multiples of 16


def morph(surface: ArraySurface, path: str | os.PathLike[str], *, frames: int = FRAMES) -> None:
    """Shows the associate family r_θ = Re ∫ e^{iθ}φ dz of a surface.

    Its members are isometric and have the same normals at the same points. θ = 90° is the conjugate surface, θ = 180°
    the surface reflected in a point. An animation runs through all θ and repeats. A page has a slider for θ.

    Args:
        surface: over a domain around which ∮ φ dz = 0.
        path: `.gif`, `.mp4` or `.html` file, replaced as a whole.
        frames: number of pictures of an animation, at 25 per second.

    Raises:
        OptionError: the suffix is not supported, or `frames` is less than 1.
        PeriodError: the surface has no associate family on its domain.
        MissingPackageError: a package that draws or encodes animations is not installed.
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
    faces, *lines = surface_layers(surface, family=True)
    scene = Scene(layers=(replace(faces, fields={}), *lines))
    with atomic_path(target) as temporary, drawn([scene], size=_SIZE, angles=angles) as pictures:
        (_write_gif if suffix == ".gif" else _write_mp4)(pictures, temporary)


def checked_suffix(path: Path) -> str:
    """The suffix of a file for `morph`, in lower case, after checks of the format and of its packages."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise OptionError(f"{path}: unknown format of an animation; use one of {', '.join(SUFFIXES)}")
    if suffix != ".html":
        require("pyvista", extra="render")
    if suffix == ".mp4":
        require("imageio_ffmpeg", extra="video")
    return suffix


def family_page(surface: ArraySurface, *, title: str) -> str:
    """A page with the surface, coloured by Gauss curvature, and a slider for θ."""
    text = "Drag to turn, wheel to zoom; the slider sets the angle θ of the associate family."
    scene = Scene(title=text, layers=surface_layers(surface, family=True))
    views = Views()
    return document(title, [f"<h1>{html.escape(title)}</h1>", views.figure(scene), views.script()])


def _write_gif(pictures: Sequence[Path], path: Path) -> None:
    from PIL import Image

    frames = [Image.open(picture).convert("RGB") for picture in pictures]
    # one palette for all frames: the surface would flicker with one for each
    palette = frames[0].quantize()
    colours = np.reshape(palette.getpalette() or [], (-1, 3))
    colours[colours.min(axis=1) >= _WHITE] = 255  # palette colours are means: white would be grey
    palette.putpalette(colours.ravel().tolist())
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    first.save(path, save_all=True, append_images=others, duration=1000 // _PER_SECOND, loop=0, optimize=True)


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
