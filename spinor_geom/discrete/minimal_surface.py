"""The discrete baseline: a triangulated disk of stationary area over a loop, or an annulus between two."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.discrete.area_descent import descend_area, harmonic_extension
from spinor_geom.discrete.first_fill import unfolded_loop
from spinor_geom.discrete.strip import discrete_annulus
from spinor_geom.domain.flattening import flatten
from spinor_geom.domain.triangulation import SizeFunction, graded_size, triangulate_polygon
from spinor_geom.errors import OptionError, TooManyRimsError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import cotangent_laplacian, face_areas
from spinor_geom.shown import Shown

DiscreteMethod = Literal["libigl", "pymeshlab"]
# The first mesh only has to be near enough for its flattening to be right.
_FIRST_CHANGE = 1e-3
_FINE_CHANGE = 1e-8
_FINE_GROWTH = 0.15


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscreteMinimalSurface(Shown):
    """A triangulated disk or annulus whose boundary is a loop or two, and whose area is stationary.

    Attributes:
        vertices: (n, 3), mesh units; the loops' points come first, bit-equal.
        faces: (f, 3), counter-clockwise about the loop.
        boundary_size: number of loop points, of all loops together.
        area: total area of the triangles.
        area_history: total area after each step of the last descent.
        converged: whether the area became stationary to the relative change asked for.
        method: what made it.
        seconds: wall time.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    boundary_size: int
    area: float
    area_history: tuple[float, ...]
    converged: bool
    method: DiscreteMethod
    seconds: float

    @property
    def iterations(self) -> int:
        """Steps of the last descent."""
        return len(self.area_history) - 1


def discrete_minimal_surface(
    loop: BoundaryLoop | Sequence[BoundaryLoop],
    *,
    method: DiscreteMethod = "libigl",
    target_edge_length: float | None = None,
    relative_change: float = 1e-10,
) -> DiscreteMinimalSurface:
    """A discrete disk of stationary area over any closed loop, or an annulus between two.

    "libigl": the loop's minimum-area triangulation is unfolded, the plane polygon triangulated, and the inner vertices
    moved by Pinkall-Polthier iteration; the surface is then flattened again, which gives a nearly conformal domain,
    meshed anew there and brought to a stationary area by Newton's method along the normals. Triangles are as long as
    the loop's edges beside it and grow with the distance from it, so their number grows like the loop's length; for an
    area that converges with the loop's edge length give `target_edge_length`.
    "pymeshlab": its close-holes filter, isotropic remeshing, and cotangent smoothing of the inner vertices.

    Two loops start from the strip of least area between them; their triangles always grow inwards, and there is no
    "pymeshlab" for them.

    Args:
        loop: a closed loop, or a sequence of one, or of two that both have the annulus on their left, as the loops of
            `PlateauSolution.rims`.
        method: which library's operators are used.
        target_edge_length: upper bound of the edge length in mesh units; None lets it grow inwards.
        relative_change: the area counts as stationary when a step lowers it by less than this share.

    Raises:
        OptionError: unknown method, one that has no annuli, or an edge length that is not positive.
        TooManyRimsError: a sequence of other than one or two loops.
        FirstFillError: no first fill was found.
        DomainError: the first fill has no simple flattening.
        SingularMatrixError: the loop crosses itself or runs along itself, so that faces have no area.

    Source: Pinkall & Polthier (1993); the first fill after Barequet & Sharir (1995).
    """
    if target_edge_length is not None and not target_edge_length > 0:
        raise OptionError(f"target_edge_length must be positive, got {target_edge_length}")
    if not isinstance(loop, BoundaryLoop) and len(loop) == 1:
        (loop,) = loop
    if not isinstance(loop, BoundaryLoop):
        if method != "libigl" or target_edge_length is not None:
            raise OptionError("between two loops there is only method='libigl', without target_edge_length")
        return _between(loop, relative_change)
    if method == "pymeshlab":
        from spinor_geom.discrete.meshlab import meshlab_minimal_surface

        return meshlab_minimal_surface(loop, target_edge_length=target_edge_length, relative_change=relative_change)
    if method != "libigl":
        raise OptionError(f"unknown method {method!r}; choose 'libigl' or 'pymeshlab'")
    start = time.perf_counter()
    first = first_disk(loop.points)
    flat = flatten(first.vertices, first.faces, len(loop)).boundary
    size = None if target_edge_length is None else _capped(flat, first, target_edge_length)
    second = _fill(flat, loop.points, relative_change=relative_change, size=size)
    return DiscreteMinimalSurface(
        vertices=second.vertices,
        faces=second.faces,
        boundary_size=len(loop),
        area=second.areas[-1],
        area_history=second.areas,
        converged=second.converged,
        method="libigl",
        seconds=time.perf_counter() - start,
    )


