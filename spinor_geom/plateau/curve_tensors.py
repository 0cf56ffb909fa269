"""Boundary curves as arrays of a solve (numpy or torch): points and derivatives of many curves at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.arrays import Array, Place, is_numpy, namespace, norm, on_device_of, place_of, unit, zeros
from spinor_geom.mesh.curve import BoundaryCurve


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveTensors:
    """A piecewise polynomial curve as arrays of one `Place`, or a padded batch of curves."""

    breaks: Float[Array, "*batch m1"]  # in [0, 1], padded with 2
    coefficients: Float[Array, "d1 *batch m 3"]  # highest power first, padded with 0
    slopes: Float[Array, "d1 *batch m 3"] | None = None  # of Γ′, if all curves are given by formulas

    @classmethod
    def of(cls, curve: BoundaryCurve, place: Place) -> CurveTensors:
        """The curve as arrays of a place."""
        return cls(
            breaks=place.put(curve.breaks),
            coefficients=place.put(curve.coefficients),
            slopes=None if curve.slopes is None else place.put(curve.slopes),
        )

    @classmethod
    def batch(cls, curves: Sequence[CurveTensors]) -> CurveTensors:
        """A batch of single curves. They keep `slopes` if all have them."""
        most = max(len(curve.breaks) for curve in curves)
        slopes = [curve.slopes for curve in curves if curve.slopes is not None]
        breaks = zeros((len(curves), most), curves[0].breaks)
        for row, curve in zip(breaks, curves, strict=True):
            row[: len(curve.breaks)] = curve.breaks
            row[len(curve.breaks) :] = 2.0
        return cls(
            breaks=breaks,
            coefficients=_side_by_side([curve.coefficients for curve in curves]),
            slopes=_side_by_side(slopes) if len(slopes) == len(curves) else None,
        )

    def at(self, which: Int[Array, " k"]) -> CurveTensors:
        """The selected curves of a batch."""
        slopes = None if self.slopes is None else self.slopes[:, which]
        return CurveTensors(breaks=self.breaks[which], coefficients=self.coefficients[:, which], slopes=slopes)

    def alone(self, which: int) -> CurveTensors:
        """One curve of a batch."""
        slopes = None if self.slopes is None else self.slopes[:, which]
        count = int((self.breaks[which] <= 1).sum())
        return CurveTensors(
            breaks=self.breaks[which, :count], coefficients=self.coefficients[:, which, : count - 1], slopes=slopes
        )

    @cached_property
    def _last_piece(self) -> Int[Array, "*batch 1"]:
        """Number of each curve's last piece."""
        return (self.breaks <= 1).sum(-1)[..., None] - 2

    @cached_property
    def _first_piece(self) -> Int[Array, "*batch 1"]:
        """Index of each curve's first piece when all pieces are numbered consecutively."""
        shape = self.breaks.shape[:-1]
        number = namespace(self.breaks).arange(math.prod(shape), **on_device_of(self.breaks))
        return (number * (self.breaks.shape[-1] - 1)).reshape(*shape, 1)

    @cached_property
    def _starts(self) -> Float[Array, " k"]:
        """Parameters at the starts of all pieces."""
        return self.breaks[..., :-1].reshape(-1)

    @cached_property
    def _pieces(self) -> Float[Array, "d3 k"]:
        return _by_piece(self.coefficients)

    @cached_property
    def _slope_pieces(self) -> Float[Array, "d3 k"] | None:
        return None if self.slopes is None else _by_piece(self.slopes)

    def point_and_derivatives(
        self, s: Float[Array, "*pts"]
    ) -> tuple[Float[Array, "*pts 3"], Float[Array, "*pts 3"], Float[Array, "*pts 3"]]:
        """Γ(s), Γ'(s) and Γ''(s) for s modulo 1, of shape (*batch, n) for a batch."""
        value, first, second = (namespace(s).moveaxis(part, 0, -1) for part in self.coordinates(s))
        return value, first, second

    def coordinates(
        self, s: Float[Array, "*pts"]
    ) -> tuple[Float[Array, "3 *pts"], Float[Array, "3 *pts"], Float[Array, "3 *pts"]]:
        """`point_and_derivatives` with one array for each coordinate, on which operations are several times as fast."""
        xp = namespace(s)
        s = s - xp.floor(s)
        piece = self._piece(s)
        h = s - _taken(self._starts, piece)
        value, first, second = _horner(self._pieces, piece, h)
        if self._slope_pieces is not None:
            first, second, _ = _horner(self._slope_pieces, piece, h)
        return value, first, second

    def point_and_derivative(self, s: Float[Array, "*pts"]) -> tuple[Float[Array, "*pts 3"], Float[Array, "*pts 3"]]:
        """Γ(s) and Γ'(s) for s modulo 1."""
        point, first, _ = self.point_and_derivatives(s)
        return point, first

    def local_edge(self, s: Float[Array, "*pts"]) -> Float[Array, "*pts"]:
        """Mean length of an edge and its two neighbours, at each parameter. It depends little on a single tiny edge."""
        return _taken(self._local_edges.reshape(-1), self._piece(s - namespace(s).floor(s)))

    @cached_property
    def _local_edges(self) -> Float[Array, "*batch m"]:
        vertices, count, xp = self.coefficients[-1], self._last_piece + 1, namespace(self.breaks)
        place = xp.arange(vertices.shape[-2], **on_device_of(vertices))
        after, before = (place + 1) % count, (place - 1) % count
        edge = norm(xp.take_along_axis(vertices, after[..., None], axis=-2) - vertices)
        return (xp.take_along_axis(edge, before, axis=-1) + edge + xp.take_along_axis(edge, after, axis=-1)) / 3

    def _piece(self, s: Float[Array, "*pts"]) -> Int[Array, "*pts"]:
        """Index of the piece at each parameter in [0, 1), among the pieces of all curves."""
        return namespace(s).minimum(_last_before(self.breaks, s), self._last_piece) + self._first_piece


