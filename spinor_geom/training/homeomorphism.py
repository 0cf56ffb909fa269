"""The paper's homeomorphisms of the circle: the integral of a positive real network, and its inverse."""

from __future__ import annotations

import itertools

import torch
from jaxtyping import Float
from torch import Tensor

# real layers of the paper's ρ
_SIZES = (1, 64, 64, 32, 1)
# pieces of [0, 1] on which ρ is linear between its values: its integral there is exact
_PIECES = 512


class CircleHomeomorphism(torch.nn.Module):
    """Ψ(t) = ∫₀ᵗ ρ/∫₀¹ ρ + b, increasing, with Ψ(t + 1) = Ψ(t) + 1, for a positive ρ and a learnable shift b.

    ρ is a real network [1, 64, 64, 32, 1] with ReLU units and an exponential output. At the start it is nearly
    constant, so Ψ is nearly the identity.

    Source: Sun & Chern (2026), reparametrisations on S¹.
    """

    def __init__(self, *, generator: torch.Generator | None = None) -> None:
        """Random parameters, on the CPU: uniform in ±1/√fan-in; b = 0.

        Args:
            generator: of the parameters.
        """
        super().__init__()
        pairs = itertools.pairwise(_SIZES)
        # made without the random numbers of all torch
        linear = [torch.nn.Linear(*pair, dtype=torch.float64, device="meta").to_empty(device="cpu") for pair in pairs]
        for name in ("weight", "bias"):
            for layer in linear:
                bound = layer.in_features**-0.5
                torch.nn.init.uniform_(getattr(layer, name), -bound, bound, generator=generator)
        self.layers = torch.nn.Sequential(
            linear[0], *(part for layer in linear[1:] for part in (torch.nn.ReLU(), layer))
        )
        self.shift = torch.nn.Parameter(torch.zeros((), dtype=torch.float64))

    def density(self, t: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """ρ(t) for t in [0, 1]."""
        output: Tensor = self.layers(t[:, None])
        return output[:, 0].exp()

    def forward(self, t: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """Ψ(t); differentiable by t and the parameters."""
        slopes, values = self._table()
        turns = t.detach().floor()
        piece = ((t.detach() - turns) * _PIECES).long().clamp(0, _PIECES - 1)
        part = (t - turns) * _PIECES - piece
        left, right = slopes[piece], slopes[piece + 1]
        return turns + values[piece] + part * (left + (right - left) * part / 2) / _PIECES + self.shift

    def inverse(self, s: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """The t with Ψ(t) = s, the zero of a quadratic; differentiable by s and the parameters."""
        slopes, values = self._table()
        wanted = s - self.shift
        turns = wanted.detach().floor()
        rest = wanted - turns
        piece = (torch.searchsorted(values.detach(), rest.detach(), right=True) - 1).clamp(0, _PIECES - 1)
        left, right = slopes[piece], slopes[piece + 1]
        above = (rest - values[piece]) * _PIECES
        part = 2 * above / (left + (left**2 + 2 * (right - left) * above).sqrt())
        return turns + (piece + part) / _PIECES

    def _table(self) -> tuple[Float[Tensor, " k"], Float[Tensor, " k"]]:
        """Ψ′ and Ψ − b at the ends of the pieces."""
        ends = torch.linspace(0, 1, _PIECES + 1, dtype=torch.float64, device=self.shift.device)
        density = self.density(ends)
        integral = torch.cumulative_trapezoid(density, dx=1 / _PIECES)
        values = torch.nn.functional.pad(integral / integral[-1], (1, 0))
        return density / integral[-1], values
