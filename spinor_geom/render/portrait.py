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
from spinor_geom.render.colours import BACK_COLOUR, FRONT_COLOUR, GRID_COLOUR, RIM_COLOUR
from spinor_geom.render.family import AssociateFamily, associate_family
from spinor_geom.render.layers import Camera, Faces, Lines, View
from spinor_geom.render.png import drawn
from spinor_geom.surface import SpinorSurface

# from the surface to the eye: in front of it and above, the third axis upwards
EYE = (1.0, -2.0, 1.3)
SIZE = (900, 720)


@dataclass(frozen=True, kw_only=True, eq=False)
class Portrait:
    """What a picture shows.

    Attributes:
        vertices: of the triangles and of the lines.
        conjugate: the same vertices on the conjugate surface, where there is one.
        faces: triangles.
        rims: edges of the boundary, drawn as tubes.
        lines: edges of lines on the surface, drawn as thin tubes.
        values: what the colour of a vertex tells; without, each side has a colour of its own.
    """

    vertices: Float[np.ndarray, "n 3"]
    conjugate: Float[np.ndarray, "n 3"] | None = None
    faces: Int[np.ndarray, "f 3"]
    rims: Int[np.ndarray, "r 2"]
    lines: Int[np.ndarray, "l 2"]
    values: Float[np.ndarray, " n"] | None = None

    @classmethod
    def of(cls, surface: SpinorSurface | AssociateFamily) -> Portrait:
        """A surface and its family, with its boundary and the image of a square grid in Ω.

        Raises:
            PeriodError: see `associate_family`.
            SurfaceError: the surface is not finite on its domain.
        """
        family = associate_family(surface) if isinstance(surface, SpinorSurface) else surface
        rim = np.arange(family.boundary_size)
        return cls(
            vertices=family.vertices,
            conjugate=family.conjugate,
            faces=family.faces,
            rims=np.stack([rim, np.roll(rim, -1)], axis=1),
            lines=family.lines,
        )

    def moved(self, matrix: ArrayLike, shift: ArrayLike = (0.0, 0.0, 0.0)) -> Portrait:
        """The picture of x ↦ matrix·x + shift, without the family."""
        linear = np.asarray(matrix, dtype=np.float64)
        return replace(self, vertices=self.vertices @ linear.T + np.asarray(shift, dtype=np.float64), conjugate=None)

    def beside(self, *others: Portrait) -> Portrait:
        """One picture of several, as they lie in space, without families; colours by values need all to have some."""
        pieces = (self, *others)
        starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)]).tolist()
        values = [piece.values for piece in pieces if piece.values is not None]
        return Portrait(
            vertices=np.concatenate([piece.vertices for piece in pieces]),
            faces=np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=False)]),
            rims=np.concatenate([piece.rims + start for piece, start in zip(pieces, starts, strict=False)]),
            lines=np.concatenate([piece.lines + start for piece, start in zip(pieces, starts, strict=False)]),
            values=np.concatenate(values) if len(values) == len(pieces) else None,
        )

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
        """Draws members of the family, all at one scale.

        Args:
            angles: θ of each, in radians; without a conjugate only 0.
            eye: see `write`.
            size: see `write`.

        Yields:
            A PNG for each; they go with the block.

        Raises:
            MissingPackageError: pyvista is not installed.
            RenderError: the drawing failed.
        """
        conjugate = self.vertices if self.conjugate is None else self.conjugate
        middle = self.vertices.mean(axis=0)
        own, other = self.vertices - middle, conjugate - middle
        turned = [np.cos(a) * own + np.sin(a) * other for a in angles] if any(angles) else [own]
        frame = _frame(np.asarray(eye, dtype=np.float64))
        seen = np.concatenate([points @ frame.T for points in turned])
        low, high = seen.min(axis=0), seen.max(axis=0)
        focus = middle + (low + high) / 2 @ frame
        radius = max(high[1] - low[1], (high[0] - low[0]) * size[1] / size[0]) / 2
        surface = Faces(
            vertices=self.vertices,
            conjugate=conjugate,
            faces=self.faces,
            colour=FRONT_COLOUR,
            inside=BACK_COLOUR,
            fields={} if self.values is None else {"": self.values},
        )
        curves = [
            Lines(vertices=self.vertices, conjugate=conjugate, edges=edges, colour=colour, width=width)
            for edges, colour, width in ((self.rims, RIM_COLOUR, 2.5), (self.lines, GRID_COLOUR, 0.75))
        ]
        camera = Camera(focus=focus, direction=frame[2], up=frame[1], radius=float(radius))
        with drawn([View(layers=[surface, *curves], camera=camera)], size=size, angles=angles) as pictures:
            yield pictures


def _frame(eye: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rows: to the right, up, and to the eye; the third axis is upwards, or the second for a view along the third."""
    direction = eye / np.linalg.norm(eye)
    upright = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(upright, direction)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(direction, right), direction])
