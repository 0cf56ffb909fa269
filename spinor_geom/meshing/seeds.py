"""Points of the unit disk that are evenly spaced in space: where a mesh of a surface over it starts from."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.domain.lattice import lattice_inside
from spinor_geom.domain.plane_domain import FourierBoundary, PlaneDomain

# A point that the boundary of the flattening goes around once: the sum that tells the number of turns is so near to it,
# unless the point is nearer to the boundary than its nodes are to each other and sums over them mean nothing.
_ONCE = 1e-3
# A flattening so many times as large as the surface tells nothing of distances inside.
_MOST_STRETCHED = 1.2
# Points that are taken back to the disk at once: their sums stay in the cache.
_AT_ONCE = 256


def is_unit_disk(domain: PlaneDomain) -> bool:
    """Whether a domain is the unit disk about 0, its boundary by angle."""
    boundary = domain.boundary
    return (
        isinstance(boundary, FourierBoundary)
        and not domain.holes
        and np.array_equal(boundary.coefficients, boundary.frequencies == 1)
    )


def even_seeds(
    stretch: Float[np.ndarray, " n"], target: float, area: float
) -> tuple[Complex[np.ndarray, " k"], Float[np.ndarray, " k"]] | None:
    """Points of the unit disk whose images on a flattening of the surface form a triangular lattice.

    The flattening G is conformal and keeps the lengths of the boundary: log |G′| is the harmonic function with the
    boundary values log λ. Where the surface is curved λ is smaller inside, so the lattice is wider in the plane: it has
    as many points as cover the surface. Of parts that the flattening covers more than once there are none.

    Args:
        stretch: λ > 0 at equal steps around the unit circle, from angle 0.
        target: mean distance of neighbours in space.
        area: of the surface.

    Returns:
        The points, and how far each is from its neighbours; none where the surface is curved so much that its
        flattening is far larger.
    """
    n = len(stretch)
    # twice as many nodes as samples hold the exponential
    series = np.fft.fft(np.log(stretch), n) / n
    series = np.concatenate([series[:1], 2 * series[1 : n // 2]])
    slope = np.exp(np.fft.ifft(series, 2 * n) * 2 * n)
    powers = np.fft.fft(slope)[:n] / (2 * n)
    rim = np.fft.ifft(np.append(0, powers / np.arange(1, n + 1)), 2 * n) * 2 * n
    circle = np.exp(1j * np.pi * np.arange(2 * n) / n)
    covered = 0.5 * float((np.conj(rim) * np.roll(rim, -1)).imag.sum())
    if not covered < _MOST_STRETCHED * area:
        return None
    spacing = target * np.sqrt(covered / area)
    lattice = lattice_inside(rim, spacing)
    # Cauchy's formula for the inverse of G and its derivative, over that for 1
    strengths = np.stack([slope * circle, slope * circle**2, circle], axis=1)
    found = []
    for some in np.split(lattice, np.arange(_AT_ONCE, len(lattice), _AT_ONCE)):
        turns, inverse, widening = (1 / (rim - some[:, None]) @ strengths).T
        once = np.abs(turns / (2 * n) - 1) < _ONCE
        found.append(np.stack([inverse[once] / turns[once], spacing * np.abs(widening[once] / turns[once])]))
    points, distance = np.concatenate(found, axis=1)
    return points, distance.real
