"""Draws scenes as PNGs, without a display."""

from __future__ import annotations

import os
import pickle
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from spinor_geom.errors import RenderError
from spinor_geom.files import atomic_path
from spinor_geom.isolate import FaultError, Process
from spinor_geom.optional import require
from spinor_geom.render.layers import View

WIDTH, HEIGHT = 1600, 800
TIME_LIMIT = 300.0  # seconds; software rendering of a million triangles takes a few
TIME_OF_FRAME = 5.0  # seconds that each frame may take besides
DRAWING, WINDOW = "spinor_geom.render.draw", "VTK_DEFAULT_OPENGL_WINDOW"  # a module, and a variable of what it uses


def write_png(views: Sequence[View], path: str | os.PathLike[str]) -> None:
    """Draws views off-screen, side by side, as `drawn`; the file is replaced as a whole."""
    with drawn(views, size=(WIDTH, HEIGHT)) as (picture,), atomic_path(path) as target:
        shutil.copyfile(picture, target)


@contextmanager
def drawn(views: Sequence[View], *, size: tuple[int, int], angles: Sequence[float] = (0.0,)) -> Iterator[list[Path]]:
    """Draws views side by side: a PNG for each angle of the associate family; they go with the block.

    Raises:
        MissingPackageError: pyvista is not installed.
        RenderError: the drawing failed.
    """
    require("pyvista", extra="render")
    with tempfile.TemporaryDirectory() as folder:
        draw_apart(views, size, angles, folder, time_limit=TIME_LIMIT + TIME_OF_FRAME * len(angles))
        yield [Path(folder) / f"{number:04d}.png" for number in range(len(angles))]


def draw_apart(*job: Any, time_limit: float) -> None:
    """Draws in a process of its own, with what it takes to draw without a display; the job is the arguments of `draw`.

    Where the system has no OpenGL library the drawing package ends its process instead of raising.

    Raises:
        RenderError: it failed, or took longer.
    """
    without_display = sys.platform.startswith("linux") and not os.environ.get("DISPLAY")
    process = Process(DRAWING, {WINDOW: os.environ.get(WINDOW, "vtkEGLRenderWindow")} if without_display else {})
    try:
        with tempfile.NamedTemporaryFile() as file:
            file.write(pickle.dumps(job))
            file.flush()
            process.run({"arguments": file.name}, lambda _: None, seconds=time_limit)
    except FaultError as fault:
        raise RenderError(_explanation(fault)) from fault
    finally:
        process.end()


def _explanation(fault: FaultError) -> str:
    if "bad X server" in fault.said:
        return "no window was opened: the display cannot be reached; check DISPLAY, or 'spinor-geom render' a picture"
    if "died by" in str(fault) or any(name in fault.said for name in ("libGL", "EGL", "OpenGL", "OSMesa")):
        return (
            "no picture was drawn: no usable OpenGL library was found; install one "
            "(Debian, Ubuntu: apt-get install libgl1 libegl1 libgl1-mesa-dri)"
        )
    return f"no picture was drawn: {fault}"
