"""Domain, network and nodes of one round of a fit, the residual between the nodes, and their refinement.

For n corners, Ω has n − 3 conformal moduli (n if it has a hole). A surface over Ω can have all its corners on those of
Γ only for certain moduli. A domain flattened from a mesh has these moduli to a few digits. The fit moves ∂Ω along
fields v = conj(g), with g holomorphic and g' = 0 at the corners, which change the moduli but not the angles. Between
two rims without corners the hole grows or shrinks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from spinor_geom.arrays import (
    EPS,
    TINY,
    Array,
    add_to_diagonal,
    cholesky_solve,
    complex_of,
    definite_cholesky,
    gram,
    namespace,
    norm,
    place_of,
    square,
    to_numpy,
)
from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary, panel_breaks
from spinor_geom.domain.quadrature import Panels
from spinor_geom.errors import DomainError
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.poles import Poles, edge_poles, place_poles, refining_poles
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.network.gauss_newton import Fit
from spinor_geom.plateau.network.network_problem import NetworkProblem, path_across

# Largest number of features, with four real unknowns each. With 300 a step takes a quarter of a second. The time grows
# with the cube.
_MAX_FEATURES = 420
_UNREAL = 0.01  # squared sine of a field that may not change a modulus. Others of twelve frames are at 0.1 and above


@dataclass(frozen=True, kw_only=True, eq=False)
class Discretisation:
    """Ω with the poles of the network and the panels of nodes on its boundary."""

    domain: PlaneDomain  # Ω
    curves: tuple[CurveTensors, ...]  # Γ, one for each boundary of Ω
    corners: tuple[Float[np.ndarray, " _"], ...]  # parameters of each curve at the corners of Ω, ascending
    poles: Poles  # poles outside Ω
    breaks: tuple[Float[np.ndarray, " _"], ...]  # ends of the panels on each boundary
    degree: int  # of the polynomials
    at_corner: int  # number of poles clustered at each corner
    branches: tuple[complex, ...]  # a point in each hole around which p and q change sign

    @classmethod
    def first(
        cls,
        domain: PlaneDomain,
        curves: tuple[CurveTensors, ...],
        corners: tuple[Float[np.ndarray, " _"], ...],
        *,
        degree: int,
        offset: float,
        at_corner: int,
        branches: tuple[complex, ...] = (),
    ) -> Discretisation:
        """One pole for each boundary vertex, and panels between the vertices, shorter towards corners.

        The clusters of poles at many corners are smaller, so that there are no more features than allowed.

        Args:
            domain: Ω.
            curves: Γ.
            corners: parameters of each curve at the corners of Ω, ascending.
            degree: degree of the polynomials.
            offset: distance of the poles from ∂Ω, in local edges.
            at_corner: largest number of poles clustered at each corner.
            branches: a point in each hole around which p and q change sign.
        """
        clusters = int(np.count_nonzero(domain.corners))
        room = _MAX_FEATURES - degree - 1 - (len(domain.corners) - clusters)
        at_corner = max(1, min(at_corner, room // max(1, clusters)))
        return cls(
            domain=domain,
            curves=curves,
            corners=corners,
            poles=place_poles(domain, offset=offset, at_corner=at_corner),
            breaks=tuple(map(panel_breaks, domain.boundaries)),
            degree=degree,
            at_corner=at_corner,
            branches=branches,
        )

    @cached_property
    def panels(self) -> Panels:
        """Nodes on ∂Ω, with four equations per unknown.

        With 1.5 the residual at the nodes of a rough loop can be a hundredth of that between them, and the iteration
        diverges.
        """
        unknowns = 4 * (self.degree + 1 + len(self.poles.positions))
        count = sum(len(some) - 1 for some in self.breaks)
        return Panels.around(self.domain, self.breaks, int(np.ceil(4 * unknowns / (2 * count))))

    @cached_property
    def network(self) -> CauchyNetwork:
        """The network, with features orthonormal on the nodes."""
        return self._network_with(self.poles)

    def _network_with(self, poles: Poles) -> CauchyNetwork:
        put = place_of(self.curves[0].breaks).put
        return CauchyNetwork.orthonormal_on(
            put(self.panels.z),
            put(self.panels.arc_weights),
            poles=put(poles.positions),
            scales=put(poles.scales),
            degree=self.degree,
            branches=self.branches,
        )

    @cached_property
    def problem(self) -> NetworkProblem:
        """The boundary problem on the nodes."""
        return NetworkProblem.on_panels(self.domain, self.panels, self.network, self.curves, self.corners)

    def refined(self, energy: Float[np.ndarray, " panels"], goal: float) -> Discretisation | None:
        """More poles and shorter panels where the residual is large, or None if no more features are allowed.

        Args:
            energy: integral of the squared residual over each panel.
            goal: target RMS residual. The panels that are not refined have at most goal²/2 together.
        """
        order = np.argsort(energy)
        is_large = np.empty(len(energy), dtype=bool)
        is_large[order] = np.cumsum(energy[order]) > 0.5 * goal**2
        room = (_MAX_FEATURES - self.degree - len(self.poles.positions)) // 2
        if room <= 0 or not is_large.any():
            return None
        is_large[order[: max(0, len(energy) - room)]] = False
        chosen = self.panels.ends[is_large]
        poles = self.poles + refining_poles(self.domain, chosen)
        middle = chosen.mean(axis=1)
        breaks = tuple(
            np.sort(np.concatenate([some, middle[middle // 2 == number] - 2 * number]))
            for number, some in enumerate(self.breaks)
        )
        return replace(self, poles=poles, breaks=breaks)

    @property
    def is_full(self) -> bool:
        """Whether no more poles are allowed."""
        return self.degree + len(self.poles.positions) + 2 > _MAX_FEATURES

    @property
    def room(self) -> float:
        """Ratio of the largest number of features to the present one."""
        return float(_MAX_FEATURES / self.network.mixing.shape[1])

    def share_at_corners(self, energy: Float[np.ndarray, " panels"]) -> float:
        """Share of a residual on the edges of ∂Ω that end at its corners."""
        middle = self.panels.ends.mean(axis=1)
        edge = np.searchsorted(self.domain.arcs[:, 0], middle, side="right") - 1
        at_corner = np.concatenate([rim.corners | np.roll(rim.corners, -1) for rim in self.domain.boundaries])[edge]
        return float(energy[at_corner].sum() / energy.sum())

    @property
    def has_moduli(self) -> bool:
        """Whether Ω has conformal moduli: it has a hole or more than three corners."""
        return bool(self.domain.holes) or bool(np.count_nonzero(self.domain.boundary.corners) > 3)

    @cached_property
    def _modulus_fields(self) -> ModulusFields:
        if self.domain.holes and not self.domain.corners.any():
            return ModulusFields.of_hole(self.domain, self.panels)
        # the spline of the moved boundary does not resolve features with poles clustered at corners
        paths = [path_across(self.domain, hole)[0] for hole in range(len(self.domain.holes))]
        z = place_of(self.problem.dz).put(np.concatenate([self.panels.z, *paths]))
        smooth = replace(self, branches=())._network_with(edge_poles(self.domain)).features(z)
        smooth = to_numpy(smooth)
        fields = ModulusFields.of_corners(self.domain, self.panels, smooth)
        # Along a holomorphic field Ω moves together with p and q, and the surface does not change. With the one nearest
        # to v, above all at the corners, poles would stay behind moved corners, and the iteration would be slow.
        distance = np.abs(self.panels.z[:, None] - self.domain.vertices[self.domain.corners]).min(axis=1)
        root, smooth = (np.sqrt(self.panels.arc_weights) / distance)[:, None], smooth[: len(distance)]
        factors, *_ = np.linalg.lstsq(root * smooth, root * fields.nodes, rcond=EPS)
        return replace(fields, nodes=fields.nodes - smooth @ factors)

    @property
    def flexible_problem(self) -> NetworkProblem:
        """The problem with an unknown for each modulus field of Ω."""
        return replace(self.problem, fields=place_of(self.problem.dz).put(self._modulus_fields.nodes))

    def length_of_move(self, fit: Fit) -> float:
        """Largest displacement of a vertex of ∂Ω by the `amounts` of a fit."""
        return float(np.abs(self._modulus_fields.vertices @ to_numpy(fit.amounts)).max(initial=0.0))

    def moved(self, fit: Fit, *, offset: float) -> Discretisation:
        """The discretisation of Ω moved by the `amounts` of a fit, with new poles."""
        domain = self._modulus_fields.moved(self.domain, to_numpy(fit.amounts))
        rims = zip(self.breaks, self.domain.boundaries, domain.boundaries, strict=True)
        return replace(
            self,
            domain=domain,
            poles=place_poles(domain, offset=offset, at_corner=self.at_corner),
            breaks=tuple(np.interp(some, old.parameters, new.parameters) for some, old, new in rims),
        )

    def rescaled(
        self, fit: Fit, *, offset: float
    ) -> tuple[Discretisation, Complex[Array, "n 2"], Float[Array, " nodes"]]:
        """A fit on an Ω whose boundary is as long, piece by piece, as that of the surface, with new poles.

        The map f of Ω has |f'| = λ on ∂Ω: log f' is the combination of features nearest to it. The surface is then as
        smooth at ∂Ω as it is in space, and where it has no corner the image has none. If a corner of Ω is beside that
        of Γ, the residual has a minimum for each Ω, which more features do not lower. The image has its corner at twice
        the distance of the point nearest to that of Γ: of the residual 5e-4 of a frame this leaves 4e-6, once the
        distance 3e-4.

        Returns:
            The discretisation, the read-outs and the slide.

        Raises:
            DomainError: the image overlaps itself, or its corners have another order.
        """
        old, t, nodes, put = self.domain.boundary, self.panels.t, self.problem.nodes, place_of(fit.readout).put
        xp, root = namespace(fit.readout), self.problem.arc_weights[:, None] ** 0.5
        features = self.problem.features[:nodes]
        rows = root * xp.concat([features.real, -features.imag], axis=1)
        matrix = gram(rows)
        add_to_diagonal(matrix, EPS**0.5)  # the features are orthonormal. An imaginary constant has no real part
        scale = root[:, 0] * xp.log(square(features @ fit.readout).sum(1))
        real, imag = cholesky_solve(definite_cholesky(matrix), (rows.mT @ scale)[:, None])[:, 0].reshape(2, -1)
        logarithm = complex_of(real, imag)
        slope = xp.exp(features @ logarithm) * self.problem.dz[:nodes]
        z, along = to_numpy(self.problem.integrate(xp.stack([slope, abs(slope) + 0j], axis=1))).T
        length = float(to_numpy(abs(slope)) @ self.panels.weights)
        r = fit.error + self.problem.point_and_derivative(fit.slide)[0]
        ends, _ = self.curves[0].point_and_derivative(put(self.corners[0]))
        corners, at = np.flatnonzero(old.corners), old.parameters[:-1].copy()
        at[corners] += 2 * ((t[[int(square(r - end).sum(1).argmin()) for end in ends]] - at[corners] + 0.5) % 1 - 0.5)
        node = np.searchsorted(t, at % 1) + nodes * np.floor(at).astype(np.int64)
        limits = np.concatenate([node[corners[-1:]] - nodes, node[corners], node[corners[:1]] + nodes])
        if (np.diff(limits) <= 0).any():
            raise DomainError("a corner of the plane domain would pass another one")
        side = np.searchsorted(corners, np.arange(len(node)), side="right")
        kept = old.corners | ((limits[side] < node) & (node < limits[side + 1]))
        node, ahead = node[kept], np.arange(node[0], node[0] + nodes + 1)
        t, along = t[ahead % nodes] + ahead // nodes, along.real[ahead % nodes] + length * (ahead // nodes)
        boundary = SplineBoundary.through(z[node % nodes], old.corners[kept])
        new = Discretisation.first(
            PlaneDomain.inside(boundary),
            self.curves,
            self.corners,
            degree=self.degree,
            offset=offset,
            at_corner=self.at_corner,
        )
        before = np.append(along[node - node[0]], along[-1])
        t = np.interp(np.interp(new.panels.t, boundary.parameters, before), along, t)
        features = self.network.features(put(old.point(t)))
        spinors = (features @ fit.readout) * xp.exp(features @ logarithm / -2)[:, None]
        return new, new.readout_of(spinors), put(interpolate_matching(self.matchings(fit)[0], t))

    def readout_of(self, spinors: Complex[Array, "nodes 2"]) -> Complex[Array, "n 2"]:
        """Coefficients of the features (read-out) that fit values of p and q at the nodes by least squares."""
        return self.problem.features[: self.problem.nodes].mT.conj() @ (self.problem.arc_weights[:, None] * spinors)

    def matchings(self, fit: Fit) -> tuple[Float[np.ndarray, "_ 2"], ...]:
        """`RimMatch.matching` of each boundary."""
        slides = self.problem.by_rim(fit.slide)
        return tuple(
            np.column_stack([t, to_numpy(slide)]) for t, slide in zip(self.panels.own_parameters, slides, strict=True)
        )

    def transferred(self, other: Discretisation, fit: Fit) -> tuple[Complex[Array, "n 2"], Float[Array, " nodes"]]:
        """Read-outs and slide, for this discretisation, of a fit on another one."""
        domains = zip(self.panels.own_parameters, self.domain.boundaries, other.domain.boundaries, strict=True)
        rims = [np.interp(t, here.parameters, there.parameters) for t, here, there in domains]
        points = [boundary.point(t) for boundary, t in zip(other.domain.boundaries, rims, strict=True)]
        put = place_of(fit.readout).put
        spinors = other.network.features(put(np.concatenate(points))) @ fit.readout
        slides = [interpolate_matching(matching, t) for matching, t in zip(other.matchings(fit), rims, strict=True)]
        return self.readout_of(spinors), put(np.concatenate(slides))


def interpolate_matching(matching: Float[np.ndarray, "n 2"], t: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Curve parameters s at parameters t of ∂Ω, by periodic linear interpolation of the pairs."""
    around = np.concatenate([matching[-1:] - 1, matching, matching[:1] + 1])
    return np.asarray(np.interp(t, around[:, 0], around[:, 1]))


