"""The boundary value problem of a Cauchy network, discretised at nodes on ∂Ω."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Complex, Float, Shaped
from scipy.optimize import isotonic_regression

from spinor_geom.arrays import Array, is_real, namespace, place_of, to_numpy, zeros
from spinor_geom.domain.plane_domain import Boundary, PlaneDomain
from spinor_geom.domain.quadrature import Panels, path_to
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.surface.array_surface import PATH_ORDER
from spinor_geom.surface.formulas import phi


@dataclass(frozen=True, kw_only=True, eq=False)
class NetworkProblem:
    """Γ, and the features of the network at the nodes on ∂Ω, then on a path to each hole."""

    curves: tuple[CurveTensors, ...]  # Γ, one curve for each boundary of Ω
    features: Complex[Array, "points n"]  # at the nodes and on the paths
    dz: Complex[Array, " points"]  # dz/dt
    weights: Float[Array, " points"]  # quadrature weights in t
    widths: Float[Array, " panels"]  # lengths of the panels in t
    rims: tuple[int, ...]  # number of panels of each boundary
    paths: tuple[int, ...]  # number of points of the path to each hole
    cumulative: Float[Array, "order order"]  # integration matrix of a panel of length 1
    slide_bounds: Float[Array, "nodes 2"]  # lowest and highest curve parameter of each node
    fields: Complex[Array, "nodes k"]  # fields along which Ω may move to change its moduli
    power: float = 1.0  # see `fit_weights`

    @classmethod
    def on_panels(
        cls,
        domain: PlaneDomain,
        panels: Panels,
        network: CauchyNetwork,
        curves: tuple[CurveTensors, ...],
        corners: tuple[Float[np.ndarray, " _"], ...],
    ) -> NetworkProblem:
        """The problem on the nodes of panels, for a fixed domain. `corners` are as for `slide_bounds`."""
        put = place_of(network.poles).put
        across = [path_across(domain, hole) for hole in range(len(domain.holes))]
        paths, steps = [path for path, _ in across], [step for _, step in across]
        sides = zip(domain.boundaries, corners, panels.own_parameters, strict=True)
        return cls(
            curves=curves,
            features=network.features(put(np.concatenate([panels.z, *paths]))),
            dz=put(np.concatenate([panels.dz, *steps])),
            weights=put(np.concatenate([panels.weights, *map(np.ones_like, steps)]).real),
            widths=put(panels.widths),
            rims=panels.rims,
            paths=tuple(map(len, paths)),
            cumulative=put(panels.cumulative),
            slide_bounds=put(np.concatenate([slide_bounds(*side) for side in sides])),
            fields=put(np.zeros((len(panels.z), 0), dtype=np.complex128)),
        )

    @property
    def nodes(self) -> int:
        """Number of nodes on ∂Ω."""
        return len(self.widths) * len(self.cumulative)

    @property
    def arc_weights(self) -> Float[Array, " nodes"]:
        """Weights of the mean by arc length of ∂Ω, with sum 1."""
        weights = (self.weights * abs(self.dz))[: self.nodes]
        return weights / weights.sum()

    @property
    def fit_weights(self) -> Float[Array, " nodes"]:
        """Weights of squared distances in fits, with sum 1: each panel has a power of its length."""
        by_panel = self.arc_weights.reshape(-1, len(self.cumulative))
        weights = (by_panel * by_panel.sum(1)[:, None] ** (self.power - 1)).reshape(-1)
        return weights / weights.sum()

    def by_rim(self, values: Shaped[Array, "nodes *rest"]) -> tuple[Shaped[Array, "_ *rest"], ...]:
        """Values at the nodes of each boundary."""
        ends = np.cumsum([0, *self.rims]) * len(self.cumulative)
        return tuple(values[start:end] for start, end in pairwise(ends.tolist()))

    def point_and_derivative(
        self, slide: Float[Array, " nodes"]
    ) -> tuple[Float[Array, "nodes 3"], Float[Array, "nodes 3"]]:
        """Γ and Γ' at the slide of each node, on the curve of its boundary."""
        parts = [curve.point_and_derivative(s) for curve, s in zip(self.curves, self.by_rim(slide), strict=True)]
        points, tangents = zip(*parts, strict=True)
        xp = namespace(slide)
        return xp.concat(points), xp.concat(tangents)

    def increasing(self, slide: Float[Array, " nodes"], speed: Float[Array, " nodes"]) -> Float[Array, " nodes"]:
        """The nearest increasing slides within the bounds, by `nearest_increasing`."""
        arrays = [[to_numpy(part) for part in self.by_rim(one)] for one in (slide, speed, self.slide_bounds)]
        parts = [nearest_increasing(*one) for one in zip(*arrays, strict=True)]
        return place_of(slide).put(np.concatenate(parts))

    def integrate(self, f: Complex[Array, "points k"]) -> Complex[Array, "nodes k"]:
        """∫ f dt from the start of the first panel to each node, along ∂Ω and the paths to the holes."""
        order, (cumulative, weights) = len(self.cumulative), (self.cumulative, self.weights)
        if not is_real(f):
            cumulative, weights = cumulative + 0j, weights + 0j
        by_panel = f[: self.nodes].reshape(-1, order, f.shape[1])
        local = (cumulative @ by_panel) * self.widths[:, None, None]
        total = (weights[: self.nodes].reshape(-1, 1, order) @ by_panel)[:, 0]
        ends = np.cumsum([0, *self.rims]).tolist()
        starts = [total[start:end].cumsum(0) - total[start:end] for start, end in pairwise(ends)]
        ends = (self.nodes + np.cumsum([0, *self.paths])).tolist()
        for hole, (start, end) in enumerate(pairwise(ends), start=1):
            starts[hole] = starts[hole] + weights[start:end] @ f[start:end]
        return (local + namespace(f).concat(starts)[:, None]).reshape(self.nodes, -1)

    def positions(self, readout: Complex[Array, "n 2"]) -> Float[Array, "nodes 3"]:
        """Positions r at the nodes, up to a constant: the real part of ∫ φ dz along ∂Ω."""
        return self.integrate(self.velocities(readout)).real

    def around_hole(self, f: Complex[Array, "points k"]) -> Complex[Array, "holes k"]:
        """∮ f dt around each hole."""
        ends = (np.cumsum(self.rims) * len(self.cumulative)).tolist()
        totals = zeros((len(self.paths), f.shape[1]), f)
        for hole, (start, end) in enumerate(pairwise(ends)):
            totals[hole] = (self.weights[start:end] + 0j) @ f[start:end]
        return totals

    def velocities(self, readout: Complex[Array, "n 2"]) -> Complex[Array, "points 3"]:
        """φ dz/dt at the nodes and on the paths. Its real part is dr/dt."""
        return self.null_curve(readout) * self.dz[:, None]

    def null_curve(self, readout: Complex[Array, "n 2"]) -> Complex[Array, "points 3"]:
        """φ at the nodes and on the paths."""
        p, q = (self.features @ readout).mT
        return phi(p, q)

    def moved(self, readout: Complex[Array, "n 2"]) -> Float[Array, "nodes 3 k"]:
        """Derivative of r at the nodes with respect to the coefficient of each field v: Re(φ v)."""
        return (self.null_curve(readout)[: self.nodes, :, None] * self.fields[:, None, :]).real


