"""The process that draws a surface: `python -m spinor_geom.render.draw_surface SCENE.npz FOLDER WIDTH HEIGHT`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from spinor_geom.render.colours import BACK_COLOUR, FRONT_COLOUR, GRID_COLOUR, RIM_COLOUR

COLOURS = "viridis"
# lengths per half the height of what is shown
RIM_RADIUS, LINE_RADIUS, MARGIN = 0.01, 0.003, 1.06
TUBE_SIDES = 10
# direction to the light in the camera's frame (right, up, to the eye), and its strength
LIGHTS = (((-0.5, 0.7, 0.8), 0.55), ((0.9, 0.1, 0.6), 0.25), ((0.1, -0.7, 0.7), 0.2), ((0.0, 0.0, 1.0), 0.2))


def draw(arrays: Path, folder: Path, width: int, height: int) -> None:
    """Draws frames 0000.png, 0001.png, … of a surface that turns through its associate family.

    Args:
        arrays: an npz file with the arrays of a `Portrait`: "camera" holds focus, right, up and the direction to the
            eye as rows.
        folder: of the pictures.
        width: of a picture, in pixels.
        height: of a picture, in pixels.
    """
    import pyvista

    scene = dict(np.load(arrays))
    focus, right, up, eye = scene["camera"]
    radius = float(scene["radius"])
    plotter: Any = pyvista.Plotter(off_screen=True, window_size=[width, height], lighting="none")
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    add_lights(plotter, focus, right, up, eye)
    surface = pyvista.PolyData.from_regular_faces(scene["vertices"], scene["faces"])
    # once: the members of the family have the same normals
    surface.compute_normals(
        cell_normals=False, split_vertices=False, consistent_normals=False, auto_orient_normals=False, inplace=True
    )
    normals = np.array(surface.point_data["Normals"])
    look: dict[str, Any] = {
        "smooth_shading": True,
        "split_sharp_edges": False,
        "ambient": 0.38,
        "diffuse": 0.72,
        "specular": 0.18,
        "specular_power": 25,
    }
    if len(scene["values"]):
        surface["values"] = scene["values"]
        plotter.add_mesh(surface, scalars="values", cmap=COLOURS, show_scalar_bar=False, **look)
    else:
        plotter.add_mesh(surface, color=FRONT_COLOUR, backface_params={"color": BACK_COLOUR, **_rest(look)}, **look)
    curves = [
        (_strips(pyvista, scene["vertices"], scene[name]), share * float(scene["half_height"]), colour)
        for name, share, colour in (("rims", RIM_RADIUS, RIM_COLOUR), ("lines", LINE_RADIUS, GRID_COLOUR))
        if len(scene[name])
    ]
    tubes = []
    for curve, thickness, colour in curves:
        tube = curve.tube(radius=thickness, n_sides=TUBE_SIDES)
        plotter.add_mesh(tube, color=colour, ambient=0.3, diffuse=0.75, specular=0.2, smooth_shading=True)
        tubes.append((curve, thickness, tube))
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = focus
    plotter.camera.position = focus + 10 * radius * eye
    plotter.camera.up = up
    plotter.camera.parallel_scale = MARGIN * float(scene["half_height"])
    for number, angle in enumerate(scene["angles"].tolist()):
        if number or angle:
            moved = scene["middle"] + np.cos(angle) * (scene["vertices"] - scene["middle"])
            moved = moved + np.sin(angle) * (scene["conjugate"] - scene["middle"])
            surface.points = moved
            surface.point_data["Normals"] = normals
            for curve, thickness, tube in tubes:
                curve.points = moved
                tube.copy_from(curve.tube(radius=thickness, n_sides=TUBE_SIDES))
        plotter.renderer.ResetCameraClippingRange()
        plotter.render()
        plotter.screenshot(str(folder / f"{number:04d}.png"))
    plotter.close()


def add_lights(plotter: Any, focus: Any, right: Any, up: Any, eye: Any) -> None:
    """Soft light from several sides, all from before the picture.

    Args:
        plotter: with no light of its own; its active window gets them.
        focus: the point that is looked at.
        right: direction in the picture.
        up: direction in the picture.
        eye: direction from the focus to the eye.
    """
    import pyvista

    for (x, y, z), strength in LIGHTS:
        place = focus + x * right + y * up + z * eye
        light = pyvista.Light(position=place, focal_point=focus, intensity=strength, light_type="scene light")
        plotter.add_light(light, only_active=True)


def _rest(look: dict[str, Any]) -> dict[str, Any]:
    return {name: look[name] for name in ("ambient", "diffuse", "specular", "specular_power")}


def _strips(pyvista: Any, vertices: Any, edges: Any) -> Any:
    """Edges joined to lines as long as possible."""
    cells = np.column_stack([np.full(len(edges), 2), edges]).ravel()
    return pyvista.PolyData(vertices, lines=cells).strip(join=True, max_length=100_000)


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
