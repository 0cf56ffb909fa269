"""The paper's complex-valued network: p and q as multilayer perceptrons with a holomorphic activation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, cast

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import OptionError, require_count, require_positive
from spinor_geom.holomorphic.blocks import in_blocks
from spinor_geom.torch_extra import Tensor, torch

ActivationName = Literal["exp", "sin", "sinh"]

# sample points on |u| = 1 for the initialisation: with ten layers the units have hundreds of oscillations
_INITIAL_POINTS = 1024
# The default gain is 1 + _BEND/depth: with few layers each has to be more nonlinear. With it fits by
# Levenberg-Marquardt reach 1e-8 on the paper's curves with 2 to 10 layers, with half of it 1e-4. The largest moduli of
# the units' arguments are random between _LEAST and 1 gain: units of equal gain are too similar.
_BEND, _LEAST = 5.0, 0.5
# initial p and q: largest deviation from the mean, and root mean square of the mean
_VARIATION, _MEAN = 0.5, 0.6
# σ and σ′
_ACTIVATIONS: Mapping[str, tuple[Callable[[Tensor], Tensor], Callable[[Tensor], Tensor]]] = {
    "exp": (torch.exp, torch.exp),
    "sin": (torch.sin, torch.cos),
    "sinh": (torch.sinh, torch.cosh),
}


class ComplexMLP(torch.nn.Module):
    """p and q as two complex-valued networks of one shape: input, weights, biases and activations in ℂ.

    z ↦ u = (z − center)/radius, then `depth` hidden layers h ↦ σ(W h + b) of `width` units and a linear read-out. With
    an entire σ both are entire. The computation is in double precision, the result in that of the points.

    With unscaled random weights exp∘exp∘exp overflows. The initial weights are scaled, layer by layer, so that
    on the circle |u| = 1 every unit's argument a = W h + b has mean 0 and a modulus of at most a gain M. By the maximum
    principle |a| ≤ M in the whole disk: |σ(a)| ≤ e^M for exp, sinh M for sin and sinh. Smaller weights would prevent
    overflow too, but each layer would damp the variation, and the network would hardly depend on z.

    Shape:
        weights: one (2, out, in) a layer, complex. First index 0 for p, 1 for q. The last is the read-out, out = 1.
        biases: one (2, out) a layer.

    Source: Sun & Chern (2026), neural representation of minimal surfaces.
    """

    kind: ClassVar[str] = "mlp"

    def __init__(
        self,
        *,
        depth: int = 3,
        width: int = 20,
        activation: ActivationName = "exp",
        center: complex = 0.0,
        radius: float = 1.0,
        gain: float | None = None,
        generator: torch.Generator | None = None,
    ) -> None:
        """A network with random parameters, complex128 on the CPU.

        The disk of the given centre and radius contains Ω. The gain is M. The default 1 + 5/depth suits second-order
        methods, about 0.5 first-order ones.

        Raises:
            OptionError: no layers or units, a radius or gain that is not positive, or an activation that is not entire.
        """
        super().__init__()
        require_count(depth=depth, width=width)
        gain = 1 + _BEND / depth if gain is None else gain
        require_positive("the radius of the disk around Ω", radius)
        require_positive("the gain", gain)
        if activation not in _ACTIVATIONS:
            raise OptionError(
                f"unknown activation {activation!r}; p and q are holomorphic only if it is entire: choose one of "
                f"{', '.join(_ACTIVATIONS)}"
            )
        self.activation: ActivationName = activation
        self.center = complex(center)
        self.radius = float(radius)
        parameters = _initial(depth, width, _ACTIVATIONS[activation][0], gain, generator)
        self.weights = torch.nn.ParameterList([weight for weight, _ in parameters])
        self.biases = torch.nn.ParameterList([bias for _, bias in parameters])

    @property
    def depth(self) -> int:
        """Number of hidden layers."""
        return len(self.weights) - 1

    @property
    def width(self) -> int:
        """Units in each hidden layer."""
        return int(self.weights[0].shape[1])

    def value(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p(z), q(z))."""
        return self._at(lambda u: self._read(self._layers(u)[0][-1]), z)

    def derivative(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p'(z), q'(z)), by the chain rule."""

        def slopes(u: Complex[Tensor, " n"]) -> Complex[Tensor, "n 2"]:
            change = torch.full_like(u, 1 / self.radius).expand(2, -1)[..., None]
            for weight, slope in zip(self.weights, self._slopes(self._layers(u)[1]), strict=False):
                change = slope * (change @ weight.mT)
            return torch.matmul(change, self.weights[-1].mT)[..., 0].mT

        return self._at(slopes, z)

    def linearised(self, z: Complex[Tensor, " n"]) -> Linearisation:
        """Linearises p and q at the points z in the parameters."""
        with torch.no_grad():
            inputs, arguments = self._layers(self._scaled(z))
            sensitivity = torch.ones_like(inputs[-1][..., :1])
            sensitivities = [sensitivity]
            for weight, slope in zip(reversed(list(self.weights)), reversed(self._slopes(arguments)), strict=False):
                sensitivity = (sensitivity @ weight) * slope
                sensitivities.append(sensitivity)
            return Linearisation(
                inputs=tuple(inputs), sensitivities=tuple(reversed(sensitivities)), value=self._read(inputs[-1])
            )

    def config(self) -> dict[str, Any]:
        """Sizes, activation and disk."""
        return {
            "depth": self.depth,
            "width": self.width,
            "activation": self.activation,
            "center": [self.center.real, self.center.imag],
            "radius": self.radius,
        }

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> ComplexMLP:
        """A network of the given sizes, with arbitrary parameters."""
        sizes = {name: config[name] for name in ("depth", "width", "activation", "radius")}
        return cls(**sizes, center=complex(*config["center"]), generator=torch.Generator().manual_seed(0))

    @classmethod
    def of_arrays(cls, config: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> ComplexMLP:
        """The network with given sizes and parameters. Raises RuntimeError if they do not fit."""
        depth, width = config["depth"], config["width"]
        wanted, found = (
            2 * ((depth - 1) * width**2 + (depth + 2) * width + 1),
            sum(array.size for array in arrays.values()),
        )
        if wanted != found:  # before memory is taken for them
            raise RuntimeError(f"it needs {wanted} parameters, got {found}")
        network = cls.from_config(config)
        network.load_state_dict({name: torch.tensor(array) for name, array in arrays.items()})
        return network

    def _scaled(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts"]:
        return ((z - self.center) / self.radius).to(self.weights[0].dtype)

    def _at(
        self, function: Callable[[Complex[Tensor, " n"]], Complex[Tensor, "n c"]], z: Complex[Tensor, "*pts"]
    ) -> Complex[Tensor, "*pts c"]:
        values: Tensor = in_blocks(function, self._scaled(z), width=2 * self.width)
        return values.to(z.dtype)

    def _layers(
        self, u: Complex[Tensor, " n"]
    ) -> tuple[list[Complex[Tensor, "2 n _"]], list[Complex[Tensor, "2 n w"]]]:
        """The inputs of all layers, that of the read-out last, and the arguments W h + b of the hidden ones."""
        inputs, arguments = [u.expand(2, -1)[..., None]], []
        for weight, bias in zip(list(self.weights)[:-1], self.biases, strict=False):
            arguments.append(inputs[-1] @ weight.mT + bias[:, None])
            inputs.append(_ACTIVATIONS[self.activation][0](arguments[-1]))
        return inputs, arguments

    def _slopes(self, arguments: list[Complex[Tensor, "2 n w"]]) -> list[Complex[Tensor, "2 n w"]]:
        """σ′ of every hidden layer."""
        return [_ACTIVATIONS[self.activation][1](argument) for argument in arguments]

    def _read(self, last: Complex[Tensor, "2 n w"]) -> Complex[Tensor, "n 2"]:
        return torch.add(last @ self.weights[-1].mT, self.biases[-1][:, None])[..., 0].mT


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearisation:
    """p and q at n points of a `ComplexMLP`, linearised in its parameters.

    They are holomorphic in the parameters, so the Jacobian J is complex. J is not computed: the contribution of a layer
    to J Jᴴ is the entrywise product of two Gram matrices.
    """

    inputs: tuple[Complex[Tensor, "2 n _"], ...]  # of each layer, (2, n, in)
    # derivatives of the output with respect to each layer's W h + b, (2, n, out)
    sensitivities: tuple[Complex[Tensor, "2 n _"], ...]
    value: Complex[Tensor, "n 2"]  # p and q

    def kernel(self) -> Complex[Tensor, "2 n n"]:
        """J Jᴴ of p and of q."""
        parts = (
            (sensitivity @ sensitivity.mH) * (1 + h @ h.mH)
            for h, sensitivity in zip(self.inputs, self.sensitivities, strict=True)
        )
        return cast(Tensor, sum(parts))

    def pulled_back(self, v: Complex[Tensor, "n 2"]) -> list[Tensor]:
        """Jᴴ v: for every weight, then every bias, in the order of `ComplexMLP.parameters`."""
        weighted = [sensitivity.conj() * v.mT[..., None] for sensitivity in self.sensitivities]
        weights = [part.mT @ h.conj() for part, h in zip(weighted, self.inputs, strict=True)]
        return [*weights, *(part.sum(1) for part in weighted)]


def disk_around(domain: PlaneDomain) -> tuple[complex, float]:
    """Centre of Ω's bounding box, and radius of the smallest disk about it that contains Ω."""
    rim = domain.boundary.vertices
    center = complex(rim.real.min() + rim.real.max(), rim.imag.min() + rim.imag.max()) / 2
    return center, float(abs(rim - center).max())


