"""What a picture shows: plain arrays, decided here; drawing them is another module's work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.fill.result import FillResult, LoopOutcome
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import vertex_normals
from spinor_geom.mesh.topology import referenced_vertices
from spinor_geom.mesh.triangle_mesh import TriangleMesh

ALONG_Y = np.cos(np.pi / 4)  # a view along the y axis, or nearly, has the z axis upright instead
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
class PairScene:
    """A mesh in two pictures side by side, with its rims; patches are in the right one only.

    Attributes:
        vertices: (V + K, 3) float64, the mesh's, then the patches'.
        faces: (F, 3) the open mesh.
        patch_faces: (T, 3) the patches.
        rim_edges: (E, 2) the edges of all boundary loops of the open mesh.
        numbers: (L, 3) where in space the number of each rim stands; no rows where they are not shown.
        number_sides: (L,) the picture that it stands in, 0 left and 1 right.
        cameras: of the left picture and of the right one.
        titles: of both.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    patch_faces: Int[np.ndarray, "t 3"]
    rim_edges: Int[np.ndarray, "e 2"]
    numbers: Float[np.ndarray, "l 3"]
    number_sides: Int[np.ndarray, " l"]
    cameras: tuple[Camera, Camera]
    titles: tuple[str, str]


def fill_scene(result: FillResult) -> PairScene:
    """The scene of a fill: the open mesh beside the filled one, with its largest patch face on.

    A hole that is small against the mesh is shown close up, else the whole mesh is shown. Where nothing was filled the
    longest open loop is looked at.
    """
    original, extension = result.original, result.extension
    # a patch that goes on with the mesh may reach far beyond it
    camera = camera_on(np.concatenate([_used(original), extension.vertices]), shown_loop(result.loops))
    return PairScene(
        vertices=np.concatenate([original.vertices, extension.vertices]),
        faces=original.faces,
        patch_faces=extension.faces,
        rim_edges=_edges([outcome.loop for outcome in result.loops]),
        numbers=np.empty((0, 3)),
        number_sides=np.empty(0, dtype=np.int64),
        cameras=(camera, camera),
        titles=("open", "filled"),
    )


def loops_scene(mesh: TriangleMesh, loops: Sequence[BoundaryLoop]) -> PairScene:
    """The scene of a mesh's rims, from before the longest one and from behind.

    The number of a rim stands at its vertex nearest to its centroid, in the picture in which the mesh there is seen.
    """
    direction, up = facing(loops[0].plane.normal if loops else np.array([0.0, 0.0, 1.0]))
    points = _used(mesh)
    places = [int(loop.vertex_ids[np.argmin(np.linalg.norm(loop.points - loop.centroid, axis=1))]) for loop in loops]
    normals = vertex_normals(mesh.vertices, mesh.faces)[places]
    return PairScene(
        vertices=mesh.vertices,
        faces=mesh.faces,
        patch_faces=np.empty((0, 3), dtype=np.int64),
        rim_edges=_edges(loops),
        numbers=mesh.vertices[places],
        number_sides=(normals @ direction < 0).astype(np.int64),
        cameras=(whole_mesh(points, direction, up), whole_mesh(points, -direction, up)),
        titles=("rims", "from behind"),
    )


def shown_loop(outcomes: Sequence[LoopOutcome]) -> LoopOutcome | None:
    """The loop with the patch of largest area, else the longest open one; None for a closed mesh."""
    filled = [outcome for outcome in outcomes if outcome.filled]
    if filled:
        return max(filled, key=lambda outcome: outcome.area or 0.0)
    return outcomes[0] if outcomes else None


def _used(mesh: TriangleMesh) -> Float[np.ndarray, "v 3"]:
    return np.asarray(mesh.vertices[referenced_vertices(mesh.faces, vertices=len(mesh.vertices))])


def _edges(loops: Sequence[BoundaryLoop]) -> Int[np.ndarray, "e 2"]:
    rims = [np.stack([loop.vertex_ids, np.roll(loop.vertex_ids, -1)], axis=1) for loop in loops]
    return np.concatenate([np.empty((0, 2), dtype=np.int64), *rims])


def camera_on(points: Float[np.ndarray, "v 3"], outcome: LoopOutcome | None) -> Camera:
    """A camera on a mesh's points that looks straight at a hole, or along the third axis if there is none."""
    if outcome is None:
        return whole_mesh(points, *facing(np.array([0.0, 0.0, 1.0])))
    loop = outcome.loop
    direction, up = facing(loop.plane.normal)
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


def facing(normal: Float[np.ndarray, "3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """The view direction against a unit normal, and the up vector: the y axis, as mesh files have it, upright."""
    axis = np.array([0.0, 1.0, 0.0])
    if abs(normal[1]) > ALONG_Y:
        axis = np.array([0.0, 0.0, -np.sign(normal[1])])
    up = axis - (axis @ normal) * normal
    return normal, up / np.linalg.norm(up)
