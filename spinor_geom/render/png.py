"""Writes a scene as a PNG, without a display."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from spinor_geom.errors import RenderError
from spinor_geom.files import atomic_path
from spinor_geom.optional import require
from spinor_geom.render.scene import PairScene

WIDTH, HEIGHT = 1600, 800
TIME_LIMIT = 300.0  # seconds; software rendering of a million triangles takes a few


def write_png(scene: PairScene, path: str | os.PathLike[str]) -> None:
    """Draws a scene off-screen, its two pictures side by side, patches in another colour.

    The drawing runs in a process of its own: where the system has no OpenGL library the drawing package ends its
    process instead of raising.

    Args:
        scene: what to draw.
        path: the PNG, replaced as a whole.

    Raises:
        MissingPackageError: pyvista is not installed.
        RenderError: the drawing failed.
    """
    require("pyvista", extra="render")
    with tempfile.TemporaryDirectory() as folder, atomic_path(path) as target:
        arrays = Path(folder) / "scene.npz"
        picture = Path(folder) / "picture.png"
        np.savez(
            arrays,
            vertices=scene.vertices,
            faces=scene.faces,
            patch_faces=scene.patch_faces,
            rim_edges=scene.rim_edges,
            numbers=scene.numbers,
            number_sides=scene.number_sides,
            cameras=np.stack([[camera.focus, camera.direction, camera.up] for camera in scene.cameras]),
            radii=np.array([camera.radius for camera in scene.cameras]),
            titles=np.array(scene.titles),
        )
        draw_apart("spinor_geom.render.draw", str(arrays), str(picture), str(WIDTH), str(HEIGHT))
        Path(target).write_bytes(picture.read_bytes())


def draw_apart(module: str, *arguments: str, time_limit: float | None = TIME_LIMIT) -> None:
    """Runs a module that draws in a process of its own, with what it takes to draw without a display.

    Args:
        module: its name.
        arguments: its command line.
        time_limit: in seconds; None for a window, which stays as long as it is looked at.

    Raises:
        RenderError: it failed, or took longer.
    """
    environment = dict(os.environ)
    package_root = str(Path(__file__).parents[2])
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [package_root, environment.get("PYTHONPATH", "")]))
    if sys.platform.startswith("linux") and not environment.get("DISPLAY"):
        environment.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    command = [sys.executable, "-m", module, *arguments]
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, errors="replace", timeout=time_limit, check=False
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
