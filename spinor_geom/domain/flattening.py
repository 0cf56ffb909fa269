"""Boundary first flattening of a discrete surface to a simple plane domain."""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float, Int
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import SuperLU

from spinor_geom.arrays import EPS, cis, norm, shifted
from spinor_geom.deadline import require_time
from spinor_geom.domain.delaunay import Rims, plane_coordinates, rim_successors
from spinor_geom.domain.polygons import bound_domain, outer_clearance, untangled
from spinor_geom.errors import DomainError, SingularMatrixError
from spinor_geom.mesh.operators import factor_symmetric, intrinsic_angles, intrinsic_laplacian, mollified_edge_lengths

Vertices = Float[np.ndarray, "n 3"]
Faces = Int[np.ndarray, "f 3"]
PerVertex = Float[np.ndarray, " m"]  # one number per boundary vertex, rim after rim
Columns = Float[np.ndarray, "m *k"]  # columns of such numbers
Polygon = Complex[np.ndarray, "_"]

# Weights α of the size of u in `flatten`, the least straightening first.
_STRENGTHS = (1e5, 1e4, 3e3, 1e3, 3e2, 1e2, 30.0, 10.0, 3.0, 1.0, 0.1)
_WIDTHS = (0.06, 0.03, 0.015)  # of the smoothing, per boundary length: wide ones first, against overlaps of far parts
CLEARANCE = 1.5  # least gap across the outside between far parts of the outer rim, in local edge lengths
_CLOSING_STEPS = 6  # Newton steps that close the holes
_LARGEST_SCALE = -float(np.log(EPS))  # with larger log scales, edge lengths are lost in rounding
_LAST_MODE = 8.6  # exp(-x²/2) is below rounding for larger x

# lays out rims as polygons, or returns None if that fails
Layout = Callable[[], tuple[Polygon, ...] | None]
# maps polygons to samples of the curves through their vertices
Drawn = Callable[[tuple[Polygon, ...]], tuple[Polygon, ...]]
Solver = Callable[[Columns], Columns]


@dataclass(frozen=True, kw_only=True, eq=False)
class Flattening:
    """Boundary of a plane domain conformal to a discrete surface."""

    rims: tuple[Polygon, ...]  # the outer boundary, counter-clockwise, then the holes, clockwise
    log_scale: PerVertex  # u: logarithm of the length in the plane per length in space, mean of two edges
    clearance: float  # smallest gap across the outside between far parts of the outer rim, in local edges, inf if wide
    neumann: "DirichletToNeumann"

    @property
    def boundary(self) -> Complex[np.ndarray, " m"]:
        """The images of all boundary vertices."""
        return np.concatenate(self.rims)

    @property
    def images(self) -> Complex[np.ndarray, " n"]:
        """The images of all vertices, by the harmonic map with those of the boundary."""
        boundary = self.boundary
        inner = self.neumann.inner_values(plane_coordinates(boundary)) @ np.array([1.0, 1j])
        return np.concatenate([boundary, inner])


