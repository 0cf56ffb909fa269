"""Zeros of a holomorphic function inside a plane domain, by the argument principle.

The change of arg f along closed paths counts the zeros inside. Triangles of Ω's triangulation that hold zeros are split
until they are small; then the moment (1/2πi)∮ z f′/f dz on a circle around each cluster gives its centre to round-off.

Source: Delves & Lyness, "A numerical method for locating the zeros of an analytic function", Math. Comp. 21 (1967).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from torch import Tensor

from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import ZeroOnContourError

HolomorphicFunction = Callable[[Complex[Tensor, " n"]], Complex[Tensor, " n"]]

# zeros nearer to each other than this share of the domain's diameter count as one multiple zero
RESOLUTION = 1e-4
# an edge is followed when arg f changes by less than this between samples, and halving the steps changes nothing
_LARGEST_STEP = np.pi / 3
_FIRST_INTERVALS = 4
_MOST_INTERVALS = 1 << 12
# (where an edge is split, direction of the shift of inner vertices): when a zero lies on a path, the next one is taken
_ATTEMPTS = ((0.4837, 0.7), (0.5291, 2.9), (0.4613, 4.4), (0.5087, 5.3))
# inner vertices are shifted by this share of their shortest edge: a zero likes to lie on a vertex, such as a centre
_SHIFT = 0.07
_CIRCLE_NODES = 128
# a polynomial of so many zeros is still solved to a few digits from its sums of powers
_MOST_ZEROS_AT_ONCE = 6
_BLOCK = 1 << 14


@dataclass(frozen=True, kw_only=True, eq=False)
class Zero:
    """A zero of a holomorphic function.

    Attributes:
        z: where; for a cluster of zeros nearer to each other than the resolution their mean.
        order: multiplicity.
    """

    z: complex
    order: int


@dataclass(frozen=True, kw_only=True, eq=False)
class _Edges:
    """Directed paths: straight from `start` to `end`, or along ∂Ω where `arc` (from and to parameter) is not NaN."""

    start: Complex[np.ndarray, " e"]
    end: Complex[np.ndarray, " e"]
    arc: Float[np.ndarray, "e 2"]

    def points(self, domain: PlaneDomain, s: Float[np.ndarray, " k"]) -> Complex[np.ndarray, "e k"]:
        """Points at the fractions s of each path."""
        straight = self.start[:, None] + s * (self.end - self.start)[:, None]
        curved = ~np.isnan(self.arc[:, 0])
        t = self.arc[curved]
        straight[curved] = domain.point(t[:, :1] + s * (t[:, 1:] - t[:, :1]))
        return np.asarray(straight)

    def take(self, index: Int[np.ndarray, " k"]) -> _Edges:
        return _Edges(start=self.start[index], end=self.end[index], arc=self.arc[index])


def find_zeros(
    function: HolomorphicFunction, domain: PlaneDomain, *, resolution: float = RESOLUTION
) -> tuple[Zero, ...]:
    """All zeros of a function inside ∂Ω, with multiplicity.

    Args:
        function: holomorphic on Ω and its boundary, evaluated point by point on complex128 tensors.
        domain: Ω.
        resolution: zeros nearer to each other than this share of the domain's diameter are reported as one.

    Returns:
        The zeros, ordered by real and then imaginary part; simple and multiple ones are exact to round-off.

    Raises:
        ZeroOnContourError: the function has a zero on ∂Ω or so near to it that it cannot be placed.
    """
    edges = _boundary_edges(domain)
    count = round(float(_turning(function, domain, edges).sum() / (2 * np.pi)))
    if count == 0:
        return ()
    rim = edges.points(domain, np.linspace(0, 1, 8, endpoint=False)).ravel()
    found = _locate(function, domain, count, rim, resolution * domain.diameter)
    centres = np.array([zero.z for zero in found])
    radii = (0.5 * _clearance(centres, rim)).tolist()
    zeros = [_polish(function, zero, radius) for zero, radius in zip(found, radii, strict=True)]
    return tuple(sorted(zeros, key=lambda zero: (zero.z.real, zero.z.imag)))


def count_zeros(function: HolomorphicFunction, centre: complex, radius: float) -> int:
    """Number of zeros inside a circle, with multiplicity.

    Raises:
        ZeroOnContourError: there is a zero on the circle.
    """
    intervals = _CIRCLE_NODES // 4
    while intervals <= _MOST_INTERVALS:
        values = _evaluate(function, centre + radius * np.exp(2j * np.pi * np.arange(intervals) / intervals))
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.angle(np.roll(values, -1) / values)
        if np.abs(step).max() < _LARGEST_STEP:
            return round(float(step.sum() / (2 * np.pi)))
        intervals *= 4
    raise ZeroOnContourError(z=complex(centre + radius))


def _evaluate(function: HolomorphicFunction, z: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
    flat = torch.tensor(np.ascontiguousarray(z)).reshape(-1)
    with torch.no_grad():
        values = torch.cat([function(block) for block in torch.split(flat, _BLOCK)])
    return np.asarray(values.cpu().resolve_conj().numpy().reshape(z.shape))


def _turning(function: HolomorphicFunction, domain: PlaneDomain, edges: _Edges) -> Float[np.ndarray, " e"]:
    """Change of arg f along each path, by sampling each finely enough.

    Raises:
        ZeroOnContourError: f has a zero on a path, or too near to it.
    """
    turning = np.full(len(edges.start), np.nan)
    todo = np.arange(len(edges.start))
    before = np.full(len(todo), np.nan)
    intervals = _FIRST_INTERVALS
    while len(todo) and intervals <= _MOST_INTERVALS:
        values = _evaluate(function, edges.take(todo).points(domain, np.linspace(0, 1, intervals + 1)))
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.angle(values[:, 1:] / values[:, :-1])
            now = step.sum(axis=1)
            done = (np.abs(step).max(axis=1) < _LARGEST_STEP) & (np.abs(now - before) < 1e-3)
        turning[todo[done]] = now[done]
        todo, before = todo[~done], now[~done]
        intervals *= 2
    if len(todo):
        raise ZeroOnContourError(z=complex(edges.start[todo[0]]))
    return turning


def _boundary_edges(domain: PlaneDomain) -> _Edges:
    vertices = domain.vertices
    return _Edges(start=vertices, end=vertices[rim_successors(domain.triangulation.rims)], arc=domain.arcs)


def _locate(
    function: HolomorphicFunction, domain: PlaneDomain, count: int, rim: Complex[np.ndarray, " n"], size: float
) -> list[Zero]:
    """The zeros, several nearer than `size` as one, each to a few digits at least."""
    failure = ZeroOnContourError(z=complex(domain.boundary.vertices[0]))
    for fraction, angle in _ATTEMPTS:
        try:
            found = _search(function, domain, rim, size, fraction=fraction, angle=angle)
        except ZeroOnContourError as error:
            failure = error
            continue
        if sum(zero.order for zero in found) == count:
            return found
    raise failure


def _search(
    function: HolomorphicFunction,
    domain: PlaneDomain,
    rim: Complex[np.ndarray, " n"],
    size: float,
    *,
    fraction: float,
    angle: float,
) -> list[Zero]:
    """Splits cells that hold zeros until a circle separates each group of them from all else."""
    found: list[Zero] = []
    corners, arcs = _cells(domain, angle)
    while True:
        winding = _cell_windings(function, domain, corners, arcs)
        hit = winding != 0
        corners, arcs, winding = corners[hit], arcs[hit], winding[hit]
        if len(winding) == 0:
            return found
        label, centre, radius, order = _groups(corners, winding)
        known = np.array([zero.z for zero in found], dtype=np.complex128)
        clear = _clearance(centre, np.append(rim, known), radius)
        settled = (order == 0) & (clear > radius)
        for k in np.flatnonzero((clear > 2 * radius) & (order > 0) & (order <= _MOST_ZEROS_AT_ONCE)):
            circle = complex(centre[k]), float(np.sqrt(radius[k] * clear[k]))
            inside = _zeros_in_circle(function, *circle, int(order[k]), size)
            settled[k] = sum(zero.order for zero in inside) == order[k]
            found += inside if settled[k] else []
        rest = ~settled[label]
        if rest.any() and np.abs(corners[rest] - np.roll(corners[rest], 1, axis=1)).max() < size / 2:
            raise ZeroOnContourError(z=complex(centre[~settled][0]))
        corners, arcs = _split(domain, corners[rest], arcs[rest], fraction)


def _cells(domain: PlaneDomain, angle: float) -> tuple[Complex[np.ndarray, "c 3"], Float[np.ndarray, "c 3 2"]]:
    """The triangles that tile Ω, inner vertices shifted, those at the boundary with the curve ∂Ω as their side."""
    mesh = domain.triangulation
    m, points = mesh.boundary_size, mesh.points.copy()
    length = np.abs(points[mesh.edges[:, 0]] - points[mesh.edges[:, 1]])
    shortest = np.full(len(points), np.inf)
    np.minimum.at(shortest, mesh.edges.ravel(), np.repeat(length, 2))
    points[m:] += _SHIFT * np.exp(1j * angle) * shortest[m:]
    ahead = np.roll(mesh.faces, -1, axis=1)
    first = np.where(mesh.faces < m, mesh.faces, 0)
    on_rim = (mesh.faces < m) & (ahead == rim_successors(mesh.rims)[first])
    arcs = np.where(on_rim[..., None], domain.arcs[first], np.nan)
    return points[mesh.faces], arcs


def _cell_windings(
    function: HolomorphicFunction,
    domain: PlaneDomain,
    corners: Complex[np.ndarray, "c 3"],
    arcs: Float[np.ndarray, "c 3 2"],
) -> Int[np.ndarray, " c"]:
    """Number of zeros in each cell."""
    start, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    # a side shared by two cells is followed once
    swap = (start.real > end.real) | ((start.real == end.real) & (start.imag > end.imag))
    low, high = np.where(swap, end, start), np.where(swap, start, end)
    _, first, inverse = np.unique(np.stack([low, high], axis=1), axis=0, return_index=True, return_inverse=True)
    edges = _Edges(start=start, end=end, arc=arcs.reshape(-1, 2))
    turning = _turning(function, domain, edges.take(first))[inverse.ravel()]
    same_way = swap == swap[first][inverse.ravel()]
    total = np.where(same_way, turning, -turning).reshape(-1, 3).sum(axis=1)
    return np.asarray(np.rint(total / (2 * np.pi)), dtype=np.int64)


def _split(
    domain: PlaneDomain, corners: Complex[np.ndarray, "c 3"], arcs: Float[np.ndarray, "c 3 2"], fraction: float
) -> tuple[Complex[np.ndarray, "d 3"], Float[np.ndarray, "d 3 2"]]:
    """Four cells for each: three at its corners, one in its middle."""
    edges = _Edges(start=corners.ravel(), end=np.roll(corners, -1, axis=1).ravel(), arc=arcs.reshape(-1, 2))
    middle = edges.points(domain, np.array([fraction])).reshape(-1, 3)
    t = arcs[..., :1] + fraction * (arcs[..., 1:] - arcs[..., :1])
    head = np.concatenate([arcs[..., :1], t], axis=-1)  # from a side's start to its middle
    tail = np.concatenate([t, arcs[..., 1:]], axis=-1)
    straight = np.full_like(head[:, 0], np.nan)
    (a, b, c), (ab, bc, ca) = corners.T, middle.T
    cells = [
        ([a, ab, ca], [head[:, 0], straight, tail[:, 2]]),
        ([ab, b, bc], [tail[:, 0], head[:, 1], straight]),
        ([ca, bc, c], [straight, tail[:, 1], head[:, 2]]),
        ([ab, bc, ca], [straight, straight, straight]),
    ]
    return (
        np.concatenate([np.stack(points, axis=1) for points, _ in cells]),
        np.concatenate([np.stack(sides, axis=1) for _, sides in cells]),
    )


def _groups(
    corners: Complex[np.ndarray, "c 3"], winding: Int[np.ndarray, " c"]
) -> tuple[Int[np.ndarray, " c"], Complex[np.ndarray, " g"], Float[np.ndarray, " g"], Int[np.ndarray, " g"]]:
    """Cells that lie near each other: group of each cell; centre, radius and number of zeros of each group."""
    middle = corners.mean(axis=1)
    reach = np.abs(corners - middle[:, None]).max(axis=1)
    near = np.argwhere(np.abs(middle[:, None] - middle) <= reach[:, None] + reach)
    graph = coo_array((np.ones(len(near)), near.T), shape=(len(middle), len(middle)))
    groups, label = connected_components(graph, directed=False)
    share = np.bincount(label, minlength=groups)
    centre = (np.bincount(label, weights=middle.real) + 1j * np.bincount(label, weights=middle.imag)) / share
    radius = np.zeros(groups)
    np.maximum.at(radius, label, np.abs(middle - centre[label]) + reach)
    order = np.rint(np.bincount(label, weights=winding, minlength=groups)).astype(np.int64)
    return label.astype(np.int64), centre, radius, order


def _clearance(
    centre: Complex[np.ndarray, " g"], others: Complex[np.ndarray, " n"], radius: Float[np.ndarray, " g"] | float = 0.0
) -> Float[np.ndarray, " g"]:
    """Distance of each centre from the disks around the other centres and from some other points."""
    apart = np.abs(centre[:, None] - centre) - radius
    np.fill_diagonal(apart, np.inf)
    return np.asarray(np.minimum(apart.min(axis=1), np.abs(centre[:, None] - others).min(axis=1)))


def _moments(function: HolomorphicFunction, centre: complex, radius: float, count: int) -> Complex[np.ndarray, " k"]:
    """Sums of the powers 0 … count of (z − centre)/radius over the zeros inside a circle.

    The trapezoidal rule's error falls geometrically with its nodes, as fast as other zeros are far from the circle.

    Raises:
        ZeroOnContourError: a node is a zero.
    """
    unit = np.exp(2j * np.pi * np.arange(_CIRCLE_NODES) / _CIRCLE_NODES)
    value = _evaluate(function, centre + radius * unit)
    if not value.all():
        raise ZeroOnContourError(z=complex(centre))
    # on the circle f is a power series in w = (z − centre)/radius, and its coefficients give w f′
    derivative = np.fft.ifft(np.fft.fft(value) * np.arange(_CIRCLE_NODES))
    return np.asarray((derivative / value * unit ** np.arange(count + 1)[:, None]).mean(axis=1))


def _zeros_in_circle(
    function: HolomorphicFunction, centre: complex, radius: float, order: int, size: float
) -> list[Zero]:
    """The zeros in a circle, roots of the polynomial with their sums of powers; none where there are not `order`."""
    moment = _moments(function, centre, radius, order)
    if not abs(moment[0] - order) < 0.1:
        return []
    coefficients = np.ones(order + 1, dtype=np.complex128)  # highest first, by Newton's identities
    for k in range(1, order + 1):
        coefficients[k] = -(coefficients[:k][::-1] * moment[1 : k + 1]).sum() / k
    roots = centre + radius * np.roots(coefficients)
    # a k-fold root is only known to round-off^(1/k)
    nearest = max(size, 10 * radius * np.finfo(np.float64).eps ** (1 / order)) if order > 1 else 0.0
    near = np.argwhere(np.abs(roots[:, None] - roots) <= nearest)
    groups, label = connected_components(coo_array((np.ones(len(near)), near.T), shape=(order, order)), directed=False)
    return [Zero(z=complex(roots[label == k].mean()), order=int((label == k).sum())) for k in range(groups)]


def _polish(function: HolomorphicFunction, zero: Zero, radius: float) -> Zero:
    """The zero moved to the mean of those inside a circle around it."""
    moment = _moments(function, zero.z, radius, 1)
    if not abs(moment[0] - zero.order) < 0.1:
        raise ZeroOnContourError(z=zero.z)
    return Zero(z=complex(zero.z + radius * moment[1] / zero.order), order=zero.order)