def independent_residual(
    stage: Discretisation, fit: Fit, *, points: int
) -> tuple[Misfit, Float[np.ndarray, " panels"]]:
    """Distance from Γ on panels of another order, which share no node with those of the fit.

    Each point is projected on Γ near its matched parameter, so that a boundary along another part of Γ has a large
    residual.

    Returns:
        The misfit, and the integral of the squared distance over each panel, with ∂Ω scaled to length 1.
    """
    count = len(stage.panels.ends)
    order = max(stage.panels.order + 3, int(np.ceil(3 * points / count)))
    dense = Panels.around(stage.domain, stage.breaks, order)
    problem = NetworkProblem.on_panels(stage.domain, dense, stage.network, stage.curves, stage.corners)
    velocity = problem.velocities(fit.readout)
    r = problem.integrate(velocity).real + fit.constant
    pairs = zip(stage.matchings(fit), dense.own_parameters, strict=True)
    slide = place_of(r).put(np.concatenate([interpolate_matching(*pair) for pair in pairs]))
    squares, rims = [], []
    for position, parameter, curve in zip(problem.by_rim(r), problem.by_rim(slide), problem.curves, strict=True):
        parameter = projected(position, parameter, curve, limit=0.5 / len(stage.panels.t))
        squares.append(square(position - curve.point_and_derivative(parameter)[0]).sum(1))
        rims.append(Misfit.of(position, parameter, curve))
    misfit = Misfit.together(rims)
    # closing the gap around the hole moves the boundary by about the gap
    gap = float(norm(problem.around_hole(velocity).real.reshape(-1)))
    energy = (problem.arc_weights * namespace(r).concat(squares)).reshape(count, order).sum(1)
    return misfit.with_offset(gap), to_numpy(energy)


