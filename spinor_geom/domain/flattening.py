"""Boundary first flattening: boundary lengths kept, or as nearly as a simple plane domain allows."""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float, Int

from spinor_geom.domain.delaunay import Rims, rim_successors
from spinor_geom.domain.polygons import bound_domain, outer_clearance, untangled
from spinor_geom.errors import DomainError
from spinor_geom.mesh.operators import factor_symmetric, intrinsic_angles, intrinsic_laplacian, mollified_edge_lengths

Vertices = Float[np.ndarray, "n 3"]
Faces = Int[np.ndarray, "f 3"]
PerVertex = Float[np.ndarray, " m"]  # one number for each vertex of the boundary, rim by rim
Matrix = Float[np.ndarray, "m m"]
Polygon = Complex[np.ndarray, "_"]

# Strengths of straightening, weakest first: weight of the size of u against the evenness of the smoothed curvature.
_STRENGTHS = (1e5, 1e4, 3e3, 1e3, 3e2, 1e2, 30.0, 10.0, 3.0, 1.0, 0.1)
_WIDTHS = (0.06, 0.03, 0.015)  # of smoothing, by the boundary length: slow windings first, then more local tangles
CLEARANCE = 1.5  # between far parts of the outer rim, across the outside, in local edge lengths
# Newton steps to holes that close, and the log scale at which they have come to nothing: floats tell edges no more.
_CLOSING_STEPS, _LARGEST_SCALE = 6, -float(np.log(np.finfo(np.float64).eps))

