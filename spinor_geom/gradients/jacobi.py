"""Normal displacements of a minimal surface whose boundary moves: solutions of Jacobi's equation.

A change of p and q by holomorphic functions displaces the surface by δr = Re ∫ δφ dz, δφ = (2pδp − 2qδq,
−2i(pδp + qδq), 2(qδp + pδq)). Its normal part u = n·δr solves Δu + |dn|²u = 0, the linearised equation of minimal
surfaces, and does not depend on the parametrisation. The combination of such u that is nearest to n·δΓ on ∂Ω, by least
squares, gives u inside. The adjoint maps weights of u at points of Ω to weights of n·δΓ, by one solve with the same
matrix. Integrals inside Ω are evaluated by Cauchy's formula.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float
from scipy.linalg import cho_factor, cho_solve

from spinor_geom.arrays import place_of, to_numpy
from spinor_geom.domain.quadrature import path_to
from spinor_geom.gradients.rim_nodes import RimNodes
from spinor_geom.holomorphic.arnoldi import arnoldi_hessenberg
from spinor_geom.holomorphic.cauchy import raw_features
from spinor_geom.holomorphic.cauchy_sums import cauchy_sums
from spinor_geom.holomorphic.poles import Poles, edge_poles, place_poles
from spinor_geom.plateau.network.network_route import point_in_hole
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.surface.array_surface import PATH_ORDER

_DEGREE = 40  # of the polynomials beside poles
_AT_ONCE = 1 << 22  # pairs of points: sums of fewer pairs are direct
_DAMPING = 1e-12  # relative to the mean diagonal entry, because tangential displacements are undetermined

Values = Complex[np.ndarray, "k f"]


@dataclass(frozen=True, kw_only=True, eq=False)
class JacobiFields:
    """The fields u of a surface between rims, at nodes on ∂Ω and at points inside Ω.

    Unknowns are the real parts of the coefficients of δp and δq, their imaginary parts, and a translation.
    """

    solution: PlateauSolution
    z: Complex[np.ndarray, " v"]  # inside Ω
    rims: list[RimNodes]  # the nodes on ∂Ω

    def by_boundary(self, by_u: Float[np.ndarray, " v"]) -> list[Float[np.ndarray, "_ 3"]]:
        """Weights of δΓ at the nodes of each rim, from weights of u at the points inside."""
        root = np.sqrt(self._lengths)
        by_unknowns = cho_solve(self._factor, self._inside(by_u))
        by_normal = root * (self._rows @ by_unknowns)[: len(root)]
        counts = np.cumsum([len(rim.places) for rim in self.rims])[:-1]
        return np.split(by_normal[:, None] * self._normal, counts)

    @cached_property
    def _nodes(self) -> Complex[np.ndarray, " k"]:
        return np.concatenate([rim.z for rim in self.rims])

    @cached_property
    def _steps(self) -> Complex[np.ndarray, " k"]:
        """Weights of ∮ f dz."""
        return np.concatenate([rim.steps for rim in self.rims])

    @cached_property
    def _normal(self) -> Float[np.ndarray, "k 3"]:
        return np.asarray(self.solution.array_surface.normal(self._nodes))

    @cached_property
    def _lengths(self) -> Float[np.ndarray, " k"]:
        """Lengths of Γ that belong to the nodes, with the sum 1."""
        length = np.linalg.norm(np.concatenate([rim.conormal for rim in self.rims]), axis=1)
        return np.asarray(length / length.sum())

    @cached_property
    def _poles(self) -> Poles:
        domain, points = self.solution.domain, sum(len(rim.loop) for rim in self.solution.rims)
        if domain.corners.any():
            return place_poles(domain)
        # a smooth ∂Ω may have many more vertices than the displacements of the points need
        step = max(1, len(domain.vertices) // (2 * points))
        poles = edge_poles(domain, offset=step)
        return Poles(positions=poles.positions[::step], scales=poles.scales[::step])

    @cached_property
    def _hessenberg(self) -> Complex[np.ndarray, "d1 d"]:
        weight = np.abs(self._steps)
        return np.asarray(arnoldi_hessenberg(self._nodes, weight / weight.sum(), _DEGREE))

    def _features(self, z: Complex[np.ndarray, " k"]) -> Values:
        """Basis functions of δp and δq. They change sign where p and q do."""
        raw = np.asarray(raw_features(z, self._hessenberg, self._poles.positions, self._poles.scales))
        surface = self.solution.array_surface
        sign_changing = getattr(surface.model, "sign_changing", None)
        if sign_changing is None:
            return raw
        sign = to_numpy(sign_changing(place_of(surface.spinor_map).put(z)))
        return np.asarray(raw * sign[:, None])

    def _changes(self, z: Complex[np.ndarray, " k"]) -> Complex[np.ndarray, "2 k f"]:
        """2pf and 2qf for all functions f."""
        spinors = np.asarray(self.solution.array_surface.spinors(z))
        return np.asarray(2 * np.moveaxis(spinors, -1, 0)[..., None] * self._features(z))

    @cached_property
    def _primitives(self) -> tuple[Complex[np.ndarray, "2 k f"], Complex[np.ndarray, "holes 2 f"]]:
        """∫ 2pf dz and ∫ 2qf dz from the start of the first rim to the nodes, and around the holes."""
        domain, first, parts, periods = self.solution.domain, 0, [], []
        for number, (rim, boundary) in enumerate(zip(self.rims, domain.boundaries, strict=True)):
            changes = self._changes(rim.z)
            along, total = rim.integral(np.moveaxis(changes, 0, 1).reshape(len(rim.z), -1))
            start = self._path(first) if len(self.rims) > 1 else 0.0
            parts.append(np.moveaxis(along.reshape(len(rim.z), 2, -1), 1, 0) + start)
            if number:
                periods.append(total.reshape(2, -1))
            first += len(boundary.vertices)
        return np.concatenate(parts, axis=1), np.array(periods, dtype=np.complex128).reshape(-1, 2, self._count)

    @cached_property
    def _centres(self) -> list[complex]:
        """A point in each hole."""
        return [point_in_hole(hole.vertices) for hole in self.solution.domain.holes]

    @property
    def _logarithms(self) -> Iterator[Complex[np.ndarray, " k"]]:
        """log(z − c) at the nodes for each hole, continuous along the rims and the paths between them."""
        domain = self.solution.domain
        starts = np.cumsum([0, *(len(boundary.vertices) for boundary in domain.boundaries)])
        for centre in self._centres:
            parts = []
            for rim, first in zip(self.rims, starts, strict=False):
                path = path_to(domain, int(first), PATH_ORDER)[0]
                angle = np.unwrap(np.angle(np.concatenate([path, rim.z]) - centre))[len(path) :]
                parts.append(np.log(np.abs(rim.z - centre)) + 1j * angle)
            yield np.concatenate(parts)

    def _path(self, vertex: int) -> Complex[np.ndarray, "2 1 f"]:
        """∫ 2pf dz and ∫ 2qf dz from the root of Ω to a vertex."""
        z, dz = path_to(self.solution.domain, vertex, PATH_ORDER)
        return np.asarray(np.einsum("k,ckf->cf", dz, self._changes(z))[:, None])

    @property
    def _count(self) -> int:
        return len(self._poles.positions) + _DEGREE + 1

    @cached_property
    def _rows(self) -> Float[np.ndarray, "equations unknowns"]:
        """Derivatives in the unknowns of √ds n·δr at the nodes, then of Re ∮ δφ dz around the holes."""
        (by_p, by_q), periods = self._primitives
        e = np.sqrt(self._lengths)[:, None] * self._normal
        rows = [_by_unknowns(e, by_p, by_q)]
        for around in periods:
            closing = _by_unknowns(np.eye(3), *np.repeat(around[:, None], 3, axis=1))
            closing[:, -3:] = 0
            rows.append(closing)
        return np.concatenate(rows)

    @cached_property
    def _factor(self) -> tuple[np.ndarray, bool]:
        matrix = self._rows.T @ self._rows
        matrix.flat[:: len(matrix) + 1] += _DAMPING * np.trace(matrix) / len(matrix)
        return cho_factor(matrix)

    def _inside(self, by_u: Float[np.ndarray, " v"]) -> Float[np.ndarray, " unknowns"]:
        """Weights of the unknowns, from weights of u at the points inside."""
        e = by_u[:, None] * np.asarray(self.solution.array_surface.normal(self.z))
        strengths = np.stack([e[:, 0] - 1j * e[:, 1], e[:, 0] + 1j * e[:, 1], e[:, 2]], axis=1)
        # Cauchy's formula, divided by the same sum for 1
        total = cauchy_sums(self._nodes, self._steps[:, None], self.z)
        strength = strengths / total
        # in blocks small enough for direct sums. The fast method needs ordered sources
        parts = np.array_split(np.arange(len(self.z)), 1 + len(self.z) * len(self._nodes) // _AT_ONCE)
        sums = sum(cauchy_sums(self.z[part], strength[part], self._nodes) for part in parts)
        spread = -sums * self._steps[:, None]
        (by_p, by_q), periods = self._primitives
        along, back, upright = spread.T
        both = np.stack([along @ by_p + upright @ by_q, upright @ by_p - back @ by_q])
        for (by_p, by_q), at_nodes, centre in zip(periods, self._logarithms, self._centres, strict=True):
            # the multivalued parts of ∫ f dz and of log(z − c) ∮ f dz/2πi cancel. Inside, arg(z − c) is left out, as
            # Re ∮ δφ dz = 0
            inside = np.log(np.abs(self.z - centre))
            along, back, upright = (spread.T @ at_nodes - strengths.T @ inside) / (2j * np.pi)
            both += np.stack([along * by_p + upright * by_q, upright * by_p - back * by_q])
        both = both.ravel()
        return np.concatenate([both.real, -both.imag, e.sum(axis=0)])


def _by_unknowns(e: Float[np.ndarray, "k 3"], by_p: Values, by_q: Values) -> Float[np.ndarray, "k unknowns"]:
    """Derivatives of e·δr in the unknowns, from ∫ 2pf dz and ∫ 2qf dz."""
    along, upright = (e[:, 0] - 1j * e[:, 1])[:, None], e[:, 2:]
    both = np.concatenate([along * by_p + upright * by_q, upright * by_p - along.conj() * by_q], axis=1)
    return np.concatenate([both.real, -both.imag, e], axis=1)
