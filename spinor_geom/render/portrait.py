"""Pictures of surfaces: each side in its colour, the rim, and the image of Ω's grid."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import igl
import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from numpy.typing import ArrayLike

from spinor_geom.domain.panels import Panels
from spinor_geom.errors import PeriodError
from spinor_geom.files import atomic_path
from spinor_geom.mesh.arrays import igl_arrays
from spinor_geom.mesh.topology import boundary_edges
from spinor_geom.meshing.embed import mesh_surface
from spinor_geom.render.layers import GRID_COLOUR, SIDES, Faces, Layer, Lines, View, turned
from spinor_geom.render.png import drawn
from spinor_geom.render.scene import upright, whole_mesh
from spinor_geom.surface import SpinorSurface, formulas

# from the surface to the eye: in front of it and above, the third axis upwards
EYE = (1.0, -2.0, 1.3)
SIZE = (900, 720)
_ALONG = 0.999
GAUSS = "Gauss curvature"
VERTICES = 4000
GRID_LINES = 16  # across the longer side of Ω
# a period larger than this share of the boundary's length is no error of the quadrature
_LARGEST_PERIOD = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Portrait:
    """What a picture shows: surfaces and lines; those with a conjugate can turn through their family."""

    layers: tuple[Layer, ...]

    @classmethod
    def of(cls, surface: SpinorSurface, *, vertices: int = VERTICES) -> Portrait:
        """A surface, meshed with so many vertices, and its family, with its boundary and the image of a grid in Ω.

        Raises:
            PeriodError: see `associate_family`.
            SurfaceError: the surface is not finite on its domain.
        """
        faces, *lines = associate_family(surface, vertices=vertices)
        return cls(layers=(replace(faces, fields={}), *lines))

    def moved(self, matrix: ArrayLike, shift: ArrayLike = (0.0, 0.0, 0.0)) -> Portrait:
        """The picture of x ↦ matrix·x + shift, without the family."""
        linear, by = np.asarray(matrix, dtype=np.float64), np.asarray(shift, dtype=np.float64)
        moved = [replace(layer, vertices=layer.vertices @ linear.T + by, conjugate=None) for layer in self.layers]
        return Portrait(layers=tuple(moved))

    def beside(self, *others: Portrait) -> Portrait:
        """One picture of several, as they lie in space, without families."""
        layers = [replace(layer, conjugate=None) for one in (self, *others) for layer in one.layers]
        return Portrait(layers=tuple(layers))

    def write(self, path: str | os.PathLike[str], *, eye: Sequence[float] = EYE, size: tuple[int, int] = SIZE) -> None:
        """Draws a PNG.

        Args:
            path: the file, replaced as a whole.
            eye: direction from the surface to the eye; the third axis is upwards.
            size: width and height in pixels.

        Raises:
            MissingPackageError: pyvista is not installed.
            RenderError: the drawing failed.
        """
        with self.frames([0.0], eye=eye, size=size) as (picture,), atomic_path(path) as target:
            shutil.copyfile(picture, target)

    @contextmanager
    def frames(
        self, angles: Sequence[float], *, eye: Sequence[float] = EYE, size: tuple[int, int] = SIZE
    ) -> Iterator[list[Path]]:
        """Draws members of the family as `write` does, all at one scale: a PNG for each angle θ, in radians.

        They go with the block. Without a conjugate there is only the angle 0.
        """
        direction = np.asarray(eye, dtype=np.float64) / np.linalg.norm(eye)
        # the second axis is upwards for a view along the third
        axis = np.eye(3)[2 if abs(direction[2]) < _ALONG else 1]
        seen = np.concatenate([turned(layer, angle) for layer in self.layers for angle in angles])
        camera = whole_mesh(seen, direction, upright(direction, axis), aspect=size[0] / size[1])
        with drawn([View(layers=self.layers, camera=camera)], size=size, angles=angles) as pictures:
            yield pictures


def plain_portrait(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], values: Float[np.ndarray, " n"] | None
) -> Portrait:
    """Triangles with their rims; colours tell the values at the vertices, else each side has a colour of its own."""
    fields = {} if values is None else {"": values}
    surface = Faces(vertices=vertices, faces=faces, fields=fields, **SIDES)
    return Portrait(layers=(surface, Lines(vertices=vertices, edges=boundary_edges(faces), width=2.5)))


def associate_family(surface: SpinorSurface, *, vertices: int = VERTICES) -> tuple[Faces, Lines, Lines]:
    """All surfaces with φ turned into e^{iθ}φ: they are isometric and have the same normals and Gauss curvature.

    They are those of a surface over a domain around which ∮ φ dz = 0, as around every one without poles of p and q: the
    surface with its Gauss curvature as a field, the image of a square grid in Ω, and the boundary, all on the same
    vertices, those of the boundary first. Their conjugates have the same mean as they.

    Raises:
        PeriodError: the conjugate surface does not close around ∂Ω or a hole, so that it has no mesh on this domain.
        SurfaceError: the surface is not finite on its domain.
    """
    if not surface.domain.holes:  # around those `associate` looks itself
        _check_periods(surface)
    mesh = mesh_surface(surface, vertices=vertices)
    turned, gauss = surface.associate(np.pi / 2).position(mesh.points), surface.gauss_curvature(mesh.points)
    known = np.column_stack([mesh.vertices, turned, gauss])
    ends, lines = grid_lines(mesh.points, mesh.faces, known)
    own, conjugate, gauss = np.split(np.concatenate([known, ends]), [3, 6], axis=1)
    places: dict[str, Any] = {"vertices": own, "conjugate": conjugate - conjugate.mean(axis=0) + own.mean(axis=0)}
    fields = {GAUSS: gauss[:, 0]}
    rim = np.arange(mesh.boundary_size)
    return (
        Faces(**places, faces=mesh.faces, fields=fields, **SIDES),
        Lines(**places, edges=lines + len(known), colour=GRID_COLOUR, width=0.75),
        Lines(**places, edges=np.stack([rim, np.roll(rim, -1)], axis=1), width=2.5),
    )


def grid_lines(
    z: Complex[np.ndarray, " n"], faces: Int[np.ndarray, "f 3"], values: Float[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, "p k"], Int[np.ndarray, "l 2"]]:
    """Where the lines of a square grid in Ω cross the edges of a mesh of it, and the pairs that a triangle joins.

    Args:
        z: vertices of the mesh.
        faces: its triangles.
        values: at the vertices, such as positions; they are interpolated.
    """
    most = GRID_LINES // 2 - 1
    step = max(np.ptp(z.real), np.ptp(z.imag)) / GRID_LINES
    points, edges = np.zeros((0, values.shape[1])), np.zeros((0, 2), dtype=np.int64)
    for x in (z.real.copy(), z.imag.copy()):
        levels = (x.min() + x.max()) / 2 + step * np.arange(-most, most + 1)
        ends, pairs, _ = igl.isolines(*igl_arrays(values, faces), x, levels)
        points, edges = np.concatenate([points, ends]), np.concatenate([edges, pairs + len(points)])
    return points, edges


def _check_periods(surface: SpinorSurface) -> None:
    domain = surface.domain
    panels = Panels.on(domain.boundary, domain.panel_breaks, surface.order)
    with torch.no_grad():
        p, q = surface.spinors(torch.from_numpy(panels.z).to(surface.constant.device)).unbind(-1)
        phi, factor = (a.cpu().resolve_conj().numpy() for a in (formulas.phi(p, q), formulas.conformal_factor(p, q)))
    period = ((panels.dz * panels.weights)[:, None] * phi).sum(axis=0)
    length = float((panels.arc_weights * factor).sum())
    if not np.abs(period).max() <= _LARGEST_PERIOD * length:
        around = "the domain's boundary, as p or q has a pole inside"
        raise PeriodError(angle=np.pi / 2, around=around, period=(-period.imag).tolist())
