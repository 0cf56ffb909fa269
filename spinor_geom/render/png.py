"""Draws scenes as PNGs, without a display."""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from spinor_geom.errors import RenderError
from spinor_geom.files import atomic_path
from spinor_geom.optional import require
from spinor_geom.render.layers import View

WIDTH, HEIGHT = 1600, 800
TIME_LIMIT = 300.0  # seconds; software rendering of a million triangles takes a few
TIME_OF_FRAME = 5.0  # seconds that each frame may take besides


def write_png(views: Sequence[View], path: str | os.PathLike[str]) -> None:
    """Draws views off-screen, side by side.

    Args:
        views: from left to right.
        path: the PNG, replaced as a whole.

    Raises:
        MissingPackageError: pyvista is not installed.
        RenderError: the drawing failed.
    """
    with drawn(views, size=(WIDTH, HEIGHT)) as (picture,), atomic_path(path) as target:
        shutil.copyfile(picture, target)


@contextmanager
def drawn(views: Sequence[View], *, size: tuple[int, int], angles: Sequence[float] = (0.0,)) -> Iterator[list[Path]]:
    """Draws views side by side.

    Args:
        views: from left to right.
        size: width and height in pixels.
        angles: of the associate family, a picture for each.

    Yields:
        The PNGs; they go with the block.

    Raises:
        MissingPackageError: pyvista is not installed.
        RenderError: the drawing failed.
    """
    require("pyvista", extra="render")
    with tempfile.TemporaryDirectory() as folder:
        draw_apart(views, size, angles, folder, time_limit=TIME_LIMIT + TIME_OF_FRAME * len(angles))
        yield [Path(folder) / f"{number:04d}.png" for number in range(len(angles))]


def draw_apart(*job: Any, time_limit: float | None) -> None:
    """Draws in a process of its own, with what it takes to draw without a display.

    Where the system has no OpenGL library the drawing package ends its process instead of raising.

    Args:
        job: the arguments of `draw`.
        time_limit: in seconds; None for a window, which stays as long as it is looked at.

    Raises:
        RenderError: it failed, or took longer.
    """
    environment = dict(os.environ)
    package_root = str(Path(__file__).parents[2])
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [package_root, environment.get("PYTHONPATH", "")]))
    if sys.platform.startswith("linux") and not environment.get("DISPLAY"):
        environment.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    with tempfile.NamedTemporaryFile() as file:
        file.write(pickle.dumps(job))
        file.flush()
        command = [sys.executable, "-m", "spinor_geom.render.draw", file.name]
        try:
            done = subprocess.run(
                command, env=environment, capture_output=True, text=True, errors="replace", timeout=time_limit
            )
        except subprocess.TimeoutExpired as error:
            raise RenderError(f"no picture was drawn: the drawing took longer than {time_limit:.0f} s") from error
    if done.returncode != 0:
        raise RenderError(_explanation(done.returncode, done.stderr))


def _explanation(status: int, said: str) -> str:
    if "bad X server" in said:
        return "no window was opened: the display cannot be reached; check DISPLAY, or 'spinor-geom render' a picture"
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    if status < 0 or any(name in said for name in ("libGL", "EGL", "OpenGL", "OSMesa")):
        return (
            "no picture was drawn: no usable OpenGL library was found; install one "
            "(Debian, Ubuntu: apt-get install libgl1 libegl1 libgl1-mesa-dri)"
        )
    return f"no picture was drawn: {lines[-1] if lines else f'the drawing process ended with status {status}'}"
