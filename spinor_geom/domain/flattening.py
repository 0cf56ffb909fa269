"""Boundary first flattening of a discrete disk: boundary lengths kept, or as nearly as a simple domain allows."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.errors import DomainError
from spinor_geom.mesh.operators import (
    factor_symmetric,
    intrinsic_angles,
    intrinsic_laplacian,
    mollified_edge_lengths,
)

# Strengths of straightening, weakest first: weight of the size of u against the evenness of the smoothed curvature.
_STRENGTHS = (1e5, 1e4, 3e3, 1e3, 3e2, 1e2, 30.0, 10.0, 3.0, 1.0, 0.1)
# Widths of the smoothing as fractions of the boundary length: slow windings first, then ever more local tangles.
_WIDTHS = (0.06, 0.03, 0.015)

# gives the Dirichlet-to-Neumann matrix Λ of a disk's boundary
NeumannMatrix = Callable[[], Float[np.ndarray, "m m"]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Flattening:
    """Boundary of a plane domain conformal to a discrete disk.

    Attributes:
        boundary: the images of the disk's boundary vertices, counter-clockwise.
        log_scale: u at those vertices: logarithm of the length in the plane per length on the disk, mean of two edges.
        clearance: smallest distance across the outside between far parts of the boundary, in local edge lengths
            (infinite where no two parts come near).
    """

    boundary: Complex[np.ndarray, " m"]
    log_scale: Float[np.ndarray, " m"]
    clearance: float


def dirichlet_to_neumann(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], boundary_size: int
) -> tuple[NeumannMatrix, Float[np.ndarray, " m"]]:
    """Dirichlet-to-Neumann matrix Λ of a discrete disk and its boundary's turning angles k₀ when flattened at u = 0.

    A flattening with boundary log scale u turns by k₀ + Λu at its vertices; the turning sums to 2π. Λ is made when it
    is asked for: most boundaries are simple at u = 0.

    Args:
        vertices: the boundary vertices come first, in boundary order.
        faces: a disk, counter-clockwise.
        boundary_size: m.

    Source: Sawhney & Crane, "Boundary First Flattening", ACM TOG 37 (2018), sections 3 and 4.
    """
    m = boundary_size
    lengths = mollified_edge_lengths(vertices, faces)
    laplacian = intrinsic_laplacian(lengths, faces)
    defect = np.full(len(vertices), 2 * np.pi)
    defect -= np.bincount(faces.ravel(), intrinsic_angles(lengths).ravel(), minlength=len(vertices))
    turning = defect[:m] - np.pi
    if len(vertices) == m:
        return lambda: np.asarray(laplacian.toarray()), turning
    inner = factor_symmetric(laplacian[m:, m:])
    coupling = laplacian[:m, m:]

    def matrix() -> Float[np.ndarray, "m m"]:
        neumann = laplacian[:m, :m].toarray() - coupling @ inner.solve(coupling.T.toarray())
        return np.asarray((neumann + neumann.T) / 2)

    return matrix, turning - coupling @ inner.solve(defect[m:])


def flatten(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    boundary_size: int,
    *,
    clearance: float = 1.5,
    drawn: Callable[[Complex[np.ndarray, " m"]], Complex[np.ndarray, " k"]] | None = None,
) -> Flattening:
    """Flattens a discrete disk conformally, with boundary scale 1 where the result is a simple polygon.

    Where two parts of the boundary cross, or come nearer than `clearance` edges across the outside, u is the minimiser
    of α(|u|²/ℓ² + u·Λu/ℓ) + |S(k₀ + Λu)/ds − 2π/ℓ|² with a Gaussian smoothing S along the boundary of length ℓ: it
    straightens the slow winding and leaves corners alone. α is lowered until the boundary is clear. Small lobes, as
    ragged rims have them, are drawn in where that does not help (see `untangled`).

    Args:
        vertices: boundary vertices first, in boundary order.
        faces: a disk, counter-clockwise.
        boundary_size: number m of boundary vertices.
        clearance: smallest allowed gap in local edge lengths; smaller gaps are accepted if nothing larger is found.
        drawn: points in order of the curve that will be drawn through the boundary's vertices, which is to be simple
            too; without it their polygon is enough.

    Raises:
        DomainError: no simple domain was found.

    Source: Sawhney & Crane (2018) for u ↦ k₀ + Λu.
    """
    m = boundary_size
    neumann, turning = dirichlet_to_neumann(vertices, faces, m)
    edge = np.linalg.norm(np.roll(vertices[:m], -1, axis=0) - vertices[:m], axis=1)
    return flatten_boundary(edge, turning, neumann, clearance=clearance, drawn=drawn)


def flatten_boundary(
    edge: Float[np.ndarray, " m"],
    turning: Float[np.ndarray, " m"],
    neumann: NeumannMatrix,
    *,
    clearance: float,
    saws: bool = False,
    drawn: Callable[[Complex[np.ndarray, " m"]], Complex[np.ndarray, " k"]] | None = None,
) -> Flattening:
    """The boundary of `flatten` from edge lengths, turning angles at u = 0 and the matrix Λ.

    Args:
        edge: lengths.
        turning: angles in radians, their sum 2π.
        neumann: gives Λ.
        clearance: as for `flatten`.
        saws: leaves u·Λu out. The boundary may then turn to and fro from vertex to vertex, which rounding it off
            undoes, and has fewer notches where it winds about itself.
        drawn: as for `flatten`.

    Raises:
        DomainError: no simple domain was found.
    """
    laid_out = itertools.starmap(partial(lay_out, edge), _candidates(edge, turning, neumann, saws=saws))
    # tee: what was laid out in vain is not laid out again for its lobes
    plain, lobed = itertools.tee(polygon for polygon in laid_out if polygon is not None)
    for polygons in (plain, map(untangled, lobed)):
        flat = _least_straightened(polygons, edge, clearance, drawn)
        if flat is not None:
            return flat
    raise DomainError(
        f"no simple plane domain was found for a boundary of {len(edge)} vertices: it stays crossed however it is "
        "straightened; check that the loop does not cross itself"
    )


def _least_straightened(
    polygons: Iterable[Complex[np.ndarray, " m"] | None],
    edge: Float[np.ndarray, " m"],
    clearance: float,
    drawn: Callable[[Complex[np.ndarray, " m"]], Complex[np.ndarray, " k"]] | None,
) -> Flattening | None:
    """The first simple polygon with enough clearance; where none has, the first with half of it, or with any."""
    found: list[Flattening] = []
    for polygon in polygons:
        if polygon is None or not is_simple(polygon) or (drawn is not None and not is_simple(drawn(polygon))):
            continue
        found.append(
            Flattening(boundary=polygon, log_scale=log_scale_of(polygon, edge), clearance=outer_clearance(polygon))
        )
        if found[-1].clearance >= clearance:
            return found[-1]
    # little straightening comes before a little more room: polygons are in order of their straightening
    return next((flat for share in (0.5, 0.0) for flat in found if flat.clearance >= share * clearance), None)


def _candidates(
    edge: Float[np.ndarray, " m"], turning: Float[np.ndarray, " m"], neumann: NeumannMatrix, *, saws: bool
) -> Iterator[tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]]:
    """Turning angles and boundary log scales to try, the nearest to 0 first."""
    yield turning, np.zeros(len(edge))
    matrix = neumann()
    ds = (edge + np.roll(edge, 1)) / 2
    length = ds.sum()
    # S is blind to what changes from vertex to vertex: without Λ here slivers turn the boundary to and fro
    size = np.diag(ds) / length**2 + (0 if saws else matrix / length)
    for width in _WIDTHS:
        smooth = smoothing(edge, width)
        slope = smooth @ matrix
        normal = slope.T @ (ds[:, None] * slope)
        load = slope.T @ (ds * (2 * np.pi / length - smooth @ turning))
        for strength in _STRENGTHS:
            log_scale = np.linalg.solve(normal + strength * size, load)
            yield turning + matrix @ log_scale, log_scale


def smoothing(edge: Float[np.ndarray, " m"], width: float) -> Float[np.ndarray, "m m"]:
    """Gaussian means along a closed boundary, the width a share of its length: turning at vertices to curvature."""
    s = np.concatenate([[0.0], np.cumsum(edge)[:-1]]) / edge.sum()
    distance = np.abs(s[:, None] - s)
    smooth = np.exp(-0.5 * (np.minimum(distance, 1 - distance) / width) ** 2)
    return np.asarray(smooth / (smooth @ ((edge + np.roll(edge, 1)) / 2))[:, None])


def log_scale_of(polygon: Complex[np.ndarray, " m"], edge: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Logarithm of a polygon's edge lengths per given ones at its vertices, the mean of two edges each."""
    ratio = np.log(np.abs(np.roll(polygon, -1) - polygon) / edge)
    return np.asarray((ratio + np.roll(ratio, 1)) / 2)


