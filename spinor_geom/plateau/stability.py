"""Second variation of area: stability of minimal surfaces, and directions in which the area decreases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
import scipy.sparse.linalg as spl
from jaxtyping import Complex, Float, Int
from scipy.linalg import eigh
from scipy.sparse import coo_array, csc_array

from spinor_geom.arrays import EPS, TINY, Array, namespace
from spinor_geom.deadline import require_time
from spinor_geom.domain.delaunay import edge_codes, plane_coordinates
from spinor_geom.domain.plane_domain import panel_breaks
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import SingularMatrixError
from spinor_geom.mesh.operators import cotangent_laplacian, factor_symmetric
from spinor_geom.surface.array_surface import ArraySurface

# Angle, in radians, up to which normals are equal, and curves and films orthogonal to a plane. The mirror images over
# the tennis seam a = 0.76 differ by 0.18 along Γ, two solutions for the same disk by 3e-4.
EQUAL_NORMALS = 0.02
Curvature: TypeAlias = tuple[float, float]  # ∫|K| dA, and a bound of its error
# Trial displacements from an unstable surface, in diagonals. Without the four smallest ones the search on the disk
# keeps the saddle over the tennis seam 0.76. With the largest one alone 4 of 6 searches end at other surfaces.
AMPLITUDES = tuple(0.2 * 0.6**k for k in range(8))
_MOST_VERTICES = 5000  # larger meshes are not refined, which would take seconds
# A mesh resolves a surface if the normals turn by less than this angle along its edges, except for this share of the
# faces: fits have tiny wrinkles in corners. With twice the angle z¹⁶ counts as stable. With no such faces a disk over a
# ragged rim is undecided.
_LARGEST_TURN, _UNRESOLVED = np.radians(60.0), 0.05


@dataclass(frozen=True, kw_only=True)
class Stability:
    """Whether a minimal surface is a local minimiser of area.

    Attributes:
        verdict: "stable", "unstable", or "undecided": the numerical error allows both, no mesh resolves the surface, or
            p and q are not finite.
        eigenvalue: the smallest μ of −Δu = μ|dn|²u with u = 0 on the boundary, n the Gauss map. Above 1 the second
            variation of area is positive. None if the total curvature decides, or no mesh resolves the surface.
        index: Morse index, the number of μ below 1, or None if it is undecided.
        total_curvature: ∫|K| dA. Below 2π every disk is stable. None if it is not resolved.

    Source: Barbosa & do Carmo, "On the size of a stable minimal surface in R³", Amer. J. Math. 98 (1976).
    """

    verdict: Literal["stable", "unstable", "undecided"]
    eigenvalue: float | None
    index: int | None
    total_curvature: float | None


def stable_by_curvature(curvature: Curvature) -> Stability | None:
    """The verdict "stable" if the total curvature is surely below 2π, or None otherwise, and for impossible values."""
    total, error = curvature
    # NaN meets neither condition. The total curvature of a plane is rounding error
    if not (total >= -(EPS**0.5) and total + error < 2 * np.pi):
        return None
    return Stability(verdict="stable", eigenvalue=None, index=0, total_curvature=total)


def assess_stability(surface: ArraySurface) -> Stability:
    """Verdict of the second variation ∫ |∇u|² + 2Kλ²u² dx dy over u with u = 0 on ∂Ω.

    If the total curvature ∫|K| dA, an integral along ∂Ω, is below 2π, the surface is stable. Otherwise the eigenvalues
    μ of −Δu = μ|dn|²u are computed with linear elements on two meshes of Ω, one refined, and extrapolated. The surface
    is stable if the smallest is above 1. If the two meshes do not decide, finer ones are tried. Wrinkles much
    smaller than the mesh size, which fits have in corners, are ignored.

    Raises:
        OutOfTimeError: time ran out.

    Source: Barbosa & do Carmo, Amer. J. Math. 98 (1976).
    """
    curvature = _boundary_curvature(surface)
    if stable := stable_by_curvature(curvature):
        return stable
    total = curvature[0] if np.isfinite(sum(curvature)) else None
    undecided = Stability(verdict="undecided", eigenvalue=None, index=None, total_curvature=total)
    mesh = _Mesh.of(surface, surface.domain.triangulation, surface.domain.arcs[:, 0])
    stability = undecided
    while np.isfinite(mesh.spinors).all():
        require_time()
        mesh, coarse = mesh.refined(), mesh
        if len(coarse.inner) and coarse.is_resolved:
            try:
                stability = _on_meshes(coarse, mesh)
            except SingularMatrixError:  # triangles without area
                stability = undecided
        if stability.index is not None or len(mesh.points) > _MOST_VERTICES:
            break
    return stability


def _on_meshes(coarse: _Mesh, fine: _Mesh) -> Stability:
    """The verdict from two meshes."""
    totals = [float(mesh.curvature.sum()) for mesh in (coarse, fine)]
    if stable := stable_by_curvature((totals[1], max(totals) - totals[1] + abs(totals[1] - totals[0]))):
        return stable
    count = 2
    while True:
        require_time()
        few = coarse.smallest_eigenpairs(count)[0]
        many = fine.smallest_eigenpairs(count)[0][: len(few)]
        # the bounds assume convergence of order 1 at least. The extrapolated value assumes order 2
        low, high = np.sort([many, 2 * many - few], axis=0)
        # the first eigenvalue that may be 1 or more. All after it are larger
        index = int(np.argmin(np.append(high < 1, False)))
        if index < len(many) or len(few) < count:
            break
        count *= 2
    counted = index < len(many) and bool(low[index] > 1)
    return Stability(
        verdict="unstable" if index else "stable" if counted else "undecided",
        eigenvalue=float((4 * many[0] - few[0]) / 3),
        index=index if counted else None,
        total_curvature=totals[1],
    )


def lowest_modes(
    surface: ArraySurface, mesh: PlaneTriangulation, count: int
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "n k"]]:
    """The smallest μ of −Δu = μ|dn|²u with u = 0 on the boundary of a mesh, ascending, and u as columns, |u| ≤ 1.

    Along u·n the second variation of area is (1 − 1/μ)∫|∇u|², negative for μ < 1. There are at most as many as inner
    vertices.
    """
    own = _Mesh.of(surface, mesh, np.zeros(mesh.boundary_size))
    values, functions = own.smallest_eigenpairs(count)
    u = np.zeros((len(mesh.points), len(values)))
    u[own.inner] = functions / np.abs(functions).max(axis=0)
    return values, u


def gauss_image_areas(spinors: Complex[np.ndarray, "n 2"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " f"]:
    """Areas of the spherical triangles between the normals at the corners of faces: ∫|K| dA, half of ∫|dn|² dx dy.

    The area is twice the phase of the product of the inner products of (p, q) around the triangle. It is negative where
    the triangle is oriented against the Gauss image.

    Source: Pancharatnam, Proc. Indian Acad. Sci. A 44 (1956): the phase of a cycle of two-component spinors is half of
    its solid angle.
    """
    a, b, c = (spinors[corner] for corner in faces.T)
    return np.asarray(2 * np.angle(_inner(a, b) * _inner(b, c) * _inner(c, a)))


def _inner(a: Complex[np.ndarray, "n 2"], b: Complex[np.ndarray, "n 2"]) -> Complex[np.ndarray, " n"]:
    return np.asarray(np.conj(a[:, 0]) * b[:, 0] + np.conj(a[:, 1]) * b[:, 1])


def curvature_within(rims: Sequence[Complex[Array, "*b _ 2"]]) -> Float[Array, "2 *b"]:
    """Total curvature of surfaces from p and q at points along each boundary of Ω, and a bound of its error.

    By Δ log λ = −Kλ², ∫|K| dA is ∮ ∂_ν log λ |dz|, the area enclosed by the normals along ∂Ω. Each branch point in Ω
    adds 4π to the result. The number of points is even. Every second point gives the error.
    """
    xp = namespace(rims[0])
    fine, coarse = (xp.stack([_polygon_area(one[..., ::step, :]) for one in rims]).sum(0) for step in (1, 2))
    return xp.stack([(4 * fine - coarse) / 3, abs(fine - coarse)])


def _polygon_area(spinors: Complex[Array, "*b n 2"]) -> Float[Array, "*b"]:
    """Area on the sphere enclosed by the normals at consecutive points of closed curves, with multiplicity.

    It is 2∮ Im(p̄ dp + q̄ dq)/λ for normals that move along great circles.
    """
    # squared, so that the sign change of antiperiodic spinors has no effect
    xp = namespace(spinors)
    turn = xp.linalg.vecdot(spinors, xp.roll(spinors, -1, axis=-2)) ** 2
    return xp.atan2(turn.imag, turn.real).sum(-1)


def _boundary_curvature(surface: ArraySurface) -> Curvature:
    """Total curvature of a surface, with its error."""
    rims = [(boundary, panel_breaks(boundary)) for boundary in surface.domain.boundaries]
    # four points a panel, doubled up to three times while 2π lies within the error
    for level in range(2, 6):
        share = np.arange(2**level) / 2**level
        along = [b.point((breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel()) for b, breaks in rims]
        curvature, error = curvature_within([surface.spinors(z) for z in along]).tolist()
        turns = [(_turning(surface, z) * np.abs(np.roll(z, -1) - z)) for z in along]
        is_resolved = _are_small(np.concatenate(turns))
        if is_resolved and abs(curvature - 2 * np.pi) > error:
            break
    return curvature, error if is_resolved else np.inf


def _turning(surface: ArraySurface, z: Complex[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """2|(p, q)′|/|(p, q)|: an upper bound of the rotation of the normal, in radians per length in Ω.

    It uses derivatives because equidistant samples of a high power can be constant.
    """
    spinors, slopes = surface.spinors(z), surface.spinor_derivatives(z)
    size = np.maximum(np.linalg.norm(spinors, axis=1), TINY)
    return np.asarray(2 * np.linalg.norm(slopes, axis=1) / size)


def _are_small(turns: Float[np.ndarray, " n"]) -> bool:
    """Whether angles between neighbours are small, except for a few. NaN is not small."""
    return bool(np.mean(~(turns <= _LARGEST_TURN)) <= _UNRESOLVED)


@dataclass(frozen=True, eq=False)
class _Mesh:
    """A triangulation of Ω with midpoint refinement that follows ∂Ω. Coarse vertices come first."""

    surface: ArraySurface
    points: Complex[np.ndarray, " n"]
    faces: Int[np.ndarray, "f 3"]
    spinors: Complex[np.ndarray, "n 2"]  # p and q at the points
    parameter: Float[np.ndarray, " n"]  # of boundary vertices, see `PlaneDomain.arcs`, NaN inside

    @classmethod
    def of(cls, surface: ArraySurface, mesh: PlaneTriangulation, rim: Float[np.ndarray, " m"]) -> _Mesh:
        """The mesh with the parameters of its boundary vertices."""
        parameter = np.append(rim, np.full(len(mesh.points) - len(rim), np.nan))
        return cls(surface, mesh.points, mesh.faces, surface.spinors(mesh.points), parameter)

    @cached_property
    def curvature(self) -> Float[np.ndarray, " f"]:
        """∫|K| dA of each face."""
        return gauss_image_areas(self.spinors, self.faces)

    @property
    def is_resolved(self) -> bool:
        """Whether the normals turn little along most edges, by their derivatives at the vertices."""
        (p, q), (dp, dq) = self.spinors.T, self.surface.spinor_derivatives(self.points).T
        turning = 2 * np.abs(p * dq - q * dp) / np.maximum((np.abs(self.spinors) ** 2).sum(axis=1), TINY)
        after = np.roll(self.faces, -1, axis=1)
        lengths = np.abs(self.points[after] - self.points[self.faces])
        return _are_small((lengths * (turning[after] + turning[self.faces]) / 2).max(axis=1))

    @property
    def inner(self) -> Int[np.ndarray, " k"]:
        return np.flatnonzero(np.isnan(self.parameter))

    def refined(self) -> _Mesh:
        """Divides triangles into four. New boundary vertices lie on ∂Ω, or on the edge if ∂Ω would flip a triangle."""
        n = len(self.points)
        codes, sides = np.unique(edge_codes(self.faces, n), return_inverse=True)
        edges = np.stack([codes // n, codes % n], axis=1)
        middle = self.points[edges].mean(axis=1)
        parameter = np.full(len(edges), np.nan)
        uses = np.bincount(sides)
        rim = np.flatnonzero(uses == 1)
        a, b = self.parameter[edges[rim]].T
        gap = np.mod(b - a + 0.5, 1.0) - 0.5  # the shortest difference modulo 1
        start = 2 * (a // 2)  # boundary number k has parameters from 2k to 2k + 1
        parameter[rim] = start + np.mod(a - start + gap / 2, 1.0)
        ab, bc, ca = (sides + n).reshape(-1, 3).T
        i, j, k = self.faces.T
        faces = np.concatenate([np.stack(t, axis=1) for t in ((i, ab, ca), (j, bc, ab), (k, ca, bc), (ab, bc, ca))])
        straight = np.concatenate([self.points, middle])
        curved = straight.copy()
        curved[n + rim] = self.surface.domain.point(parameter[rim])
        a, b, c = curved[faces].T
        kept = np.unique(faces[np.imag(np.conj(b - a) * (c - a)) <= 0])
        curved[kept] = straight[kept]
        spinors = np.concatenate([self.spinors, self.surface.spinors(curved[n:])])
        return _Mesh(self.surface, curved, faces, spinors, np.concatenate([self.parameter, parameter]))

    def smallest_eigenpairs(self, count: int) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "i k"]]:
        """The smallest μ of −Δu = μ|dn|²u for u = 0 outside the inner vertices, ascending, and u at these.

        Raises:
            SingularMatrixError: faces have no area.
        """
        stiffness = cotangent_laplacian(plane_coordinates(self.points), self.faces)
        # ∫ |dn|²uv of linear elements, |dn|² being constant on each face: twice the area of its Gauss image
        local = self.curvature[:, None, None] / 6 * (np.ones((3, 3)) + np.eye(3))
        rows, columns = np.repeat(self.faces, 3, axis=1).ravel(), np.tile(self.faces, (1, 3)).ravel()
        mass = csc_array(coo_array((local.ravel(), (rows, columns)), shape=stiffness.shape))
        inner = self.inner
        s, m = (csc_array(whole[inner][:, inner]) for whole in (stiffness, mass))
        count = min(count, len(inner))
        if not (np.isfinite(s.data).all() and np.isfinite(m.data).all()):
            raise SingularMatrixError(size=len(inner))
        # as M u = (1/μ) S u, because S is definite if all faces have area, and M may not be
        try:
            if len(inner) <= 2 * count:
                inverse, functions = eigh(
                    m.toarray(), s.toarray(), subset_by_index=[len(inner) - count, len(inner) - 1]
                )
            else:
                solve = spl.LinearOperator(s.shape, matvec=factor_symmetric(s).solve, dtype=np.float64)
                inverse, functions = spl.eigsh(m, k=count, M=s, Minv=solve, which="LA", v0=np.ones(len(inner)))
        except (np.linalg.LinAlgError, spl.ArpackError) as error:
            raise SingularMatrixError(size=len(inner)) from error
        order = np.argsort(inverse)[::-1]
        return 1 / np.maximum(inverse[order], TINY), functions[:, order]
