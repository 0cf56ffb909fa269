"""Any surface or mesh as vertices, triangles and values, and what other libraries and browsers take of it."""

from __future__ import annotations

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
from spinor_geom.fill.result import FillResult
from spinor_geom.measures.mean_curvature import discrete_mean_curvature
from spinor_geom.mesh.topology import boundary_edges
from spinor_geom.meshing.embed import Patch, mesh_patch, mesh_surface
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.render.layers import (
    INSIDE_COLOUR,
    MESH_COLOUR,
    PATCH_COLOUR,
    RIM_COLOUR,
    UNKNOWN_COLOUR,
    VIRIDIS,
    Faces,
    Layer,
    Lines,
    Scale,
)
from spinor_geom.render.page import Scene, Views, document
from spinor_geom.surface.spinor_surface import SpinorSurface

GAUSS, MEAN, NORMAL = "gauss_curvature", "mean_curvature", "normal"
# of larger meshes a notebook would become as large itself
MOST_FACES = 200_000
_HEIGHT = 430  # of a frame, in pixels
_FRAME_STYLE = "body { margin: .3rem auto } figure.view { margin: 0 } figure.wide canvas { height: 20rem }"


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """Triangles with values at their vertices, (n,) or (n, k) by name, as `Shown` tells them.

    Colours tell the one that `curvature` names; `patch_faces` have another.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    values: Mapping[str, np.ndarray] = field(default_factory=dict)
    curvature: str = MEAN
    patch_faces: Int[np.ndarray, " p"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def rims(self) -> Int[np.ndarray, "r 2"]:
        """The edges with one face."""
        return boundary_edges(self.faces)

    @property
    def told(self) -> Float[np.ndarray, " n"]:
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


def colours_of(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Colours in sRGB, 0 to 1, of values on viridis over their `Scale`; grey where there is none."""
    scale, stops = Scale.of(values), np.array([_rgb(stop) for stop in VIRIDIS])
    share = (values - scale.low) / ((scale.high - scale.low) or 1.0)
    place = np.clip(np.nan_to_num(share), 0, 1) * (len(stops) - 1)
    colours = np.stack([np.interp(place, np.arange(len(stops)), stops[:, k]) for k in range(3)], axis=1)
    return np.where(np.isfinite(values)[:, None], colours, _rgb(UNKNOWN_COLOUR))


def shape_page(shape: Shape, *, title: str) -> str:
    """A page with a shape, to turn, its curvature as a choice of colours."""
    ours = np.isin(np.arange(len(shape.faces)), shape.patch_faces)
    curvature = shape.values[shape.curvature]
    name = f"{shape.curvature.replace('_', ' ')}, 1/unit{'²' * (shape.curvature == GAUSS)}"
    parts = [(~ours, MESH_COLOUR, INSIDE_COLOUR), (ours, PATCH_COLOUR, None)]
    layers: list[Layer] = [
        Faces(
            vertices=shape.vertices,
            faces=shape.faces[chosen],
            colour=colour,
            inside=inside,
            fields={name: curvature},
        )
        for chosen, colour, inside in parts
        if chosen.any()
    ]
    if len(shape.rims):
        layers.append(Lines(vertices=shape.vertices, edges=shape.rims, colour=RIM_COLOUR, width=2.5))
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


def _rgb(colour: str) -> Float[np.ndarray, "3"]:
    return np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