class DirichletToNeumann:
    """The Dirichlet-to-Neumann operator Λ of a discrete surface, a symmetric m × m matrix that is not stored.

    Λ is the Schur complement of the Laplacian after the elimination of the inner vertices. Products and systems with
    it are sparse solves, so that memory grows in proportion to the mesh.
    """

    def __init__(self, laplacian: Callable[[], csc_array], boundary_size: int) -> None:
        """`laplacian` computes the Laplacian of all vertices, boundary vertices first. It is called on first use."""
        self.boundary_size = boundary_size
        self._make = laplacian

    @cached_property
    def _laplacian(self) -> csc_array:
        return self._make().tocsc()

    @cached_property
    def _inner(self) -> SuperLU:
        return factor_symmetric(self._laplacian[self.boundary_size :, self.boundary_size :])

    def __matmul__(self, values: Columns) -> Columns:
        """Λ times columns of values at the boundary vertices."""
        # selecting a part of a small sparse matrix takes longer than the product with the whole matrix
        product = self._laplacian @ self._extended(values)
        return np.asarray(product[: self.boundary_size] + self.inner_load(product[self.boundary_size :]))

    def inner_values(self, values: Columns) -> Float[np.ndarray, "i *k"]:
        """The discretely harmonic values at the inner vertices for columns of values at the boundary vertices."""
        if self.boundary_size == self._laplacian.shape[0]:
            return np.zeros((0, *values.shape[1:]))
        return np.asarray(self._inner.solve(-(self._laplacian @ self._extended(values))[self.boundary_size :]))

    def inner_load(self, load: Float[np.ndarray, " i *k"]) -> Columns:
        """The equivalent load on the boundary vertices of a load on the inner vertices."""
        if not len(load):
            return np.zeros((self.boundary_size, *load.shape[1:]))
        solved = self._extended(self._inner.solve(load), start=self.boundary_size)
        return np.asarray(-(self._laplacian @ solved)[: self.boundary_size])

    def _extended(self, values: Float[np.ndarray, "j *k"], *, start: int = 0) -> Float[np.ndarray, "n *k"]:
        """Columns of values at all vertices: the given ones from vertex `start` on, 0 elsewhere."""
        every = np.zeros((self._laplacian.shape[0], *values.shape[1:]))
        every[start : start + len(values)] = values
        return every

    def solver(self, diagonal: PerVertex, factor: float) -> Solver:
        """The solver of systems with the matrix diag(diagonal) + factor·Λ."""
        system = factor_symmetric(factor * self._laplacian + diags_array(self._extended(diagonal)))

        def solve(load: Columns) -> Columns:
            return np.asarray(system.solve(self._extended(load))[: self.boundary_size])

        return solve


def dirichlet_to_neumann(vertices: Vertices, faces: Faces, boundary_size: int) -> tuple[DirichletToNeumann, PerVertex]:
    """Dirichlet-to-Neumann operator Λ of a discrete surface, and the turning angles k₀ of its boundary at u = 0.

    The flattening with boundary log scale u has the turning angles k₀ + Λu. Boundary vertices come first, by rims.

    Source: Sawhney & Crane, "Boundary First Flattening", ACM TOG 37 (2018), sections 3 and 4.
    """
    lengths = mollified_edge_lengths(vertices, faces)
    neumann = DirichletToNeumann(lambda: intrinsic_laplacian(lengths, faces, len(vertices)), boundary_size)
    defect = np.full(len(vertices), 2 * np.pi)
    defect -= np.bincount(faces.ravel(), intrinsic_angles(lengths).ravel(), minlength=len(vertices))
    return neumann, defect[:boundary_size] - np.pi + neumann.inner_load(defect[boundary_size:])


def flatten(
    vertices: Vertices, faces: Faces, boundary_size: int, *, holes: Rims = (), drawn: Drawn | None = None
) -> Flattening:
    """Flattens a discrete surface conformally, with a boundary scale as close to 1 as possible for a simple boundary.

    The boundary of a disk is first laid out at u = 0. With holes, Newton's method minimises |u|²/ℓ² + u·Λu/ℓ with the
    constraints that each hole is closed and has the total turning −2π. Each rim is laid out separately. Position,
    rotation and scale of the holes minimise the conformal energy, which is the Dirichlet energy minus the area.

    If rims cross, or the gap across the outside between two far parts of the outer rim is below `CLEARANCE`, u
    minimises α(|u|²/ℓ² + u·Λu/ℓ) + |S(k₀ + Λu)/ds − κ|², where κ is the curvature of circles of the rims' lengths and S
    is a Gaussian smoothing along them. This straightens long windings and keeps corners. α is lowered until the
    boundary is simple with that clearance. If no α suffices, small lobes are removed by `untangled`.

    The first `boundary_size` vertices are those of the outer rim, then those of the holes, in order with the surface on
    their left. `holes` are their numbers, and faces run counter-clockwise. `drawn` maps the rims to samples of the
    curves through their vertices, which must bound a domain as well. Raises a DomainError if no simple domain is found.

    Source: Sawhney & Crane (2018) for u ↦ k₀ + Λu; Lévy et al., "Least squares conformal maps", ACM TOG 21 (2002), for
    the conformal energy.
    """
    neumann, turning = dirichlet_to_neumann(vertices, faces, boundary_size)
    after = rim_successors((boundary_size - sum(holes), *holes))
    edge = norm(vertices[after] - vertices[:boundary_size])
    return flatten_boundary(edge, turning, neumann, holes=holes, drawn=drawn)


