"""Sums of many Cauchy kernels at many points, by a fast multipole method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Inexact, Int
from scipy.spatial import cKDTree
from scipy.special import comb

from spinor_geom.arrays import TINY, Array, complex_of, is_numpy
from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.holomorphic.series import power_table

# Two clusters are far apart if the sum of their radii is at most _APART times their distance. Then _TERMS terms
# of a series are accurate to 1e-12.
_APART, _TERMS = 0.4, 32
_SOURCES_PER_LEAF = 8
# largest side of a cell of targets, as a share of its distance from the sources, and fewest targets in a cell
_CELL_SIDE, _FEWEST_IN_CELL = 0.3, 4
_MOST_HALVINGS = 40
# numbers of sources, and of pairs of sources and targets, up to which direct sums are faster, number of pairs that fit
# the cache, and of targets below which products are narrow. With 1,600 sources and 16,000 targets direct sums take 0.7
# of the time beside the sources, where most large numbers of targets are, and twice as long within a curve. With 2,000
# sources and 30,000 targets 0.8 of it, and three times as long.
_FEW_SOURCES, _FEW_PAIRS, _AT_ONCE, _FEWEST_AT_ONCE = 2000, 1 << 23, 1 << 14, 16
_PAIRS = 1 << 10  # pairs of clusters, or sources, whose series fit the cache
_BINOMIALS = comb(np.add.outer(np.arange(_TERMS), np.arange(_TERMS)), np.arange(_TERMS)[:, None])


def cauchy_sums(
    sources: Complex[np.ndarray, " n"], strengths: Inexact[np.ndarray, "n c"], targets: Complex[np.ndarray, " m"]
) -> Complex[np.ndarray, "m c"]:
    """Σ_j g_j/(ζ_j − z) at targets z, to 1e-12 of the sum of the absolute values, and infinite or NaN at a source.

    The sources ζ_j are in order along a curve. The strengths g_j, real or complex, have one column for each sum.
    """
    if len(sources) > _FEW_SOURCES and len(sources) * len(targets) > _FEW_PAIRS:
        return fast_sums(sources, strengths, targets)
    return np.asarray(direct_sums(sources, strengths, targets))


def direct_sums(
    sources: Complex[Array, " n"], strengths: Inexact[Array, "n c"], targets: Complex[Array, " m"]
) -> Complex[Array, "m c"]:
    """`cauchy_sums` to rounding, of arrays or tensors. The sources need no order."""
    if not is_numpy(targets):
        return (1 / (sources - targets[:, None])) @ strengths
    step = max(_FEWEST_AT_ONCE, _AT_ONCE // max(1, len(sources)))
    starts = range(0, max(1, len(targets)), step)
    # real numbers, since complex division takes twice as long. One row per sum, since BLAS is slow on narrow columns
    by_x, by_y = (np.concatenate([g.real, g.imag], axis=1).T.copy() for g in (strengths, -1j * strengths))
    real, imag = sources.real[:, None], sources.imag[:, None]
    totals = []
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        for start in starts:
            some = targets[start : start + step]
            x, y = real - some.real, imag - some.imag
            inverse = x * x
            inverse += y * y
            np.divide(1, inverse, out=inverse)
            x *= inverse
            y *= inverse
            totals.append(by_x @ x + by_y @ y)
    total = totals[0] if len(totals) == 1 else np.concatenate(totals, axis=1)
    return complex_of(*np.split(total, 2)).T


def fast_sums(
    sources: Complex[np.ndarray, " n"], strengths: Inexact[np.ndarray, "n c"], targets: Complex[np.ndarray, " m"]
) -> Complex[np.ndarray, "m c"]:
    """`cauchy_sums` by a fast multipole method.

    Segments of successive sources have multipole series, and cells of targets power series of all distant sources.

    Source: Greengard & Rokhlin, "A fast algorithm for particle simulations", J. Comput. Phys. 73 (1987).
    """
    tree = _Sources.of(sources, strengths)
    cell, centre, radius = _cells(sources, targets)
    far, (near, _) = tree.pairs(centre, radius)
    # targets in cells near a source, and targets without a cell (−1), are summed directly
    has_series = np.ones(len(centre) + 1, dtype=bool)
    has_series[near] = has_series[-1] = False
    series = np.zeros((len(centre), strengths.shape[1], _TERMS), dtype=np.complex128)
    for level, (own, segment) in zip(tree.levels, far, strict=True):
        kept = np.flatnonzero(has_series[own])
        for some in np.split(kept, np.arange(_PAIRS, len(kept), _PAIRS)):
            here, there = own[some], segment[some]
            # from the segments' multipole series to power series in (z − centre)/radius
            inverse = 1 / (centre[here] - level.centre[there])
            scaled = level.moments[there] * _powers(level.radius[there] * inverse)[:, None, :]
            local = (scaled.reshape(-1, _TERMS) @ _BINOMIALS).reshape(scaled.shape)
            local *= (-inverse[:, None] * _powers(-radius[here] * inverse))[:, None, :]
            _add_by_owner(series, here, local)
    result = np.empty((len(targets), strengths.shape[1]), dtype=np.complex128)
    inside = has_series[cell]
    some = cell[inside]
    result[inside] = _horner(series, some, (targets[inside] - centre[some]) / radius[some])
    result[~inside] = _direct_sums(tree, targets[~inside])
    return result


_Pairs = tuple[Int[np.ndarray, " _"], Int[np.ndarray, " _"]]  # indices of target clusters, ascending, and of segments


@dataclass(frozen=True, kw_only=True, eq=False)
class _Level:
    """A level of the tree: segments of equal numbers of sources, their moments Σ g_j ((ζ_j − centre)/radius)^k."""

    centre: Complex[np.ndarray, " s"]
    radius: Float[np.ndarray, " s"]
    moments: Complex[np.ndarray, "s c k"]

    @classmethod
    def of(cls, z: Complex[np.ndarray, "s i"], g: Inexact[np.ndarray, "s i c"]) -> _Level:
        low, high = z.real.min(axis=1) + 1j * z.imag.min(axis=1), z.real.max(axis=1) + 1j * z.imag.max(axis=1)
        centre = 0.5 * (low + high)
        offset = z - centre[:, None]
        radius = np.abs(offset).max(axis=1)
        piece = min(z.shape[1], _PAIRS)  # long segments are divided into pieces, whose powers fit the cache
        unit = (offset / np.maximum(radius, TINY)[:, None]).reshape(-1, piece)
        by_column = g.reshape(-1, piece, g.shape[2]).swapaxes(1, 2)
        step = _PAIRS // piece
        parts = [
            by_column[k : k + step] @ _powers(unit[k : k + step].ravel()).reshape(-1, piece, _TERMS)
            for k in range(0, len(unit), step)
        ]
        moments = np.concatenate(parts).reshape(len(z), -1, g.shape[2], _TERMS).sum(axis=1)
        return cls(centre=centre, radius=radius, moments=moments)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sources:
    """A binary tree of segments, and the sources of its leaves."""

    levels: tuple[_Level, ...]
    z: Complex[np.ndarray, "l i"]
    g: Inexact[np.ndarray, "l i c"]

    @classmethod
    def of(cls, sources: Complex[np.ndarray, " n"], strengths: Inexact[np.ndarray, "n c"]) -> _Sources:
        depth = int(np.ceil(np.log2(max(1.0, len(sources) / _SOURCES_PER_LEAF))))
        missing = (_SOURCES_PER_LEAF << depth) - len(sources)
        z = np.append(sources, np.full(missing, sources[-1]))  # sources of strength 0 fill the last leaves
        g = np.concatenate([strengths, np.zeros((missing, strengths.shape[1]))])
        levels = tuple(_Level.of(z.reshape(1 << k, -1), g.reshape(1 << k, -1, g.shape[1])) for k in range(depth + 1))
        return cls(levels=levels, z=z.reshape(1 << depth, -1), g=g.reshape(1 << depth, -1, g.shape[1]))

    def pairs(self, centre: Complex[np.ndarray, " t"], radius: Float[np.ndarray, " t"]) -> tuple[list[_Pairs], _Pairs]:
        """Pairs of target clusters and distant segments, for each level, and pairs of clusters and near leaves."""
        own, segment = np.arange(len(centre)), np.zeros(len(centre), dtype=np.int64)
        far: list[_Pairs] = []
        for level in self.levels:
            if far:
                own, segment = np.repeat(own, 2), np.add.outer(2 * segment, [0, 1]).ravel()
            apart = radius[own] + level.radius[segment] < _APART * np.abs(centre[own] - level.centre[segment])
            far.append((own[apart], segment[apart]))
            own, segment = own[~apart], segment[~apart]
        return far, (own, segment)


def _cells(
    sources: Complex[np.ndarray, " n"], targets: Complex[np.ndarray, " m"]
) -> tuple[Int[np.ndarray, " m"], Complex[np.ndarray, " t"], Float[np.ndarray, " t"]]:
    """Square cells of distant targets: the cell of each target, −1 for none, and the cells' circumcircles."""
    tree = cKDTree(plane_coordinates(sources))
    cell, count = np.full(len(targets), -1), 0
    centres, radii = [np.zeros(0, dtype=np.complex128)], [np.zeros(0)]
    extent = max(float(np.abs(z - sources[0]).max(initial=0.0)) for z in (sources, targets))
    side = 2.0 ** np.ceil(np.log2(extent or 1.0))
    left = np.arange(len(targets))
    for _ in range(_MOST_HALVINGS):
        corner = np.floor(targets[left].real / side) + 1j * np.floor(targets[left].imag / side)
        corner, number, members = np.unique(corner, return_inverse=True, return_counts=True)
        centre = (corner + 0.5 + 0.5j) * side
        distance, _ = tree.query(plane_coordinates(centre))
        crowd = members >= _FEWEST_IN_CELL
        good = crowd & (side <= _CELL_SIDE * distance)
        chosen = good[number]
        cell[left[chosen]] = count + (np.cumsum(good) - 1)[number[chosen]]
        count += int(good.sum())
        centres.append(centre[good])
        radii.append(np.full(int(good.sum()), side / np.sqrt(2)))
        left = left[(crowd & ~good)[number]]
        if len(left) == 0:
            break
        side /= 2
    return cell, np.concatenate(centres), np.concatenate(radii)


