"""Small pictures of patches and curves as SVG: plain text, without a graphics library."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

SIZE = 160
MARGIN = 8
# More triangles than a small picture can show: the outline alone is drawn.
MOST_FACES = 3000
TILT = np.radians(35.0)  # against the plane of the points, so that the shape shows
DARK, LIGHT = np.array([28, 78, 128]), np.array([196, 222, 245])


def thumbnail(points: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], outline: Int[np.ndarray, " k"]) -> str:
    """A surface and its rim, or a curve alone, as one `svg` element.

    Args:
        points: in any unit; one finite point at least.
        faces: of the surface; shaded by their inclination, the farther first.
        outline: the points of the curve in order.
    """
    turned = _seen(points)
    low, high = turned.min(axis=0), turned.max(axis=0)
    extent = float((high - low)[:2].max())
    scale = (SIZE - 2 * MARGIN) / extent if extent > np.finfo(np.float64).tiny else 1.0
    flat = SIZE / 2 + (turned - 0.5 * (low + high)) * scale * [1, -1, 1]
    shapes = []
    if 0 < len(faces) <= MOST_FACES:
        shapes += _triangles(flat, faces)
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in flat[outline, :2].tolist())
    shapes.append(f'<polyline points="{path}" fill="none" stroke="#d0021b" stroke-width="1.5"/>')
    return f'<svg viewBox="0 0 {SIZE} {SIZE}" width="{SIZE}" height="{SIZE}">{"".join(shapes)}</svg>'


def _seen(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """The points with their plane almost across the line of sight, the third coordinate towards the eye."""
    centred = points - points.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    if len(axes) < 3 or np.linalg.det(axes) < 0:
        axes = np.vstack([axes[:2], np.cross(axes[0], axes[1])]) if len(axes) > 1 else np.eye(3)
    x, y, z = (centred @ axes.T).T
    return np.stack([x, np.cos(TILT) * y + np.sin(TILT) * z, np.cos(TILT) * z - np.sin(TILT) * y], axis=1)


def _triangles(flat: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> list[str]:
    corners = flat[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    shade = np.abs(normals[:, 2]) / np.where(lengths > 0, lengths, 1.0)
    colors = (DARK + shade[:, None] * (LIGHT - DARK)).astype(int)
    order = np.argsort(corners[:, :, 2].mean(axis=1), kind="stable")
    return [
        f'<path d="M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}L{e:.1f} {f:.1f}Z" fill="#{red:02x}{green:02x}{blue:02x}"/>'
        for (a, b, c, d, e, f), (red, green, blue) in zip(
            corners[order, :, :2].reshape(-1, 6).tolist(), colors[order].tolist(), strict=True
        )
    ]