def nearest_increasing(
    s: Float[np.ndarray, " n"], speed: Float[np.ndarray, " n"], bounds: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, " n"]:
    """The nearest non-decreasing slide with s_n ≤ s_0 + 1 within the bounds, by isotonic regression.

    The periodic sequence is cut where the speed |Γ'| is largest. A shorter step instead would stall at corners and on
    noisy curves.
    """
    if (np.diff(np.append(s, s[0] + 1)) <= 0).any():
        cut = int(np.argmax(speed))
        line = np.concatenate([s[cut:], s[:cut] + 1])
        line = isotonic_regression(line).x
        line = np.minimum(line, line[0] + 1)
        s = np.concatenate([line[len(s) - cut :] - 1, line[: len(s) - cut]])
    return np.asarray(np.clip(s, *bounds.T))


def slide_bounds(
    boundary: Boundary, corners: Float[np.ndarray, " c"], t: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n 2"]:
    """Lowest and highest curve parameter of nodes at parameters t of ∂Ω: those of the adjacent corners.

    `corners` are the curve parameters at the corners of Ω, ascending.
    """
    if not len(corners):
        return np.broadcast_to([-np.inf, np.inf], (len(t), 2))
    ends = np.concatenate([corners[-1:] - 1, corners, corners[:1] + 1])
    side = np.searchsorted(boundary.parameters[:-1][boundary.corners], t, side="right")
    # strictly inside the side, because Γ′ at a corner is that of the next side
    return np.stack([ends[side] + 1e-13, ends[side + 1] - 1e-13], axis=1)


def path_across(domain: PlaneDomain, hole: int) -> tuple[Complex[np.ndarray, " w"], Complex[np.ndarray, " w"]]:
    """Nodes and weights on a path from the first vertex of the outer boundary to that of a hole."""
    first = sum(len(boundary.vertices) for boundary in domain.boundaries[: hole + 1])
    (there, back), (here, ahead) = (path_to(domain, k, PATH_ORDER) for k in (0, first))
    return np.append(there, here), np.append(-back, ahead)
