"""Scenes of meshes with boundary loops: before and after a fill, and the numbered loops."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from spinor_geom.adapters import MeshFile, textured
from spinor_geom.adapters.contents import color_scale_of
from spinor_geom.domain.delaunay import rim_edges
from spinor_geom.errors import HiddenTextureWarning, MeshFileError
from spinor_geom.files import up_axis
from spinor_geom.fill.fill_result import FillResult, LoopOutcome
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import vertex_normals
from spinor_geom.mesh.topology import referenced_vertices
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.render.camera import Camera
from spinor_geom.render.scene import MESH, PATCH, Faces, Label, Layer, Lines, Scene

MOST_LABELS = 200  # numbers of loops in a view
LARGEST_IMAGE = 2048  # pixels of the longer side of a texture that is shown
UPWARDS = np.array([0.0, 0.0, 1.0])
_MARGIN = 2.2  # radius shown around a small hole, in radii of the hole
_CLOSE_UP = 0.5  # the close-up is used if its radius is below this share of the mesh's radius


def fill_scene(result: FillResult) -> tuple[Scene, Scene]:
    """The open and the filled mesh, both with the camera of `fill_camera`."""
    original, camera = result.original, fill_camera(result)
    mesh = mesh_layers(original, [outcome.loop for outcome in result.loops], skin=skin_of(result.mesh, original))
    patches = replace(_patches(result), edges=True)
    return Scene(layers=mesh, camera=camera, title="open"), Scene(
        layers=[*mesh, patches], camera=camera, title="filled"
    )


def whole_scene(result: FillResult, up: Literal["y", "z"], *, aspect: float) -> Scene:
    """The whole filled mesh and the rims left open, from where most area of the patches is seen if nothing hides it.

    `up` is the axis that is upwards, `aspect` the picture's width per height.
    """
    patches = _patches(result)
    one, two, three = np.moveaxis(patches.vertices[patches.faces], 1, 0)
    direction = most_seen(np.cross(two - one, three - one))
    towards = UPWARDS if direction is None else direction
    left_open = [outcome.loop for outcome in result.loops if not outcome.filled]
    mesh = mesh_layers(result.original, left_open, skin=skin_of(result.mesh, result.original))
    return Scene(layers=[*mesh, patches], camera=Camera.facing(_shown_points(result), towards, up, aspect=aspect))


def _patches(result: FillResult) -> Faces:
    vertices = np.concatenate([result.original.vertices, result.extension.vertices])
    return Faces(vertices=vertices, faces=result.extension.faces, **PATCH)


def fill_camera(result: FillResult) -> Camera:
    """The camera of `hole_camera` for the loop of `shown_loop`."""
    return hole_camera(_shown_points(result), shown_loop(result.loops), up_of(result))


def most_seen(areas: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, "3"] | None:
    """The direction in which the projection of the faces that are turned towards it has most area, None without area.

    `areas` are the normals of the faces, as long as the faces' areas. From both sides of each axis, the direction
    becomes that of the sum of the normals that are turned towards it, until these stay the same. Each step increases
    the projection, which is a convex function of the direction.
    """
    totals = np.concatenate([np.eye(3), -np.eye(3)])
    is_seen = np.zeros((len(areas), len(totals)), dtype=bool)
    while ((now := areas @ totals.T > 0) != is_seen).any():
        is_seen, totals = now, now.T.astype(np.float64) @ areas
    sizes = np.linalg.norm(totals, axis=1)
    best = int(np.argmax(sizes))
    return totals[best] / sizes[best] if is_seen.any() else None


def _shown_points(result: FillResult) -> Float[np.ndarray, "v 3"]:
    # a smooth patch may reach far beyond the mesh
    return np.concatenate([used_vertices(result.original), result.extension.vertices])


def patch_labels(result: FillResult) -> list[Label]:
    """The numbers of the loops, each at the vertex of its patch that is nearest to the mean of all, for the first."""
    labels: list[Label] = []
    for outcome in result.loops:
        if outcome.patch is not None and len(labels) < MOST_LABELS:
            vertices = outcome.patch.vertices
            middle = np.linalg.norm(vertices - vertices.mean(axis=0), axis=1).argmin()
            labels.append((vertices[middle], str(outcome.index)))
    return labels


def up_of(result: FillResult) -> Literal["y", "z"]:
    """The axis that is upwards in the file that was filled, or y if the mesh is from no file."""
    return up_axis(result.mesh.path if isinstance(result.mesh, MeshFile) else None)


def loops_scene(
    mesh: TriangleMesh,
    loops: Sequence[BoundaryLoop],
    *,
    up: Literal["y", "z"] = "y",
    skin: Mapping[str, Any] | None = None,
) -> tuple[Scene, Scene]:
    """Two scenes of a mesh: against the longest loop's normal, and from behind. Loops are numbered where visible."""
    front = Camera.facing(used_vertices(mesh), loops[0].plane.normal if loops else UPWARDS, up)
    behind = Camera.around(used_vertices(mesh), -front.direction, front.up)
    nearest = [int(loop.vertex_ids[np.argmin(np.linalg.norm(loop.points - loop.centroid, axis=1))]) for loop in loops]
    is_behind = vertex_normals(mesh.vertices, mesh.faces)[nearest] @ front.direction < 0
    layers = mesh_layers(mesh, loops, skin=skin)

    def seen(camera: Camera, title: str, shown: np.ndarray) -> Scene:
        labels = [(mesh.vertices[nearest[k]], str(k)) for k in np.flatnonzero(shown)]
        return Scene(layers=layers, camera=camera, title=title, labels=labels)

    return seen(front, "boundary loops", ~is_behind), seen(behind, "from behind", is_behind)


