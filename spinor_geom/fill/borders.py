"""Detects boundary loops that are borders of sheets: a patch over such a loop would lie on the mesh.

The loop is smoothed by a moving average over the width of its hole, w = 2 · area / length, and a coarse minimal disk is
computed over the smoothed loop. Both are compared with the adjacent mesh: the faces within 0.1 w of the loop, and all
that touch it. The turning of a loop is its total geodesic curvature in the mesh. The rules, in order:

1. A loop with a turning below −π is a hole, and nothing else is computed. Around a hole in a plane the turning is −2π.
2. A loop is a hole if the turning of the smoothed loop is negative. Rule 1 does not apply to loops with pinch vertices.
3. A loop is a border if the mean rise of the adjacent mesh is below sin 25.5°, and the mesh lies inside the loop.
   Around bowls with an opening of 45° the angle is 28° and more, along terrains and range scans at most 24°.
4. A loop is a border if the turning of the smoothed loop is above 0.89 of 2π, for any rise. It is 0.9 to 1 of 2π
   around half-pipes, roofs and twisted ribbons, at most 0.87 around bowls with an opening of 45°.
5. For a loop that touches or crosses itself, rule 3 does not apply, because the disk has no sides. In addition, the
   turning of the loop itself must be 0.89 to 1.11 of 2π: it is 2π around a strip rolled up until its windings touch.

The rise is the sine of the angle between the mesh and the disk: sin θ at the rim of a spherical cap of polar angle θ, 1
at the end of a tube, 0 along a plane sheet. Upward and downward slopes cancel, so hilly sheets have a small rise. The
turning of the smoothed loop is 2π cos θ for the cap, 0 at the end of a tube, and 2π around a flat sheet that is bent
isometrically. Rise and turning do not depend on the triangulation along the loop or the orientation of the faces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from spinor_geom.arrays import TINY
from spinor_geom.deadline import require_time
from spinor_geom.discrete.first_fill import disk_without_inner_points
from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.errors import SheetBorderError, SpinorGeomError
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.intersections import loop_crossings
from spinor_geom.mesh.operators import face_areas, nearest_on_mesh, vertex_normals

_LEAST_RISE = np.sin(np.radians(25.5))  # rule 3
_LEAST_TURNING = 0.89  # rule 4, in units of 2π
_CLEARLY_NEGATIVE = -np.pi  # rule 1
_COLLAR = 0.1  # in units of w. With half of it the turning around half-pipes is too small
_POINTS_PER_WIDTH = 4  # of the smoothed loop
_MOST_POINTS = 10_000  # of longer loops, only every k-th point is compared with the mesh
_AT_ONCE = 2048  # points of which the nearest ones on a loop are found: in a tangle each takes a millisecond
_MOST_WIDTHS = 40  # limits the smoothed loop to 160 points, the maximum of the first fill
_ROUNDS = 3  # iterations for w. After one, smoothed rims of noisy UV spheres are still rough


def require_no_border(patched: PatchedMesh, loop: BoundaryLoop) -> None:
    """Raises a SheetBorderError for a loop that is the border of a sheet. No surface is solved for."""
    if patched.turning(loop) < _CLEARLY_NEGATIVE and not patched.is_pinched(loop):
        return
    nearby = _NearbyFaces.of(patched, loop)
    if nearby.turning < 0:
        return
    turning = nearby.turning
    if len(loop_crossings(loop.points)):
        turning = patched.turning(loop) / (2 * np.pi)
        if turning > 2 - _LEAST_TURNING:
            return
    else:
        try:
            inward, rise = nearby.mean_direction
        except SpinorGeomError:
            return  # no coarse disk was found
        if rise < _LEAST_RISE and rise < inward:
            angle, least = (np.degrees(np.arcsin(x)) for x in (rise, _LEAST_RISE))
            raise SheetBorderError(
                evidence=f"the mean angle between the mesh and a disk over it is {angle:.0f}° (below {least:.1f}°)"
            )
    if turning > _LEAST_TURNING:
        evidence = f"its total geodesic curvature is {360 * turning:.0f}°, that of a flat sheet is 360°"
        raise SheetBorderError(evidence=evidence)


@dataclass(frozen=True, kw_only=True, eq=False)
class _NearbyFaces:
    """The faces near a loop, and the smoothed loop.

    Attributes:
        points: equidistant points of the smoothed loop.
        nearest: for each face the index of the nearest of these points.
        offsets: for each face the vector from the nearest point of the loop to its centroid, times its area, in
            units of the loop's diagonal, so that powers do not underflow.
    """

    points: Float[np.ndarray, "n 3"]
    nearest: Int[np.ndarray, " f"]
    offsets: Float[np.ndarray, "f 3"]

    @classmethod
    def of(cls, patched: PatchedMesh, loop: BoundaryLoop) -> _NearbyFaces:
        mesh, some = patched.mesh, slice(None, None, math.ceil(len(loop) / _MOST_POINTS))
        points, ids, corners = loop.points[some], loop.vertex_ids[some], loop.corners[some]
        own = replace(loop, points=points, vertex_ids=ids, corners=corners, beside=None)
        area = face_areas(own.points, disk_without_inner_points(own.points)).sum()
        points, width = _smoothed(own, float(area))
        faces = _faces_within(patched, loop, _COLLAR * width)
        centroids = mesh.vertices[mesh.faces[faces]].mean(axis=1)
        nearest, along = _nearest_on(own, centroids)
        areas = face_areas(mesh.vertices, mesh.faces[faces])
        return cls(
            points=points,
            nearest=np.rint(along / own.perimeter * len(points)).astype(np.int64) % len(points),
            offsets=(centroids - nearest) / own.diagonal * (areas / own.diagonal**2)[:, None],
        )

    @property
    def mean_direction(self) -> tuple[float, float]:
        """Sums of the offsets along the coarse disk's inward conormals and, absolute, along its normals.

        Both are divided by the sum of the offsets' lengths. Raises a FirstFillError if there is no disk.
        """
        normals = _disk_normals(self.points)
        conormals = _unit(np.cross(normals, np.roll(self.points, -1, axis=0) - np.roll(self.points, 1, axis=0)))
        inner = np.einsum("fk,fk->f", self.offsets, conormals[self.nearest])
        over = np.einsum("fk,fk->f", self.offsets, normals[self.nearest])
        total = max(float(np.hypot(inner, over).sum()), TINY)
        return float(inner.sum()) / total, abs(float(over.sum())) / total

    @property
    def turning(self) -> float:
        """Total geodesic curvature of the smoothed loop in the mesh, in units of 2π.

        It is the sum over the points of the change of the unit tangent, projected on the direction to the faces there.
        """
        n = len(self.points)
        ahead = _unit(np.roll(self.points, -1, axis=0) - self.points)
        back = np.roll(ahead, 1, axis=0)
        along = _unit(ahead + back)[self.nearest]
        across = self.offsets - np.einsum("fk,fk->f", self.offsets, along)[:, None] * along
        sums = np.stack([np.bincount(self.nearest, x, minlength=n) for x in across.T], axis=1)
        # averaged over the width of the hole, because some points have no face
        towards = _unit(uniform_filter1d(sums, _POINTS_PER_WIDTH + 1, axis=0, mode="wrap"))
        return float(np.sum((ahead - back) * towards)) / (2 * np.pi)


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, TINY))


def _smoothed(loop: BoundaryLoop, area: float) -> tuple[Float[np.ndarray, "n 3"], float]:
    """A loop averaged over the width of its hole, and that width, w = 2 · area / length of the smoothed loop.

    A ragged loop is much longer than the smoothed one, and w from its own length would be too small.
    """
    length = loop.perimeter
    for _ in range(_ROUNDS):
        # at most that of a circle. The length is 0 if the average is a point
        width = min(2 * area / max(length, TINY), length / (2 * np.pi))
        points = _averaged(loop, max(width, loop.perimeter / _MOST_WIDTHS))
        length = float(np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).sum())
    return points, width


def _averaged(loop: BoundaryLoop, width: float) -> Float[np.ndarray, "n 3"]:
    """Equidistant points of the moving average of a loop over a given length."""
    fine = 16  # samples at each point
    count = fine * round(_POINTS_PER_WIDTH * loop.perimeter / width)
    along = np.cumsum(loop.edge_lengths) - loop.edge_lengths
    positions = np.arange(count) * (loop.perimeter / count)
    samples = np.stack([np.interp(positions, along, x, period=loop.perimeter) for x in loop.points.T], axis=1)
    window = max(1, round(width / loop.perimeter * count))
    return np.asarray(uniform_filter1d(samples, window, axis=0, mode="wrap")[::fine])


def _disk_normals(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Normals of a coarse minimal disk at its boundary points."""
    disk = first_disk(points)
    return vertex_normals(disk.vertices, disk.faces)[: len(points)]


