"""Polynomials and Cauchy units at Gauss-Legendre nodes on the edges of a polygon.

Along an edge a unit with a distant pole is nearly a polynomial of low degree and is interpolated from few nodes. Only
units with near poles are evaluated at all nodes. This avoids most dense arrays of all edges and all poles.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.arrays import Array, Place, add_at, gram, namespace, place_of, shifted, to_numpy, zeros
from spinor_geom.domain.quadrature import rule
from spinor_geom.holomorphic.blocks import block_size
from spinor_geom.holomorphic.cauchy import cauchy_units

# Units with poles at least this many edge lengths from the middle of an edge are computed at half of the nodes. With 7
# of 14 periods around holes are exact to 1e-9.
_FAR = 3.0
# Rows of R that include units with distant poles: mean and slope. With one row 58 instead of 59 of sixty rims cut along
# triangles converge.
_LONG_RANGE = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class EdgeFeatures:
    """The polynomials Q_0 … Q_d and the units d_k/(z − ζ_k), in this order, at g nodes on n edges."""

    polynomials: Complex[Array, "n g d1"]
    few: Complex[Array, "n c m"]  # the units at few nodes
    units: Complex[Array, "n g q"]  # the units with near poles
    near: Complex[Array, "n g q"]  # the same minus their interpolants through few nodes
    index: Int[Array, "n q"]  # which units these are
    between: Complex[Array, "g c"]  # interpolation from the few nodes

    @classmethod
    def on(
        cls,
        polygon: Complex[Array, " n"],
        polynomials: Complex[Array, "n g d1"],
        poles: Complex[Array, " m"],
        scales: Float[Array, " m"],
    ) -> EdgeFeatures:
        """The features at Gauss-Legendre nodes on the edges of a polygon, from the polynomials there."""
        place, xp, nodes = place_of(polygon), namespace(polygon), polynomials.shape[1]
        between, z = _interpolation(nodes // 2, nodes, place) + 0j, nodes_on_edges(polygon, nodes)
        few = cauchy_units(nodes_on_edges(polygon, nodes // 2), poles, scales)
        index = place.put(_near(to_numpy(polygon), to_numpy(poles)))
        units = scales[index][:, None] / (z[..., None] - poles[index][:, None])
        near = units - between @ xp.take_along_axis(few, index[:, None], axis=2)
        return cls(polynomials=polynomials, few=few, units=units, near=near, index=index, between=between)

    @property
    def count(self) -> int:
        """Number of features."""
        return int(self.polynomials.shape[2] + self.few.shape[2])

    def values(self, readout: Complex[Array, "k r"]) -> Complex[Array, "n g r"]:
        """Sums of the features with given coefficients."""
        degrees = self.polynomials.shape[2]
        polynomial, units = readout[:degrees], readout[degrees:]
        return (
            _product(self.polynomials, polynomial)
            + self.between @ _product(self.few, units)
            + self.near @ namespace(units).take(units, self.index.reshape(-1), axis=0).reshape(*self.index.shape, -1)
        )

    def by_edge(self, weights: Complex[Array, "n r g"]) -> Complex[Array, "n r k"]:
        """Σ w f over the nodes of each edge, for each feature f."""
        units = (weights @ self.between) @ self.few
        n, r, m = units.shape
        xp = namespace(units)
        rows = place_of(units).put(np.arange(n * r).reshape(n, r, 1))
        units = xp.reshape(units, (-1,))
        add_at(units, rows * m + self.index[:, None], weights @ self.near)
        return xp.concat([weights @ self.polynomials, xp.reshape(units, (n, r, m))], axis=2)

    def adjoint(self, weights: Complex[Array, "n g r"]) -> Complex[Array, "k r"]:
        """Σ f̄ w over all nodes, for each feature f."""
        xp = namespace(weights)
        r = weights.shape[2]

        def summed(features: Complex[Array, "n _ f"], by: Complex[Array, "n _ r"]) -> Complex[Array, "f r"]:
            # conjugates of the few weights instead of those of the features
            return (xp.reshape(features, (-1, features.shape[2])).mT @ xp.reshape(by.conj(), (-1, r))).conj()

        units = xp.reshape(summed(self.few, self.between.mT @ weights), (-1,))
        columns = self.index[..., None] * r + place_of(weights).put(np.arange(r))
        add_at(units, columns, self.near.mT.conj() @ weights)
        return xp.concat([summed(self.polynomials, weights), xp.reshape(units, (-1, r))])

    def gram(self, norm: Complex[Array, "h g"], shares: Float[Array, " n"], own: slice) -> Complex[Array, "c c"]:
        """Lower triangle of Σ share·(Rf)ᴴ(Rf′) over all edges, for the features f, f′ in `own`.

        R is triangular in Legendre polynomials: row k vanishes for polynomials of lower degree. Its last rows neglect
        units with distant poles, which are nearly linear along the edge.
        """
        xp = namespace(shares)
        root = (xp.sqrt(shares) + 0j)[:, None, None]
        whole = xp.broadcast_to(norm[:_LONG_RANGE], (len(shares), _LONG_RANGE, norm.shape[1]))
        long_range = root * self.by_edge(whole)[..., own]
        matrix = gram(xp.reshape(long_range, (-1, long_range.shape[2])))
        polynomials, units = (root * (norm[_LONG_RANGE:] @ part) for part in (self.polynomials, self.units))
        degrees, size = polynomials.shape[2], matrix.shape[0]
        first = place_of(shares).put(np.arange(degrees))
        index = xp.concat([xp.broadcast_to(first, (len(shares), degrees)), degrees + self.index], axis=1) - own.start
        # features of other rims go to one more row and column
        index = xp.where((index >= 0) & (index < size), index, size)
        total = zeros(((size + 1) ** 2,), matrix)
        every = xp.concat([polynomials, units], axis=2)
        edges = block_size(place_of(shares), units.shape[2] * every.shape[2])
        for start in range(0, len(shares), edges):
            some = slice(start, start + edges)
            places = index[some, degrees:, None] * (size + 1) + index[some, None]
            add_at(total, places, units[some].mT.conj() @ every[some])
        matrix = matrix + xp.reshape(total, (size + 1, size + 1))[:size, :size]
        if own.start == 0:
            matrix[:degrees, :degrees] += gram(xp.reshape(polynomials, (-1, degrees)))
        return matrix


def _product(features: Complex[Array, "n g k"], readout: Complex[Array, "k r"]) -> Complex[Array, "n g r"]:
    """Sums over features in one product, which for short edges takes half the time of one for each edge."""
    n, g, k = features.shape
    return (features.reshape(n * g, k) @ readout).reshape(n, g, -1)


def nodes_on_edges(polygon: Complex[Array, " n"], count: int) -> Complex[Array, "n g"]:
    """Gauss-Legendre nodes on the edges of a polygon."""
    share = place_of(polygon).put(rule("gauss", count).nodes)
    return polygon[:, None] + share * (shifted(polygon, -1) - polygon)[:, None]


def _near(polygon: Complex[np.ndarray, " n"], poles: Complex[np.ndarray, " m"]) -> Int[np.ndarray, "n q"]:
    """The poles nearest to each edge of a polygon, equally many for each, with all that are near."""
    after = shifted(polygon, -1)
    distance = np.abs((polygon + after)[:, None] / 2 - poles)
    count = int((distance < _FAR * np.abs(after - polygon)[:, None]).sum(axis=1).max())
    return np.asarray(np.argpartition(distance, min(count, len(poles) - 1), axis=1)[:, :count])


@lru_cache
def _interpolation(few: int, count: int, place: Place) -> Float[Array, "g c"]:
    """The matrix from values at few Gauss-Legendre nodes to those of their interpolating polynomial at more nodes."""
    places, weights = rule("gauss", few)
    degrees = np.arange(few)
    at_few = np.polynomial.legendre.legvander(2 * places - 1, few - 1)
    at_all = np.polynomial.legendre.legvander(2 * rule("gauss", count).nodes - 1, few - 1)
    return place.put(at_all @ ((2 * degrees + 1) * at_few * weights[:, None]).T)
