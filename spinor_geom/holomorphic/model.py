"""The protocol of holomorphic models, and the models that can be saved."""

import copy
from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, cast, runtime_checkable

import numpy as np
from jaxtyping import Complex

from spinor_geom.arrays import Array, namespace
from spinor_geom.errors import StorageError
from spinor_geom.holomorphic.array_model import ArrayModel
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.series import PowerSeries


@runtime_checkable
class HolomorphicModel(Protocol):
    """Two holomorphic functions p, q of one complex variable: an `ArrayModel`, or a `torch.nn.Module`."""

    kind: ClassVar[str]

    def value(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        """(p(z), q(z))."""

    def derivative(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        """(p'(z), q'(z))."""

    def config(self) -> dict[str, Any]:
        """Sizes from which `from_config` makes a model of the same shape, as JSON values."""


@runtime_checkable
class IntegrableModel(HolomorphicModel, Protocol):
    """A model whose products p², q², pq have integrals in closed form."""

    def primitive(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 3"]:
        """(∫ p² dζ, ∫ q² dζ, ∫ pq dζ) from a fixed point to z, to round-off."""


def conjugated(model: HolomorphicModel) -> HolomorphicModel:
    """The model of conj(p(z̄)) and conj(q(z̄)): all its arrays are conjugated, as features are rational or entire."""
    if isinstance(model, ArrayModel):
        return cast(
            HolomorphicModel,
            model.with_arrays({name: namespace(array).conj(array) for name, array in model.arrays.items()}),
        )
    image = copy.deepcopy(model)
    for parameter in image.parameters():  # type: ignore[attr-defined]
        parameter.data = parameter.data.conj().resolve_conj()
    return image


_ARRAY_MODELS: tuple[Any, ...] = (CauchyInterpolant, CauchyNetwork, LaurentSeries, PowerSeries)
_CLASSES = {model.kind: model for model in _ARRAY_MODELS}
KINDS = tuple(sorted([*_CLASSES, "mlp"]))  # of models that can be saved


def saved_arrays(model: HolomorphicModel) -> Mapping[str, Array]:
    """The arrays that a file of a model contains. Raises StorageError if it cannot be read again."""
    kind = getattr(model, "kind", type(model).__name__)
    if kind not in KINDS:
        raise StorageError(f"a model of kind {kind!r} cannot be saved; known: {', '.join(KINDS)}", kind=kind)
    if isinstance(model, ArrayModel):
        return {name: model.arrays[name] for name in (*model.trained, *model.fixed)}
    arrays: Mapping[str, Array] = model.state_dict()  # type: ignore[attr-defined]
    return arrays


def rebuild(kind: str, config: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> HolomorphicModel:
    """Rebuilds a saved model from its kind, `config` and arrays. Raises StorageError if they are inconsistent."""
    if kind not in KINDS:
        raise StorageError(f"unknown holomorphic model {kind!r}; known: {', '.join(KINDS)}")
    try:
        if kind == "mlp":
            from spinor_geom.holomorphic.mlp import ComplexMLP

            return ComplexMLP.of_arrays(config, arrays)
        model = _CLASSES[kind].from_config(config)
        wanted, found = ({name: array.shape for name, array in some.items()} for some in (saved_arrays(model), arrays))
        if wanted != found:
            raise TypeError(f"it needs arrays of shapes {wanted}, got {found}")
        whole: HolomorphicModel = model.with_arrays(arrays)
        return whole
    except (KeyError, TypeError, ValueError, OverflowError, RuntimeError) as error:
        raise StorageError(f"the saved {kind!r} model does not fit its description: {error}") from error
