"""Pictures of fills and of rims: what is in them, and from where it is seen."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from spinor_geom.fill.result import FillResult, LoopOutcome
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import vertex_normals
from spinor_geom.mesh.topology import referenced_vertices
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.render.layers import MESH, PATCH, Camera, Faces, Layer, Lines, View

ALONG_Y = np.cos(np.pi / 4)  # a view along the y axis, or nearly, has the z axis upright instead
MARGIN_OF_HOLE = 2.2  # radius shown around a small hole, in radii of the hole
CLOSE_UP = 0.5  # a hole that would fill less of the mesh's radius than this is shown close up


def fill_scene(result: FillResult) -> tuple[View, ...]:
    """The open mesh beside the filled one, its largest patch, else its longest loop, face on; small ones close up."""
    original, extension = result.original, result.extension
    # a patch that goes on with the mesh may reach far beyond it
    camera = camera_on(np.concatenate([used_vertices(original), extension.vertices]), shown_loop(result.loops))
    mesh = _layers(original, [outcome.loop for outcome in result.loops])
    vertices = np.concatenate([original.vertices, extension.vertices])
    patch = Faces(vertices=vertices, faces=extension.faces, edges=True, **PATCH)
    return View(layers=mesh, camera=camera, title="open"), View(layers=[*mesh, patch], camera=camera, title="filled")


def loops_scene(mesh: TriangleMesh, loops: Sequence[BoundaryLoop]) -> tuple[View, ...]:
    """A mesh's rims from before the longest one and from behind, each with its number where the mesh there is seen."""
    direction, up = facing(loops[0].plane.normal if loops else np.array([0.0, 0.0, 1.0]))
    points = used_vertices(mesh)
    places = [int(loop.vertex_ids[np.argmin(np.linalg.norm(loop.points - loop.centroid, axis=1))]) for loop in loops]
    normals = vertex_normals(mesh.vertices, mesh.faces)[places]
    is_behind = normals @ direction < 0
    layers = _layers(mesh, loops)
    return tuple(
        View(
            layers=layers,
            camera=whole_mesh(points, towards, up),
            title=title,
            labels=[(mesh.vertices[places[k]], str(k)) for k in np.flatnonzero(is_behind == behind)],
        )
        for towards, title, behind in ((direction, "rims", False), (-direction, "from behind", True))
    )


def shown_loop(outcomes: Sequence[LoopOutcome]) -> LoopOutcome | None:
    """The loop with the patch of largest area, else the longest open one; None for a closed mesh."""
    filled = [outcome for outcome in outcomes if outcome.filled]
    if filled:
        return max(filled, key=lambda outcome: outcome.area or 0.0)
    return outcomes[0] if outcomes else None


def used_vertices(mesh: TriangleMesh) -> Float[np.ndarray, "v 3"]:
    """The points of a mesh that its faces use."""
    return np.asarray(mesh.vertices[referenced_vertices(mesh.faces, vertices=len(mesh.vertices))])


def _layers(mesh: TriangleMesh, loops: Sequence[BoundaryLoop]) -> list[Layer]:
    rims = [np.stack([loop.vertex_ids, np.roll(loop.vertex_ids, -1)], axis=1) for loop in loops]
    edges = np.concatenate([np.empty((0, 2), dtype=np.int64), *rims])
    return [
        Faces(vertices=mesh.vertices, faces=mesh.faces, **MESH),
        Lines(vertices=mesh.vertices, edges=edges, width=2.0),
    ]


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
    points: Float[np.ndarray, "v 3"],
    direction: Float[np.ndarray, "3"],
    up: Float[np.ndarray, "3"],
    *,
    aspect: float = 1,
) -> Camera:
    """The camera of a given direction that just shows all points in a picture of a width per height."""
    frame = np.stack([np.cross(up, direction), up, direction])
    seen = points @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    radius = float(((high - low)[:2] / [aspect, 1]).max() / 2)
    return Camera(focus=(low + high) / 2 @ frame, direction=direction, up=up, radius=radius)


def facing(normal: Float[np.ndarray, "3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """The view direction against a unit normal, and the up vector: the y axis, as mesh files have it, upright."""
    axis = np.array([0.0, 1.0, 0.0])
    if abs(normal[1]) > ALONG_Y:
        axis = np.array([0.0, 0.0, -np.sign(normal[1])])
    return normal, upright(normal, axis)


def upright(direction: Float[np.ndarray, "3"], axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The unit vector across a view's direction that is nearest to an axis."""
    up = axis - (axis @ direction) * direction
    return np.asarray(up / np.linalg.norm(up))
