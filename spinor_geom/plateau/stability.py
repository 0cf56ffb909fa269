"""Second variation of area: is a minimal disk a local minimiser?"""

from __future__ import annotations

import numpy as np
import scipy.sparse.linalg as spl
from jaxtyping import Bool, Complex, Float, Int
from scipy.linalg import eigh
from scipy.sparse import coo_array, csc_array

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.plateau.solution import Stability
from spinor_geom.surface.spinor_surface import SpinorSurface

# Below this share of 2π the total curvature decides, whatever the error of its quadrature.
_SURE = 0.98
# Where refinement changes the total curvature by a larger share, the meshes are too coarse for the surface.
_RESOLVED = 0.1
_EIGENVALUES = 6
# A triangle that following ∂Ω would shrink below this share of its area keeps its straight side.
_THIN = 0.1


def assess_stability(surface: SpinorSurface) -> Stability:
    """Verdict of the second variation ∫ |∇u|² + 2Kλ²u² dx dy over u with u = 0 on ∂Ω.

    The total curvature ∫|K| dA decides first: below 2π the disk is stable. Otherwise the eigenvalues μ of
    −Δu = μ|dn|²u are computed with linear elements on two meshes of Ω, one refined, and extrapolated; the disk is
    stable if the smallest is above 1. The difference of the meshes is the margin within which it is "undecided";
    so it is where the total curvature still changes with the mesh, as on very rough rims.

    Source: Barbosa & do Carmo, Amer. J. Math. 98 (1976).
    """
    mesh = _Mesh.of(surface.domain)
    while mesh.inner.sum() < _EIGENVALUES:
        mesh = mesh.refined(surface.domain)
    fine = mesh.refined(surface.domain)
    finest = fine.refined(surface.domain)
    density = _gauss_image_density(surface, finest.points)
    mass, fine_mass = mesh.mass(density), fine.mass(density)
    curvature, coarse_curvature = 0.5 * float(fine_mass.sum()), 0.5 * float(mass.sum())
    resolved = abs(curvature - coarse_curvature) <= _RESOLVED * curvature
    if max(curvature, coarse_curvature) < _SURE * 2 * np.pi:
        return Stability(verdict="stable", eigenvalue=None, index=0, total_curvature=curvature)
    coarse_values = _smallest_eigenvalues(mesh.stiffness(), mass, mesh.inner)
    values = _smallest_eigenvalues(fine.stiffness(), fine_mass, fine.inner)
    count = min(len(coarse_values), len(values))
    # linear elements converge at order 2: one step of extrapolation, its size as the error
    extrapolated = (4 * values[:count] - coarse_values[:count]) / 3
    margin = 0.5 * np.abs(values[:count] - extrapolated)
    index = int((extrapolated + margin < 1).sum())
    # the eigenvalues are in order: the first that is not surely below 1 decides about all after it
    sure = resolved and (index == count or bool(extrapolated[index] - margin[index] > 1))
    smallest = float(extrapolated[0])
    return Stability(
        verdict=("unstable" if index else "stable") if sure else "undecided",
        eigenvalue=smallest,
        index=index if sure else None,
        total_curvature=curvature,
    )