NeumannMatrix = Callable[[], Matrix]  # gives the Dirichlet-to-Neumann matrix Λ of a surface's boundary
# makes of polygons the points of the curves that are drawn through their vertices
Drawn = Callable[[tuple[Polygon, ...]], tuple[Polygon, ...]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Flattening:
    """Boundary of a plane domain conformal to a discrete surface."""

    rims: tuple[Polygon, ...]  # the outer boundary's image, counter-clockwise, then those of holes, clockwise
    log_scale: PerVertex  # u: logarithm of the length in the plane per length in space, mean of two edges
    clearance: float  # smallest gap across the outside between far parts of the outer rim, in local edges

    @property
    def boundary(self) -> Complex[np.ndarray, " m"]:
        """The images of all boundary vertices."""
        return np.concatenate(self.rims)


def dirichlet_to_neumann(vertices: Vertices, faces: Faces, boundary_size: int) -> tuple[NeumannMatrix, PerVertex]:
    """Dirichlet-to-Neumann matrix Λ of a discrete surface and its boundary's turning k₀ when flattened at u = 0.

    A flattening with boundary log scale u turns by k₀ + Λu at its vertices; a disk's turning sums to 2π. Λ is made when
    it is asked for: most boundaries are simple at u = 0. The boundary's vertices come first, in order, rim by rim.

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

    def matrix() -> Matrix:
        neumann = laplacian[:m, :m].toarray() - coupling @ inner.solve(coupling.T.toarray())
        return np.asarray((neumann + neumann.T) / 2)

    return matrix, turning - coupling @ inner.solve(defect[m:])


def flatten(
    vertices: Vertices, faces: Faces, boundary_size: int, *, holes: Rims = (), drawn: Drawn | None = None
) -> Flattening:
    """Flattens a discrete surface conformally, with boundary scale as near to 1 as a simple boundary allows.

    A disk's boundary turns by 2π and closes at u = 0. Around holes |u|²/ℓ² + u·Λu/ℓ is least under the conditions that
    each rim turns by −2π and closes, by Newton's method. Each rim is laid out by itself; the place, turn and scale of
    the holes are those of least conformal energy, which is Dirichlet's less the area.

    Where rims cross, or two parts of the outer one come nearer than 1.5 edges across the outside, u is the
    minimiser of α(|u|²/ℓ² + u·Λu/ℓ) + |S(k₀ + Λu)/ds − κ|² with κ the curvature of circles as long as the rims and a
    Gaussian smoothing S along them: it straightens the slow winding and leaves corners alone. α is lowered until the
    boundary is clear. Small lobes, as ragged rims have them, are drawn in where that does not help (see `untangled`).

    The first vertices are the m of the boundary: those of the outer rim, then those of the holes, in order with the
    surface on their left; the faces run counter-clockwise. The curves that will be drawn through the rims' vertices are
    to bound a domain too. A DomainError tells that no simple domain was found.

    Source: Sawhney & Crane (2018) for u ↦ k₀ + Λu; Lévy et al., "Least squares conformal maps", ACM TOG 21 (2002), for
    the conformal energy.
    """
    neumann, turning = dirichlet_to_neumann(vertices, faces, boundary_size)
    after = rim_successors((boundary_size - sum(holes), *holes))
    edge = np.linalg.norm(vertices[after] - vertices[:boundary_size], axis=1)
    return flatten_boundary(edge, turning, neumann, holes=holes, drawn=drawn)


def flatten_boundary(
    edge: PerVertex,
    turning: PerVertex,
    neumann: NeumannMatrix,
    *,
    clearance: float = CLEARANCE,
    holes: Rims = (),
    saws: bool = False,
    drawn: Drawn | None = None,
) -> Flattening:
    """The boundary of `flatten`, which raises alike, from edge lengths, turning angles at u = 0 and the matrix Λ.

    A gap below the clearance, in local edge lengths, is accepted if no larger one is found. `saws` leaves u·Λu out: the
    boundary may then turn to and fro from vertex to vertex, which rounding off undoes, and winds with fewer notches.
    """
    rims = (len(edge) - sum(holes), *holes)
    # tee: what was laid out in vain is not laid out again for its lobes
    plain, lobed = itertools.tee(_laid_out(edge, turning, neumann, rims, saws=saws))
    for boundaries in (plain, (tuple(map(untangled, boundary)) for boundary in lobed)):
        flat = _least_straightened(boundaries, edge, clearance, drawn)
        if flat is not None:
            return flat
    raise DomainError(
        f"no simple plane domain was found for a boundary of {' + '.join(map(str, rims))} vertices: it stays crossed "
        "however it is straightened; check that the loop does not cross itself"
    )


def _least_straightened(
    boundaries: Iterable[tuple[Polygon | None, ...]], edge: PerVertex, clearance: float, drawn: Drawn | None
) -> Flattening | None:
    """The first boundary of a domain with enough clearance; where none has, the first with half of it, or with any."""
    found: list[Flattening] = []
    for boundary in boundaries:
        rims = tuple(rim for rim in boundary if rim is not None)
        if len(rims) < len(boundary) or not bound_domain(rims) or (drawn is not None and not bound_domain(drawn(rims))):
            continue
        parts = np.split(edge, np.cumsum([len(rim) for rim in rims[:-1]]))
        ratios = [np.log(np.abs(np.roll(rim, -1) - rim) / length) for rim, length in zip(rims, parts, strict=True)]
        scale = np.concatenate([(ratio + np.roll(ratio, 1)) / 2 for ratio in ratios])
        found.append(Flattening(rims=rims, log_scale=scale, clearance=outer_clearance(rims[0])))
        if found[-1].clearance >= clearance:
            return found[-1]
    # little straightening comes before a little more room: boundaries are in order of their straightening
    return next((flat for share in (0.5, 0.0) for flat in found if flat.clearance >= share * clearance), None)


def _laid_out(
    edge: PerVertex, turning: PerVertex, neumann: NeumannMatrix, rims: Rims, *, saws: bool
) -> Iterator[tuple[Polygon, ...]]:
    """The rims as polygons, for one boundary log scale after the other, the nearest to 0 first."""
    ends = np.cumsum(rims[:-1])
    for turned, log_scale, matrix in _candidates(edge, turning, neumann, rims, saws=saws):
        parts = zip(*(np.split(each, ends) for each in (edge, turned, log_scale)), strict=True)
        polygons = [polygon for part in parts if (polygon := lay_out(*part)) is not None]
        if len(polygons) == len(rims):
            yield tuple(polygons) if matrix is None else (polygons[0], *_placed(polygons, matrix))


def _candidates(
    edge: PerVertex, turning: PerVertex, neumann: NeumannMatrix, rims: Rims, *, saws: bool
) -> Iterator[tuple[PerVertex, PerVertex, Matrix | None]]:
    """Turning angles and boundary log scales to try, the nearest to 0 first, with Λ where there are holes."""
    ends = np.cumsum(rims)
    holes = [slice(start, end) for start, end in itertools.pairwise(ends.tolist())]
    if not holes:
        yield turning, np.zeros(len(edge)), None
    matrix = neumann()
    if not np.isfinite(matrix).all():
        return
    parts = np.split(edge, ends[:-1])
    ds = np.concatenate([(part + np.roll(part, 1)) / 2 for part in parts])
    length = ds.sum() / len(rims)
    even = np.concatenate([np.full(len(part), 2 * np.pi / part.sum()) for part in parts])
    even[ends[0] :] *= -1
    # S is blind to what changes from vertex to vertex: without Λ here slivers turn the boundary to and fro
    size = np.diag(ds) / length**2 + (0 if saws else matrix / length)

    def systems() -> Iterator[tuple[Matrix, PerVertex]]:
        if holes:
            yield size, np.zeros(len(edge))
        for width in _WIDTHS:
            smooth = scipy.linalg.block_diag(*(smoothing(part, width) for part in parts))
            slope = smooth @ matrix
            normal, load = slope.T @ (ds[:, None] * slope), slope.T @ (ds * (even - smooth @ turning))
            yield from ((normal + strength * size, load) for strength in _STRENGTHS)

    for normal, load in systems():
        try:
            factor = scipy.linalg.cho_factor(normal)
        except np.linalg.LinAlgError:  # slivers: Λ is so large that rounding hides the size of u
            continue
        u = scipy.linalg.cho_solve(factor, load)
        if not np.abs(u).max() < _LARGEST_SCALE:
            continue
        for _ in range(_CLOSING_STEPS if holes else 0):
            gap, slope = map(
                np.concatenate, zip(*(_gap(u, edge, turning, matrix, hole) for hole in holes), strict=True)
            )
            along = scipy.linalg.cho_solve(factor, slope.T)
            # a hole that lies straight at first bends to neither side sooner
            u = u - along @ np.linalg.lstsq(slope @ along, gap, rcond=None)[0]
            if not np.abs(u).max() < _LARGEST_SCALE:
                break
        else:
            yield turning + matrix @ u, u, matrix if holes else None


def _gap(
    u: PerVertex, edge: PerVertex, turning: PerVertex, neumann: Matrix, rim: slice
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 m"]]:
    """Both coordinates of a hole's gap, by its length, and its turning beyond −2π at log scale u; the slopes by u."""
    flux = neumann[rim]
    turned = turning[rim] + flux @ u
    count = len(turned)
    own = np.arange(count)
    after = np.roll(own, -1)
    step = edge[rim] * np.exp((u[rim] + u[rim][after]) / 2 + 1j * np.cumsum(turned))
    # directions are taken from their mean: from that of the first edge, a rim far from closed would bend there
    ahead = step[::-1].cumsum()[::-1] - step.sum() * (1 - own / count)
    slope = 1j * (ahead @ flux)
    slope[rim] += (step + np.roll(step, 1)) / 2
    total = np.abs(step).sum()
    gap, slope = step.sum() / total, slope / total
    return (
        np.array([gap.real, gap.imag, turned.sum() + 2 * np.pi]),
        np.stack([slope.real, slope.imag, flux.sum(axis=0)]),
    )


def _placed(rims: Sequence[Polygon], neumann: Matrix) -> list[Polygon]:
    """The holes where the conformal energy ½ z*Λz − area of t + βz for each is least."""
    outer, *shapes = rims
    shapes = [shape - shape.mean() for shape in shapes]
    basis = scipy.linalg.block_diag(*(np.stack([np.ones_like(shape), shape], axis=1) for shape in shapes))
    m = len(outer)
    quadratic = basis.conj().T @ neumann[m:, m:] @ basis
    areas = [np.imag(np.conj(shape) * np.roll(shape, -1)).sum() for shape in shapes]  # twice, and negative
    quadratic[np.diag_indices_from(quadratic)] -= np.ravel([(0.0, area) for area in areas])
    moves = np.linalg.solve(quadratic, -basis.conj().T @ (neumann[m:, :m] @ outer)).reshape(-1, 2)
    return [t + beta * shape for (t, beta), shape in zip(moves, shapes, strict=True)]


def smoothing(edge: PerVertex, width: float) -> Matrix:
    """Gaussian means along a closed boundary, the width a share of its length: turning at vertices to curvature."""
    s = np.concatenate([[0.0], np.cumsum(edge)[:-1]]) / edge.sum()
    distance = np.abs(s[:, None] - s)
    smooth = np.exp(-0.5 * (np.minimum(distance, 1 - distance) / width) ** 2)
    return np.asarray(smooth / (smooth @ ((edge + np.roll(edge, 1)) / 2))[:, None])


def lay_out(edge: PerVertex, turning: PerVertex, log_scale: PerVertex) -> Complex[np.ndarray, " m"] | None:
    """Polygon of given turning and edge lengths e^u, closed by the least relative change of these; None if none is."""
    length = edge * np.exp((log_scale + np.roll(log_scale, -1)) / 2)
    direction = np.exp(1j * (np.cumsum(turning) - turning[0]))  # edge j runs after the turns at vertices 1 … j
    rows = np.stack([direction.real, direction.imag])
    gram = (rows * length) @ rows.T
    if not np.isfinite(gram).all() or np.linalg.matrix_rank(gram) < 2:
        return None
    closed = length * (1 - rows.T @ np.linalg.solve(gram, rows @ length))
    if closed.min() <= 0:
        return None
    return np.asarray(np.concatenate([[0.0], np.cumsum(closed * direction)[:-1]]))