def flatten_boundary(
    edge: PerVertex,
    turning: PerVertex,
    neumann: DirichletToNeumann,
    *,
    clearance: float = CLEARANCE,
    holes: Rims = (),
    drawn: Drawn | None = None,
) -> Flattening:
    """`flatten` from the edge lengths, the turning angles at u = 0 and the operator Λ. Raises the same errors.

    A gap below the clearance, in local edge lengths, is accepted if no larger one is found.
    """
    rims = (len(edge) - sum(holes), *holes)
    plain, lobed = itertools.tee(_layouts(edge, turning, neumann, rims))
    for families in (plain, ([partial(_untangled, layout) for layout in family] for family in lobed)):
        flat = _least_straightened(families, edge, neumann, clearance, drawn)
        if flat is not None:
            return flat
    raise DomainError(
        f"no simple plane domain was found for a boundary of {' + '.join(map(str, rims))} vertices: it crosses itself "
        "at every strength of straightening; check that the loop does not cross itself"
    )


def _untangled(layout: Layout) -> tuple[Polygon, ...] | None:
    rims = [untangled(rim) for rim in layout() or ()]
    simple = tuple(rim for rim in rims if rim is not None)
    return simple if len(simple) == len(rims) else None


def _least_straightened(
    families: Iterable[Sequence[Layout]],
    edge: PerVertex,
    neumann: DirichletToNeumann,
    clearance: float,
    drawn: Drawn | None,
) -> Flattening | None:
    """The first simple boundary with enough clearance, else the first with half of it, else the first simple one.

    A family runs from the least to the most straightened boundary. It is left out if neither of these two is simple.

    Raises an OutOfTimeError if the time limit was reached before one with enough clearance.
    """

    @cache
    def simple(layout: Layout) -> Flattening | None:
        require_time()
        rims = layout()
        if not rims or not bound_domain(rims) or (drawn is not None and not bound_domain(drawn(rims))):
            return None
        parts = _parts(edge, tuple(map(len, rims)))
        ratios = [np.log(np.abs(shifted(rim, -1) - rim) / length) for rim, length in zip(rims, parts, strict=True)]
        scale = np.concatenate([(ratio + shifted(ratio, 1)) / 2 for ratio in ratios])
        gap = outer_clearance(rims[0], clearance)
        return Flattening(rims=rims, log_scale=scale, clearance=gap, neumann=neumann)

    found: list[Flattening] = []
    for family in families:
        if simple(family[0]) is None and simple(family[-1]) is None:
            continue
        for flat in filter(None, map(simple, family)):
            found.append(flat)
            if flat.clearance >= clearance:
                return flat
    return next((flat for share in (0.5, 0.0) for flat in found if flat.clearance >= share * clearance), None)


