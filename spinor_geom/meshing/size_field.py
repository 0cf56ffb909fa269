"""How long the edges of a patch shall be in Ω."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float
from scipy.spatial import cKDTree

from spinor_geom.domain.delaunay import Rims, plane_coordinates
from spinor_geom.domain.sizes import SizeFunction, size_bounds

# change of the edge length per unit of distance from the boundary, upwards and downwards
GROWTH = 0.35
DECAY = 0.5
# λ below this share of its median counts as this: a branch point must not ask for endless triangles
SMALLEST_STRETCH = 1e-3
NEIGHBOURS = 4
TINY = np.finfo(np.float64).tiny


def size_field(
    samples: Complex[np.ndarray, " n"],
    factor: Float[np.ndarray, " n"],
    boundary: Complex[np.ndarray, " m"],
    target: float,
    *,
    rims: Rims | None = None,
) -> SizeFunction:
    """Edge length in Ω that gives about `target` in space, and the boundary's own edge lengths beside the boundary.

    h(z) = target/λ(z), but within e ± growth·d at a distance d from a boundary vertex with edges of mean length e: it
    grows by 0.35 and falls by 0.5 per unit of distance. log λ is averaged over the four nearest samples, weighted by
    the inverse squared distance.

    Args:
        samples: Points of Ω.
        factor: λ there, lengths in space per length in Ω.
        boundary: The patch's boundary vertices in Ω, rim after rim.
        target: In units of space.
        rims: Numbers of vertices of the rims; none for a single one.

    Returns:
        A function from points (k,) of Ω to lengths (k,) in units of Ω.
    """
    bounds = size_bounds(boundary, growth=GROWTH, decay=DECAY, rims=rims)
    stretch = _interpolated_stretch(samples, factor)

    def size(z: Complex[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        shortest, longest = bounds(z)
        return np.asarray(np.minimum(np.maximum(target / stretch(z), shortest), longest))

    return size


def _interpolated_stretch(samples: Complex[np.ndarray, " n"], factor: Float[np.ndarray, " n"]) -> SizeFunction:
    """λ as a cheap function, from its values at some points."""
    finite = np.isfinite(factor)
    usual = np.median(factor[finite]) if finite.any() else 1.0
    log_factor = np.log(np.maximum(np.where(finite, factor, usual), max(SMALLEST_STRETCH * usual, TINY)))
    tree = cKDTree(plane_coordinates(samples))
    neighbours = min(NEIGHBOURS, len(samples))

    def stretch(z: Complex[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        distance, index = tree.query(plane_coordinates(z), k=neighbours)
        weight = 1 / np.maximum(distance, TINY**0.25) ** 2
        return np.asarray(np.exp((weight * log_factor[index]).sum(axis=1) / weight.sum(axis=1)))

    return stretch
