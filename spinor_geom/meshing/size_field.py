"""How long the edges of a patch shall be in Ω."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.domain.nearest import NearestPoints
from spinor_geom.domain.sizes import GROWTH, RegionSizes, size_bounds

# change of the edge length per unit of distance from the boundary, downwards
DECAY = 0.5
# λ below this share of its median counts as this: a branch point must not ask for endless triangles
SMALLEST_STRETCH = 1e-3
NEIGHBOURS = 4
TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """A part of Ω that is to be triangulated for the surface over it.

    Attributes:
        rims: Its boundary vertices in Ω, counter-clockwise, then those of holes, clockwise.
        samples: Points of Ω.
        factor: λ there, lengths in space per length in Ω.
        target: Edge length in space.
        area: Of the surface over it.
        seeds: Points to start from, and how far each is from its neighbours; if there are any.
    """

    rims: Sequence[Complex[np.ndarray, " _"]]
    samples: Complex[np.ndarray, " n"]
    factor: Float[np.ndarray, " n"]
    target: float
    area: float
    seeds: tuple[Complex[np.ndarray, " k"], Float[np.ndarray, " k"]] | None = None


def size_field(pieces: Sequence[Piece]) -> RegionSizes:
    """Edge lengths in Ω that give about `target` in space, and the boundary's own edge lengths beside the boundary.

    h(z) = target/λ(z), but within e ± growth·d at a distance d from a boundary vertex with edges of mean length e: it
    grows by 0.35 and falls by 0.5 per unit of distance. log λ is averaged over the four nearest samples, weighted by
    the inverse squared distance.

    Args:
        pieces: Any number.

    Returns:
        A function from points (k,) of Ω and the numbers (k,) of their pieces to lengths (k,) in units of Ω.
    """
    rims = [rim for piece in pieces for rim in piece.rims]
    owner = np.repeat(np.arange(len(pieces)), [sum(map(len, piece.rims)) for piece in pieces])
    bounds = size_bounds(np.concatenate(rims), growth=GROWTH, decay=DECAY, rims=tuple(map(len, rims)), region=owner)
    target = np.array([piece.target for piece in pieces])
    tree = NearestPoints(
        np.concatenate([piece.samples for piece in pieces]),
        np.repeat(np.arange(len(pieces)), [len(piece.samples) for piece in pieces]),
    )
    # where a piece has fewer samples than are asked for, the last weighs nothing
    log_factor = np.concatenate([*(_log_factor(piece.factor) for piece in pieces), [0.0]])

    def size(z: Complex[np.ndarray, " k"], region: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        shortest, longest = bounds(z, region)
        distance, index = tree.query(z, region, count=NEIGHBOURS)
        weight = 1 / np.maximum(distance, TINY**0.25) ** 2
        stretch = np.exp((weight * log_factor[index]).sum(axis=1) / weight.sum(axis=1))
        return np.asarray(np.minimum(np.maximum(target[region] / stretch, shortest), longest))

    return size


def _log_factor(factor: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    finite = np.isfinite(factor)
    usual = np.median(factor[finite]) if finite.any() else 1.0
    return np.asarray(np.log(np.maximum(np.where(finite, factor, usual), max(SMALLEST_STRETCH * usual, TINY))))
