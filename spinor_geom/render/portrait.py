"""Pictures of surfaces: each side in its colour, the rim, and the image of Ω's grid."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from spinor_geom.files import atomic_path
from spinor_geom.mesh.topology import boundary_edges
from spinor_geom.render.family import VERTICES, associate_family
from spinor_geom.render.layers import BACK_COLOUR, FRONT_COLOUR, Faces, Layer, Lines, View, turned
from spinor_geom.render.png import drawn
from spinor_geom.render.scene import upright, whole_mesh
from spinor_geom.surface import SpinorSurface

# from the surface to the eye: in front of it and above, the third axis upwards
EYE = (1.0, -2.0, 1.3)
SIZE = (900, 720)
_ALONG = 0.999


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
    surface = Faces(vertices=vertices, faces=faces, colour=FRONT_COLOUR, inside=BACK_COLOUR, fields=fields)
    return Portrait(layers=(surface, Lines(vertices=vertices, edges=boundary_edges(faces), width=2.5)))
