"""The process that draws a scene: `python -m spinor_geom.render.draw SCENE.npz PICTURE.png WIDTH HEIGHT`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from spinor_geom.render.colours import INSIDE_COLOUR, MESH_COLOUR, PATCH_COLOUR, RIM_COLOUR
from spinor_geom.render.draw_surface import add_lights

RIM_WIDTH, LABEL_SIZE = 6, 14
# two windows side by side share the width; a margin keeps the mesh off the frame
MARGIN = 1.12


def draw(arrays: Path, picture: Path, width: int, height: int) -> None:
    """Draws the mesh twice, side by side, on the right with its patches.

    Args:
        arrays: an npz file with the arrays of a `PairScene`; "cameras" holds focus, direction and up of each as rows.
        picture: the PNG to write.
        width: of the picture, in pixels.
        height: of the picture, in pixels.
    """
    import pyvista

    scene = dict(np.load(arrays))
    mesh = pyvista.PolyData.from_regular_faces(scene["vertices"], scene["faces"])
    rims = pyvista.PolyData(scene["vertices"], lines=_cells(scene["rim_edges"])) if len(scene["rim_edges"]) else None
    mesh.compute_normals(
        cell_normals=False, split_vertices=False, consistent_normals=False, auto_orient_normals=False, inplace=True
    )
    plotter: Any = pyvista.Plotter(
        off_screen=True, shape=(1, 2), window_size=[width, height], border=False, lighting="none"
    )
    plotter.enable_anti_aliasing("ssaa", all_renderers=True)
    soft = {"ambient": 0.42, "diffuse": 0.8, "specular": 0.08}
    for column, title in enumerate(scene["titles"].tolist()):
        plotter.subplot(0, column)
        focus, direction, up = scene["cameras"][column]
        add_lights(plotter, focus, np.cross(up, direction), up, direction)
        plotter.set_background("white")
        inside = {"color": INSIDE_COLOUR, **soft}
        plotter.add_mesh(
            mesh, color=MESH_COLOUR, backface_params=inside, smooth_shading=True, split_sharp_edges=False, **soft
        )
        if column == 1 and len(scene["patch_faces"]):
            patch = pyvista.PolyData.from_regular_faces(scene["vertices"], scene["patch_faces"])
            plotter.add_mesh(patch, color=PATCH_COLOUR, show_edges=True, edge_opacity=0.4, **soft)
        if rims is not None:
            plotter.add_mesh(rims, color=RIM_COLOUR, line_width=RIM_WIDTH, render_lines_as_tubes=True)
        plotter.add_text(title, font_size=LABEL_SIZE, color="black")
        _look(plotter, scene["cameras"][column], float(scene["radii"][column]), aspect=width / 2 / height)
        numbers = np.flatnonzero(scene["number_sides"] == column)
        if len(numbers):
            plotter.add_point_labels(
                scene["numbers"][numbers],
                numbers.astype(str).tolist(),
                font_size=LABEL_SIZE,
                text_color="black",
                shape_color="white",
                shape_opacity=0.8,
                show_points=False,
                always_visible=True,
            )
    plotter.screenshot(str(picture))
    plotter.close()


def _cells(rows: Any) -> Any:
    """Index rows in VTK's flat form: each preceded by its length."""
    return np.column_stack([np.full(len(rows), rows.shape[1]), rows]).ravel()


def _look(plotter: Any, camera: Any, radius: float, aspect: float) -> None:
    focus, direction, up = camera
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = focus
    plotter.camera.position = focus + 10 * radius * direction
    plotter.camera.up = up
    plotter.camera.parallel_scale = MARGIN * radius / min(aspect, 1.0)
    plotter.reset_camera_clipping_range()


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