def _nearest_on(
    loop: BoundaryLoop, points: Float[np.ndarray, "k 3"]
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, " k"]]:
    """The nearest points on a loop, and the arc length up to each. Raises an OutOfTimeError."""
    k = np.arange(len(loop))
    edges, found = np.stack([k, np.roll(k, -1)], axis=1), []
    for first in range(0, max(len(points), 1), _AT_ONCE):
        require_time()
        found.append(nearest_on_mesh(points[first : first + _AT_ONCE], loop.points, edges))
    edge, foot = (np.concatenate([one[column] for one in found]) for column in (1, 2))
    along = np.cumsum(loop.edge_lengths)[edge] - loop.edge_lengths[edge]
    return foot, along + np.linalg.norm(foot - loop.points[edge], axis=1)


def _faces_within(patched: PatchedMesh, loop: BoundaryLoop, distance: float) -> Int[np.ndarray, " f"]:
    """The mesh faces at a loop and at the vertices within a distance that are connected to it by edges."""
    tree = cKDTree(loop.points)
    reached = front = loop.vertex_ids
    while len(front):
        neighbours = np.setdiff1d(patched.mesh.faces[patched.faces_at(front)], reached)
        front = neighbours[tree.query(patched.mesh.vertices[neighbours])[0] <= distance]
        reached = np.concatenate([reached, front])
    return patched.faces_at(reached)