def _between(loops: Sequence[BoundaryLoop], relative_change: float) -> DiscreteMinimalSurface:
    if len(loops) != 2:
        raise TooManyRimsError(sizes=[len(loop) for loop in loops])
    start = time.perf_counter()
    plane, descent = discrete_annulus(loops[0].points, loops[1].points, relative_change=relative_change)
    return DiscreteMinimalSurface(
        vertices=descent.vertices,
        faces=plane.faces,
        boundary_size=plane.boundary_size,
        area=descent.areas[-1],
        area_history=descent.areas,
        converged=descent.converged,
        method="libigl",
        seconds=time.perf_counter() - start,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Disk:
    """A triangulated disk over a closed curve, the curve's points first, and how its area fell."""

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    areas: tuple[float, ...]
    converged: bool


def first_disk(points: Float[np.ndarray, "m 3"]) -> Disk:
    """A disk over a closed curve that is minimal to about three digits: enough to flatten it.

    Raises:
        FirstFillError: no first fill was found.
    """
    return _fill(unfolded_loop(points), points, relative_change=_FIRST_CHANGE)


def finer_disk(disk: Disk, boundary_size: int) -> Disk:
    """The disk flattened and meshed anew, finer inside, until its area is stationary; twice.

    Folds and narrow places that the first mesh is too coarse for come out right.

    Raises:
        DomainError: the disk has no simple flattening.
    """
    points = disk.vertices[:boundary_size]
    for _ in range(2):
        flat = flatten(disk.vertices, disk.faces, boundary_size).boundary
        disk = _fill(flat, points, relative_change=_FINE_CHANGE, size=graded_size(flat, growth=_FINE_GROWTH))
    return disk


def _fill(
    polygon: Complex[np.ndarray, " m"],
    points: Float[np.ndarray, "m 3"],
    *,
    relative_change: float,
    size: SizeFunction | None = None,
) -> Disk:
    """Meshes a polygon, maps it harmonically to the loop, and descends in area."""
    plane = triangulate_polygon(polygon, size or graded_size(polygon))
    flat = np.column_stack([plane.points.real, plane.points.imag, np.zeros(len(plane.points))])
    mapped = harmonic_extension(cotangent_laplacian(flat, plane.faces), points)
    descent = descend_area(mapped, plane.faces, len(points), relative_change=relative_change)
    return Disk(vertices=descent.vertices, faces=plane.faces, areas=descent.areas, converged=descent.converged)


def _capped(polygon: Complex[np.ndarray, " m"], first: Disk, target: float) -> SizeFunction:
    """Graded size with an upper bound in space: the bound in the plane is target over the local stretch."""
    graded = graded_size(polygon)
    boundary = np.column_stack([polygon.real, polygon.imag])
    flat = harmonic_extension(cotangent_laplacian(first.vertices, first.faces), boundary) @ np.array([1.0, 1.0j])
    flat = flat[first.faces]
    plane_area = 0.5 * np.abs(np.imag(np.conj(flat[:, 1] - flat[:, 0]) * (flat[:, 2] - flat[:, 0])))
    stretch = np.sqrt(face_areas(first.vertices, first.faces) / np.maximum(plane_area, 1e-300))
    middle = flat.mean(axis=1)
    tree = cKDTree(np.column_stack([middle.real, middle.imag]))

    def size(z: Complex[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        _, near = tree.query(np.column_stack([z.real, z.imag]))
        return np.asarray(np.minimum(graded(z), target / stretch[near]))

    return size