def _initial(
    depth: int, width: int, function: Callable[[Tensor], Tensor], gain: float, generator: torch.Generator | None
) -> list[tuple[Complex[Tensor, "2 _ _"], Complex[Tensor, "2 _"]]]:
    """Initial weight and bias of each layer, see `ComplexMLP`."""

    def normal(*shape: int) -> Complex[Tensor, "..."]:
        return torch.randn(*shape, dtype=torch.complex128, generator=generator)

    turn = 2 * math.pi * torch.arange(_INITIAL_POINTS, dtype=torch.float64) / _INITIAL_POINTS
    h = torch.polar(torch.ones_like(turn), turn).expand(2, -1)[..., None]
    layers = []
    for _ in range(depth):
        weight, bias, a = _bounded(h, normal(2, width, h.shape[-1]), gain, generator)
        layers.append((weight, bias))
        h = function(a)
    weight, bias, _ = _bounded(h, normal(2, 1, width), _VARIATION, generator)
    # p and q have a mean other than 0, so that there is no branch point in the middle. |p|² + |q|² is about 1, so that
    # the surface is about as large as Ω
    return [*layers, (weight, bias + _MEAN * normal(2, 1))]


def _bounded(
    h: Complex[Tensor, "2 n i"], weight: Complex[Tensor, "2 o i"], largest: float, generator: torch.Generator | None
) -> tuple[Complex[Tensor, "2 o i"], Complex[Tensor, "2 o"], Complex[Tensor, "2 n o"]]:
    """Scaled weight W and bias b such that W h + b has mean 0 and a modulus of at most `largest`, and W h + b."""
    a = h @ weight.mT
    mean = a.mean(1)
    share: Float[Tensor, "2 o"] = torch.rand(mean.shape, dtype=torch.float64, generator=generator)
    scale = largest * (_LEAST + (1 - _LEAST) * share) / (a - mean[:, None]).abs().amax(1)
    return weight * scale[..., None], -mean * scale, (a - mean[:, None]) * scale[:, None]
