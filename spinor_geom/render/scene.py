"""What a picture shows: plain arrays, decided here; drawing them is another module's work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.fill.result import FillResult, LoopOutcome
from spinor_geom.mesh.topology import referenced_vertices

TILT = np.radians(35.0)  # of the view against the hole's normal, so that the patch's shape shows
MARGIN_OF_HOLE = 2.2  # radius shown around a small hole, in radii of the hole
CLOSE_UP = 0.5  # a hole that would fill less of the mesh's radius than this is shown close up


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A parallel projection.

    Attributes:
        focus: (3,) the point in the middle of the picture, in mesh units.
        direction: (3,) unit vector from the focus to the eye.
        up: (3,) unit vector that points up in the picture.
        radius: half the height that is shown, in mesh units.
    """

    focus: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    radius: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FillScene:
    """An open mesh and its patches, as seen by one camera.

    Attributes:
        vertices: (V + K, 3) float64, the mesh's, then the patches'.
        faces: (F, 3) the open mesh.
        patch_faces: (T, 3) the patches.
        rim_edges: (E, 2) the edges of all boundary loops of the open mesh.
        camera: looks at the largest hole that was filled.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    patch_faces: Int[np.ndarray, "t 3"]
    rim_edges: Int[np.ndarray, "e 2"]
    camera: Camera


def fill_scene(result: FillResult) -> FillScene:
    """The scene of a fill: looks at its largest filled hole, from the side its normal points to.

    A hole that is small against the mesh is shown close up, else the whole mesh is shown. Where nothing was filled the
    largest open loop is looked at.
    """
    original, extension = result.original, result.extension
    rims = [
        np.stack([loop.vertex_ids, np.roll(loop.vertex_ids, -1)], axis=1) for loop in (o.loop for o in result.loops)
    ]
    used = original.vertices[referenced_vertices(original.faces, vertices=len(original.vertices))]
    return FillScene(
        vertices=np.concatenate([original.vertices, extension.vertices]),
        faces=original.faces,
        patch_faces=extension.faces,
        rim_edges=np.concatenate([np.empty((0, 2), dtype=np.int64), *rims]),
        camera=camera_on(used, shown_loop(result.loops)),
    )


def shown_loop(outcomes: Sequence[LoopOutcome]) -> LoopOutcome | None:
    """The filled loop of longest perimeter, else the longest open one; None for a closed mesh."""
    return next((outcome for outcome in outcomes if outcome.filled), outcomes[0] if outcomes else None)


def camera_on(points: Float[np.ndarray, "v 3"], outcome: LoopOutcome | None) -> Camera:
    """A camera on a mesh's points that looks at a hole, or along the third axis if there is none."""
    if outcome is None:
        return whole_mesh(points, *tilted(np.array([0.0, 0.0, 1.0])))
    loop = outcome.loop
    direction, up = tilted(loop.plane.normal)
    camera = whole_mesh(points, direction, up)
    radius = MARGIN_OF_HOLE * float(np.linalg.norm(loop.points - loop.centroid, axis=1).max())
    if radius < CLOSE_UP * camera.radius:
        return Camera(focus=loop.centroid, direction=direction, up=up, radius=radius)
    return camera


def whole_mesh(
    points: Float[np.ndarray, "v 3"], direction: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"]
) -> Camera:
    """The camera of a given direction that just shows all points in a square picture."""
    frame = np.stack([np.cross(up, direction), up, direction])
    seen = points @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    return Camera(focus=(low + high) / 2 @ frame, direction=direction, up=up, radius=float((high - low)[:2].max() / 2))


def tilted(normal: Float[np.ndarray, "3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """A view direction tilted against a normal, and an up vector perpendicular to it.

    The tilt is about the coordinate axis that is most nearly perpendicular to the normal, so that a mesh that stands
    upright on an axis is seen upright.
    """
    axis = np.eye(3)[int(np.argmin(np.abs(normal)))]
    sideways = np.cross(axis, normal)
    sideways /= np.linalg.norm(sideways)
    direction = np.cos(TILT) * normal + np.sin(TILT) * sideways
    up = np.cross(direction, axis)
    return direction, up / np.linalg.norm(up)