def _direct_sums(tree: _Sources, targets: Complex[np.ndarray, " m"]) -> Complex[np.ndarray, "m c"]:
    """The sums at targets without a cell, from the segments' multipole series and single sources."""
    total = np.zeros((len(targets), tree.g.shape[2]), dtype=np.complex128)
    far, near = tree.pairs(targets, np.zeros(len(targets)))
    for level, (own, segment) in zip(tree.levels, far, strict=True):
        for start in range(0, len(own), _PAIRS):
            target, s = own[start : start + _PAIRS], segment[start : start + _PAIRS]
            inverse = 1 / (targets[target] - level.centre[s])
            powers = -inverse[:, None] * _powers(level.radius[s] * inverse)
            _add_by_owner(total, target, (level.moments[s] @ powers[:, :, None])[:, :, 0])
    for start in range(0, len(near[0]), _PAIRS):
        target, leaf = (numbers[start : start + _PAIRS] for numbers in near)
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            kernel = 1 / (tree.z[leaf] - targets[target][:, None])
            _add_by_owner(total, target, (kernel[:, None, :] @ tree.g[leaf])[:, 0])
    return total


def _horner(
    series: Complex[np.ndarray, "t c k"], cell: Int[np.ndarray, " m"], u: Complex[np.ndarray, " m"]
) -> Complex[np.ndarray, "m c"]:
    """Σ_k series[cell, :, k] u^k."""
    by_term = np.ascontiguousarray(np.moveaxis(series, 2, 0))
    parts = [np.zeros((0, series.shape[1]), dtype=np.complex128)]
    for start in range(0, len(u), _PAIRS):
        some, power = cell[start : start + _PAIRS], u[start : start + _PAIRS, None]
        total = by_term[-1][some]
        for terms in by_term[-2::-1]:
            total *= power
            total += terms[some]
        parts.append(total)
    return np.concatenate(parts)


def _powers(x: Complex[np.ndarray, " p"]) -> Complex[np.ndarray, "p k"]:
    return np.asarray(power_table(x, _TERMS).T)


def _add_by_owner(
    total: Complex[np.ndarray, "t *rest"], owner: Int[np.ndarray, " p"], values: Complex[np.ndarray, "p *rest"]
) -> None:
    """Adds to `total` at the ascending indices `owner`, which may repeat."""
    if len(owner):
        first = np.flatnonzero(np.append(True, owner[1:] != owner[:-1]))
        total[owner[first]] += np.add.reduceat(values, first, axis=0)
