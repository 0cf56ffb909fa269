"""Pictures and pages of the filled meshes of a batch."""

from __future__ import annotations

from functools import partial
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.store import RESULTS, Writer
from spinor_geom.errors import SpinorGeomError
from spinor_geom.files import up_axis, write_text

if TYPE_CHECKING:
    from spinor_geom.fill.fill_result import FillResult

PICTURE, PAGE, PROGRAM = "picture.png", "page.html", "viewer.js"  # the last one is shared by all pages
SIZE = (320, 240)
TIME_LIMIT = 50.0  # seconds for a picture, less than a worker may be silent


class MeshPictures:
    """Draws filled meshes one after the other, in a process that starts with the first."""

    def __init__(self) -> None:
        self._painter: Any = None

    def add(self, result: FillResult, source: Source, record: dict[str, Any], files: dict[str, Writer]) -> None:
        """Adds the page and the picture to a record and its files, or the reason why there is no picture."""
        # these imports take longer than a small file
        from spinor_geom.render.fill_scene import whole_scene
        from spinor_geom.render.png import Painter
        from spinor_geom.render.report import small_report

        name = source.member or source.path
        up, parts = up_axis(name), PurePosixPath(RESULTS, source.key).parts
        text = small_report(result, name=Path(name).name, up=up, program="../" * len(parts) + PROGRAM)
        record["page"], files[PAGE] = PAGE, partial(write_text, text=text)
        self._painter = self._painter or Painter()
        scene = whole_scene(result, up, aspect=SIZE[0] / SIZE[1])
        try:
            picture = self._painter.drawn_png([scene], size=SIZE, time_limit=TIME_LIMIT)
        except SpinorGeomError as error:
            record["notes"].append(str(error))
        else:
            record["picture"], files[PICTURE] = PICTURE, partial(Path.write_bytes, data=picture)
