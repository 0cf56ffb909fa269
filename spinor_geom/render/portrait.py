"""Pictures of surfaces, of fills and of rims: what is in them, and from where it is seen."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import igl
import numpy as np
from jaxtyping import Complex, Float, Int
from numpy.typing import ArrayLike

from spinor_geom.errors import PeriodError, require_type
from spinor_geom.fill.fill_result import FillResult, LoopOutcome
from spinor_geom.mesh.arrays import igl_arrays
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import vertex_normals
from spinor_geom.mesh.topology import boundary_edges, referenced_vertices
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import mesh_surface
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.render.layers import GRID_COLOUR, MESH, PATCH, SIDES, Camera, Faces, Layer, Lines, View, turned
from spinor_geom.render.png import drawn, write_png
from spinor_geom.surface import SpinorSurface

EYE = (1.0, -2.0, 1.3)  # from the surface to the eye: in front of it and above, the third axis upwards
SIZE = (900, 720)
_ALONG = 0.999
GAUSS = "Gauss curvature"
VERTICES = 4000
GRID_LINES = 16  # across the longer side of Ω
_LARGEST_PERIOD = 1e-6  # a period larger than this share of the integrals on its way is no error of the quadrature
ALONG_Y = np.cos(np.pi / 4)  # a view along the y axis, or nearly, has the z axis upright instead
MARGIN_OF_HOLE = 2.2  # radius shown around a small hole, in radii of the hole
CLOSE_UP = 0.5  # a hole that would fill less of the mesh's radius than this is shown close up


@dataclass(frozen=True, kw_only=True, eq=False)
class Portrait:
    """What a picture shows: surfaces and lines; those with a conjugate can turn through their family."""

    layers: tuple[Layer, ...]

    @classmethod
    def of(cls, surface: SpinorSurface | PlateauSolution, *, vertices: int = VERTICES) -> Portrait:
        """A surface, meshed with so many vertices, and its family, with its boundary and the image of a grid in Ω.

        Raises:
            ArgumentTypeError: it is neither a surface nor a solution, whose surface is taken.
            PeriodError: see `associate_family`.
            SurfaceError: the surface is not finite on its domain.
        """
        takes = "a SpinorSurface or a PlateauSolution"
        require_type(surface, (SpinorSurface, PlateauSolution), function="Portrait.of", takes=takes)
        whole = surface.surface if isinstance(surface, PlateauSolution) else surface
        faces, *lines = associate_family(whole, vertices=vertices)
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
        write_png([self._seen([0.0], eye, size)], path, size=size)

    def frames(
        self, angles: Sequence[float], *, eye: Sequence[float] = EYE, size: tuple[int, int] = SIZE
    ) -> AbstractContextManager[list[Path]]:
        """Draws members of the family as `write` does, all at one scale: a PNG for each angle θ, in radians.

        They go with the block. Without a conjugate there is only the angle 0.
        """
        return drawn([self._seen(angles, eye, size)], size=size, angles=angles)

    def _seen(self, angles: Sequence[float], eye: Sequence[float], size: tuple[int, int]) -> View:
        direction = np.asarray(eye, dtype=np.float64) / np.linalg.norm(eye)
        # the second axis is upwards for a view along the third
        axis = np.eye(3)[2 if abs(direction[2]) < _ALONG else 1]
        seen = np.concatenate([turned(layer, angle) for layer in self.layers for angle in angles])
        camera = whole_mesh(seen, direction, upright(direction, axis), aspect=size[0] / size[1])
        return View(layers=self.layers, camera=camera)


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
        (rim,) = surface.rim_primitives(surface.order)
        period = rim.at_breaks[-1]
        if not np.abs(period).max() <= _LARGEST_PERIOD * np.abs(rim.at_breaks).max():
            around = "the domain's boundary, as p or q has a pole inside"
            raise PeriodError(angle=np.pi / 2, around=around, period=(-period.imag).tolist())
    mesh = mesh_surface(surface, vertices=vertices)
    turned, gauss = surface.associate(np.pi / 2).position(mesh.points), surface.gauss_curvature(mesh.points)
    known = np.column_stack([mesh.vertices, turned, gauss])
    ends, lines = grid_lines(mesh.points, mesh.faces, known)
    own, conjugate, gauss = np.split(np.concatenate([known, ends]), [3, 6], axis=1)
    places: dict[str, Any] = {"vertices": own, "conjugate": conjugate - conjugate.mean(axis=0) + own.mean(axis=0)}
    fields = {GAUSS: gauss[:, 0]}
    ends = np.arange(mesh.boundary_size)
    return (
        Faces(**places, faces=mesh.faces, fields=fields, **SIDES),
        Lines(**places, edges=lines + len(known), colour=GRID_COLOUR, width=0.75),
        Lines(**places, edges=np.stack([ends, np.roll(ends, -1)], axis=1), width=2.5),
    )


def grid_lines(
    z: Complex[np.ndarray, " n"], faces: Int[np.ndarray, "f 3"], values: Float[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, "p k"], Int[np.ndarray, "l 2"]]:
    """Values, such as positions, where lines of a square grid in Ω cross a mesh's edges, and pairs on a triangle."""
    most = GRID_LINES // 2 - 1
    step = max(np.ptp(z.real), np.ptp(z.imag)) / GRID_LINES
    points, edges = np.zeros((0, values.shape[1])), np.zeros((0, 2), dtype=np.int64)
    for x in (z.real.copy(), z.imag.copy()):
        levels = (x.min() + x.max()) / 2 + step * np.arange(-most, most + 1)
        ends, pairs, _ = igl.isolines(*igl_arrays(values, faces), x, levels)
        points, edges = np.concatenate([points, ends]), np.concatenate([edges, pairs + len(points)])
    return points, edges


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
