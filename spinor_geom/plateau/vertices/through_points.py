"""Newton's method for surfaces through given points: features of p and q, integrals along polygons in Ω."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import (
    EPS,
    Array,
    Place,
    add_to_diagonal,
    definite_cholesky,
    namespace,
    place_of,
    shifted,
    solve_lower,
    square,
)
from spinor_geom.deadline import require_time
from spinor_geom.domain.quadrature import rule
from spinor_geom.holomorphic.arnoldi import arnoldi_basis, arnoldi_polynomials
from spinor_geom.holomorphic.cauchy import CauchyNetwork, raw_features, sign_changing
from spinor_geom.holomorphic.poles import Poles
from spinor_geom.plateau.steps import STALLED, Steps
from spinor_geom.plateau.vertices.edge_features import EdgeFeatures, nodes_on_edges
from spinor_geom.plateau.vertices.point_equations import PointEquations
from spinor_geom.surface.formulas import phi

# Counts are of the sixty rims "cut" of benchmarks/constants.py, of which 59 converge.
# Gauss-Legendre nodes on each edge, and degree of the polynomials. The distance is measured with twice as many nodes.
# If it is too large the solve is repeated with them. With 10 nodes 58 rims converge.
NODES = 14
# Step lengths to try. Without the last one 57 rims converge.
_LENGTHS = (1.0, 0.5, 0.25)
# A linearisation takes as long as one step for every 30 points. Before the next linearisation, one slow step, which
# does not halve the distance, is allowed for every 100 points. Without slow steps noisy rims take 40 % longer.
_POINTS_PER_SLOW_STEP = 100


@dataclass(frozen=True, kw_only=True, eq=False)
class OnRim:
    """The features on one rim of Ω, and the function that changes sign around holes, by which they are multiplied."""

    polygon: Complex[Array, " n"]
    dz: Complex[Array, "n g"]  # weights of integrals, at Gauss-Legendre nodes on the edges
    sign: Complex[Array, "n g"]
    features: EdgeFeatures  # without the sign
    own: slice  # the features of the rim's own poles
    norm: Complex[Array, "c c"]  # L with LLᴴ the Gram matrix of the own features in H¹

    def nearest(self, spinors: Complex[Array, "n g 2"]) -> Complex[Array, "c 2"]:
        """Orthonormal read-outs of the own features, without sign change, nearest in H¹ to values at the nodes."""
        norm = _norm_of_edge(spinors.shape[1], place_of(spinors)) + 0j
        weighted = norm.mT @ (norm @ spinors) * shares(self.polygon)[:, None, None]
        return solve_lower(self.norm, self.features.adjoint(weighted)[self.own])

    def nearest_between(self, spinors: Complex[Array, "n 2"]) -> Complex[Array, "k 2"]:
        """Orthonormal read-outs nearest in H¹ to values at the midpoints of the edges, linear between them."""
        share = place_of(spinors).put(rule("gauss", self.sign.shape[1]).nodes)[:, None]
        edge, xp = shares(self.polygon)[:, None, None], namespace(spinors)
        before, after = shifted(spinors, 1, axis=0)[:, None], shifted(spinors, -1, axis=0)[:, None]
        back = xp.clip(0.5 - share, 0, None) * edge * 2 / (edge + shifted(edge, 1, axis=0))
        ahead = xp.clip(share - 0.5, 0, None) * edge * 2 / (edge + shifted(edge, -1, axis=0))
        return self.nearest((1 - back - ahead) * spinors[:, None] + back * before + ahead * after)

    def values(self, raw: Complex[Array, "k 2"]) -> Complex[Array, "n g 2"]:
        """Values of p and q at the nodes."""
        return self.sign[..., None] * self.features.values(raw)

    def steps(self, spinors: Complex[Array, "n g 2"]) -> Float[Array, "n 3"]:
        """Re ∫ φ dz over each edge."""
        squares = (spinors * self.dz[..., None]).mT @ spinors
        pp, qq, pq = squares[:, 0, 0], squares[:, 1, 1], squares[:, 0, 1]
        # the real part of `null_vector`
        return namespace(spinors).stack([(pp - qq).real, (pp + qq).imag, 2 * pq.real], axis=1)

    def changes(self, spinors: Complex[Array, "n g 2"]) -> Complex[Array, "2 n k"]:
        """∫ 2pf dz and ∫ 2qf dz over each edge for all features f."""
        return self.features.by_edge((spinors * (2 * self.dz * self.sign)[..., None]).mT).swapaxes(0, 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Basis:
    """Polynomials and Cauchy units, those of the outer rim first, with the H¹ norm of each rim's features."""

    hessenberg: Complex[Array, "d1 d"]
    poles: Complex[Array, " m"]
    scales: Float[Array, " m"]
    branches: Complex[Array, " b"]
    rims: tuple[OnRim, ...]
    paths: tuple[tuple[Complex[Array, "_ k"], Complex[Array, "_"]], ...]  # features on a path to each rim, and dz

    @classmethod
    def on(
        cls,
        polygons: Sequence[Complex[Array, "_"]],
        poles: Sequence[Poles],
        *,
        nodes: int,
        paths: Sequence[tuple[Complex[np.ndarray, "_"], Complex[np.ndarray, "_"]]] = (),
        branches: Complex[Array, " b"] | None = None,
    ) -> Basis:
        """The features on the rims of Ω.

        Raises:
            OutOfTimeError: time ran out.
        """
        outer, xp = polygons[0], namespace(polygons[0])
        place = place_of(outer)
        branches = outer[:0] if branches is None else branches
        positions = place.put(np.concatenate([each.positions for each in poles]))
        scales = place.put(np.concatenate([each.scales for each in poles]))
        gauss = place.put(rule("gauss", nodes).weights)
        weight, degree = shares(outer)[:, None] * gauss, min(NODES, max(2, len(outer) // 2))
        hessenberg, values = arnoldi_basis(nodes_on_edges(outer, nodes).reshape(-1), weight.reshape(-1), degree)
        polynomials = [
            values.reshape(len(outer), nodes, -1),
            *(arnoldi_polynomials(nodes_on_edges(polygon, nodes), hessenberg) for polygon in polygons[1:]),
        ]
        # polynomials count as features of the outer rim
        ends = [0, *(len(hessenberg) + np.cumsum([len(each.positions) for each in poles])).tolist()]
        rims = []
        for number, polygon in enumerate(polygons):
            require_time()  # for thousands of points each product takes seconds
            features = EdgeFeatures.on(polygon, polynomials[number], positions, scales)
            require_time()
            own = slice(*ends[number : number + 2])
            matrix = features.gram(_norm_of_edge(nodes, place) + 0j, shares(polygon), own)
            each = xp.arange(matrix.shape[0])
            # units with neighbouring poles are nearly linearly dependent
            add_to_diagonal(matrix, EPS**0.5 * matrix[each, each].real.mean())
            rims.append(
                OnRim(
                    polygon=polygon,
                    dz=(shifted(polygon, -1) - polygon)[:, None] * gauss,
                    sign=sign_changing(nodes_on_edges(polygon, nodes), branches),
                    features=features,
                    own=own,
                    norm=definite_cholesky(matrix),
                )
            )
        on_paths = [
            (raw_features(z, hessenberg, positions, scales) * sign_changing(z, branches)[..., None], dz)
            for z, dz in ([place.put(part) for part in path] for path in paths)
        ]
        return cls(
            hessenberg=hessenberg,
            poles=positions,
            scales=scales,
            branches=branches,
            rims=tuple(rims),
            paths=tuple(on_paths),
        )

    def raw(self, readout: Complex[Array, "k 2"]) -> Complex[Array, "k 2"]:
        """Read-outs of the features from read-outs of the orthonormal ones."""
        parts = [solve_lower(rim.norm, readout[rim.own], adjoint=True) for rim in self.rims]
        return namespace(readout).concat(parts)

    def readout(self, raw: Complex[Array, "k 2"]) -> Complex[Array, "k 2"]:
        """Read-outs of the orthonormal features from those of the features."""
        return namespace(raw).concat([rim.norm.mT.conj() @ raw[rim.own] for rim in self.rims])

    def orthonormal(self, rows: Complex[Array, "r k"]) -> Complex[Array, "k r"]:
        """Conjugates of linear functions of the features, as functions of the orthonormal ones."""
        return namespace(rows).concat([solve_lower(rim.norm, rows[:, rim.own].mT.conj()) for rim in self.rims])

    def network(self, raw: Complex[Array, "k 2"]) -> CauchyNetwork:
        """The network with given read-outs of the features."""
        return CauchyNetwork.of_raw_features(
            self.rims[0].polygon,
            hessenberg=self.hessenberg,
            poles=self.poles,
            scales=self.scales,
            readout=raw,
            branches=self.branches,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Passing:
    """A surface with given read-outs, and the points of all rims that it should pass through."""

    basis: Basis
    points: tuple[Float[Array, "_ 3"], ...]
    raw: Complex[Array, "k 2"]

    @cached_property
    def _spinors(self) -> tuple[Complex[Array, "_ g 2"], ...]:
        return tuple(rim.values(self.raw) for rim in self.basis.rims)

    @cached_property
    def _steps(self) -> tuple[Float[Array, "_ 3"], ...]:
        return tuple(rim.steps(spinors) for rim, spinors in zip(self.basis.rims, self._spinors, strict=True))

    @property
    def _gaps(self) -> list[Float[Array, "3"]]:
        """Re ∮ φ dz around each hole."""
        return [steps.sum(0) for steps in self._steps[1:]]

    @property
    def _changes(self) -> list[Complex[Array, "2 _ k"]]:
        return [rim.changes(spinors) for rim, spinors in zip(self.basis.rims, self._spinors, strict=True)]

    @cached_property
    def _on_paths(self) -> tuple[Complex[Array, "_ 2"], ...]:
        return tuple(path @ self.raw for path, _ in self.basis.paths)

    @cached_property
    def _starts(self) -> list[Float[Array, "3"]]:
        """Differences of the first point of each rim from the given one, without a common constant."""
        path = [
            (phi(*each.mT) * dz[:, None]).sum(0).real
            for each, (_, dz) in zip(self._on_paths, self.basis.paths, strict=True)
        ]
        return [(path[k] if path else 0.0) - points[0] for k, points in enumerate(self.points)]

    @cached_property
    def error(self) -> Float[Array, "n 3"]:
        """Differences of Re ∫ φ dz over each edge from its vector, then those between the starts of two rims."""
        xp = namespace(self.raw)
        edges = [
            step - (shifted(points, -1, axis=0) - points) for step, points in zip(self._steps, self.points, strict=True)
        ]
        first, *others = self._starts
        return xp.concat([*edges, *((other - first)[None] for other in others)])

    @cached_property
    def distance(self) -> float:
        """Root mean square of the distances of the points, with mean 0, and of the periods of r around each hole."""
        xp = namespace(self.raw)
        rows = [
            step.cumsum(0) - step - (points - points[0]) + start
            for step, points, start in zip(self._steps, self.points, self._starts, strict=True)
        ]
        away = xp.concat(rows)
        away = xp.concat([away - away.mean(0), *(gap[None] for gap in self._gaps)])
        return math.sqrt(square(away).sum(1).mean())

    def at(self, readout: Complex[Array, "k 2"]) -> Passing:
        """The surface with other read-outs."""
        return replace(self, raw=self.basis.raw(readout))

    def linearised(self) -> PointEquations:
        """The derivative of the error with respect to the read-outs."""
        on_paths = [
            2 * (values * dz[:, None]).mT @ path
            for values, (path, dz) in zip(self._on_paths, self.basis.paths, strict=True)
        ]
        between = [(other - on_paths[0])[:, None] for other in on_paths[1:]]
        rows = namespace(self.raw).concat([*self._changes, *between], axis=1)
        starts = np.cumsum([0, *map(len, self.points)])
        before = [
            start + np.roll(np.arange(len(points)), 1) for start, points in zip(starts, self.points, strict=False)
        ]
        before.append(np.arange(starts[-1], rows.shape[1]))
        by_p, by_q = map(self.basis.orthonormal, rows)
        return PointEquations.of(by_p, by_q, np.concatenate(before))

    def closed(self, readout: Complex[Array, "k 2"]) -> Complex[Array, "k 2"]:
        """The nearest read-outs whose periods are 0, to first order."""
        xp = namespace(self.raw)
        rows = xp.stack([over_edge.sum(1) for over_edge in self._changes[1:]], axis=1)
        return readout + PointEquations.of(*map(self.basis.orthonormal, rows)).step(xp.stack(self._gaps), None)


@lru_cache
def _norm_of_edge(count: int, place: Place) -> Float[Array, "d g"]:
    """R with |Rf|² = ∫ |f|² + |f′|² over an edge of length 1, from values at the nodes.

    f is projected on polynomials of a degree of half the nodes: p and q hardly vary along an edge.
    """
    places, weights = rule("gauss", count)
    degrees = np.arange(count // 2 + 1)
    values = np.polynomial.legendre.legvander(2 * places - 1, degrees[-1])
    slopes = 2 * np.polynomial.legendre.legval(2 * places - 1, np.polynomial.legendre.legder(np.eye(len(degrees)))).T
    both = np.diag(1 / (2 * degrees + 1)) + slopes.T @ (weights[:, None] * slopes)
    projection = (2 * degrees[:, None] + 1) * (values * weights[:, None]).T
    return place.put(np.linalg.cholesky(both).T @ projection)


def nearest_through(
    here: Passing, readout: Complex[Array, "k 2"], *, start: Complex[Array, "k 2"], allowed: float, steps: Steps
) -> Complex[Array, "k 2"]:
    """Read-outs nearest to `start` whose surface passes through all points, to allowed/2, by Newton's method.

    Raises:
        OutOfTimeError: time ran out.
    """
    linear: PointEquations | None = None
    taken: list[Complex[Array, "k 2"]] = []  # the steps since the last linearisation
    slow, n = 0, len(here.error)
    while here.distance > allowed / 2 and steps.left:
        require_time()
        fresh = linear is None
        if linear is None:
            linear, taken, slow = here.linearised(), [], 0
        # a step with a new linearisation leads to the solution nearest to the start
        step = linear.step(here.error, readout - start if fresh else None)
        if slow:
            step = _updated(step, taken)
        for length in _LENGTHS:
            there = here.at(readout + length * step)
            if there.distance < here.distance:
                break
        else:
            if fresh:
                break
            linear = None
            continue
        readout, here, before = readout + length * step, there, here.distance
        taken.append(length * step)
        steps.take("Newton", here.distance)
        if here.distance > before / 2:
            if fresh and here.distance > STALLED * before:
                break
            slow += 1
            if slow * _POINTS_PER_SLOW_STEP > n:
                linear = None
    return readout


def _updated(step: Complex[Array, "k 2"], taken: Sequence[Complex[Array, "k 2"]]) -> Complex[Array, "k 2"]:
    """A step with an old linearisation after Broyden's updates by the steps taken since.

    Source: Kelley, "Iterative methods for linear and nonlinear equations" (1995), chapter 7.
    """

    def share(earlier: Complex[Array, "k 2"]) -> Float[Array, ""]:
        return (earlier.conj() * step).real.sum() / square(earlier).sum()

    for earlier, later in pairwise(taken):
        step = step + later * share(earlier)
    return step / (1 - share(taken[-1]))


def shares(polygon: Complex[Array, " n"]) -> Float[Array, " n"]:
    """Lengths of a polygon's edges over its perimeter."""
    edge = abs(shifted(polygon, -1) - polygon)
    return edge / edge.sum()
