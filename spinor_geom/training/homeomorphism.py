"""The paper's homeomorphisms of the circle: the integral of a positive real network, and its inverse by bisection."""

from __future__ import annotations

import itertools
import math

import torch
from jaxtyping import Float
from torch import Tensor

# real layers of the paper's ρ
_SIZES = (1, 64, 64, 32, 1)
# pieces of [0, 1] on which ρ is linear between its values: its integral there is exact
_PIECES = 512
# halvings of [0, 1]: to round-off
_HALVINGS = 53


class CircleHomeomorphism(torch.nn.Module):
    """Ψ(t) = ∫₀ᵗ ρ/∫₀¹ ρ + b, increasing, with Ψ(t + 1) = Ψ(t) + 1, for a positive ρ and a learnable shift b.

    ρ is a real network [1, 64, 64, 32, 1] with ReLU units and an exponential output. At the start it is nearly
    constant, so Ψ is nearly the identity.

    Source: Sun & Chern (2026), reparametrisations on S¹.
    """

    def __init__(self, *, generator: torch.Generator | None = None, device: torch.device | str = "cpu") -> None:
        """Random parameters: uniform in ±1/√fan-in; b = 0.

        Args:
            generator: of the parameters, on the CPU.
            device: of the parameters.
        """
        super().__init__()

        def uniform(size: int, *shape: int) -> torch.nn.Parameter:
            drawn = torch.rand(*shape, dtype=torch.float64, generator=generator)
            return torch.nn.Parameter(((2 * drawn - 1) / math.sqrt(size)).to(device))

        pairs = list(itertools.pairwise(_SIZES))
        self.weights = torch.nn.ParameterList([uniform(size, out, size) for size, out in pairs])
        self.biases = torch.nn.ParameterList([uniform(size, out) for size, out in pairs])
        self.shift = torch.nn.Parameter(torch.zeros((), dtype=torch.float64, device=device))

    def density(self, t: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """ρ(t) for t in [0, 1]."""
        h = t[:, None]
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            h = (torch.relu(h) if layer else h) @ weight.mT + bias
        return h[:, 0].exp()

    def forward(self, t: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """Ψ(t); differentiable by t and the parameters."""
        return self._value(t, self._table()) + self.shift

    def inverse(self, s: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """The t with Ψ(t) = s, by bisection; differentiable by s and the parameters.

        The derivatives are those of the implicit function theorem: ∂t/∂s = 1/Ψ′(t), ∂t/∂w = −∂Ψ/∂w/Ψ′(t).
        """
        table = self._table()
        wanted = s - self.shift
        with torch.no_grad():
            turns = wanted.floor()
            rest = wanted - turns
            low, high = torch.zeros_like(rest), torch.ones_like(rest)
            for _ in range(_HALVINGS):
                middle = (low + high) / 2
                below = self._value(middle, table) < rest
                low, high = torch.where(below, middle, low), torch.where(below, high, middle)
            t = turns + (low + high) / 2
            slope = self._slope(t, table)
        # a Newton step whose value is round-off and whose derivative is the theorem's
        return t - (self._value(t, table) - wanted) / slope

    def _table(self) -> Float[Tensor, " k"]:
        """ρ/∫₀¹ρ at the ends of the pieces."""
        ends = torch.linspace(0, 1, _PIECES + 1, dtype=torch.float64, device=self.shift.device)
        density = self.density(ends)
        return density / ((density[1:] + density[:-1]).sum() / (2 * _PIECES))

    @staticmethod
    def _value(t: Float[Tensor, " n"], table: Float[Tensor, " k"]) -> Float[Tensor, " n"]:
        """Ψ(t) − b."""
        before = torch.nn.functional.pad(((table[1:] + table[:-1]) / (2 * _PIECES)).cumsum(0), (1, 0))
        turns = t.detach().floor()
        piece, part = CircleHomeomorphism._place(t - turns)
        left, right = table[piece], table[piece + 1]
        return turns + before[piece] + part * (left + (right - left) * part / 2) / _PIECES

    @staticmethod
    def _slope(t: Float[Tensor, " n"], table: Float[Tensor, " k"]) -> Float[Tensor, " n"]:
        """Ψ′(t)."""
        piece, part = CircleHomeomorphism._place(t - t.floor())
        return table[piece] + (table[piece + 1] - table[piece]) * part

    @staticmethod
    def _place(t: Float[Tensor, " n"]) -> tuple[Tensor, Float[Tensor, " n"]]:
        """The piece that holds t in [0, 1], and how far along it t lies."""
        scaled = t * _PIECES
        piece = scaled.detach().long().clamp(0, _PIECES - 1)
        return piece, scaled - piece