def _layouts(
    edge: PerVertex, turning: PerVertex, neumann: DirichletToNeumann, rims: Rims
) -> Iterator[Sequence[Layout]]:
    """Families of layouts of the rims: the one at u = 0, then those for each width of the smoothing."""
    holes = [slice(start, end) for start, end in itertools.pairwise(np.cumsum(rims).tolist())]

    def laid_out(turned: PerVertex, u: PerVertex) -> tuple[Polygon, ...] | None:
        parts = zip(*(_parts(each, rims) for each in (edge, turned, u)), strict=True)
        polygons = [polygon for part in parts if (polygon := lay_out(*part)) is not None]
        if len(polygons) < len(rims):
            return None
        return (polygons[0], *_placed(polygons, neumann)) if holes else tuple(polygons)

    def closed(u: PerVertex, solve: Solver) -> tuple[Polygon, ...] | None:
        for _ in range(_CLOSING_STEPS if holes else 0):
            if not np.abs(u).max() < _LARGEST_SCALE:
                return None
            gaps, slopes = zip(*(_gap(u, edge, turning, neumann, hole) for hole in holes), strict=True)
            gap, slope = np.concatenate(gaps), np.concatenate(slopes)
            along = solve(slope.T)
            # by least squares, because the constraints of a hole without width are linearly dependent
            u = u - along @ np.linalg.lstsq(slope @ along, gap, rcond=None)[0]
        return laid_out(turning + neumann @ u, u) if np.abs(u).max() < _LARGEST_SCALE else None

    if not holes:
        yield [cache(partial(laid_out, turning, np.zeros(len(edge))))]
    for family in _straightened(edge, turning, neumann, rims):
        yield [cache(partial(closed, u, solve)) for u, solve in family]


def _parts(values: PerVertex, rims: Rims) -> list[PerVertex]:
    """The values on each rim."""
    ends = itertools.accumulate(rims, initial=0)
    return [values[start:end] for start, end in itertools.pairwise(ends)]


def _straightened(
    edge: PerVertex, turning: PerVertex, neumann: DirichletToNeumann, rims: Rims
) -> Iterator[Sequence[tuple[PerVertex, Solver]]]:
    """The minimisers u of `flatten` by width and strength, and solvers of the systems that they satisfy.

    S has low rank: the systems are αA + WWᵀ with a sparse A and a narrow W (Woodbury's identity).
    """
    parts = _parts(edge, rims)
    ds = np.concatenate([(part + shifted(part, 1)) / 2 for part in parts])
    length = ds.sum() / len(rims)
    even = np.concatenate([np.full(len(part), 2 * np.pi / part.sum()) for part in parts])
    even[rims[0] :] *= -1
    diagonal = ds / length**2
    try:
        solve = neumann.solver(diagonal, 1 / length)
    except SingularMatrixError:
        return
    if len(rims) > 1:
        yield [(np.zeros(len(edge)), solve)]
    for width in _WIDTHS:
        factors = [smoothing(part, width) for part in parts]
        spread, modes = (scipy.linalg.block_diag(*each) for each in zip(*factors, strict=True))
        q, r = np.linalg.qr(np.sqrt(ds)[:, None] * spread)
        w = neumann @ (modes @ r.T)
        target = q.T @ (np.sqrt(ds) * (even - spread @ (modes.T @ turning)))
        x = solve(w)
        inner = w.T @ x
        if not np.isfinite(inner).all():
            continue
        values, vectors = np.linalg.eigh((inner + inner.T) / 2)
        x = x @ vectors
        load = vectors.T @ target
        shares = [(strength, 1 / (strength + np.maximum(values, 0.0))) for strength in _STRENGTHS]
        yield [(x @ (weights * load), _updated(solve, x, weights, strength)) for strength, weights in shares]


def _updated(solve: Solver, x: Float[np.ndarray, "m r"], weights: Float[np.ndarray, " r"], strength: float) -> Solver:
    """The solver for αA + WWᵀ, α the strength, from the solver for A and x and weights of `_straightened`."""
    return lambda load: np.asarray((solve(load) - x @ (weights[:, None] * (x.T @ load))) / strength)