def _last_before(breaks: Float[Array, "*batch m"], s: Float[Array, "*pts"]) -> Int[Array, "*pts"]:
    """Index of the last break that is at most s. Each row of a batch has its own breaks."""
    if not is_numpy(s):
        import torch

        return torch.searchsorted(breaks, s.contiguous(), right=True) - 1
    if breaks.ndim == 1:
        return np.searchsorted(breaks, s, side="right") - 1
    return np.stack([np.searchsorted(own, row, side="right") for own, row in zip(breaks, s, strict=True)]) - 1


def _taken(values: Float[Array, " k"], which: Int[Array, "*pts"]) -> Float[Array, "*pts"]:
    """values[which]."""
    # for tensors it takes a third of the time of indexing
    return namespace(values).take(values, which.reshape(-1), axis=0).reshape(which.shape)


def _side_by_side(parts: Sequence[Float[Array, "_ _ 3"]]) -> Float[Array, "d1 b m 3"]:
    """Coefficients of several curves, padded with 0 and stacked."""
    highest, most = (max(part.shape[axis] for part in parts) for axis in (0, 1))
    filled = zeros((highest, len(parts), most, 3), parts[0])
    for number, part in enumerate(parts):
        filled[highest - len(part) :, number, : part.shape[1]] = part
    return filled


def _by_piece(coefficients: Float[Array, "d1 *batch m 3"]) -> Float[Array, "d3 k"]:
    """Coefficients of all pieces of all curves, one row for each power and coordinate."""
    rows = coefficients.reshape(len(coefficients), -1, 3).swapaxes(1, 2)
    return rows.reshape(3 * len(coefficients), -1)


def _horner(
    pieces: Float[Array, "d3 k"], piece: Int[Array, "*pts"], h: Float[Array, "*pts"]
) -> tuple[Float[Array, "3 *pts"], Float[Array, "3 *pts"], Float[Array, "3 *pts"]]:
    """Value, first and second derivative of polynomials at h."""
    # one array for each coordinate: a last axis of length 3 is far slower
    xp = namespace(h)
    local = xp.take(pieces, piece.reshape(-1), axis=1).reshape(-1, 3, *piece.shape)
    value, first = local[0] * h, xp.asarray(local[0], copy=True)
    value += local[1]
    second = xp.zeros_like(value)
    for coefficient in local[2:]:
        second *= h
        second += first
        first *= h
        first += value
        value *= h
        value += coefficient
    second *= 2
    return value, first, second


def normals_of(tangent: Float[Array, "*pts 3"]) -> tuple[Float[Array, "*pts 3"], Float[Array, "*pts 3"]]:
    """Two orthonormal directions normal to each tangent."""
    along, xp = unit(tangent), namespace(tangent)
    axis = place_of(tangent).put(np.eye(3))[xp.argmin(abs(along), axis=-1)]
    first = unit(xp.linalg.cross(along, axis))
    return first, xp.linalg.cross(along, first)