def _gauss_image_density(surface: SpinorSurface, z: Complex[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """|dn|² = −2Kλ² = 8|p'q − pq'|²/(|p|² + |q|²)², twice the area of the Gauss image per area of Ω."""
    p, q = np.moveaxis(surface.spinors(z), -1, 0)
    dp, dq = np.moveaxis(surface.spinor_derivatives(z), -1, 0)
    scale = np.abs(p) ** 2 + np.abs(q) ** 2
    return np.asarray(8 * np.abs(dp * q - p * dq) ** 2 / np.maximum(scale, 1e-300) ** 2)


class _Mesh:
    """A triangulation of Ω with midpoint refinement that follows ∂Ω."""

    def __init__(
        self, points: Complex[np.ndarray, " n"], faces: Int[np.ndarray, "f 3"], parameter: Float[np.ndarray, " n"]
    ) -> None:
        self.points, self.faces = points, faces
        self.parameter = parameter  # of boundary vertices on ∂Ω; NaN inside
        self._edges, self._sides = _edges(faces)

    @classmethod
    def of(cls, domain: PlaneDomain) -> _Mesh:
        mesh = domain.triangulation
        parameter = np.full(len(mesh.points), np.nan)
        parameter[: mesh.boundary_size] = domain.boundary.parameters[:-1]
        return cls(mesh.points, mesh.faces, parameter)

    @property
    def inner(self) -> Bool[np.ndarray, " n"]:
        return np.asarray(np.isnan(self.parameter))

    def refined(self, domain: PlaneDomain) -> _Mesh:
        """Every triangle in four; new boundary points on ∂Ω, or on the sides where ∂Ω would turn a triangle over."""
        n, edges, sides = len(self.points), self._edges, self._sides
        middle = self.points[edges].mean(axis=1)
        parameter = np.full(len(edges), np.nan)
        uses = np.bincount(sides.ravel(), minlength=len(edges))
        rim = np.flatnonzero(uses == 1)
        a, b = self.parameter[edges[rim]].T
        gap = np.mod(b - a + 0.5, 1.0) - 0.5  # the short way around
        parameter[rim] = np.mod(a + gap / 2, 1.0)
        ab, bc, ca = (sides + n).T
        i, j, k = self.faces.T
        faces = np.concatenate([np.stack(t, axis=1) for t in ((i, ab, ca), (j, bc, ab), (k, ca, bc), (ab, bc, ca))])
        straight = np.concatenate([self.points, middle])
        curved = straight.copy()
        curved[n + rim] = domain.boundary.point(parameter[rim])
        thin = _areas(curved, faces) <= _THIN * _areas(straight, faces)
        kept = np.unique(faces[thin])
        curved[kept] = straight[kept]
        return _Mesh(curved, faces, np.concatenate([self.parameter, parameter]))

    def stiffness(self) -> csc_array:
        """∫ ∇u·∇v of linear elements."""
        corner = self.points[self.faces]
        opposite = np.roll(corner, -2, axis=1) - np.roll(corner, -1, axis=1)
        area = _areas(self.points, self.faces)
        local = np.real(np.conj(opposite[:, :, None]) * opposite[:, None, :]) / (4 * area[:, None, None])
        return self._assembled(local)

    def mass(self, density: Float[np.ndarray, " k"]) -> csc_array:
        """∫ density·u·v by the edge midpoint rule; its first entries belong to the refined mesh's vertices."""
        area = _areas(self.points, self.faces)
        ab, bc, ca = (density[self._sides + len(self.points)] * (area / 12)[:, None]).T
        local = np.stack(
            [np.stack([ab + ca, ab, ca], 1), np.stack([ab, ab + bc, bc], 1), np.stack([ca, bc, bc + ca], 1)], axis=1
        )
        return self._assembled(local)

    def _assembled(self, local: Float[np.ndarray, "f 3 3"]) -> csc_array:
        rows, columns = np.repeat(self.faces, 3, axis=1).ravel(), np.tile(self.faces, (1, 3)).ravel()
        n = len(self.points)
        return csc_array(coo_array((local.ravel(), (rows, columns)), shape=(n, n)))


def _areas(points: Complex[np.ndarray, " n"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " f"]:
    a, b, c = points[faces].T
    return np.asarray(0.5 * np.imag(np.conj(b - a) * (c - a)))


def _edges(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "f 3"]]:
    """Every edge once, and for each face its edges ab, bc, ca."""
    pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, index = np.unique(pairs, axis=0, return_inverse=True)
    return edges, index.reshape(faces.shape)


def _smallest_eigenvalues(
    stiffness: csc_array, mass: csc_array, inner: Bool[np.ndarray, " n"]
) -> Float[np.ndarray, " k"]:
    """The smallest μ of S u = μ M u for u = 0 on the boundary, ascending."""
    free = np.flatnonzero(inner)
    s, m = csc_array(stiffness[free][:, free]), csc_array(mass[free][:, free])
    count = min(_EIGENVALUES, len(free))
    if len(free) <= 4 * _EIGENVALUES:
        # as M u = (1/μ) S u: S is always definite, M need not be
        inverse = eigh(m.toarray(), s.toarray(), eigvals_only=True)[::-1][:count]
    else:
        factor = spl.splu(s)
        inverse = spl.eigsh(
            m,
            k=count,
            M=s,
            Minv=spl.LinearOperator(s.shape, matvec=factor.solve, dtype=np.float64),
            which="LA",
            v0=np.ones(len(free)),
            return_eigenvectors=False,
        )[::-1]
    return np.asarray(1 / np.maximum(np.sort(inverse)[::-1], 1e-300))