def _gap(
    u: PerVertex, edge: PerVertex, turning: PerVertex, neumann: DirichletToNeumann, rim: slice
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 m"]]:
    """Closing error of a hole at log scale u (gap x, y per length; turning + 2π), and its derivatives in u."""
    turned = turning[rim] + (neumann @ u)[rim]
    count = len(turned)
    own = np.arange(count)
    after = shifted(own, -1)
    step = edge[rim] * np.exp((u[rim] + u[rim][after]) / 2 + 1j * np.cumsum(turned))
    # relative to the mean direction. Relative to the first edge, a rim with a large gap would bend at that edge
    ahead = step[::-1].cumsum()[::-1] - step.sum() * (1 - own / count)
    rows = np.zeros((len(u), 3))
    rows[rim] = np.stack([ahead.real, ahead.imag, np.ones(count)], axis=1)
    flux = neumann @ rows
    slope = 1j * (flux[:, 0] + 1j * flux[:, 1])
    slope[rim] += (step + shifted(step, 1)) / 2
    total = np.abs(step).sum()
    gap, slope = step.sum() / total, slope / total
    return np.array([gap.real, gap.imag, turned.sum() + 2 * np.pi]), np.stack([slope.real, slope.imag, flux[:, 2]])


def _placed(rims: Sequence[Polygon], neumann: DirichletToNeumann) -> list[Polygon]:
    """The holes t + βz, with t and β of least conformal energy ½ z*Λz − area."""
    outer, *shapes = rims
    shapes = [shape - shape.mean() for shape in shapes]
    basis = scipy.linalg.block_diag(*(np.stack([np.ones_like(shape), shape], axis=1) for shape in shapes))
    columns = scipy.linalg.block_diag(outer[:, None], basis)
    flux = (neumann @ columns.real + 1j * (neumann @ columns.imag))[len(outer) :]
    load, quadratic = basis.conj().T @ flux[:, 0], basis.conj().T @ flux[:, 1:]
    areas = [np.imag(np.conj(shape) * shifted(shape, -1)).sum() for shape in shapes]  # twice, and negative
    quadratic[np.diag_indices_from(quadratic)] -= np.ravel([(0.0, area) for area in areas])
    moves = np.linalg.solve(quadratic, -load).reshape(-1, 2)
    return [t + beta * shape for (t, beta), shape in zip(moves, shapes, strict=True)]


def smoothing(edge: PerVertex, width: float) -> tuple[Float[np.ndarray, "m r"], Float[np.ndarray, "m r"]]:
    """Factors of the Gaussian smoothing S = PFᵀ along a closed boundary, which maps turning angles to curvature.

    The columns of F are the Fourier modes of the arc length whose weight is above rounding. The width is a share of the
    boundary length.
    """
    s = 2 * np.pi * (np.cumsum(edge) - edge) / edge.sum()
    k = np.arange(1, np.ceil(_LAST_MODE / (2 * np.pi * width)) + 1)
    modes = np.concatenate([np.ones((len(s), 1)), np.cos(s[:, None] * k), np.sin(s[:, None] * k)], axis=1)
    weight = 2 * np.exp(-0.5 * (2 * np.pi * k * width) ** 2)
    spread = modes * np.concatenate([[1.0], weight, weight])
    ds = (edge + shifted(edge, 1)) / 2
    return spread / (spread @ (modes.T @ ds))[:, None], modes


def lay_out(edge: PerVertex, turning: PerVertex, log_scale: PerVertex) -> Complex[np.ndarray, " m"] | None:
    """Closed polygon of given turning angles with edge lengths nearest to e^u·edge, or None if there is none."""
    length = edge * np.exp((log_scale + shifted(log_scale, -1)) / 2)
    direction = cis(turning.cumsum() - turning[0])  # edge j runs after the turns at vertices 1 … j
    # the changes of the lengths minimise the sum of their squares per length
    total, gap, double = float(length.sum()), complex(length @ direction), complex(length @ direction**2)
    determinant = total**2 - abs(double) ** 2
    if not determinant > EPS * total**2:
        return None
    shift = 2 * (total * gap - double * gap.conjugate()) / determinant
    closed = length * (1 - (direction.real * shift.real + direction.imag * shift.imag))
    if closed.min() <= 0:
        return None
    polygon = np.zeros(len(edge), dtype=np.complex128)
    polygon[1:] = (closed * direction)[:-1].cumsum()
    return polygon
