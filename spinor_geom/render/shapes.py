"""Surfaces and meshes as vertices, triangles and values, for other libraries, glTF files and notebooks."""

import html
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.adapters import MeshFile, to_mesh
from spinor_geom.adapters.mesh_files import write_triangles
from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface
from spinor_geom.errors import MeshFileError
from spinor_geom.fill.fill_result import FillResult
from spinor_geom.measures import discrete_mean_curvature
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch, mesh_patch, mesh_surface
from spinor_geom.meshing.solid import Solid
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.render.camera import Camera
from spinor_geom.render.fill_scene import fill_camera, patch_labels, skin_of
from spinor_geom.render.page import Views, document, table
from spinor_geom.render.portrait import Portrait
from spinor_geom.render.scene import MESH, PATCH, Faces, Label, Layer, Scene, viridis
from spinor_geom.surface.array_surface import ArraySurface

GAUSS, MEAN, NORMAL = "gauss_curvature", "mean_curvature", "normal"
MOST_FACES = 200_000  # larger meshes are not embedded in a notebook
_HEIGHT = 430  # of a frame, in pixels
_FRAME_STYLE = "body { margin: .3rem auto } figure.view { margin: 0 } figure.wide canvas { height: 20rem }"


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """Triangles with values at their vertices."""

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    values: Mapping[str, np.ndarray]  # (n,) or (n, k), names as in `Shown`
    skin: Mapping[str, Any] = field(default_factory=dict)  # own colours, see `skin_of`
    colour_field: str = MEAN  # name of the values shown as colours
    is_new: Bool[np.ndarray, " f"] | None = None  # which faces are patches of a fill, None if not known
    camera: Camera | None = None  # None: an overview
    labels: Sequence[Label] = ()  # numbers of patches
    loops: Sequence[tuple[str, ...]] = ()  # rows of a table of the loops of a fill, its head first

    @property
    def curvature(self) -> Float[np.ndarray, " n"]:
        """The values shown as colours."""
        return self.values[self.colour_field]

    def portrait(self, *, curvature: bool) -> Portrait:
        """The triangles and their boundary, coloured by curvature or with one colour for each side."""
        name = f"{self.colour_field.replace('_', ' ')}, 1/unit{'²' * (self.colour_field == GAUSS)}"
        whole = Portrait.of_mesh(self.vertices, self.faces, {name: self.curvature} if curvature else None, self.skin)
        return (
            whole
            if curvature or self.is_new is None
            else Portrait(layers=(*self._parts(self.is_new), *whole.layers[1:]))
        )

    def _parts(self, is_new: Bool[np.ndarray, " f"]) -> list[Faces]:
        """The mesh with its own colours, and the patches."""
        skin = dict(self.skin)
        if "image" in skin:
            skin["skin"] = skin["skin"].reshape(-1, 3, 2)[~is_new[: len(skin["skin"]) // 3]].reshape(-1, 2)
        return [
            Faces(vertices=self.vertices, faces=self.faces[~is_new], **skin, **MESH),
            Faces(vertices=self.vertices, faces=self.faces[is_new], **PATCH),
        ]

    def write_gltf(self, path: str | os.PathLike[str]) -> None:
        """See `Shown.to_gltf`."""
        target = Path(path)
        if target.suffix.lower() != ".glb":
            raise MeshFileError(f"{target}: binary glTF has the suffix .glb, not '{target.suffix}'", path=target)
        attributes = {"color": viridis(self.curvature)}
        if NORMAL in self.values:
            attributes[NORMAL] = self.values[NORMAL]
        write_triangles(self.vertices, self.faces, target, attributes)

    def framed(self, *, title: str) -> str:
        """An `iframe` with an interactive view, for a notebook, or text for more than `MOST_FACES` triangles."""
        facts = f"{title}: {len(self.vertices)} vertices, {len(self.faces)} triangles"
        if len(self.faces) > MOST_FACES:
            return f"<p>{html.escape(facts)}; too many to show here: plot the result of to_pyvista().</p>"
        views = Views()
        layers: Sequence[Layer] = self.portrait(curvature=True).layers
        if self.is_new is not None:
            layers = self._parts(self.is_new)
        scene = Scene(title=facts, layers=layers, unit="mesh units", camera=self.camera, labels=self.labels)
        below = [table(self.loops[0], self.loops[1:])] if self.loops else []
        page = document(facts, [views.figure(scene), *below, views.script()], style=_FRAME_STYLE)
        return (
            f'<iframe title="{html.escape(title)}" srcdoc="{html.escape(page)}" width="100%" height="{_HEIGHT}" '
            'style="border: 0" sandbox="allow-scripts"></iframe>'
        )


def shape_of(shown: Any) -> Shape:
    """The triangles of a surface, a solution, a patch or a fill (its filled mesh), or of any mesh `fill_hole` takes.

    Raises a SurfaceError for a surface that is not finite on its domain, a DomainError for a solution that cannot be
    meshed, and an UnknownMeshTypeError for other types.
    """
    if isinstance(shown, ArraySurface):
        return _minimal(mesh_surface(shown), shown)
    if isinstance(shown, PlateauSolution):
        return _minimal(mesh_patch(shown), shown.array_surface)
    if isinstance(shown, (Patch, DiscreteMinimalSurface, Solid)):
        shown = mesh = TriangleMesh(shown.vertices, shown.faces)
    else:
        mesh = to_mesh(shown.mesh if isinstance(shown, FillResult) else shown)
    mean = np.full(len(mesh.vertices), np.nan)
    if len(mesh.faces):
        curvature = discrete_mean_curvature(mesh.vertices, mesh.faces)
        mean[curvature.vertices] = curvature.values
    values = {**mesh.vertex_attributes, MEAN: mean}
    if not isinstance(shown, FillResult):
        known = isinstance(shown, MeshFile) and shown.contents.face_loops is not None
        is_new = shown.contents.loop_of_faces[shown.face_polygons] >= 0 if known else None
        return Shape(vertices=mesh.vertices, faces=mesh.faces, values=values, skin=skin_of(shown, mesh), is_new=is_new)
    rows = [(str(o.index), str(len(o.loop)), o.state, str(o.faces_added), o.reason) for o in shown.loops]
    first = len(mesh.faces) - len(shown.extension.faces)
    return Shape(
        vertices=mesh.vertices,
        faces=mesh.faces,
        values=values,
        skin=skin_of(
            shown.mesh, TriangleMesh(mesh.vertices, mesh.faces[:first], vertex_attributes=mesh.vertex_attributes)
        ),
        is_new=np.arange(len(mesh.faces)) >= first,
        camera=fill_camera(shown),
        labels=patch_labels(shown),
        loops=[("loop", "points", "patch", "new faces", "reason"), *rows],
    )


def _minimal(patch: Patch, surface: ArraySurface) -> Shape:
    values = {
        NORMAL: np.asarray(surface.normal(patch.points)),
        GAUSS: np.asarray(surface.gauss_curvature(patch.points)),
    }
    return Shape(vertices=patch.vertices, faces=patch.faces, values=values, colour_field=GAUSS)