def skin_of(source: object, mesh: TriangleMesh) -> dict[str, Any]:
    """The texture of a mesh, or the colours of its vertices, as `skin` and `image` of `Faces`, empty without colours.

    The triangles of `mesh` are the first ones of `source`, a mesh of any type. Warns of a texture that is not shown.
    """
    try:
        found = textured(source, LARGEST_IMAGE)
    except MeshFileError as error:
        warnings.warn(f"the texture is not shown: {error}", HiddenTextureWarning, stacklevel=3)
        found = None
    if found is not None:
        image, corners = found
        return {"skin": corners[: len(mesh.faces)].reshape(-1, 2), "image": image}
    colours = mesh.vertex_attributes.get("color", np.zeros((0, 0)))
    if isinstance(source, MeshFile):
        srgb = source.contents.srgb
        return {} if srgb is None else {"skin": srgb[: len(mesh.vertices)]}
    return {"skin": np.clip(colours[:, :3] / color_scale_of(colours), 0, 1)} if colours.shape[1] >= 3 else {}


def mesh_layers(
    mesh: TriangleMesh,
    loops: Sequence[BoundaryLoop],
    *,
    edges: bool | str = False,
    skin: Mapping[str, Any] | None = None,
    apart: bool = False,
) -> list[Layer]:
    """A mesh, with its own colours if `skin` has them, and its boundary loops, with `edges` as in `Faces`.

    With `apart` each loop is a layer, which a click selects.
    """
    layers: list[Layer] = [Faces(vertices=mesh.vertices, faces=mesh.faces, edges=edges, **(skin or {}), **MESH)]
    if apart:
        for number, loop in enumerate(loops):
            layers.append(Lines(vertices=loop.points, edges=rim_edges((len(loop),)), width=4, loop=str(number)))
    elif loops:
        points = np.concatenate([loop.points for loop in loops])
        layers.append(Lines(vertices=points, edges=rim_edges(tuple(map(len, loops))), width=2.5))
    return layers


def shown_loop(outcomes: Sequence[LoopOutcome]) -> BoundaryLoop | None:
    """The filled loop of largest area, else the longest loop, or None for a closed mesh."""
    filled = [outcome for outcome in outcomes if outcome.filled]
    if filled:
        return max(filled, key=lambda outcome: outcome.area or 0.0).loop
    return outcomes[0].loop if outcomes else None


def used_vertices(mesh: TriangleMesh) -> Float[np.ndarray, "v 3"]:
    """The vertices of a mesh that its faces use."""
    return np.asarray(mesh.vertices[referenced_vertices(mesh.faces, vertices=len(mesh.vertices))])


def hole_camera(points: Float[np.ndarray, "v 3"], loop: BoundaryLoop | None, up: Literal["y", "z"] = "y") -> Camera:
    """A camera that faces a hole and shows all points, or a small hole close up, or without a hole along the z axis."""
    if loop is None:
        return Camera.facing(points, UPWARDS, up)
    camera = Camera.facing(points, loop.plane.normal, up)
    radius = _MARGIN * float(np.linalg.norm(loop.points - loop.centroid, axis=1).max())
    if radius < _CLOSE_UP * camera.radius:
        return Camera(focus=loop.centroid, direction=camera.direction, up=camera.up, radius=radius)
    return camera
