"""Which boundary loops are borders of sheets: along these a patch would lie on the mesh."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from spinor_geom.discrete.first_fill import disk_without_inner_points
from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.errors import SheetBorderError, SpinorGeomError
from spinor_geom.fill.surroundings import Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import face_areas, vertex_normals

# Borders of terrains and of range scans have angles of up to 26°; ragged spherical caps of polar angle 45° have 33° and
# more, as the mean over the collar is less than the angle at the rim.
_LEAST_ANGLE = np.radians(27.5)
# The share of the mesh beside a loop that has to agree on the direction: 0.6 and more on sheets and on shells, 0.25
# around a Möbius strip, whose disk leaves it to either side.
_LEAST_AGREEMENT = 0.45
_COLLAR = 0.1  # width of the mesh that is compared, per width of the hole; no less than the faces at the loop
_POINTS_PER_WIDTH = 4  # of the smoothed loop
_LONGEST_IN_WIDTHS = 40  # points of longer loops are farther apart: the first fill takes no more than 160
_FEWEST_POINTS = 12
_SAMPLES = 16  # a point's, from which the smoothed loop is averaged


def refuse_border(surroundings: Surroundings, loop: BoundaryLoop) -> None:
    """Refuses, before anything is solved, a loop over which a patch would lie on the mesh.

    The loop is averaged over the width of its hole, and a coarse minimal disk is spanned over that. The faces beside
    the loop lie in some direction from it: their mean, in the frame of the disk's inner conormal and normal, has an
    angle to the disk. It is 180° around a hole in a plane, 90° at the end of a tube, θ at the rim of a spherical cap of
    polar angle θ, and 0° along the border of a plane sheet. Slopes up and down cancel, so hilly sheets have small
    angles, too. It depends neither on how the faces are cut along the loop nor on their orientation.

    Raises:
        SheetBorderError: the angle is below 27.5°.
    """
    if surroundings.turning(loop) <= 0:
        return  # most holes, at no cost
    try:
        inner, over = _mean_direction(surroundings, loop)
    except SpinorGeomError:
        return  # no coarse disk, so nothing is known of its patch: it is solved as others are
    angle = np.arctan2(abs(over), inner)
    if angle < _LEAST_ANGLE and np.hypot(inner, over) > _LEAST_AGREEMENT:
        raise SheetBorderError(angle=np.degrees(angle), least=np.degrees(_LEAST_ANGLE))


def _mean_direction(surroundings: Surroundings, loop: BoundaryLoop) -> tuple[float, float]:
    """The mean direction from the loop to the mesh: along the disk's inner conormal and along its normal.

    Each is a share of what these add up to without regard to signs.
    """
    mesh, perimeter = surroundings.mesh, loop.perimeter
    area = face_areas(loop.points, disk_without_inner_points(loop.points)).sum()
    width = max(2 * float(area) / perimeter, perimeter / _LONGEST_IN_WIDTHS)
    conormals, normals = _disk_frames(_averaged(loop, width))
    faces = _faces_within(surroundings, loop, _COLLAR * 2 * float(area) / perimeter)
    middles = mesh.vertices[mesh.faces[faces]].mean(axis=1)
    nearest, along = _nearest_on(loop, middles)
    place = np.rint(along / perimeter * len(normals)).astype(np.int64) % len(normals)
    weighted = (middles - nearest) * face_areas(mesh.vertices, mesh.faces[faces])[:, None]
    inner = np.einsum("fk,fk->f", weighted, conormals[place])
    over = np.einsum("fk,fk->f", weighted, normals[place])
    total = max(float(np.hypot(inner, over).sum()), np.finfo(np.float64).tiny)
    return float(inner.sum()) / total, float(over.sum()) / total


def _nearest_on(
    loop: BoundaryLoop, points: Float[np.ndarray, "k 3"]
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, " k"]]:
    """The nearest of the points of the two edges at the nearest vertex of a loop, and the length of the loop up to it."""
    vertex = cKDTree(loop.points).query(points)[1]
    edge = np.stack([vertex - 1, vertex])  # the first edge of a loop ends at its vertex 1, the last at its vertex 0
    start, lengths = loop.points[edge], loop.edge_lengths[edge]
    side = np.roll(loop.points, -1, axis=0)[edge] - start
    squares = np.maximum(lengths**2, np.finfo(np.float64).tiny)
    share = np.clip(np.einsum("ekx,ekx->ek", points - start, side) / squares, 0.0, 1.0)
    foot = start + share[:, :, None] * side
    nearer = np.linalg.norm(points - foot, axis=2).argmin(axis=0), np.arange(len(points))
    along = (np.cumsum(loop.edge_lengths) - loop.edge_lengths)[edge] + share * lengths
    return foot[nearer], along[nearer]


def _averaged(loop: BoundaryLoop, width: float) -> Float[np.ndarray, "n 3"]:
    """Points at even distances along a loop, each the mean of the loop over a piece of the given length around it."""
    count = max(_FEWEST_POINTS, round(_POINTS_PER_WIDTH * loop.perimeter / width))
    along = np.cumsum(loop.edge_lengths) - loop.edge_lengths
    places = np.arange(count * _SAMPLES) * (loop.perimeter / (count * _SAMPLES))
    samples = np.stack([np.interp(places, along, x, period=loop.perimeter) for x in loop.points.T], axis=1)
    window = max(1, round(width / loop.perimeter * len(samples)))
    return np.asarray(uniform_filter1d(samples, window, axis=0, mode="wrap")[::_SAMPLES])


def _disk_frames(points: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Inner conormals and normals of a coarse minimal disk along its boundary, or a FirstFillError."""
    disk = first_disk(points)
    normals = vertex_normals(disk.vertices, disk.faces)[: len(points)]
    conormals = np.cross(normals, np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0))
    lengths = np.linalg.norm(conormals, axis=1, keepdims=True)
    return conormals / np.maximum(lengths, np.finfo(np.float64).tiny), normals


def _faces_within(surroundings: Surroundings, loop: BoundaryLoop, distance: float) -> Int[np.ndarray, " f"]:
    """The mesh's faces at a loop and those reached from it over vertices no farther from it than a distance."""
    tree = cKDTree(loop.points)
    reached = front = loop.vertex_ids
    while len(front):
        beside = np.setdiff1d(surroundings.mesh.faces[surroundings.faces_at(front)], reached)
        front = beside[tree.query(surroundings.mesh.vertices[beside])[0] <= distance]
        reached = np.concatenate([reached, front])
    return surroundings.faces_at(reached)
