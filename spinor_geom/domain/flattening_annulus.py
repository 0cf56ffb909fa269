"""Boundary first flattening of a discrete annulus to a plane domain with a hole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float, Int

from spinor_geom.domain.delaunay import flat_coordinates
from spinor_geom.domain.flattening import dirichlet_to_neumann, is_simple, lay_out, log_scale_of, smoothing
from spinor_geom.domain.plane_domain import SplineBoundary, sampled
from spinor_geom.mesh.intersections import crossings_between

# Strengths and width of the straightening, as for disks.
_STRENGTHS = (np.inf, 1e4, 1e3, 1e2, 10.0, 1.0, 0.1)
_WIDTH = 0.06
# Newton steps to rims that close, and the share below which a condition counts as one with the others.
_CLOSING_STEPS, _DEPENDENT = 6, 1e-4
# Logarithm of a scale at which a search for u has come to nothing.
_LARGEST_SCALE = 20.0
# Points of each piece of the curves through the vertices, which must not cross.
_POINTS_OF_A_PIECE = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class AnnularFlattening:
    """Boundaries of a plane domain conformal to a discrete annulus.

    Attributes:
        outer: the images of the first rim's vertices, counter-clockwise.
        inner: those of the second rim's, clockwise.
        log_scale: u at all of them: logarithm of the length in the plane per length on the annulus.
    """

    outer: Complex[np.ndarray, " m"]
    inner: Complex[np.ndarray, " n"]
    log_scale: Float[np.ndarray, " r"]

    @property
    def distortion(self) -> float:
        """Range of u."""
        return float(np.ptp(self.log_scale))


def flatten_annulus(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], sizes: tuple[int, int]
) -> AnnularFlattening | None:
    """Flattens a discrete annulus conformally, its first rim outside, with boundary scale as near to 1 as that allows.

    The first rim's turning is to sum to 2π, the second's to −2π, and both rims are to close: conditions on u under
    which |u|²/ℓ² + u·Λu/ℓ is least, found by Newton's method. Where the boundaries cross, u also makes their turning
    even, more and more, as for disks. Each boundary is laid out by itself; the place, turn and scale of the hole are
    those of least conformal energy, which is Dirichlet's less the area.

    Args:
        vertices: the first rim's come first, then the second's, both in order with the annulus on their left.
        faces: an annulus, counter-clockwise.
        sizes: numbers of the rims' vertices.

    Returns:
        The flattening; None where no simple domain was found.

    Source: Sawhney & Crane, "Boundary First Flattening", ACM TOG 37 (2018); Lévy et al., "Least squares conformal
    maps", ACM TOG 21 (2002), for the conformal energy.
    """
    m, rim = sizes[0], sum(sizes)
    make_neumann, turning = dirichlet_to_neumann(vertices, faces, rim)
    neumann = make_neumann()
    if not np.isfinite(neumann).all():
        return None
    parts = slice(0, m), slice(m, rim)
    edge = np.concatenate([np.linalg.norm(np.roll(vertices[p], -1, axis=0) - vertices[p], axis=1) for p in parts])
    for u in _candidates(edge, turning, neumann, m):
        if not np.isfinite(u).all():
            continue
        turned = turning + neumann @ u
        outer, inner = (lay_out(edge[p], turned[p], u[p]) for p in parts)
        if outer is None or inner is None or not (np.isfinite(outer).all() and np.isfinite(inner).all()):
            continue
        placed = _placed(outer, inner, neumann)
        if not _is_annulus(outer, placed):
            continue
        scales = [log_scale_of(polygon, edge[p]) for polygon, p in zip((outer, placed), parts, strict=True)]
        return AnnularFlattening(outer=outer, inner=placed, log_scale=np.concatenate(scales))
    return None


def _candidates(
    edge: Float[np.ndarray, " r"], turning: Float[np.ndarray, " r"], neumann: Float[np.ndarray, "r r"], m: int
) -> Iterator[Float[np.ndarray, " r"]]:
    """Boundary log scales to try, the nearest to 0 first."""
    sizes = m, len(edge) - m
    rims = np.split(edge, [m])
    ds = np.concatenate([(e + np.roll(e, 1)) / 2 for e in rims])
    length = edge.sum() / 2
    size = np.diag(ds) / length**2 + neumann / length
    flux = neumann[:m].sum(axis=0)
    missing = 2 * np.pi - turning[:m].sum()
    smooth = scipy.linalg.block_diag(*(smoothing(e, _WIDTH) for e in rims))
    slope = smooth @ neumann
    even = np.concatenate(
        [np.full(k, sign * 2 * np.pi / e.sum()) for k, sign, e in zip(sizes, (1, -1), rims, strict=True)]
    )
    normal = slope.T @ (ds[:, None] * slope)
    load = slope.T @ (ds * (even - smooth @ turning))
    for strength in _STRENGTHS:
        matrix, right = (size, 0 * load) if strength == np.inf else (normal + strength * size, load)
        factor = scipy.linalg.cho_factor(matrix)
        u = scipy.linalg.cho_solve(factor, right)
        for _ in range(_CLOSING_STEPS):
            if not np.abs(u).max() < _LARGEST_SCALE:
                u = np.full(len(u), np.nan)
                break
            gap, slope_of_gap = _gaps(u, edge, turning, neumann, m)
            gap, slope_of_gap = np.append(gap, flux @ u - missing), np.vstack([slope_of_gap, flux])
            along = scipy.linalg.cho_solve(factor, slope_of_gap.T)
            # both rims close together in the limit of small triangles: their conditions are nearly dependent
            u = u - along @ np.linalg.lstsq(slope_of_gap @ along, gap, rcond=_DEPENDENT)[0]
        yield u


def _gaps(
    u: Float[np.ndarray, " r"],
    edge: Float[np.ndarray, " r"],
    turning: Float[np.ndarray, " r"],
    neumann: Float[np.ndarray, "r r"],
    m: int,
) -> tuple[Float[np.ndarray, "4"], Float[np.ndarray, "4 r"]]:
    """By how much the rims laid out with log scale u do not close, by their lengths, and the derivatives by u."""
    turned = turning + neumann @ u
    gaps, slopes = [], []
    for part in (slice(0, m), slice(m, len(u))):
        count = part.stop - part.start
        after = np.roll(np.arange(count), -1)
        own = np.arange(count)
        step = edge[part] * np.exp((u[part] + u[part][after]) / 2) * np.exp(1j * (np.cumsum(turned[part])))
        # directions are taken from their mean: from that of the first edge, a rim far from closed would bend there
        ahead = step[::-1].cumsum()[::-1] - step.sum() * (1 - own / count)
        slope = 1j * (ahead @ neumann[part])
        by_scale = np.zeros(len(u), dtype=np.complex128)
        np.add.at(by_scale, part.start + own, step / 2)
        np.add.at(by_scale, part.start + after, step / 2)
        total = np.abs(step).sum()
        gap, slope = step.sum() / total, (slope + by_scale) / total
        gaps += [gap.real, gap.imag]
        slopes += [slope.real, slope.imag]
    return np.array(gaps), np.array(slopes)


def _placed(
    outer: Complex[np.ndarray, " m"], inner: Complex[np.ndarray, " n"], neumann: Float[np.ndarray, "r r"]
) -> Complex[np.ndarray, " n"]:
    """The inner polygon where the conformal energy ½ z*Λz − area of t + βz is least."""
    m = len(outer)
    shape = inner - inner.mean()
    basis = np.stack([np.ones_like(shape), shape], axis=1)
    quadratic = basis.conj().T @ neumann[m:, m:] @ basis
    area = 0.5 * float((np.conj(shape) * np.roll(shape, -1)).imag.sum())
    quadratic[1, 1] -= 2 * area
    t, beta = np.linalg.solve(quadratic, -basis.conj().T @ (neumann[m:, :m] @ outer))
    return np.asarray(t + beta * shape)


def _is_annulus(outer: Complex[np.ndarray, " m"], inner: Complex[np.ndarray, " n"]) -> bool:
    """Whether the curves through the vertices are simple, run as the boundary of an annulus does, and do not cross."""
    if any((polygon == np.roll(polygon, 1)).any() for polygon in (outer, inner)):
        return False
    curves = [sampled(SplineBoundary.through(polygon), _POINTS_OF_A_PIECE) for polygon in (outer, inner)]
    if not is_simple(curves[0]) or not is_simple(curves[1][::-1]):
        return False
    space = [flat_coordinates(z) for z in curves]
    if len(crossings_between(*space)):
        return False
    away = curves[0] - curves[1][0]
    return bool(np.angle(np.roll(away, -1) / away).sum() > np.pi)
