"""Second variation of area: is a minimal surface a local minimiser, and along which functions does its area fall?"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Literal

import numpy as np
import scipy.sparse.linalg as spl
from jaxtyping import Complex, Float, Int
from scipy.linalg import eigh
from scipy.sparse import coo_array, csc_array

from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.domain.plane_domain import panel_breaks
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.mesh.operators import cotangent_laplacian, factor_symmetric
from spinor_geom.surface.spinor_surface import SpinorSurface

# Points on ∂Ω for the total curvature, at least, and how often they are doubled while 2π lies within the error.
_FEWEST_SAMPLES, _DOUBLINGS = 400, 3
# Total curvature, as a share of 2π, from which on the eigenvalues decide: meshes tell it to about a percent.
_SURE = 0.98
# Where refinement changes the total curvature by a larger share, the eigenvalues do not yet converge at their order.
_RESOLVED = 0.05
# Inner vertices of the coarsest mesh, and vertices after which no finer one is tried.
_FEWEST_INNER_VERTICES, _MANY_VERTICES = 6, 5000
# A triangle that following ∂Ω would shrink below this share of its area keeps its straight side.
_THIN = 0.1
# Of eigenvectors, relative: eigenvalues are right to its square.
_TOLERANCE = 1e-6


@dataclass(frozen=True, kw_only=True)
class Stability:
    """Whether a minimal surface is a local minimiser of area.

    Attributes:
        verdict: "stable", "unstable", or "undecided" where the error of the computation leaves both possible.
        eigenvalue: the smallest μ of −Δu = μ|dn|²u with u = 0 on the boundary, n the Gauss map; above 1 the second
            variation of area is positive. None where the total curvature alone decides.
        index: Morse index, the number of μ below 1; None where the error leaves it open.
        total_curvature: ∫|K| dA; below 2π every disk is stable.

    Source: Barbosa & do Carmo, "On the size of a stable minimal surface in R³", Amer. J. Math. 98 (1976).
    """

    verdict: Literal["stable", "unstable", "undecided"]
    eigenvalue: float | None
    index: int | None
    total_curvature: float


def assess_stability(surface: SpinorSurface) -> Stability:
    """Verdict of the second variation ∫ |∇u|² + 2Kλ²u² dx dy over u with u = 0 on ∂Ω.

    The total curvature ∫|K| dA, an integral along ∂Ω, decides first: below 2π the surface is stable. Otherwise the
    eigenvalues μ of −Δu = μ|dn|²u are computed with linear elements on two meshes of Ω, one refined, and extrapolated;
    the surface is stable if the smallest is above 1. The difference of the meshes is the margin within which they leave
    it open; then finer ones are tried, and after them it is "undecided". Wrinkles of the surface far below the meshes'
    size, as fits have them in corners, do not count.

    Source: Barbosa & do Carmo, Amer. J. Math. 98 (1976).
    """
    curvature, error = _boundary_curvature(surface)
    if curvature + error < _SURE * 2 * np.pi:
        return Stability(verdict="stable", eigenvalue=None, index=0, total_curvature=curvature)
    mesh = _Mesh.of(surface)
    while True:
        mesh, coarse = mesh.refined(), mesh
        if len(coarse.inner) < _FEWEST_INNER_VERTICES:
            continue
        stability = _on_meshes(coarse, mesh)
        if stability.index is not None or len(mesh.points) > _MANY_VERTICES:
            return stability


def _on_meshes(coarse: _Mesh, fine: _Mesh) -> Stability:
    """The verdict of two meshes."""
    curvatures = [float(mesh.curvature.sum()) for mesh in (coarse, fine)]
    resolved = abs(curvatures[1] - curvatures[0]) <= _RESOLVED * curvatures[1]
    if resolved and max(curvatures) < _SURE * 2 * np.pi:
        return Stability(verdict="stable", eigenvalue=None, index=0, total_curvature=curvatures[1])
    count = 2
    while True:
        few = coarse.smallest_eigenvalues(count)
        many = fine.smallest_eigenvalues(count)[: len(few)]
        # linear elements converge at order 2, where they do not yet at order 1 or more: extrapolation by a third of the
        # difference and half of that as the error, or by anything up to the difference
        step = many - few
        values = many + step / (3 if resolved else 2)
        margin = np.abs(step) / (6 if resolved else 2)
        # the eigenvalues are in order: the first that is not surely below 1 decides about all after it
        index = int(np.argmin(np.append(values + margin < 1, False)))
        if index < len(values) or len(few) < count:
            break
        count *= 2
    counted = index < len(values) and bool(values[index] - margin[index] > 1)
    return Stability(
        verdict="unstable" if index else "stable" if counted else "undecided",
        eigenvalue=float(values[0]),
        index=index if counted else None,
        total_curvature=curvatures[1],
    )


def lowest_modes(
    surface: SpinorSurface, mesh: PlaneTriangulation, count: int
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "n k"]]:
    """The smallest μ of −Δu = μ|dn|²u with u = 0 on the boundary of a mesh, ascending, and their functions u.

    Along u·n the second variation of area is (1 − 1/μ)∫|∇u|²: negative where μ < 1.

    Args:
        surface: a minimal surface.
        mesh: of its Ω or most of it.
        count: how many; fewer come back where the mesh has fewer inner vertices.

    Returns:
        μ, and for each a column with the values of u at the mesh's vertices, the largest |u| being 1.
    """
    spinors = surface.spinors(mesh.points)
    inner = np.arange(mesh.boundary_size, len(mesh.points))
    mass = _mass(gauss_image_areas(spinors, mesh.faces), mesh.faces, len(mesh.points))
    values, functions = _smallest_eigenpairs(_stiffness(mesh.points, mesh.faces), mass, inner, count)
    u = np.zeros((len(mesh.points), len(values)))
    u[inner] = functions / np.abs(functions).max(axis=0)
    return values, u


def gauss_image_areas(spinors: Complex[np.ndarray, "n 2"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " f"]:
    """Areas of the spherical triangles between the normals at the corners of faces: ∫|K| dA, half of ∫|dn|² dx dy.

    The area is twice the phase of the product of (p, q)'s inner products around the triangle, negative where the
    triangle runs the other way than on the surface's Gauss image.

    Source: Pancharatnam, Proc. Indian Acad. Sci. A 44 (1956): the phase of a cycle of two-component spinors is half of
    its solid angle.
    """
    a, b, c = (spinors[corner] for corner in faces.T)
    return np.asarray(2 * np.angle(_inner(a, b) * _inner(b, c) * _inner(c, a)))


def _inner(a: Complex[np.ndarray, "n 2"], b: Complex[np.ndarray, "n 2"]) -> Complex[np.ndarray, " n"]:
    return np.asarray(np.conj(a[:, 0]) * b[:, 0] + np.conj(a[:, 1]) * b[:, 1])


def _polygon_area(spinors: Complex[np.ndarray, "n 2"]) -> float:
    """Area that the normals at consecutive points of a closed curve enclose on the sphere, sheet by sheet.

    It is 2∮ Im(p̄ dp + q̄ dq)/λ for normals that run along arcs of great circles.
    """
    # squared, so that a change of sign, as antiperiodic spinors have one, does not count
    return float(np.angle(_inner(spinors, np.roll(spinors, -1, axis=0)) ** 2).sum())


def _boundary_curvature(surface: SpinorSurface) -> tuple[float, float]:
    """Total curvature by an integral along ∂Ω, and a bound of its error; 4π too large for each branch point.

    Δ log λ = −Kλ² turns ∫|K| dA into ∮ ∂_ν log λ |dz|, which is the area enclosed by the normals along ∂Ω.
    """
    rims = [(boundary, panel_breaks(boundary)) for boundary in surface.domain.boundaries]
    fewest = min(len(breaks) for _, breaks in rims) - 1
    first = max(0, int(np.ceil(np.log2(_FEWEST_SAMPLES / fewest))))
    coarse = None
    for level in range(first, first + 1 + _DOUBLINGS):
        share = np.arange(2**level) / 2**level
        spinors = [
            surface.spinors(boundary.point((breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel()))
            for boundary, breaks in rims
        ]
        fine = sum(map(_polygon_area, spinors))
        if coarse is None:
            coarse = sum(_polygon_area(some[::2]) for some in spinors)
        curvature, error = (4 * fine - coarse) / 3, abs(fine - coarse)
        if abs(curvature - 2 * np.pi) > error:
            break
        coarse = fine
    return curvature, error


class _Mesh:
    """A triangulation of Ω with midpoint refinement that follows ∂Ω; the coarse vertices come first in the refined."""

    def __init__(
        self,
        surface: SpinorSurface,
        points: Complex[np.ndarray, " n"],
        faces: Int[np.ndarray, "f 3"],
        parameter: Float[np.ndarray, " n"],
    ) -> None:
        self.surface, self.points, self.faces = surface, points, faces
        self.parameter = parameter  # of boundary vertices on ∂Ω; NaN inside
        # a mesh is the finer one of two, then the coarser
        self.smallest_eigenvalues = cache(self._smallest_eigenvalues)

    @classmethod
    def of(cls, surface: SpinorSurface) -> _Mesh:
        mesh = surface.domain.triangulation
        parameter = np.full(len(mesh.points), np.nan)
        parameter[: mesh.boundary_size] = surface.domain.arcs[:, 0]
        return cls(surface, mesh.points, mesh.faces, parameter)

    @cached_property
    def curvature(self) -> Float[np.ndarray, " f"]:
        """∫|K| dA of each face."""
        return gauss_image_areas(self.surface.spinors(self.points), self.faces)

    @property
    def inner(self) -> Int[np.ndarray, " k"]:
        return np.flatnonzero(np.isnan(self.parameter))

    def refined(self) -> _Mesh:
        """Every triangle in four; new boundary points on ∂Ω, or on the sides where ∂Ω would turn a triangle over."""
        n = len(self.points)
        edges, sides = _edges(self.faces, n)
        middle = self.points[edges].mean(axis=1)
        parameter = np.full(len(edges), np.nan)
        uses = np.bincount(sides.ravel(), minlength=len(edges))
        rim = np.flatnonzero(uses == 1)
        a, b = self.parameter[edges[rim]].T
        gap = np.mod(b - a + 0.5, 1.0) - 0.5  # the short way around
        start = 2 * (a // 2)  # of the parameters of the edge's boundary
        parameter[rim] = start + np.mod(a - start + gap / 2, 1.0)
        ab, bc, ca = (sides + n).T
        i, j, k = self.faces.T
        faces = np.concatenate([np.stack(t, axis=1) for t in ((i, ab, ca), (j, bc, ab), (k, ca, bc), (ab, bc, ca))])
        straight = np.concatenate([self.points, middle])
        curved = straight.copy()
        curved[n + rim] = self.surface.domain.point(parameter[rim])
        thin = _areas(curved, faces) <= _THIN * _areas(straight, faces)
        kept = np.unique(faces[thin])
        curved[kept] = straight[kept]
        return _Mesh(self.surface, curved, faces, np.concatenate([self.parameter, parameter]))

    def _smallest_eigenvalues(self, count: int) -> Float[np.ndarray, " k"]:
        """The smallest μ."""
        mass = _mass(self.curvature, self.faces, len(self.points))
        return _smallest_eigenpairs(_stiffness(self.points, self.faces), mass, self.inner, count)[0]


def _stiffness(points: Complex[np.ndarray, " n"], faces: Int[np.ndarray, "f 3"]) -> csc_array:
    """∫ ∇u·∇v of linear elements."""
    return cotangent_laplacian(plane_coordinates(points), faces)


def _mass(areas: Float[np.ndarray, " f"], faces: Int[np.ndarray, "f 3"], n: int) -> csc_array:
    """∫ |dn|²uv of linear elements, |dn|² being constant on each face: twice the area of its Gauss image."""
    local = areas[:, None, None] / 6 * (np.ones((3, 3)) + np.eye(3))
    rows, columns = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, (1, 3)).ravel()
    return csc_array(coo_array((local.ravel(), (rows, columns)), shape=(n, n)))


def _areas(points: Complex[np.ndarray, " n"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " f"]:
    a, b, c = points[faces].T
    return np.asarray(0.5 * np.imag(np.conj(b - a) * (c - a)))


def _edges(faces: Int[np.ndarray, "f 3"], n: int) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "f 3"]]:
    """Every edge once, and for each face its edges ab, bc, ca."""
    other = np.roll(faces, -1, axis=1)
    codes, index = np.unique(np.minimum(faces, other) * n + np.maximum(faces, other), return_inverse=True)
    return np.stack([codes // n, codes % n], axis=1), index.reshape(faces.shape)


def _smallest_eigenpairs(
    stiffness: csc_array, mass: csc_array, inner: Int[np.ndarray, " i"], count: int
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "i k"]]:
    """The smallest μ of S u = μ M u for u = 0 outside the inner vertices, ascending, and the values of u there."""
    s, m = csc_array(stiffness[inner][:, inner]), csc_array(mass[inner][:, inner])
    count = min(count, len(inner))
    # as M u = (1/μ) S u: S is always definite, M need not be
    if len(inner) <= 2 * count:
        inverse, functions = eigh(m.toarray(), s.toarray(), subset_by_index=[len(inner) - count, len(inner) - 1])
    else:
        solve = spl.LinearOperator(s.shape, matvec=factor_symmetric(s).solve, dtype=np.float64)
        inverse, functions = spl.eigsh(m, k=count, M=s, Minv=solve, which="LA", v0=np.ones(len(inner)), tol=_TOLERANCE)
    order = np.argsort(inverse)[::-1]
    return 1 / np.maximum(inverse[order], 1e-300), functions[:, order]