def projected(
    r: Float[Array, "n 3"], slide: Float[Array, " n"], curve: CurveTensors, *, limit: float
) -> Float[Array, " n"]:
    """Parameters of the points of Γ nearest to given points: from near ones a Gauss-Newton step of at most `limit`."""
    point, tangent = curve.point_and_derivative(slide)
    move = ((r - point) * tangent).sum(1) / square(tangent).sum(1)
    return slide + namespace(move).clip(move, -limit, limit)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModulusFields:
    """Vector fields on ∂Ω that change the moduli of Ω: conj(g), which keeps corner angles, or growth of the hole."""

    nodes: Complex[np.ndarray, "nodes k"]  # at the nodes of the panels, in units of Ω, up to holomorphic fields
    vertices: Complex[np.ndarray, "m k"]  # at the vertices of ∂Ω, or of its hole. At most the diameter of Ω

    @classmethod
    def of_corners(cls, domain: PlaneDomain, panels: Panels, features: Complex[np.ndarray, "all n"]) -> ModulusFields:
        """A field for each modulus of a domain with corners, n − 3 for n corners or n around a hole, and a few more.

        The moves of least strain that change the moduli have g' a quadratic differential of Ω: holomorphic, with g'dz²
        real along ∂Ω. The fields are the combinations of features, vanishing at the corners, that are nearest to this.
        A strip is stretched along its length. So is a finger without corners, which changes no modulus, but may be
        nearer to this: all combinations that are as near are taken.

        Source: Ahlfors, "Lectures on quasiconformal mappings" (1966), chapter VI, for the pairing.
        """
        corner = domain.vertices[domain.corners]
        count = len(corner) - (0 if domain.holes else 3)
        # flattened domains have one hole at most
        none = np.zeros(0, dtype=np.complex128)
        path, steps = path_across(domain, 0) if domain.holes else (none, none)
        nodes = len(panels.z)
        vanishing = np.prod((np.append(panels.z, path)[:, None] - corner) / domain.diameter, axis=1)
        slopes = (vanishing / np.abs(vanishing).max())[:, None] * features
        if domain.holes:
            outer = panels.rims[0] * panels.order
            # g must be single-valued around the hole
            slopes = slopes @ scipy.linalg.null_space(((panels.dz * panels.weights)[:outer] @ slopes[:outer])[None])
        g_slopes = slopes @ _nearest_to_real(slopes[:nodes], panels, count)
        count = g_slopes.shape[1]
        by_panel = (g_slopes[:nodes] * panels.dz[:, None]).reshape(-1, panels.order, count)
        totals = (panels.weights.reshape(-1, panels.order, 1) * by_panel).sum(axis=1)
        start = np.cumsum(totals, axis=0) - totals
        start[panels.rims[0] :] += steps @ g_slopes[nodes:]
        g = (start[:, None] + panels.widths[:, None, None] * (panels.cumulative @ by_panel)).reshape(-1, count)
        at_vertex = np.abs(panels.ends[:, 0] - domain.arcs[:, :1]).argmin(axis=1)
        middle = start[at_vertex].mean(axis=0)
        size = np.abs(start[at_vertex] - middle).max(axis=0) / domain.diameter
        return cls(nodes=np.conj((g - middle) / size), vertices=np.conj((start[at_vertex] - middle) / size))

    @classmethod
    def of_hole(cls, domain: PlaneDomain, panels: Panels) -> ModulusFields:
        """The field along the hole's normals, larger where the gap to the outer boundary is wide."""
        (hole,), outer = domain.holes, domain.boundary.vertices
        w = hole.vertices
        ahead, back = np.roll(w, -1) - w, w - np.roll(w, 1)
        gap, _ = cKDTree(plane_coordinates(outer)).query(plane_coordinates(w))
        radius = np.abs(w - w.mean()).mean()
        tangent = ahead / np.abs(ahead) + back / np.abs(back)
        tangent /= np.maximum(np.abs(tangent), TINY)
        field = 1j * tangent / (1 / gap + 1 / radius)
        spline = CubicSpline(hole.parameters, np.append(field, field[0]), bc_type="periodic")
        split = panels.order * panels.rims[0]
        nodes = np.zeros(len(panels.t), dtype=np.complex128)
        nodes[split:] = spline(panels.t[split:] - 2)
        return cls(nodes=nodes[:, None], vertices=field[:, None])

    def moved(self, domain: PlaneDomain, amounts: Float[np.ndarray, " k"]) -> PlaneDomain:
        """Ω with its hole moved, or with all vertices moved by at most a tenth of its diameter."""
        move = self.vertices @ amounts
        if len(move) < len(domain.vertices):
            hole = SplineBoundary.through(domain.holes[0].vertices + move)
            return PlaneDomain.inside(domain.boundary, domain.log_scale, holes=(hole,))
        move *= min(1.0, 0.1 * domain.diameter / np.abs(move).max(initial=1e-300))
        moves = np.split(move, np.cumsum(domain.triangulation.rims)[:-1])
        boundary, *holes = (
            SplineBoundary.through(rim.vertices + by, rim.corners)
            for rim, by in zip(domain.boundaries, moves, strict=True)
        )
        return PlaneDomain.inside(boundary, domain.log_scale, holes=tuple(holes))


def _nearest_to_real(f: Complex[np.ndarray, "nodes n"], panels: Panels, count: int) -> Complex[np.ndarray, "n k"]:
    """Coefficients of the combinations of functions f with the least ratio of ∮|Im f dz²/|dz|²|² |dz| to ∮|f|² |dz|.

    There are `count`, or more if their ratios are below `_UNREAL`.
    """
    root = np.sqrt(panels.arc_weights)[:, None]
    along = root * (panels.dz / np.abs(panels.dz))[:, None] ** 2 * f
    imaginary = np.concatenate([along.imag, along.real], axis=1)
    real = np.concatenate([along.real, -along.imag], axis=1)
    unreal = imaginary.T @ imaginary
    whole = unreal + real.T @ real
    whole[np.diag_indices_from(whole)] *= 1 + 1e-10  # the functions are nearly dependent
    ratios, best = scipy.linalg.eigh(unreal, whole, subset_by_index=[0, 2 * count - 1])
    n, chosen = f.shape[1], max(count, int(np.count_nonzero(ratios < _UNREAL)))
    return np.asarray(best[:n, :chosen] + 1j * best[n:, :chosen])
