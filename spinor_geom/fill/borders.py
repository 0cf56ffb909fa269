"""Which boundary loops are borders of sheets, over which a patch would lie on the mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from spinor_geom.discrete.first_fill import disk_without_inner_points
from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.errors import SheetBorderError, SpinorGeomError
from spinor_geom.fill.surroundings import Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.intersections import loop_crossings
from spinor_geom.mesh.operators import face_areas, vertex_normals

# Seen from a coarse disk over the loop, the mesh beside it rises by the sine of this angle, at least, where there is a
# hole: 28° and more around bowls with an opening of 45°, at most 24° along the borders of terrains and range scans.
_LEAST_RISE = np.sin(np.radians(25.5))
# Least turning of a loop within the mesh, in turns, that is a border's whatever the rise: 0.9 to 1 around half-pipes,
# roofs and twisted ribbons, at most 0.87 around bowls with an opening of 45°.
_LEAST_TURNING = 0.89
_CLEARLY_NEGATIVE = -np.pi  # turning of a loop that is no border; −2π around a hole in a plane
# Width of the mesh that is compared, per width of the hole, and no less than the faces at the loop; with half of it
# half-pipes turn too little.
_COLLAR = 0.1
_POINTS_PER_WIDTH = 4  # of the averaged loop
_LONGEST_IN_WIDTHS = 40  # points of longer loops are farther apart: the first fill takes no more than 160
_FEWEST_POINTS = 12
_ROUNDS = 3  # to the width of a ragged hole; after one, rims of noisy UV spheres are still rough
_SAMPLES = 16  # a point's, from which the averaged loop is computed


def refuse_border(surroundings: Surroundings, loop: BoundaryLoop) -> None:
    """Refuses, before anything is solved, a loop that is the border of a sheet.

    The loop is averaged over the width of its hole, and a coarse minimal disk is spanned over that. The faces beside
    the loop lie in some direction from it. Either of two averages over them shows a border:

    - Their mean rise over the disk is small, and they lie inside the loop. The rise is the sine of the angle between
      the mesh and the disk: sin θ at the rim of a spherical cap of polar angle θ, 1 at the end of a tube, 0 along the
      border of a plane sheet. Slopes up and down cancel, so hilly sheets have a small mean rise.
    - The averaged loop turns by a full turn within the mesh, as around a flat sheet that is bent but not stretched. It
      is cos θ of a turn for the cap, and 0 at the end of a tube.

    Both depend neither on how the faces are cut along the loop nor on their orientation.

    Raises:
        SheetBorderError: the mean rise is below sin 25.5°, or the turning is above 0.89 of a turn.
    """
    if surroundings.turning(loop) < _CLEARLY_NEGATIVE and not surroundings.is_pinched(loop):
        return  # most holes, at no cost
    beside = _Collar.of(surroundings, loop)
    if beside.turning < 0:
        return  # a hole with pinch vertices, which needs no disk
    try:
        inward, rise = beside.mean_direction
    except SpinorGeomError:
        return  # no coarse disk, so nothing is known of its patch: it is solved as others are
    if rise < _LEAST_RISE and rise < inward:
        angle, least = (np.degrees(np.arcsin(x)) for x in (rise, _LEAST_RISE))
        evidence = f"the mesh lies at {angle:.0f}° to a disk over it on average (under {least:.1f}°)"
    elif beside.turning > _LEAST_TURNING:
        evidence = f"it turns by {360 * beside.turning:.0f}° within the mesh, as around a flat sheet (360°)"
    else:
        return
    if not len(loop_crossings(loop.points)):  # a disk over a loop that crosses itself has no side
        raise SheetBorderError(evidence=evidence)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Collar:
    """The faces beside a loop, and the averaged loop.

    Attributes:
        points: of the averaged loop, at even distances.
        places: for each face the nearest of these points.
        offsets: for each face its middle, seen from the nearest point of the loop, times its area; in diagonals of
            the loop, whose powers are numbers.
    """

    points: Float[np.ndarray, "n 3"]
    places: Int[np.ndarray, " f"]
    offsets: Float[np.ndarray, "f 3"]

    @classmethod
    def of(cls, surroundings: Surroundings, loop: BoundaryLoop) -> _Collar:
        """Those within 0.1 widths of the hole, and all that touch the loop."""
        mesh = surroundings.mesh
        area = face_areas(loop.points, disk_without_inner_points(loop.points)).sum()
        points, width = _smoothed(loop, float(area))
        faces = _faces_within(surroundings, loop, _COLLAR * width)
        middles = mesh.vertices[mesh.faces[faces]].mean(axis=1)
        nearest, along = _nearest_on(loop, middles)
        areas = face_areas(mesh.vertices, mesh.faces[faces])
        return cls(
            points=points,
            places=np.rint(along / loop.perimeter * len(points)).astype(np.int64) % len(points),
            offsets=(middles - nearest) / loop.diagonal * (areas / loop.diagonal**2)[:, None],
        )

    @property
    def mean_direction(self) -> tuple[float, float]:
        """How far the faces lie inside a coarse disk's boundary, and how far to one side of it; or a FirstFillError.

        Each is a share of what these two distances add up to without regard to signs.
        """
        conormals, normals = _disk_frames(self.points)
        inner = np.einsum("fk,fk->f", self.offsets, conormals[self.places])
        over = np.einsum("fk,fk->f", self.offsets, normals[self.places])
        total = max(float(np.hypot(inner, over).sum()), np.finfo(np.float64).tiny)
        return float(inner.sum()) / total, abs(float(over.sum())) / total

    @property
    def turning(self) -> float:
        """The total geodesic curvature of the averaged loop within the mesh, in turns.

        It is the sum of how much the loop's direction changes at each point, towards the faces near it.
        """
        n = len(self.points)
        ahead = _unit(np.roll(self.points, -1, axis=0) - self.points)
        back = np.roll(ahead, 1, axis=0)
        along = _unit(ahead + back)[self.places]
        across = self.offsets - np.einsum("fk,fk->f", self.offsets, along)[:, None] * along
        sums = np.stack([np.bincount(self.places, x, minlength=n) for x in across.T], axis=1)
        # over the width of the hole: there is not a face at every point
        towards = _unit(uniform_filter1d(sums, _POINTS_PER_WIDTH + 1, axis=0, mode="wrap"))
        return float(np.sum((ahead - back) * towards)) / (2 * np.pi)


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, np.finfo(np.float64).tiny))


def _nearest_on(
    loop: BoundaryLoop, points: Float[np.ndarray, "k 3"]
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, " k"]]:
    """The nearest point on the two edges at the nearest vertex of a loop, and the length of the loop up to it."""
    vertex = cKDTree(loop.points).query(points)[1]
    edge = np.stack([vertex - 1, vertex])  # the last edge, −1, ends at vertex 0
    start, lengths = loop.points[edge], loop.edge_lengths[edge]
    side = np.roll(loop.points, -1, axis=0)[edge] - start
    squares = np.maximum(lengths**2, np.finfo(np.float64).tiny)
    share = np.clip(np.einsum("ekx,ekx->ek", points - start, side) / squares, 0.0, 1.0)
    foot = start + share[:, :, None] * side
    nearer = np.linalg.norm(points - foot, axis=2).argmin(axis=0), np.arange(len(points))
    along = (np.cumsum(loop.edge_lengths) - loop.edge_lengths)[edge] + share * lengths
    return foot[nearer], along[nearer]


def _smoothed(loop: BoundaryLoop, area: float) -> tuple[Float[np.ndarray, "n 3"], float]:
    """A loop averaged over the width of its hole, and that width: twice the area per length of the averaged loop.

    Teeth make a loop longer, and the width by its own length is too small to average them out.
    """
    length = loop.perimeter
    for _ in range(_ROUNDS):
        width = min(2 * area / length, length / (2 * np.pi))  # of a circle at most
        points = _averaged(loop, max(width, loop.perimeter / _LONGEST_IN_WIDTHS))
        length = float(np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).sum())
    return points, width


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
    return _unit(conormals), normals


def _faces_within(surroundings: Surroundings, loop: BoundaryLoop, distance: float) -> Int[np.ndarray, " f"]:
    """The mesh's faces at a loop and those reached from it over vertices no farther from it than a distance."""
    tree = cKDTree(loop.points)
    reached = front = loop.vertex_ids
    while len(front):
        beside = np.setdiff1d(surroundings.mesh.faces[surroundings.faces_at(front)], reached)
        front = beside[tree.query(surroundings.mesh.vertices[beside])[0] <= distance]
        reached = np.concatenate([reached, front])
    return surroundings.faces_at(reached)
