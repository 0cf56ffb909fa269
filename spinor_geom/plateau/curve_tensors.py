"""Boundary curves as tensors: points and derivatives of many curves at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from spinor_geom.mesh.curve import BoundaryCurve


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveTensors:
    """A piecewise polynomial curve as tensors, or a padded batch of curves."""

    breaks: Float[Tensor, "*batch m1"]  # in [0, 1], padded with 2
    coefficients: Float[Tensor, "d1 *batch m 3"]  # highest power first, padded with 0
    slopes: Float[Tensor, "d1 *batch m 3"] | None = None  # of Γ′, if all curves are given by formulas

    @classmethod
    def of(cls, curve: BoundaryCurve, device: torch.device) -> CurveTensors:
        """The curve on a device."""
        return cls(
            breaks=torch.tensor(curve.breaks, device=device),
            coefficients=torch.tensor(curve.coefficients, device=device),
            slopes=None if curve.slopes is None else torch.tensor(curve.slopes, device=device),
        )

    @classmethod
    def batch(cls, curves: Sequence[CurveTensors]) -> CurveTensors:
        """A batch of single curves; they keep `slopes` if all have them."""
        most = max(len(curve.breaks) for curve in curves)
        slopes = [curve.slopes for curve in curves if curve.slopes is not None]
        return cls(
            breaks=torch.stack(
                [torch.nn.functional.pad(curve.breaks, (0, most - len(curve.breaks)), value=2.0) for curve in curves]
            ),
            coefficients=_side_by_side([curve.coefficients for curve in curves]),
            slopes=_side_by_side(slopes) if len(slopes) == len(curves) else None,
        )

    def at(self, which: Int[Tensor, " k"]) -> CurveTensors:
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
    def _last_piece(self) -> Int[Tensor, "*batch 1"]:
        return (self.breaks <= 1).sum(-1, keepdim=True) - 2

    @cached_property
    def _first_piece(self) -> Int[Tensor, "*batch 1"]:
        """Number of each curve's first piece among the pieces of all."""
        shape = self.breaks.shape[:-1]
        number = torch.arange(shape.numel(), device=self.breaks.device) * (self.breaks.shape[-1] - 1)
        return number.reshape(*shape, 1)

    @cached_property
    def _starts(self) -> Float[Tensor, " k"]:
        return self.breaks[..., :-1].flatten()

    @cached_property
    def _pieces(self) -> Float[Tensor, "d3 k"]:
        return _by_piece(self.coefficients)

    @cached_property
    def _slope_pieces(self) -> Float[Tensor, "d3 k"] | None:
        return None if self.slopes is None else _by_piece(self.slopes)

    def point_and_derivatives(
        self, s: Float[Tensor, "*pts"]
    ) -> tuple[Float[Tensor, "*pts 3"], Float[Tensor, "*pts 3"], Float[Tensor, "*pts 3"]]:
        """Γ(s), Γ'(s) and Γ''(s); s is taken modulo 1, of shape (*batch, n) for a batch."""
        s = s - s.floor()
        piece = self._piece(s)
        h = s - _taken(self._starts, piece)
        value, first, second = _horner(self._pieces, piece, h)
        if self._slope_pieces is None:
            return value, first, second
        first, second, _ = _horner(self._slope_pieces, piece, h)
        return value, first, second

    def point_and_derivative(self, s: Float[Tensor, "*pts"]) -> tuple[Float[Tensor, "*pts 3"], Float[Tensor, "*pts 3"]]:
        """Γ(s) and Γ'(s); s is taken modulo 1."""
        point, first, _ = self.point_and_derivatives(s)
        return point, first

    def local_edge(self, s: Float[Tensor, "*pts"]) -> Float[Tensor, "*pts"]:
        """Mean length of an edge and its two neighbours, at each parameter; a single tiny edge hardly changes it."""
        return _taken(self._local_edges.flatten(), self._piece(s - s.floor()))

    @cached_property
    def _local_edges(self) -> Float[Tensor, "*batch m"]:
        vertices, count = self.coefficients[-1], self._last_piece + 1
        place = torch.arange(vertices.shape[-2], device=vertices.device)
        after, before = (place + 1) % count, (place - 1) % count
        edge = (torch.take_along_dim(vertices, after[..., None], -2) - vertices).norm(dim=-1)
        mean: Tensor = (edge.gather(-1, before) + edge + edge.gather(-1, after)) / 3
        return mean

    def _piece(self, s: Float[Tensor, "*pts"]) -> Int[Tensor, "*pts"]:
        """Index of the piece at each parameter in [0, 1), among the pieces of all curves."""
        return torch.minimum(torch.searchsorted(self.breaks, s, right=True) - 1, self._last_piece) + self._first_piece


def _taken(values: Float[Tensor, " k"], which: Int[Tensor, "*pts"]) -> Float[Tensor, "*pts"]:
    # takes a third of the time of indexing
    return values.index_select(0, which.flatten()).reshape(which.shape)


def _side_by_side(parts: Sequence[Float[Tensor, "_ _ 3"]]) -> Float[Tensor, "d1 b m 3"]:
    """Coefficients of several curves, padded with 0 and stacked."""
    highest, most = (max(part.shape[axis] for part in parts) for axis in (0, 1))
    filled = [torch.nn.functional.pad(part, (0, 0, 0, most - part.shape[1], highest - len(part), 0)) for part in parts]
    return torch.stack(filled, dim=1)


def _by_piece(coefficients: Float[Tensor, "d1 *batch m 3"]) -> Float[Tensor, "d3 k"]:
    """Coefficients of all pieces of all curves, one row for each power and coordinate."""
    return coefficients.flatten(1, -2).transpose(1, 2).flatten(0, 1)


def _horner(
    pieces: Float[Tensor, "d3 k"], piece: Int[Tensor, "*pts"], h: Float[Tensor, "*pts"]
) -> tuple[Float[Tensor, "*pts 3"], Float[Tensor, "*pts 3"], Float[Tensor, "*pts 3"]]:
    """Value, first and second derivative of polynomials at h."""
    # one array for each coordinate: a last axis of length 3 is far slower
    local = pieces.gather(1, piece.flatten().expand(len(pieces), -1)).reshape(-1, 3, *piece.shape)
    value, first = torch.addcmul(local[1], local[0], h), local[0].clone()
    second = torch.zeros_like(value)
    for coefficient in local[2:]:
        torch.addcmul(first, second, h, out=second)
        torch.addcmul(value, first, h, out=first)
        torch.addcmul(coefficient, value, h, out=value)
    return value.movedim(0, -1), first.movedim(0, -1), second.mul_(2).movedim(0, -1)


def normals_of(tangent: Float[Tensor, "*pts 3"]) -> tuple[Float[Tensor, "*pts 3"], Float[Tensor, "*pts 3"]]:
    """Two orthonormal directions normal to each tangent."""
    unit = torch.nn.functional.normalize(tangent, dim=-1)
    axis = torch.nn.functional.one_hot(unit.abs().argmin(-1), 3).to(unit.dtype)
    first = torch.nn.functional.normalize(torch.linalg.cross(unit, axis), dim=-1)
    return first, torch.linalg.cross(unit, first)
