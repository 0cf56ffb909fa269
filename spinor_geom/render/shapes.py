"""Any surface or mesh as vertices, triangles and values, and what other libraries and browsers take of it."""

import html
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters import MeshFile, Polygons, to_mesh
from spinor_geom.adapters.contents import FileContents
from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface
from spinor_geom.errors import MeshFileError
from spinor_geom.fill.fill_result import FillResult
from spinor_geom.measures import discrete_mean_curvature
from spinor_geom.mesh.topology import boundary_edges
from spinor_geom.meshing.embed import Patch, mesh_patch, mesh_surface
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.render.layers import MESH, PATCH, Faces, Layer, Lines, Scale, colours_of
from spinor_geom.render.page import Scene, Views, document
from spinor_geom.surface.spinor_surface import SpinorSurface

GAUSS, MEAN, NORMAL = "gauss_curvature", "mean_curvature", "normal"
MOST_FACES = 200_000  # of larger meshes a notebook would become as large itself
_HEIGHT = 430  # of a frame, in pixels
_FRAME_STYLE = "body { margin: .3rem auto } figure.view { margin: 0 } figure.wide canvas { height: 20rem }"


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """Triangles with values at their vertices, (n,) or (n, k) by name, as `Shown` tells them."""

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    values: Mapping[str, np.ndarray] = field(default_factory=dict)
    curvature: str = MEAN  # the value that colours tell
    patch_faces: Int[np.ndarray, " p"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def rims(self) -> Int[np.ndarray, "r 2"]:
        """The edges with one face."""
        return boundary_edges(self.faces)

    @property
    def clipped(self) -> Float[np.ndarray, " n"]:
        """The curvature, its extremes cut off at the ends of its `Scale`."""
        scale = Scale.of(self.values[self.curvature])
        return np.asarray(np.clip(self.values[self.curvature], scale.low, scale.high))

    def write_gltf(self, path: str | os.PathLike[str]) -> None:
        """See `Shown.to_gltf`."""
        target = Path(path)
        if target.suffix.lower() != ".glb":
            raise MeshFileError(f"{target}: binary glTF has the suffix .glb, not '{target.suffix}'", path=target)
        srgb = colours_of(self.values[self.curvature])
        # glTF's colours are linear
        linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        attributes = {"color": linear} | ({NORMAL: self.values[NORMAL]} if NORMAL in self.values else {})
        contents = FileContents(
            vertices=np.asarray(self.vertices),
            polygons=Polygons.of_triangles(np.asarray(self.faces)),
            attributes=attributes,
            representatives=np.arange(len(self.vertices)),
        )
        MeshFile.of_contents(contents, path=None).write(target)

    def framed(self, *, title: str) -> str:
        """A frame for a notebook, with a page of its own; above `MOST_FACES` triangles only their number."""
        facts = f"{title}: {len(self.vertices)} vertices, {len(self.faces)} triangles"
        if len(self.faces) > MOST_FACES:
            return f"<p>{html.escape(facts)}; too many to show here, to_pyvista() gives an object to plot.</p>"
        text = shape_page(self, title=facts)
        return (
            f'<iframe title="{html.escape(title)}" srcdoc="{html.escape(text)}" width="100%" height="{_HEIGHT}" '
            'style="border: 0" sandbox="allow-scripts"></iframe>'
        )


def shape_of(shown: Any) -> Shape:
    """The triangles of a surface, a solution, a patch or a fill (its filled mesh), or of any mesh `fill_hole` takes.

    Raises:
        SurfaceError: the surface is not finite on its domain.
        DomainError: the solution cannot be meshed.
        UnknownMeshTypeError: no adapter knows the type.
    """
    if isinstance(shown, SpinorSurface):
        return _minimal(mesh_surface(shown), shown)
    if isinstance(shown, PlateauSolution):
        return _minimal(mesh_patch(shown), shown.surface)
    if isinstance(shown, FillResult):
        added = np.arange(len(shown.extension.faces))
        return replace(shape_of(shown.mesh), patch_faces=len(shown.original.faces) + added)
    if isinstance(shown, (Patch, DiscreteMinimalSurface)):
        return _mesh(shown.vertices, shown.faces, {})
    mesh = to_mesh(shown)
    return _mesh(mesh.vertices, mesh.faces, mesh.vertex_attributes)


def shape_page(shape: Shape, *, title: str) -> str:
    """A page with a shape, to turn, its curvature as a choice of colours."""
    ours = np.isin(np.arange(len(shape.faces)), shape.patch_faces)
    curvature = shape.values[shape.curvature]
    name = f"{shape.curvature.replace('_', ' ')}, 1/unit{'²' * (shape.curvature == GAUSS)}"
    layers: list[Layer] = [
        Faces(vertices=shape.vertices, faces=shape.faces[chosen], fields={name: curvature}, **look)
        for chosen, look in ((~ours, MESH), (ours, PATCH))
        if chosen.any()
    ]
    if len(shape.rims):
        layers.append(Lines(vertices=shape.vertices, edges=shape.rims, width=2.5))
    scales = {name: Scale.of(curvature)} if np.isfinite(curvature).any() else {}
    views = Views()
    scene = Scene(title=title, layers=layers, scales=scales, unit="units", shape="wide")
    return document(title, [views.figure(scene), views.script()], style=_FRAME_STYLE)


def _minimal(patch: Patch, surface: SpinorSurface) -> Shape:
    values = {
        NORMAL: np.asarray(surface.normal(patch.points)),
        GAUSS: np.asarray(surface.gauss_curvature(patch.points)),
    }
    return Shape(vertices=patch.vertices, faces=patch.faces, values=values, curvature=GAUSS)


def _mesh(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], attributes: Mapping[str, np.ndarray]
) -> Shape:
    mean = np.full(len(vertices), np.nan)
    if len(faces):
        found = discrete_mean_curvature(vertices, faces)
        mean[found.vertices] = found.values
    return Shape(vertices=vertices, faces=faces, values={**attributes, MEAN: mean})
