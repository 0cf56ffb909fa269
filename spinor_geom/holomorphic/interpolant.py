"""Cauchy's integral formula at nodes on ∂Ω as a pair of rational functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import torch
from jaxtyping import Complex
from torch import Tensor

from spinor_geom.errors import DtypeError

# entries of a points × nodes table computed at once
_BLOCK = 1 << 21


class CauchyInterpolant(torch.nn.Module):
    """p and q as rational functions with given values at nodes on ∂Ω: a Cauchy layer with its poles on ∂Ω.

    f(z) = Σ_j w_j f_j/(ζ_j − z) / Σ_j w_j/(ζ_j − z) with w_j = dz/dt at the node: the trapezoidal rule for Cauchy's
    integral of f over that of 1, which are off by the same factor near ∂Ω. It takes the values f_j at the nodes and is
    as accurate between them as in the middle of Ω. The units' denominators cancel: f is holomorphic in Ω and on ∂Ω.

    Shape:
        nodes: (n,), ζ_j, in order, at equal steps of an analytic parameter t of ∂Ω.
        weights: (n,), dz/dt there.
        values: (n, 2), complex; column 0 is p, column 1 is q.

    Source: Ioakimidis, Papadakis & Perdios, "Numerical evaluation of analytic functions by Cauchy's theorem", BIT 31
    (1991).
    """

    kind: ClassVar[str] = "cauchy-interpolant"
    nodes: Tensor
    weights: Tensor

    def __init__(
        self,
        nodes: Complex[Tensor, " n"],
        weights: Complex[Tensor, " n"],
        values: Complex[Tensor, "n 2"],
    ) -> None:
        """Raises DtypeError where a tensor is not complex."""
        super().__init__()
        for name, tensor in (("nodes", nodes), ("weights", weights), ("values", values)):
            if not tensor.is_complex():
                raise DtypeError(f"{name} must be complex, got {tensor.dtype}")
        self.register_buffer("nodes", nodes)
        self.register_buffer("weights", weights)
        self.values = torch.nn.Parameter(values.clone())

    def features(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts n"]:
        """The cardinal functions at z: 1 at their own node, 0 at the others."""
        kernel, _ = self._kernel(z)
        return kernel / kernel.sum(-1, keepdim=True)

    def value(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p(z), q(z))."""
        return _in_blocks(self._value, z, len(self.nodes))

    def derivative(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p'(z), q'(z))."""
        return _in_blocks(self._derivative, z, len(self.nodes))

    def _value(self, z: Complex[Tensor, " m"]) -> Complex[Tensor, "m 2"]:
        kernel, _ = self._kernel(z)
        return (kernel @ self.values) / kernel.sum(-1, keepdim=True)

    def _derivative(self, z: Complex[Tensor, " m"]) -> Complex[Tensor, "m 2"]:
        # with N = Σ w f/(ζ − z), D = Σ w/(ζ − z): (N/D)' = (Σ w f/(ζ − z)² − (N/D) Σ w/(ζ − z)²)/D
        kernel, inverse = self._kernel(z)
        total = kernel.sum(-1, keepdim=True)
        value = (kernel @ self.values) / total
        squared = kernel * inverse
        # at a node ζ_k the limit, Σ_{j≠k} w_j (f_k − f_j)/(ζ_j − ζ_k)/w_k
        hit = self.nodes == z[..., None]
        at_node = hit.any(-1, keepdim=True)
        own = torch.where(at_node, hit.to(kernel.dtype) @ self.weights[:, None], 1)
        squared = torch.where(at_node, -(self.weights * inverse).masked_fill(hit, 0) / own, squared)
        return (squared @ self.values - value * squared.sum(-1, keepdim=True)) / total

    def _kernel(self, z: Complex[Tensor, "*pts"]) -> tuple[Complex[Tensor, "*pts n"], Complex[Tensor, "*pts n"]]:
        """Rows w_j/(ζ_j − z), and 1/(ζ_j − z); the row of a node itself is 1 there and 0 elsewhere."""
        difference = self.nodes - z[..., None]
        hit = difference == 0
        inverse = 1 / torch.where(hit, torch.ones_like(difference), difference)
        kernel = self.weights * inverse
        at_node = hit.any(-1, keepdim=True)
        return torch.where(at_node, hit.to(kernel.dtype), kernel), inverse

    def config(self) -> dict[str, Any]:
        """Number of nodes."""
        return {"nodes": len(self.nodes)}

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> CauchyInterpolant:
        """An interpolant of zeros with the given size."""
        count = int(config["nodes"])
        zeros = torch.zeros(count, dtype=torch.complex128)
        return cls(zeros, zeros.clone(), torch.zeros(count, 2, dtype=torch.complex128))


def _in_blocks(function: Callable[[Tensor], Tensor], z: Complex[Tensor, "*pts"], n: int) -> Complex[Tensor, "*pts 2"]:
    size = max(1, _BLOCK // n)
    flat = z.reshape(-1)
    parts = [function(flat[start : start + size]) for start in range(0, max(1, len(flat)), size)]
    return torch.cat(parts).reshape(*z.shape, 2)
