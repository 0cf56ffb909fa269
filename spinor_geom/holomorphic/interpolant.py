"""Rational interpolation at nodes on ∂Ω by the barycentric form of Cauchy's integral formula."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import torch
from jaxtyping import Bool, Complex
from torch import Tensor
from torch._C._functorch import is_functorch_wrapped_tensor
from torch.autograd.forward_ad import unpack_dual

from spinor_geom.holomorphic.blocks import in_blocks, require_complex
from spinor_geom.holomorphic.cauchy_sums import cauchy_sums

Nodes = Complex[Tensor, " n"]
Values = Complex[Tensor, "n 2"]  # of p and q at the nodes

_MANY = 700  # above this number of nodes and of points the fast multipole method is faster


class CauchyInterpolant(torch.nn.Module):
    """p and q as rational functions with given values at nodes on ∂Ω.

    f(z) = Σ_j w_j f_j/(ζ_j − z) / Σ_j w_j/(ζ_j − z) with w_j = dz/dt at the node: the trapezoidal rule for Cauchy's
    integral of f divided by that of 1. Near ∂Ω their errors cancel. f is holomorphic in Ω and on ∂Ω, interpolates the
    values f_j, and is as accurate near ∂Ω as in the middle of Ω.

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

    def __init__(self, nodes: Nodes, weights: Nodes, values: Values) -> None:
        """Raises DtypeError if a tensor is not complex."""
        super().__init__()
        require_complex(nodes=nodes, weights=weights, values=values)
        self.register_buffer("nodes", nodes)
        self.register_buffer("weights", weights)
        self.values = torch.nn.Parameter(values.clone())

    def value(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p(z), q(z)); at many points on the CPU, without gradients, by the fast multipole method, to 1e-12."""
        if min(z.numel(), len(self.nodes)) > _MANY and all(_is_plain(t) for t in (z, self.values)):
            flat = z.reshape(-1)
            parts = (self.nodes, _strengths(self.weights, self.values), flat)
            sums = cauchy_sums(*(part.detach().resolve_conj().numpy() for part in parts))
            with np.errstate(over="ignore", invalid="ignore"):
                value = torch.from_numpy(sums[:, :2] / sums[:, 2:])
            at_node = ~value.isfinite().all(-1)
            value[at_node] = interpolated(flat[at_node], self.nodes, self.weights, self.values)
            return value.reshape(*z.shape, 2)
        return in_blocks(
            lambda some: interpolated(some, self.nodes, self.weights, self.values), z, width=len(self.nodes)
        )

    def derivative(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p'(z), q'(z))."""
        data = self.nodes, self.weights, self.values
        return in_blocks(lambda some: interpolated_slope(some, *data), z, width=len(self.nodes))

    def config(self) -> dict[str, Any]:
        """Number of nodes."""
        return {"nodes": len(self.nodes)}

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> CauchyInterpolant:
        """An interpolant of zeros with the given size."""
        zeros = torch.zeros(int(config["nodes"]), 4, dtype=torch.complex128)
        return cls(zeros[:, 0].clone(), zeros[:, 1].clone(), zeros[:, 2:])


def interpolated(z: Complex[Tensor, " m"], nodes: Nodes, weights: Nodes, values: Values) -> Complex[Tensor, "m 2"]:
    """Σ_j w_j f_j/(ζ_j − z) / Σ_j w_j/(ζ_j − z) for two functions with values f_j at the nodes ζ_j."""
    inverse, hit = _inverse_differences(z, nodes)
    sums = inverse @ _strengths(weights, values)
    at_node = values.index_select(0, hit.to(torch.uint8).argmax(-1))
    return torch.where(hit.any(-1, keepdim=True), at_node, sums[:, :2] / sums[:, 2:])


def interpolated_slope(
    z: Complex[Tensor, " m"], nodes: Nodes, weights: Nodes, values: Values
) -> Complex[Tensor, "m 2"]:
    """Derivatives of the functions of `interpolated`."""
    # with N = Σ w f/(ζ − z), D = Σ w/(ζ − z): (N/D)' = (Σ w f/(ζ − z)² − (N/D) Σ w/(ζ − z)²)/D
    inverse, hit = _inverse_differences(z, nodes)
    strengths = _strengths(weights, values)
    sums, slopes = inverse @ strengths, (inverse * inverse) @ strengths
    elsewhere = (slopes[:, :2] - sums[:, :2] / sums[:, 2:] * slopes[:, 2:]) / sums[:, 2:]
    # the limit at a node ζ_k is Σ_{j≠k} w_j (f_k − f_j)/(ζ_j − ζ_k)/w_k
    node = hit.to(torch.uint8).argmax(-1)
    own, weight = values.index_select(0, node), weights.index_select(0, node)[:, None]
    return torch.where(hit.any(-1, keepdim=True), (own * sums[:, 2:] - sums[:, :2]) / weight, elsewhere)


def _strengths(weights: Nodes, values: Values) -> Complex[Tensor, "n 3"]:
    """Numerators of the sums: w f for both functions, and w."""
    return torch.cat([values, torch.ones_like(values[:, :1])], dim=-1) * weights[:, None]


def _inverse_differences(z: Complex[Tensor, " m"], nodes: Nodes) -> tuple[Complex[Tensor, "m n"], Bool[Tensor, "m n"]]:
    """1/(ζ_j − z), or 0 where z is the node ζ_j, and the mask of these entries."""
    difference = nodes - z[:, None]
    square = difference.real.square() + difference.imag.square()
    hit = square < torch.finfo(square.dtype).tiny
    # faster than complex division
    return difference.conj() * square.masked_fill(hit, torch.inf).reciprocal(), hit


def _is_plain(t: Complex[Tensor, "*any"]) -> bool:
    """Whether numpy can evaluate a tensor: finite, complex128, on the CPU, without gradients or transforms."""
    return (
        not torch.is_grad_enabled()
        and t.device.type == "cpu"
        and t.dtype == torch.complex128
        # torch.func wraps tensors; forward mode without it attaches a tangent
        and not is_functorch_wrapped_tensor(t)
        and unpack_dual(t).tangent is None  # type: ignore[no-untyped-call] # torch leaves it untyped
        and bool(t.isfinite().all())
    )
