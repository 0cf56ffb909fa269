"""Strips of triangles between two loops, and discrete annuli made from them."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.deadline import seconds_left
from spinor_geom.discrete.area_descent import (
    FIRST_CHANGE,
    Disk,
    Faces,
    Vertices,
    descend_from_plane,
    harmonic_extension,
)
from spinor_geom.domain.sizes import GROWTH, SizeField
from spinor_geom.domain.triangulation import PlaneTriangulation, triangulate_polygon
from spinor_geom.mesh.operators import mollified_laplacian
from spinor_geom.mesh.spacing import edge_lengths

Rim = Float[np.ndarray, "m 3"]
OtherRim = Float[np.ndarray, "n 3"]
Places = tuple[Complex[np.ndarray, " _"], Complex[np.ndarray, " _"]]  # of both rims

_MOST_POINTS = 128  # of a loop in the search for the strip. Longer ones are thinned
_ROUNDS = 2  # of remeshing
_GRID = 64  # radii, and angles, at which edge lengths are given


def minimum_area_strip(first: Rim, second: OtherRim) -> tuple[Int[np.ndarray, "f 3"], float]:
    """The strip of m + n triangles of least area between two closed polygons, and its area.

    Both polygons have the strip on their left. Each triangle has an edge of one polygon and a vertex of the other. The
    vertices of the second are numbered after those of the first. Dynamic programming for all start vertices of the
    second polygon at once, O(mn²).

    Source: Fuchs, Kedem & Uselton, "Optimal surface reconstruction from planar contours", Comm. ACM 20 (1977).
    """
    m, n = len(first), len(second)
    back = second[::-1]  # the direction of the first
    across = back - first[:, None]
    edges_a, edges_b = np.roll(first, -1, axis=0) - first, np.roll(back, -1, axis=0) - back
    along_a = 0.5 * np.linalg.norm(np.cross(edges_a[:, None], across), axis=2)  # (m, n): edge i of the first, vertex j
    along_b = 0.5 * np.linalg.norm(np.cross(edges_b, -across), axis=2)  # (m, n): vertex i, edge j of the second
    # row i, column l: least area of a strip from (0, start) to (i, start + l), for each start
    around = (np.arange(n)[:, None] + np.arange(n + 1)) % n
    edges = (np.arange(n)[:, None] + np.arange(n)) % n
    rows = np.empty((m + 1, n, n + 1))
    for i in range(m + 1):
        passed = np.cumsum(along_b[i % m][edges], axis=1)
        passed = np.concatenate([np.zeros((n, 1)), passed], axis=1)
        if i == 0:
            rows[i] = passed
            continue
        up = rows[i - 1] + along_a[i - 1][around]
        rows[i] = passed + np.minimum.accumulate(up - passed, axis=1)
    start = int(rows[m, :, n].argmin())
    faces, i, l_ = [], m, n
    while i or l_:
        a, b = i % m, int(around[start, l_])
        by_first = rows[i - 1, start, l_] + along_a[i - 1, b] if i else math.inf
        by_second = rows[i, start, l_ - 1] + along_b[a, edges[start, l_ - 1]] if l_ else math.inf
        # b counts the second polygon's vertices in reverse
        if by_first <= by_second:
            faces.append(((i - 1) % m, a, m + n - 1 - b))
            i -= 1
        else:
            faces.append((a, m + n - 1 - b, m + n - 1 - int(edges[start, l_ - 1])))
            l_ -= 1
    return np.array(faces[::-1]), float(rows[m, start, n])


def runs_backward(first: Rim, second: OtherRim) -> bool:
    """Whether the least-area strip between two closed polygons is smaller with the second one reversed."""
    first, second = (points[_thinned(points)] for points in (first, second))
    return minimum_area_strip(first, second[::-1])[1] < minimum_area_strip(first, second)[1]


def _thinned(points: OtherRim) -> Int[np.ndarray, " k"]:
    return np.arange(0, len(points), math.ceil(len(points) / _MOST_POINTS))


def discrete_annulus(
    first: Rim, second: OtherRim, *, relative_change: float = FIRST_CHANGE
) -> tuple[PlaneTriangulation, Disk]:
    """A triangulated annulus of stationary area between two polygons, both with it on their left.

    The strip of least area gives initial positions of the vertices on a round annulus, which is meshed and mapped to a
    surface of stationary area. Then it is remeshed twice on the round annulus to which this surface is conformal: the
    harmonic function that is 0 on one rim and 1 on the other, and its flux through the rims, give the positions.

    Raises:
        DomainError: no round annulus can be meshed with the rims' vertices.

    Source: Pinkall & Polthier, Experim. Math. 2 (1993), for the descent.
    """
    points = np.concatenate([first, second])
    outer, inner = _strip_places(first, second)
    plane = triangulate_polygon(outer, holes=[inner])
    descent = descend_from_plane(plane, points, relative_change=FIRST_CHANGE)
    for _ in range(_ROUNDS):
        outer, inner = _conformal_places(descent.vertices, plane.faces, len(first), len(points))
        plane = triangulate_polygon(outer, holes=[inner])
        descent = descend_from_plane(plane, points, relative_change=relative_change)
    return plane, descent


def ruled_annulus(first: Rim, second: OtherRim, target: float) -> tuple[PlaneTriangulation, Float[np.ndarray, "v 3"]]:
    """A triangulated round annulus, mapped to straight lines between two polygons. Its area is not minimised.

    `target` is the edge length in space, and all else is as for `discrete_annulus`.
    """
    rims = (first, second)
    places = _strip_places(first, second)
    length = sum(float(edge_lengths(points).sum()) for points in rims) / 2
    # wanted lengths in proportion to the distance from the centre, on a polar grid
    radii = np.geomspace(np.abs(places[1]).min(), np.abs(places[0]).max(), _GRID)
    samples = (radii[:, None] * np.exp(2j * np.pi * np.arange(_GRID) / _GRID)).ravel()
    lengths = 2 * np.pi * np.abs(samples) * target / length
    size = SizeField(decay=GROWTH, samples=samples, lengths=lengths, neighbours=4)
    plane = triangulate_polygon(places[0], size, holes=[places[1]], seconds=seconds_left())
    inner = plane.points[plane.boundary_size :]
    share = (np.log(np.abs(inner)) / math.log(abs(places[1][0])))[:, None]
    ends = [
        np.stack([np.interp(np.angle(inner), np.angle(z), column, period=2 * np.pi) for column in points.T], axis=1)
        for z, points in zip(places, rims, strict=True)
    ]
    return plane, np.concatenate([first, second, (1 - share) * ends[0] + share * ends[1]])


def _strip_places(first: Rim, second: OtherRim) -> Places:
    """Positions on a round annulus: angles by the strip of least area, radii by its mean width."""
    kept = [_thinned(p) for p in (first, second)]
    faces, area = minimum_area_strip(first[kept[0]], second[kept[1]])
    turn = np.exp(2j * np.pi * (np.arange(len(faces)) + 0.5) / len(faces))
    total = np.zeros(len(kept[0]) + len(kept[1]), dtype=np.complex128)
    for corner in faces.T:
        np.add.at(total, corner, turn)
    angles = np.split(np.angle(total), [len(kept[0])])
    length = sum(float(edge_lengths(points).sum()) for points in (first, second)) / 2
    inner = math.exp(-2 * np.pi * area / length**2)
    places = []
    for sign, some, index, points in zip((1, -1), angles, kept, (first, second), strict=True):
        # increasing angles, interpolated between the points kept
        turned = np.unwrap(sign * some)
        ends = np.append(index, len(points)), np.append(turned, turned[0] + 2 * np.pi)
        places.append(np.exp(1j * sign * np.interp(np.arange(len(points)), *ends)))
    return places[0], inner * places[1]


def _conformal_places(vertices: Vertices, faces: Faces, m: int, rim: int) -> Places:
    """Positions of the rims' vertices on the round annulus that a discrete annulus is conformal to."""
    laplacian = mollified_laplacian(vertices, faces)
    height = harmonic_extension(laplacian, np.repeat([0.0, 1.0], [m, rim - m])[:, None])
    flux = np.abs((laplacian @ height)[:rim, 0])
    energy = flux.sum() / 2
    modulus = 2 * np.pi / energy
    angles = []
    for part in (flux[:m], flux[m:]):
        step = np.pi * (part + np.roll(part, -1)) / part.sum()
        angles.append(np.cumsum(step) - step)
    shift = _best_rotation([vertices[:m], vertices[m:rim]], angles, modulus)
    return np.exp(1j * angles[0]), math.exp(-modulus) * np.exp(-1j * (angles[1] + shift))


def _best_rotation(rims: list[np.ndarray], angles: list[np.ndarray], modulus: float) -> float:
    """The rotation of the inner rim, which is clockwise, that minimises the energy of the annulus's harmonic map."""
    n = 256
    even = 2 * np.pi * np.arange(n) / n
    spectra = [
        np.fft.rfft([np.interp(even, at, column, period=2 * np.pi) for column in points.T], axis=1)
        for points, at in zip(rims, angles, strict=True)
    ]
    k = np.arange(n // 2 + 1)
    weight = -np.append(1 / modulus, k[1:] / np.sinh(np.minimum(k[1:] * modulus, 300.0)))
    energy = np.fft.irfft(weight * (spectra[0] * spectra[1]).sum(axis=0), n=n)
    # the second rim is at the angle −x − rotation
    return float(-even[int(energy.argmin())])
