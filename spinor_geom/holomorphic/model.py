"""The protocol of holomorphic models, and the table of models that can be saved."""

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, TypeAlias, get_args, runtime_checkable

import torch
from jaxtyping import Complex
from torch import Tensor

from spinor_geom.errors import OptionError, StorageError
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.holomorphic.series import PowerSeries


@runtime_checkable
class HolomorphicModel(Protocol):
    """A `torch.nn.Module` of two holomorphic functions p, q of one complex variable."""

    kind: ClassVar[str]

    def value(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p(z), q(z))."""

    def derivative(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        """(p'(z), q'(z))."""

    def config(self) -> dict[str, Any]:
        """Sizes from which `from_config` makes a model of the same shape; JSON-ready."""


@runtime_checkable
class IntegrableModel(HolomorphicModel, Protocol):
    """A model whose products p², q², pq have integrals in closed form."""

    def primitive(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 3"]:
        """(∫ p² dζ, ∫ q² dζ, ∫ pq dζ) from a fixed point to z, to round-off."""


Model: TypeAlias = CauchyInterpolant | CauchyNetwork | ComplexMLP | LaurentSeries | PowerSeries

MODELS: dict[str, type[Model]] = {model.kind: model for model in get_args(Model)}


def rebuild(kind: str, config: Mapping[str, Any], state: Mapping[str, Tensor]) -> torch.nn.Module:
    """Rebuilds a saved model from its kind, `config` and state dict. Raises StorageError if they are inconsistent."""
    if kind not in MODELS:
        raise StorageError(f"unknown holomorphic model {kind!r}; known: {', '.join(sorted(MODELS))}")
    try:
        model = MODELS[kind].from_config(config)
        model.load_state_dict(dict(state))
    except (KeyError, TypeError, RuntimeError, OptionError) as error:
        raise StorageError(f"the saved {kind!r} model does not fit its description: {error}") from error
    return model
