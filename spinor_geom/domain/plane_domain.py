"""The plane domain Ω on which p and q are defined."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import TypeAlias

import igl
import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from numpy.polynomial.polynomial import polyval
from scipy.interpolate import PPoly
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from spinor_geom.arrays import backwards, modulo_one
from spinor_geom.domain.delaunay import Rims, plane_coordinates, rim_edges
from spinor_geom.domain.triangulation import PlaneTriangulation, triangulate_polygon
from spinor_geom.errors import DtypeError, OptionError
from spinor_geom.mesh.array_checks import shared
from spinor_geom.mesh.interpolation import piecewise_cubic
from spinor_geom.mesh.piece_polynomials import reversed_pieces

# Panel ends beside a corner, in edge lengths from it: they resolve the singularity to 2⁻¹⁶ of an edge. The distance of
# each panel from the poles at the corner, relative to its length, is that of an edge from its poles.
TOWARDS_CORNER = 0.25 ** np.arange(1, 9)
# Pieces of an edge that show its shape: in tests for self-crossings and narrow places, and where integration paths
# leave Ω. With 2 rough curves take a third longer.
PARTS = 4
_ASIDE = 1e-9  # distance of one-sided derivatives from a corner
Vertices = Complex[np.ndarray, " m"]
LogScale = Float[np.ndarray, " m"]


@dataclass(frozen=True, eq=False)
class SplineBoundary:
    """A closed curve z(t) of polynomial pieces, t in [0, 1), smooth except at its corners."""

    parameters: Float[np.ndarray, " m1"]  # of the vertices, from 0. The last one is 1, the first vertex again
    coefficients: Complex[np.ndarray, "d1 m"]  # of the pieces, highest power first
    corners: Bool[np.ndarray, " m"]  # which vertices are corners

    def __repr__(self) -> str:
        return f"SplineBoundary({len(self.corners)} pieces, {int(self.corners.sum())} corners)"

    @classmethod
    def through(cls, vertices: Vertices, corners: Bool[np.ndarray, " m"] | None = None) -> SplineBoundary:
        """The cubic spline with chord-length parameters that interpolates the vertices."""
        flags = np.zeros(len(vertices), dtype=bool) if corners is None else np.asarray(corners, dtype=bool)
        parameters, coefficients = piecewise_cubic(plane_coordinates(np.asarray(vertices, dtype=np.complex128)), flags)
        return cls(parameters, coefficients[..., 0] + 1j * coefficients[..., 1], flags)

    @property
    def vertices(self) -> Vertices:
        """The ends of the pieces."""
        return np.asarray(self.coefficients[-1])

    def point(self, t: Float[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        """z(t). t is taken modulo 1."""
        h, piece = self._places(t)
        value = self.coefficients[0, piece]
        for row in self.coefficients[1:]:
            value = value * h + row[piece]
        return np.asarray(value)

    def derivative(self, t: Float[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        """dz/dt."""
        h, piece = self._places(t)
        degree = len(self.coefficients) - 1
        value = degree * self.coefficients[0, piece]
        for power, row in zip(range(degree - 1, 0, -1), self.coefficients[1:-1], strict=True):
            value = value * h + power * row[piece]
        return np.asarray(value)

    @property
    def corner_angles(self) -> Float[np.ndarray, " c"]:
        """Angles of the domain on the left at the corners, in radians."""
        ends = self.parameters[:-1][self.corners]
        before, after = (self.derivative(ends + side) for side in (-_ASIDE, _ASIDE))
        return np.asarray(np.pi - np.angle(after / before))

    def _places(self, t: Float[np.ndarray, "*pts"]) -> tuple[Float[np.ndarray, "*pts"], Int[np.ndarray, "*pts"]]:
        """The distances from the starts of the pieces, and the numbers of the pieces."""
        t = modulo_one(t)
        piece = np.searchsorted(self.parameters[1:-1], t, side="right")
        return np.asarray(t - self.parameters[piece]), np.asarray(piece)

    def mirrored(self) -> SplineBoundary:
        """The mirror image z̄ in the opposite direction, with the same first vertex, so that Ω stays on the left."""
        first, vertices = backwards(len(self.corners)), self.vertices.conj()
        coefficients = reversed_pieces(self.coefficients.conj()[..., None], self.parameters)[..., 0]
        coefficients[-1] = vertices[first]
        return SplineBoundary(1 - self.parameters[::-1], coefficients, self.corners[first])

    def divided(self, parts: int) -> SplineBoundary:
        """The same curve with each piece divided into `parts` pieces."""
        t = self.parameters
        parameters = np.append((t[:-1, None] + np.diff(t)[:, None] * np.arange(parts) / parts).ravel(), t[-1])
        powers = range(len(self.coefficients) - 1, -1, -1)
        coefficients = np.stack([self._pieces(parameters[:-1], nu=k) / math.factorial(k) for k in powers])
        corners = np.zeros(len(parameters) - 1, dtype=bool)
        corners[::parts] = self.corners
        return SplineBoundary(parameters, coefficients, corners)

    @cached_property
    def _pieces(self) -> PPoly:
        return PPoly(self.coefficients, self.parameters)


class FourierBoundary:
    """The analytic closed curve z(t) = Σ_k c_k e^{2πikt}, k = −K … K, with vertices at equal steps of t, no corners."""

    def __init__(self, coefficients: Complex[np.ndarray, " odd"], count: int) -> None:
        """Takes the coefficients from c_{−K} to c_K and the number of vertices.

        Raises:
            DtypeError: the number of coefficients is even, so that there is none of frequency 0 in the middle.
        """
        self.coefficients = shared(np.array(coefficients, dtype=np.complex128))
        if self.coefficients.ndim != 1 or len(self.coefficients) % 2 == 0:
            raise DtypeError(
                "a Fourier boundary needs an odd number of coefficients, of the frequencies from −K to K, got an array "
                f"of shape {self.coefficients.shape}; add zeros for missing frequencies"
            )
        self.parameters = shared(np.linspace(0.0, 1.0, count + 1))
        self.vertices = shared(self.point(self.parameters[:-1]))
        self.corners = shared(np.zeros(count, dtype=bool))

    @classmethod
    def circle(cls, radius: float = 1.0, count: int = 64) -> FourierBoundary:
        """The circle with centre 0, counter-clockwise."""
        return cls(np.array([0.0, 0.0, radius]), count)

    @classmethod
    def round_hole(cls, radius: float, count: int = 64, *, centre: complex = 0.0) -> FourierBoundary:
        """A circle, clockwise."""
        return cls(np.array([radius, centre, 0.0]), count)

    @property
    def frequencies(self) -> Int[np.ndarray, " odd"]:
        """The frequencies k of the coefficients, −K … K."""
        highest = len(self.coefficients) // 2
        return np.arange(-highest, highest + 1)

    def point(self, t: Float[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        """z(t)."""
        return self._sum(self.coefficients, t)

    def derivative(self, t: Float[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        """dz/dt."""
        return self._sum(2j * np.pi * self.frequencies * self.coefficients, t)

    def grid(self, n: int) -> Complex[np.ndarray, "3 n"]:
        """Rows z, dz/dt and d²z/dt² at t = j/n, j = 0 … n − 1, for n > 2K."""
        k = self.frequencies
        spectrum = np.zeros((3, n), dtype=np.complex128)
        spectrum[:, k] = (2j * np.pi * k) ** np.arange(3)[:, None] * self.coefficients
        return np.asarray(np.fft.ifft(spectrum, axis=1) * n)

    def mirrored(self) -> FourierBoundary:
        """The mirror image z̄ in the opposite direction, with the same first vertex, so that Ω stays on the left."""
        return FourierBoundary(self.coefficients.conj(), len(self.vertices))

    def divided(self, parts: int) -> FourierBoundary:
        """The same curve with `parts` times as many vertices."""
        return FourierBoundary(self.coefficients, parts * len(self.vertices))

    def _sum(self, c: Complex[np.ndarray, " odd"], t: Float[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        e = np.exp(2j * np.pi * np.asarray(t, dtype=np.float64))
        middle = len(c) // 2
        # positive and negative powers separately: a single polynomial would need the factor e^{-2πiKt}
        ahead, back = np.append(0.0, c[middle + 1 :]), c[middle::-1]
        return np.asarray(polyval(e, ahead) + polyval(np.conj(e), back))


# Ω is on the left: the outer boundary runs counter-clockwise, those of holes clockwise. Parameters are modulo 1.
Boundary: TypeAlias = SplineBoundary | FourierBoundary


def sampled(boundary: Boundary, each: int = PARTS) -> Complex[np.ndarray, " n"]:
    """Points along a boundary: `each` per piece, from its first vertex on, at equal steps of the parameter."""
    t = boundary.parameters
    return boundary.point((t[:-1, None] + np.diff(t)[:, None] * (np.arange(each) / each)).ravel())


@dataclass(frozen=True, kw_only=True, eq=False)
class PlaneDomain:
    """A plane domain Ω, simply connected or with holes, with a triangulation of it.

    Parameters of boundary points are t in [0, 1) on the outer boundary, t + 2(k + 1) on hole k.

    Attributes:
        boundary: the outer boundary, counter-clockwise.
        triangulation: triangles inside the polygons of the boundary vertices. These come first, rim after rim.
        log_scale: u at the boundary vertices: e^u is the length in Ω per length on the flattened discrete surface.
        holes: boundaries of the holes, clockwise.
    """

    boundary: Boundary
    triangulation: PlaneTriangulation
    log_scale: LogScale = field(default_factory=lambda: np.zeros(0))
    holes: tuple[Boundary, ...] = ()

    def __repr__(self) -> str:
        count = len(self.triangulation.points)
        corners = sum(int(boundary.corners.sum()) for boundary in self.boundaries)
        return f"PlaneDomain({corners} corners, {len(self.holes)} holes, triangulated with {count} points)"

    @classmethod
    @lru_cache(maxsize=16)
    def disk(cls, radius: float = 1.0, n: int = 64) -> PlaneDomain:
        """The disk |z| < radius with `n` boundary vertices. Raises an OptionError unless radius > 0 and n ≥ 3."""
        if not radius > 0 or n < 3:
            raise OptionError(f"a disk needs a positive radius and at least 3 vertices, got {radius} and {n}")
        return cls.inside(FourierBoundary.circle(radius, n))

    @classmethod
    def annulus(cls, inner: float, outer: float = 1.0, n: int = 64) -> PlaneDomain:
        """The annulus inner < |z| < outer with `n` vertices on each circle.

        Raises:
            OptionError: not 0 < inner < outer, n < 3, or the polygons of the vertices cross.
        """
        if not 0 < inner < outer or n < 3 or inner >= outer * np.cos(np.pi / n):
            raise OptionError(
                f"an annulus needs 0 < inner < outer and n ≥ 3 vertices whose polygon encloses the hole, got {inner}, "
                f"{outer} and {n}"
            )
        return cls.inside(FourierBoundary.circle(outer, n), holes=(FourierBoundary.round_hole(inner, n),))

    @classmethod
    def from_boundary(cls, vertices: Vertices, corners: Bool[np.ndarray, " m"] | None = None) -> PlaneDomain:
        """The domain inside the spline through vertices, counter-clockwise. Raises the errors of `inside`."""
        return cls.inside(SplineBoundary.through(vertices, corners))

    @classmethod
    def inside(
        cls, boundary: Boundary, log_scale: LogScale | None = None, *, holes: tuple[Boundary, ...] = ()
    ) -> PlaneDomain:
        """The domain inside a curve and outside holes, triangulated with edges that grow inwards.

        Raises:
            DomainError: the polygons of the vertices cross, run in the wrong direction, or a hole is not inside.
        """
        rims = tuple(len(each.vertices) for each in (boundary, *holes))
        vertices = np.concatenate([each.vertices for each in (boundary, *holes)])
        return cls(
            boundary=boundary,
            triangulation=_graded_triangulation(vertices.tobytes(), rims),
            log_scale=shared(np.zeros(len(vertices))) if log_scale is None else log_scale,
            holes=holes,
        )

    @cached_property
    def mirrored(self) -> PlaneDomain:
        """The mirror image of a domain, with the mirror image of its triangulation."""
        boundary, *holes = (each.mirrored() for each in self.boundaries)
        order = backwards(*(len(each.vertices) for each in self.boundaries))
        image = PlaneDomain(
            boundary=boundary,
            triangulation=self.triangulation.mirrored(),
            log_scale=self.log_scale[order] if len(self.log_scale) else self.log_scale,
            holes=tuple(holes),
        )
        # the image of the root, also among ties
        vars(image)["root"] = int(order[self.root]) if self.root < len(order) else self.root
        return image

    def divided(self, parts: int) -> PlaneDomain:
        """The same domain with each piece of ∂Ω divided into `parts` pieces and a new triangulation."""
        boundary, *holes = (each.divided(parts) for each in self.boundaries)
        return PlaneDomain.inside(boundary, np.repeat(self.log_scale, parts), holes=tuple(holes))

    @property
    def boundaries(self) -> tuple[Boundary, ...]:
        """The outer boundary, then those of the holes."""
        return (self.boundary, *self.holes)

    @cached_property
    def vertices(self) -> Vertices:
        """The vertices of all boundaries."""
        return shared(np.concatenate([boundary.vertices for boundary in self.boundaries]))

    @cached_property
    def corners(self) -> Bool[np.ndarray, " m"]:
        """Which vertices of ∂Ω are corners."""
        return shared(np.concatenate([boundary.corners for boundary in self.boundaries]))

    @cached_property
    def arcs(self) -> Float[np.ndarray, "m 2"]:
        """The parameters of both ends of each piece of ∂Ω."""
        ends = [2.0 * number + boundary.parameters for number, boundary in enumerate(self.boundaries)]
        return shared(np.concatenate([np.stack([t[:-1], t[1:]], axis=1) for t in ends]))

    def point(self, t: Float[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        """Points of ∂Ω. Raises an OptionError for a parameter outside all boundaries."""
        return self._on_boundaries("point", t)

    def derivative(self, t: Float[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        """dz/dt at points of ∂Ω. Raises an OptionError for a parameter outside all boundaries."""
        return self._on_boundaries("derivative", t)

    def _on_boundaries(self, method: str, t: Float[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts"]:
        t = np.asarray(t)
        known = (t >= 0) & (t < 2 * len(self.boundaries))
        if not known.all():
            wrong = t[~known].flat[0]
            raise OptionError(
                f"{wrong:.6g} is not a parameter of this domain's boundary; give t in [0, 1) on the outer boundary and "
                "t + 2(k + 1) on that of hole k"
            )
        number = t // 2
        z = np.empty(number.shape, dtype=np.complex128)
        for k, boundary in enumerate(self.boundaries):
            here = number == k
            z[here] = getattr(boundary, method)(t[here] - 2 * k)
        return z

    @cached_property
    def diameter(self) -> float:
        """Diagonal of the bounding box."""
        v = self.boundary.vertices
        return float(np.hypot(np.ptp(v.real), np.ptp(v.imag)))

    def contains(self, z: Complex[np.ndarray, "*pts"]) -> Bool[np.ndarray, "*pts"]:
        """Whether points lie in Ω, by `distance_outside`."""
        z = np.asarray(z, dtype=np.complex128)
        return (self.distance_outside(z.ravel()) < 0).reshape(z.shape)

    @cached_property
    def fine_polygons(self) -> tuple[Float[np.ndarray, "n 2"], Int[np.ndarray, "n 2"]]:
        """Points on all boundaries, and the edges between them."""
        parts = [sampled(boundary, 16) for boundary in self.boundaries]
        return plane_coordinates(np.concatenate(parts)), rim_edges(tuple(map(len, parts)))

    def distance_outside(self, z: Complex[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Signed distance of points from ∂Ω, negative inside Ω, with each piece of ∂Ω replaced by 16 straight edges."""
        if not len(z):
            return np.zeros(0)
        by_normals = igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
        return np.asarray(igl.signed_distance(plane_coordinates(z), *self.fine_polygons, sign_type=by_normals)[0])

    @cached_property
    def root(self) -> int:
        """Index of the inner vertex nearest to the mean of all inner vertices, or without these of any vertex."""
        points, m = self.triangulation.points, self.triangulation.boundary_size
        first = m if len(points) > m else 0
        return first + int(np.argmin(np.abs(points[first:] - points[first:].mean())))

    @cached_property
    def parents(self) -> Int[np.ndarray, " n"]:
        """For each vertex of the triangulation its predecessor on the path from the root. The root's is itself.

        Paths are the shortest ones along edges, with the lengths of edges at ∂Ω multiplied by a large factor: integrals
        are less accurate near the poles of p and q, which are near ∂Ω.
        """
        points = self.triangulation.points
        n, m = len(points), self.triangulation.boundary_size
        edges = self.triangulation.edges
        on_boundary = (edges < m).sum(axis=1)
        cost = np.abs(points[edges[:, 1]] - points[edges[:, 0]]) * np.array([1.0, 1e3, 1e6])[on_boundary]
        graph = coo_array((cost, (edges[:, 0], edges[:, 1])), shape=(n, n)).tocsr()
        _, before = dijkstra(graph, directed=False, indices=np.array(self.root), return_predecessors=True)
        parents = before.ravel().astype(np.int64)
        parents[self.root] = self.root
        return shared(parents)

    def visited(self, wanted: Int[np.ndarray, " k"]) -> Int[np.ndarray, " v"]:
        """The vertices on the paths from the root to the given ones, both ends included, ascending."""
        on_path = np.zeros(len(self.parents), dtype=bool)
        while len(wanted):
            on_path[wanted] = True
            wanted = np.unique(self.parents[wanted])
            wanted = wanted[~on_path[wanted]]
        return np.flatnonzero(on_path)


def panel_breaks(boundary: Boundary) -> Float[np.ndarray, " b"]:
    """Ends of quadrature panels on a boundary, from 0 to 1: the vertices, and more points beside corners."""
    t, corners = boundary.parameters, np.flatnonzero(boundary.corners)
    if not len(corners):
        return t
    width = np.diff(t)
    after = t[corners, None] + width[corners, None] * TOWARDS_CORNER
    end = np.where(corners == 0, 1.0, t[corners])
    before = end[:, None] - width[corners - 1][:, None] * TOWARDS_CORNER
    return np.unique(np.concatenate([t, after.ravel(), before.ravel()]))


@lru_cache(maxsize=16)  # most loops are solved on the unit disk
def _graded_triangulation(vertices: bytes, rims: Rims) -> PlaneTriangulation:
    """`triangulate_polygon` of rims. The complex vertices are given as bytes, which can be hashed."""
    points = np.frombuffer(vertices, dtype=np.complex128)
    outer, *holes = np.split(points, np.cumsum(rims)[:-1])
    mesh = triangulate_polygon(outer, holes=holes)
    shared(mesh.points)
    shared(mesh.faces)
    return mesh
