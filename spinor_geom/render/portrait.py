"""Pictures of surfaces, and the layers that show a surface with its associate family."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import igl
import numpy as np
from jaxtyping import Complex, Float, Int
from numpy.typing import ArrayLike

from spinor_geom.domain.delaunay import rim_edges
from spinor_geom.errors import PeriodError, require_type
from spinor_geom.mesh.array_checks import igl_arrays
from spinor_geom.mesh.topology import boundary_edges
from spinor_geom.meshing.embed import mesh_surface
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.render.png import write_png
from spinor_geom.render.scene import EYE, GRID_COLOUR, SIDES, Faces, Layer, Lines, Scene, overview
from spinor_geom.surface.array_surface import ArraySurface

SIZE = (900, 720)
GAUSS = "Gauss curvature"
VERTICES = 4000
GRID_LINES = 16  # across the longer side of Ω
_LARGEST_PERIOD = 1e-6  # relative to the primitives along ∂Ω. Quadrature errors are smaller


@dataclass(frozen=True, kw_only=True, eq=False)
class Portrait:
    """A picture of surfaces and lines."""

    layers: tuple[Layer, ...]

    @classmethod
    def of(cls, surface: ArraySurface | PlateauSolution, *, vertices: int = VERTICES) -> Portrait:
        """The picture of a surface or solution, with its boundary and the image of a grid in Ω.

        Args:
            surface: what to draw.
            vertices: approximate number of vertices of its mesh.

        Raises:
            ArgumentTypeError: `surface` is neither a surface nor a solution.
            SurfaceError: the surface is not finite on its domain.
        """
        takes = "a SpinorSurface or a PlateauSolution"
        require_type(surface, (ArraySurface, PlateauSolution), function="Portrait.of", takes=takes)
        whole = surface.array_surface if isinstance(surface, PlateauSolution) else surface
        faces, *lines = surface_layers(whole, vertices=vertices)
        return cls(layers=(replace(faces, fields={}), *lines))

    @classmethod
    def of_mesh(
        cls,
        vertices: Float[np.ndarray, "n 3"],
        faces: Int[np.ndarray, "f 3"],
        fields: Mapping[str, Float[np.ndarray, " n"]] | None = None,
        skin: Mapping[str, Any] | None = None,
    ) -> Portrait:
        """A mesh with its boundary, coloured by the first field, else by its own colours, else each side in one."""
        surface = Faces(vertices=vertices, faces=faces, fields=fields or {}, **(skin or {}), **SIDES)
        return cls(layers=(surface, Lines(vertices=vertices, edges=boundary_edges(faces), width=2.5)))

    def moved(self, matrix: ArrayLike, shift: ArrayLike = (0.0, 0.0, 0.0)) -> Portrait:
        """The picture of x ↦ matrix·x + shift."""
        linear, by = np.asarray(matrix, dtype=np.float64), np.asarray(shift, dtype=np.float64)
        return Portrait(layers=tuple(replace(one, vertices=one.vertices @ linear.T + by) for one in self.layers))

    def beside(self, *others: Portrait) -> Portrait:
        """Combines pictures into one, at their positions in space."""
        return Portrait(layers=tuple(layer for one in (self, *others) for layer in one.layers))

    def write(self, path: str | os.PathLike[str], *, eye: Sequence[float] = EYE, size: tuple[int, int] = SIZE) -> None:
        """Draws a PNG.

        Args:
            path: the file, replaced as a whole.
            eye: direction from the surface to the eye. The third axis is upwards.
            size: width and height in pixels.

        Raises:
            MissingPackageError: pyvista is not installed.
            RenderError: the drawing failed.
        """
        write_png([self.scene(eye=eye, size=size)], path, size=size)

    def scene(self, *, eye: Sequence[float] = EYE, size: tuple[int, int] = SIZE) -> Scene:
        """The layers with a camera that shows all of them, and arguments as for `write`."""
        return Scene(layers=self.layers, camera=overview(self.layers, eye=eye, aspect=size[0] / size[1]))


def surface_layers(
    surface: ArraySurface, *, vertices: int = VERTICES, family: bool = False
) -> tuple[Faces, Lines, Lines]:
    """A surface with its Gauss curvature as a field, the image of a square grid in Ω, and the boundary.

    The layers have the same vertices, those of the boundary first. With `family` they have the conjugate surface too.
    Its combinations with the surface are the associate family, φ replaced by e^{iθ}φ: isometric surfaces with the same
    normals and Gauss curvature. Raises a PeriodError if the conjugate surface does not close: ∮ φ dz ≠ 0 around ∂Ω or a
    hole, as around poles of p or q, and a SurfaceError if the surface is not finite on its domain.
    """
    if family:
        _require_closed_conjugate(surface)
    mesh = mesh_surface(surface, vertices=vertices)
    conjugate = surface.associate(np.pi / 2).position(mesh.points) if family else mesh.vertices
    known = np.column_stack([mesh.vertices, conjugate, surface.gauss_curvature(mesh.points)])
    ends, lines = grid_lines(mesh.points, mesh.faces, known)
    own, conjugate, gauss = np.split(np.concatenate([known, ends]), [3, 6], axis=1)
    places: dict[str, Any] = {"vertices": own}
    if family:
        places["conjugate"] = conjugate - conjugate.mean(axis=0) + own.mean(axis=0)
    return (
        Faces(**places, faces=mesh.faces, fields={GAUSS: gauss[:, 0]}, **SIDES),
        Lines(**places, edges=lines + len(known), colour=GRID_COLOUR, width=0.75),
        Lines(**places, edges=rim_edges(mesh.rims), width=2.5),
    )


def _require_closed_conjugate(surface: ArraySurface) -> None:
    """Raises a PeriodError if ∮ φ dz ≠ 0 around ∂Ω. Around holes `SpinorSurface.associate` checks it."""
    if surface.domain.holes:
        return
    (rim,) = surface.rim_primitives(surface.order)
    period = rim.at_breaks[-1]
    if not np.abs(period).max() <= _LARGEST_PERIOD * np.abs(rim.at_breaks).max():
        around = "the domain's boundary, because p or q has a pole inside"
        raise PeriodError(angle=np.pi / 2, around=around, period=(-period.imag).tolist())


def grid_lines(
    z: Complex[np.ndarray, " n"], faces: Int[np.ndarray, "f 3"], values: Float[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, "p k"], Int[np.ndarray, "l 2"]]:
    """A square grid in Ω: interpolated values at its intersections with a mesh's edges, and segments between these."""
    most = GRID_LINES // 2 - 1
    step = max(np.ptp(z.real), np.ptp(z.imag)) / GRID_LINES
    points, edges = np.zeros((0, values.shape[1])), np.zeros((0, 2), dtype=np.int64)
    for x in (z.real.copy(), z.imag.copy()):
        levels = (x.min() + x.max()) / 2 + step * np.arange(-most, most + 1)
        ends, pairs, _ = igl.isolines(*igl_arrays(values, faces), x, levels)
        points, edges = np.concatenate([points, ends]), np.concatenate([edges, pairs + len(points)])
    return points, edges