def lay_out(
    edge: Float[np.ndarray, " m"], turning: Float[np.ndarray, " m"], log_scale: Float[np.ndarray, " m"]
) -> Complex[np.ndarray, " m"] | None:
    """Polygon with given turning at its vertices and edge lengths e^u, closed by the least relative change of lengths.

    Returns:
        The vertices, or None where closing would need an edge of negative length or all edges are parallel.
    """
    length = edge * np.exp((log_scale + np.roll(log_scale, -1)) / 2)
    direction = np.exp(1j * (np.cumsum(turning) - turning[0]))  # edge j runs after the turns at vertices 1 … j
    rows = np.stack([direction.real, direction.imag])
    gram = (rows * length) @ rows.T
    if np.linalg.matrix_rank(gram) < 2:
        return None
    closed = length * (1 - rows.T @ np.linalg.solve(gram, rows @ length))
    if closed.min() <= 0:
        return None
    return np.asarray(np.concatenate([[0.0], np.cumsum(closed * direction)[:-1]]))


def crossing_edges(polygon: Complex[np.ndarray, " m"]) -> Int[np.ndarray, "c 2"]:
    """Pairs i < j of edges of a closed polygon that cross; neighbours count where one folds back onto the other."""
    m = len(polygon)
    ends = np.stack([polygon, np.roll(polygon, -1)])
    edge, middle = ends[1] - ends[0], ends.mean(axis=0)
    half = 0.5 * np.abs(edge)
    tree = cKDTree(plane_coordinates(middle))
    # the share is for round-off: edges cross only where their middles are within half their lengths
    i, j = tree.query_pairs(2.001 * half.max(), output_type="ndarray").T
    near = (np.abs(middle[i] - middle[j]) <= 1.001 * (half[i] + half[j])) & (j - i > 1) & (j - i < m - 1)
    i, j = i[near], j[near]
    on_line = 1e-12 * np.abs(edge) * np.abs(polygon - polygon[0]).max()

    def apart(one: Int[np.ndarray, " k"], other: Int[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
        side = np.imag(np.conj(edge[one]) * (ends[:, other] - polygon[one]))
        # points on the line of an edge are on neither side: edges of one straight side do not cross by round-off
        side[np.abs(side) <= on_line[one]] = 0
        return np.asarray(side[0] * side[1] < 0)

    hit = apart(i, j)
    hit[hit] = apart(j[hit], i[hit])
    turn = np.conj(edge) * np.roll(edge, -1)
    back = np.flatnonzero((turn.imag == 0) & (turn.real < 0))
    folds = np.sort(np.stack([back, (back + 1) % m], axis=1), axis=1)
    pairs = np.concatenate([np.stack([i[hit], j[hit]], axis=1), folds])
    return np.asarray(pairs[np.lexsort(pairs.T[::-1])])


def is_simple(polygon: Complex[np.ndarray, " m"]) -> bool:
    """Whether a closed polygon runs counter-clockwise, stands still nowhere and does not cross itself."""
    after = np.roll(polygon, -1)
    edges = np.abs(after - polygon)
    # a shorter edge is lost in the arc length around
    moves = bool((edges > np.finfo(np.float64).eps * edges.sum()).all())
    return moves and bool(np.imag(np.conj(polygon) * after).sum() > 0) and not len(crossing_edges(polygon))


def untangled(polygon: Complex[np.ndarray, " m"]) -> Complex[np.ndarray, " m"] | None:
    """A simple polygon near to one that is crossed only by small lobes of itself; None where far parts cross.

    The vertices of each lobe are drawn towards the chord that closes it until it is gone. Ragged rims of scans unfold
    with such lobes; any simple domain will do there, and only a few edges are moved.
    """
    z: Complex[np.ndarray, " m"] = polygon.copy()
    m = len(polygon)
    for _ in range(60):
        pairs = crossing_edges(z)
        if not len(pairs):
            return z
        first, last = pairs.T
        forwards = last - first
        swap = forwards > m - forwards
        first, last = np.where(swap, last, first), np.where(swap, first, last)
        size = np.mod(last - first, m)  # inner vertices of the lobe: first + 1 … last
        if size.max() > min(24, m // 3):
            return None
        for start, count in zip(first.tolist(), size.tolist(), strict=True):
            inner = (start + 1 + np.arange(count)) % m
            share = np.arange(1, count + 1) / (count + 1)
            chord = z[start] + share * (z[(start + count + 1) % m] - z[start])
            z[inner] += 0.5 * (chord - z[inner])
    return None


def outer_clearance(polygon: Complex[np.ndarray, " m"]) -> float:
    """Smallest gap across the outside between far parts of a simple polygon, in local edge lengths.

    Far: the way along the boundary is more than four times the gap plus six edges.
    """
    a, b = polygon, np.roll(polygon, -1)
    edge = np.abs(b - a)
    local = (edge + np.roll(edge, 1)) / 2
    s = np.concatenate([[0.0], np.cumsum(edge)[:-1]])
    along = np.abs(s[:, None] - s)
    along = np.minimum(along, edge.sum() - along)
    gap = np.abs(a[:, None] - a)
    relative = gap / np.maximum(local[:, None], local)
    i, j = np.nonzero(np.triu((relative < 8) & (along > 4 * gap + 6 * np.maximum(local[:, None], local))))
    if not len(i):
        return np.inf
    order = np.argsort(relative[i, j])
    i, j = i[order], j[order]
    # the smallest gaps first: the first that lies outside all along is the answer
    for start in range(0, len(i), 256):
        block = slice(start, start + 256)
        along_gap = a[i[block], None] + np.array([0.2, 0.5, 0.8]) * (a[j[block]] - a[i[block]])[:, None]
        d = a - along_gap[:, :, None]
        outside = (np.angle(np.roll(d, -1, axis=2) * np.conj(d)).sum(axis=2) < np.pi).all(axis=1)
        if outside.any():
            first = start + int(np.argmax(outside))
            return float(relative[i[first], j[first]])
    return np.inf
