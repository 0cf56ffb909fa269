"""The minimal surface of p and q near a harmonic surface between rims with corners.

p and q are square roots of components of φ = 2∂X/∂z, expanded by least squares in functions with the poles of the
harmonic surface X. Where X is not exactly conformal, their surface misses Γ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import zpstrf

from spinor_geom.arrays import EPS, NUMPY, Place, cis, norm, square
from spinor_geom.deadline import require_time
from spinor_geom.domain.plane_domain import TOWARDS_CORNER, PlaneDomain, SplineBoundary, panel_breaks
from spinor_geom.domain.quadrature import Panels, path_to
from spinor_geom.errors import SurfaceError
from spinor_geom.holomorphic.arnoldi import arnoldi_hessenberg
from spinor_geom.holomorphic.cauchy import FACTOR_SECONDS, CauchyNetwork, raw_features
from spinor_geom.holomorphic.poles import Poles
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.piece_polynomials import ANALYTIC_DEGREE
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.lifted_surface import TURN_OF_AN_EDGE
from spinor_geom.plateau.harmonic.smooth_domain import COARSE
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.network.discretisation import interpolate_matching, projected
from spinor_geom.plateau.network.network_problem import nearest_increasing, slide_bounds
from spinor_geom.plateau.newton import ROUNDING, STEPS_TO_ROUNDING
from spinor_geom.plateau.rims.cornered import CorneredSurface
from spinor_geom.plateau.rims.sides import SAMPLES, slices
from spinor_geom.plateau.vertices.point_equations import PointEquations
from spinor_geom.surface.array_surface import PATH_ORDER, ArraySurface
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.frames import signs_close_up, spinors_from_phi

# Nodes of a panel. Towards corners panels are quartered, and integrals of p² are exact to 1e-11.
_ORDER = 8
_NULL = 0.3  # |φ·φ| / |φ|² up to which the sign of p and q is clear


@dataclass(frozen=True, kw_only=True, eq=False)
class CorneredLift:
    """Expansions of p and q of harmonic surfaces over one Ω."""

    surface: CorneredSurface
    curves: tuple[BoundaryCurve, ...]  # in the order and direction of ∂Ω

    def lifted(self) -> LiftedSurface:
        """The minimal surface of p and q.

        Raises:
            SurfaceError: the harmonic surface has a branch point of odd order.
        """
        slides = np.concatenate(list(map(self._slide, range(len(self.panels)))))
        return LiftedSurface.of(self, self._closed(self._expanded()), slides)

    def integrated(
        self, values: Complex[np.ndarray, "n k"], on_paths: Sequence[Complex[np.ndarray, "_ k"]]
    ) -> Complex[np.ndarray, "n k"]:
        """∫ f dz from Ω's root to the nodes."""
        parts = []
        rims = zip(self.panels, self.rows, self.paths, on_paths, self.domain.boundaries, self.anchors, strict=True)
        for own, rows, (_, steps), path, boundary, anchor in rims:
            velocity = (values[rows] * own.dz[:, None]).reshape(-1, own.order, values.shape[1])
            total = np.einsum("pg,pgk->pk", own.weights.reshape(-1, own.order), velocity)
            ends = np.concatenate([np.zeros_like(total[:1]), np.cumsum(total, axis=0)])
            start = steps @ path - ends[np.searchsorted(own.breaks, boundary.parameters[anchor])]
            inner = np.diff(own.breaks)[:, None, None] * (own.cumulative @ velocity)
            parts.append((start + ends[:-1, None] + inner).reshape(len(own.z), -1))
        return np.concatenate(parts)

    @cached_property
    def domain(self) -> PlaneDomain:
        """Ω, with vertices at the corners."""
        outer, *holes = self._boundaries
        return PlaneDomain.inside(outer, holes=tuple(holes))

    @cached_property
    def panels(self) -> tuple[Panels, ...]:
        """Panels on each boundary of Ω."""
        return tuple(Panels.on(one, panel_breaks(one), _ORDER) for one in self.domain.boundaries)

    @cached_property
    def z(self) -> Complex[np.ndarray, " n"]:
        """The nodes of all panels."""
        return np.concatenate([own.z for own in self.panels])

    @cached_property
    def steps(self) -> Complex[np.ndarray, " n"]:
        """Dz times the weights at the nodes."""
        return np.concatenate([own.dz * own.weights for own in self.panels])

    @cached_property
    def rows(self) -> tuple[slice, ...]:
        """The nodes of each boundary."""
        return slices([len(own.z) for own in self.panels])

    @cached_property
    def anchors(self) -> tuple[int, ...]:
        """The vertex of each boundary with the longest edges beside it, far from corners and other circles."""
        found = []
        for boundary in self.domain.boundaries:
            ahead = np.diff(boundary.parameters)
            found.append(int((np.minimum(ahead, np.roll(ahead, 1)) * ~boundary.corners).argmax()))
        return tuple(found)

    @cached_property
    def paths(self) -> tuple[tuple[Complex[np.ndarray, " _"], Complex[np.ndarray, " _"]], ...]:
        """Nodes and dz on paths from Ω's root to the anchors."""
        firsts = np.cumsum([0, *(len(boundary.vertices) for boundary in self.domain.boundaries)]).tolist()
        return tuple(
            path_to(self.domain, first + anchor, PATH_ORDER)
            for first, anchor in zip(firsts, self.anchors, strict=False)
        )

    @cached_property
    def _null_curve(self) -> Complex[np.ndarray, "n 3"]:
        """φ of the harmonic surface at the nodes."""
        return self.surface.null_curve(self.z)

    @cached_property
    def branches(self) -> Complex[np.ndarray, " b"]:
        """The centres of holes around which p and q change their sign."""
        is_odd = [not continuous_spinors(self._null_curve[own])[1] for own in self.rows[1:]]
        return self.surface.form.circles.centres[1:][is_odd]

    def squared_root(self, z: Complex[np.ndarray, " _"]) -> Complex[np.ndarray, " _"]:
        """The square of the factor of p and q that changes sign."""
        return np.asarray((z[:, None] - self.branches).prod(axis=-1))

    def _by_rim(self) -> Complex[np.ndarray, "n m2"]:
        """Values of p and q over the factor that changes sign: columns for each boundary, 0 on the others.

        Raises:
            SurfaceError: the signs change around a boundary.
        """
        reduced = self._null_curve / self.squared_root(self.z)[:, None]
        parts, close_up = zip(*(continuous_spinors(reduced[own]) for own in self.rows), strict=True)
        if not all(close_up):
            raise SurfaceError(
                "the harmonic surface between the rims has a branch point of odd order; no immersed minimal surface "
                "was found near it"
            )
        joined = np.zeros((len(self.z), 2 * len(parts)), dtype=np.complex128)
        for number, (own, part) in enumerate(zip(self.rows, parts, strict=True)):
            joined[own, 2 * number : 2 * number + 2] = part
        return joined

    @cached_property
    def hessenberg(self) -> Complex[np.ndarray, "d1 d"]:
        """The recurrence of the polynomials."""
        weights = np.abs(self.steps) / np.abs(self.steps).sum()
        return np.asarray(arnoldi_hessenberg(self.z, weights, self.surface.form.rims.powers[0]))

    def features(self, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n f"]:
        """The functions in which p and q are expanded."""
        return np.asarray(raw_features(z, self.hessenberg, self.poles.positions, self.poles.scales))

    @cached_property
    def at_nodes(self) -> Complex[np.ndarray, "n f"]:
        """The features at the nodes."""
        return self.features(self.z)

    @cached_property
    def on_paths(self) -> tuple[Complex[np.ndarray, "_ f"], ...]:
        """The features on the paths."""
        return tuple(self.features(z) for z, _ in self.paths)

    @cached_property
    def _weighted(self) -> Complex[np.ndarray, "f n"]:
        # Errors of p and q move the boundary by their products with p and q. Near corners the energy hardly depends on
        # the harmonic surface: φ is not null there, and would spoil p and q far from them.
        reliable = 1 / (_defects(self._null_curve) + COARSE**0.75)
        weights = norm(self._null_curve) * np.abs(self.steps) * reliable
        return np.asarray((self.at_nodes.conj() * weights[:, None]).T)

    @cached_property
    def _normal_equations(self) -> tuple[Complex[np.ndarray, "r r"], Int[np.ndarray, " r"], Float[np.ndarray, " f"]]:
        """The Cholesky factor of the features that are kept, their numbers, and the sizes of all features."""
        rows, columns = self.at_nodes.shape
        require_time(FACTOR_SECONDS * rows * columns**2)
        gram = self._weighted @ self.at_nodes
        size = np.sqrt(np.diag(gram).real)
        factor, order, rank, _ = zpstrf(gram / size / size[:, None], tol=ROUNDING, lower=1)
        return factor[:rank, :rank], order[:rank] - 1, size

    def _solved(self, right: Complex[np.ndarray, "f c"]) -> Complex[np.ndarray, "f c"]:
        factor, kept, size = self._normal_equations
        found = np.zeros_like(right)
        half = solve_triangular(factor, right[kept] / size[kept, None], lower=True)
        found[kept] = solve_triangular(factor, half, lower=True, trans="C") / size[kept, None]
        return found

    def _expanded(self) -> Complex[np.ndarray, "f 2"]:
        """Coefficients of p and q, with the signs on the boundaries for which they fit best."""
        right = self._weighted @ self._by_rim()
        found = self._solved(right)
        # refined to the accuracy of orthonormal functions
        found += self._solved(right - self._weighted @ (self.at_nodes @ found))
        by_rim = (right.reshape(len(right), -1, 2), found.reshape(len(right), -1, 2))
        agreement = np.einsum("fic,fjc->ij", by_rim[0].conj(), by_rim[1]).real
        np.fill_diagonal(agreement, 0.0)
        vector = np.linalg.eigh(agreement + agreement.T)[1][:, -1]
        return np.asarray(np.einsum("fic,i->fc", by_rim[1], np.where(vector * vector[0] < 0, -1.0, 1.0)))

    def _closed(self, readout: Complex[np.ndarray, "f 2"]) -> Complex[np.ndarray, "f 2"]:
        """The coefficients with the least change for which Re ∮ φ dz = 0 around each hole."""
        for _ in range(STEPS_TO_ROUNDING):
            gaps, rows = [], []
            for own in self.rows[1:]:
                features, step = self.at_nodes[own], (self.steps * self.squared_root(self.z))[own, None]
                values = features @ readout
                gaps.append((step * phi(*values.T)).sum(axis=0).real)
                rows.append((2 * (step * values).T @ features).conj())
            by_p, by_q = np.stack(rows, axis=-1)
            readout = readout + PointEquations.of(by_p, by_q).step(np.stack(gaps), None)
        return readout

    @cached_property
    def poles(self) -> Poles:
        """Those of the harmonic surface, and poles in the holes in place of powers."""
        form = self.surface.form
        positions, scales, _ = form.circles.poles(form.rims)
        poles = Poles(positions=positions, scales=scales)
        circles = zip(form.circles.centres[1:], form.circles.radii[1:], form.rims.powers[1:], strict=True)
        for centre, radius, powers in circles:
            # EPS**0.5 is the share of powers as high as the number of poles that enter lower ones
            inside = radius * EPS ** (0.5 / powers)
            around = centre + inside * cis(2 * np.pi / powers * np.arange(powers))
            poles += Poles(positions=around, scales=np.full(powers, radius - inside))
        return poles

    @cached_property
    def _boundaries(self) -> tuple[SplineBoundary, ...]:
        """The circles, from their first corners on."""
        circles, boundaries = self.surface.form.circles, []
        # of edges towards a corner, unless its angle is above 180°. Panels are shorter
        levels = round(self.surface.form.rims.resolution.depth / math.log(4)) - len(TOWARDS_CORNER) // 2
        for rim, (centre, radius, sign) in enumerate(zip(circles.centres, circles.radii, circles.signs, strict=True)):
            arguments = self._ends(rim)
            parts = []
            own = [side for side in self.surface.form.rims.sides if side.rim == rim]
            for (start, end), side in zip(pairwise(arguments.tolist()), own, strict=True):
                even = self._edges(rim, start, end)
                near = 0.25 ** np.arange(levels, 0, -1)
                ahead, back = (
                    length * near[: levels * (exponent <= 1)]
                    for length, exponent in zip((even[1] - start, end - even[-2]), side.exponents, strict=True)
                )
                parts.append(np.concatenate([[start], start + ahead, even[1:-1], end - back[::-1]]))
            corners = np.concatenate(
                [
                    (np.arange(len(part)) == 0) & (side.corners is not None and side.start in self._corners[rim])
                    for part, side in zip(parts, own, strict=True)
                ]
            )
            at = np.append(np.concatenate(parts), arguments[-1])
            k = np.arange(ANALYTIC_DEGREE, -1, -1)[:, None]
            slopes = (2j * np.pi * sign) ** k / [[math.factorial(power)] for power in k.ravel()]
            coefficients = radius * slopes * np.exp(1j * sign * at[:-1])
            coefficients[-1] += centre
            parameters = np.append((at[:-1] - at[0]) / (2 * np.pi), 1.0)
            boundaries.append(SplineBoundary(parameters, coefficients, corners))
        return tuple(boundaries)

    def _edges(self, rim: int, start: float, end: float) -> Float[np.ndarray, " k"]:
        """Arguments between two on a circle, in steps as long as the gap to the nearest other circle at most."""
        circles = self.surface.form.circles
        at = np.linspace(start, end, SAMPLES)
        z = circles.centres[rim] + circles.radii[rim] * cis(circles.signs[rim] * at)
        gaps = np.abs(np.abs(z - circles.centres[:, None]) - circles.radii[:, None])
        longest = np.minimum(TURN_OF_AN_EDGE, np.delete(gaps, rim, axis=0).min(axis=0) / circles.radii[rim])
        edges = cumulative_trapezoid(1 / longest, at, initial=0)
        edges *= math.ceil(edges[-1]) / edges[-1]
        return np.asarray(np.interp(np.arange(round(edges[-1]) + 1), edges, at))

    def _has_corners(self, rim: int) -> bool:
        return bool((self.surface.form.rims.rim_of_corner == rim).any())

    def _ends(self, rim: int) -> Float[np.ndarray, " k"]:
        """Arguments of the ends of a rim's sides, closed."""
        form = self.surface.form
        own = form.circles.arguments[form.rims.rim_of_corner == rim] if self._has_corners(rim) else np.zeros(1)
        return np.append(own, own[0] + 2 * np.pi)

    @cached_property
    def tensors(self) -> tuple[CurveTensors, ...]:
        """Γ on each boundary."""
        return self.surface.form.rims.curves

    @cached_property
    def bounds(self) -> tuple[Float[np.ndarray, "_ 2"], ...]:
        """Lowest and highest curve parameter of each node: those of the adjacent corners."""
        rims = zip(self.domain.boundaries, self._corners, self.panels, strict=True)
        return tuple(slide_bounds(one, corners, own.t) for one, corners, own in rims)

    @cached_property
    def _corners(self) -> tuple[Float[np.ndarray, " _"], ...]:
        return tuple(curve.breaks[:-1][curve.corners] for curve in self.curves)

    def _slide(self, rim: int) -> Float[np.ndarray, " n"]:
        """Curve parameters of the harmonic surface at the nodes of a boundary."""
        rims, ends, t = self.surface.form.rims, self._ends(rim), self.panels[rim].t
        starts = (ends - ends[0]) / (2 * np.pi)
        numbers = [number for number, side in enumerate(rims.sides) if side.rim == rim]
        own = np.searchsorted(starts[1:-1], t, side="right")
        slide = np.empty_like(t)
        for k, number in enumerate(numbers):
            side, here = rims.sides[number], own == k
            shares = np.stack([t[here] - starts[k], starts[k + 1] - t[here]]) / (starts[k + 1] - starts[k])
            shares = np.maximum(shares, EPS)  # a node may equal the corner up to rounding errors
            coefficients = self.surface.slides[rims.columns[number]]
            slide[here] = side.slide(side.base(shares) + side.modes(shares) @ coefficients)[0]
        return slide


def _defects(curve: Complex[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """|φ·φ| / |φ|²: 0 for a conformal surface."""
    return np.asarray(np.abs((curve**2).sum(axis=1)) / square(norm(curve)))


def continuous_spinors(curve: Complex[np.ndarray, "n 3"]) -> tuple[Complex[np.ndarray, "n 2"], bool]:
    """P and q of φ along a closed curve, and whether their signs return. φ may not be null near corners.

    Signs are continuous over the nodes where φ is nearly null. Others have the sign of the last of these.
    """
    defects = _defects(curve)
    clear = np.flatnonzero(defects <= max(_NULL, float(np.median(defects))))
    spinors = np.stack(spinors_from_phi(curve), axis=-1)
    continuous = np.stack(spinors_from_phi(curve[clear]), axis=-1)
    before = continuous[np.searchsorted(clear, np.arange(len(curve)), side="right") - 1]
    sign = np.where((spinors * before.conj()).sum(axis=1).real < 0, -1.0, 1.0)
    return spinors * sign[:, None], bool(signs_close_up(*continuous.T))


@dataclass(frozen=True, kw_only=True, eq=False)
class LiftedSurface:
    """The minimal surface of given p and q, and the points of Γ closest to its boundary."""

    lift: CorneredLift
    readout: Complex[np.ndarray, "f 2"]  # coefficients of p and q
    constant: Float[np.ndarray, "3"]  # the position of Ω's root
    slides: Float[np.ndarray, " n"]  # parameters of the closest points of Γ

    @classmethod
    def of(
        cls, lift: CorneredLift, readout: Complex[np.ndarray, "f 2"], slides: Float[np.ndarray, " n"]
    ) -> LiftedSurface:
        """The surface with the best constant, and the points of Γ closest to its boundary, near given ones."""
        null_curve = phi(*(lift.at_nodes @ readout).T) * lift.squared_root(lift.z)[:, None]
        on_paths = [
            phi(*(features @ readout).T) * lift.squared_root(z)[:, None]
            for (z, _), features in zip(lift.paths, lift.on_paths, strict=True)
        ]
        r = lift.integrated(null_curve, on_paths).real
        weights = np.abs(lift.steps) * norm(null_curve)
        weights /= weights.sum()
        rims = list(zip(lift.tensors, lift.rows, lift.bounds, strict=True))
        points = [curve.point_and_derivative(slides[own])[0] for curve, own, _ in rims]
        constant = weights @ (np.concatenate(points) - r)
        for _ in range(2):
            points, near = [], []
            for curve, own, bounds in rims:
                found = projected(r[own] + constant, slides[own], curve, limit=0.5 / len(r))
                speed = square(curve.point_and_derivative(found)[1]).sum(1)
                near.append(nearest_increasing(found, speed, bounds))
                points.append(curve.point_and_derivative(near[-1])[0])
            slides, constant = np.concatenate(near), weights @ (np.concatenate(points) - r)
        return cls(lift=lift, readout=readout, constant=constant, slides=slides)

    def surface(self, place: Place) -> ArraySurface:
        """The surface."""
        lift = self.lift
        network = CauchyNetwork.of_raw_features(
            place.put(lift.z),
            hessenberg=place.put(lift.hessenberg),
            poles=place.put(lift.poles.positions),
            scales=place.put(lift.poles.scales),
            readout=place.put(self.readout),
            branches=place.put(lift.branches),
        )
        return ArraySurface(network, lift.domain, self.constant)

    def part(self, z: Complex[np.ndarray, "*pts"], number: int) -> Complex[np.ndarray, "*pts 2"]:
        """The part of p and q with poles in one hole, or outside the disk for 0, without the factor at branches."""
        poles, circles = self.lift.poles, self.lift.surface.form.circles
        away = np.abs(poles.positions[:, None] - circles.centres[1:]) / circles.radii[1:]
        inside = np.where(away.min(axis=1) < 1, away.argmin(axis=1) + 1, 0)
        features = self.lift.features(z.ravel())
        features[:, np.append(np.zeros(len(self.lift.hessenberg), dtype=np.int64), inside) != number] = 0.0
        return np.asarray((features @ self.readout).reshape(*z.shape, 2))

    @cached_property
    def misfit(self) -> Misfit:
        """The distance of its boundary from Γ, at points between the nodes."""
        surface, parts = self.surface(NUMPY), []
        rims = zip(surface.rim_primitives(_ORDER + 3), self.matchings, self.lift.paths, strict=True)
        for number, (rim, matching, (path, steps)) in enumerate(rims):
            boundary, curve = self.lift.domain.boundaries[number], self.lift.tensors[number]
            start = (surface.null_curve(path) * steps[:, None]).sum(axis=0)
            at = np.searchsorted(rim.panels.breaks, boundary.parameters[self.lift.anchors[number]])
            r = self.constant + (start + rim.primitive - rim.at_breaks[at]).real
            slide = projected(r, interpolate_matching(matching, rim.panels.t), curve, limit=0.5 / len(self.slides))
            parts.append(Misfit.of(r, slide, curve))
        return Misfit.together(parts)

    @property
    def matchings(self) -> tuple[Float[np.ndarray, "_ 2"], ...]:
        """`RimMatch.matching` of each boundary."""
        pairs = zip(self.lift.panels, self.lift.rows, strict=True)
        return tuple(np.column_stack([own.t, self.slides[rows]]) for own, rows in pairs)
