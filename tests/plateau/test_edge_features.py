"""Features on the edges of a polygon are those of a Cauchy network, with few dense entries."""

import numpy as np
import pytest
from jaxtyping import Complex

from spinor_geom.arrays import NUMPY
from spinor_geom.holomorphic.arnoldi import arnoldi_basis
from spinor_geom.holomorphic.cauchy import raw_features
from spinor_geom.holomorphic.poles import polygon_poles
from spinor_geom.plateau.vertices.edge_features import EdgeFeatures, nodes_on_edges
from spinor_geom.plateau.vertices.through_points import _norm_of_edge, shares

NODES = 14
TOLERANCE = 1e-7  # of interpolants through 7 nodes, from 3 edges away, with a margin of 100


@pytest.fixture(scope="module")
def features() -> tuple[Complex[np.ndarray, " n"], EdgeFeatures, Complex[np.ndarray, "n g k"]]:
    """A ragged polygon, its features, and the same without interpolation."""
    rng, n = np.random.default_rng(0), 120
    t = 2 * np.pi * np.arange(n) / n
    polygon = np.exp(1j * t) * (1 + 0.3 * np.cos(3 * t)) + 0.01 * (rng.standard_normal(n) + 1j * rng.standard_normal(n))
    poles, z = polygon_poles(polygon), nodes_on_edges(polygon, NODES)
    hessenberg, polynomials = arnoldi_basis(z.ravel(), np.full(z.size, 1 / z.size), 24)
    some = EdgeFeatures.on(polygon, polynomials.reshape(n, NODES, -1), poles.positions, poles.scales)
    return polygon, some, raw_features(z, hessenberg, poles.positions, poles.scales)


def test_values_and_sums_are_those_of_all_features_at_all_nodes(features) -> None:
    _, some, every = features
    n, g, k = every.shape
    assert some.count == k
    assert some.near.shape[2] < k / 4
    rng = np.random.default_rng(1)
    readout, weights = rng.standard_normal((k, 2)) + 0j, rng.standard_normal((n, g, 2)) + 1j
    scale = np.abs(every).max() * k**0.5
    assert np.abs(some.values(readout) - every @ readout).max() < TOLERANCE * scale
    assert np.abs(some.by_edge(weights.mT) - weights.mT @ every).max() < TOLERANCE * g * scale
    adjoint = np.einsum("ngk,ngc->kc", every.conj(), weights)
    assert np.abs(some.adjoint(weights) - adjoint).max() < TOLERANCE * n * g * scale


@pytest.mark.parametrize("own", [slice(0, 145), slice(60, 100)])
def test_the_gram_matrix_neglects_only_distant_poles_beyond_linear_terms(features, own: slice) -> None:
    polygon, some, every = features
    norm = _norm_of_edge(NODES, NUMPY) + 0j
    rows = np.sqrt(shares(polygon))[:, None, None] * (norm @ every[..., own])
    matrix = np.einsum("nhk,nhl->kl", rows.conj(), rows)
    difference = np.tril(some.gram(norm, shares(polygon), own) - matrix)
    # quadratic terms from 3 edges away: (1/6)³ of a unit, 3.5 times that in H¹, on some edges
    assert np.abs(difference).max() < 8 * (3.5 / 6**3) ** 2 * np.abs(matrix).max()
