"""Models of arrays as torch modules, for training."""

from __future__ import annotations

from typing import Any, cast

from spinor_geom.arrays import to_numpy
from spinor_geom.holomorphic.array_model import ArrayModel
from spinor_geom.holomorphic.model import HolomorphicModel
from spinor_geom.torch_extra import torch


class ModelModule(torch.nn.Module):
    """An `ArrayModel` with its trained arrays as parameters and the others as buffers.

    It has the attributes and methods of the model.
    """

    def __init__(self, model: ArrayModel) -> None:
        super().__init__()
        for name, array in model.arrays.items():
            tensor = array.clone() if isinstance(array, torch.Tensor) else torch.tensor(array)
            if name in model.trained:
                self.register_parameter(name, torch.nn.Parameter(tensor))
            else:
                self.register_buffer(name, tensor, persistent=name in model.fixed)
        self._untracked = model

    def __repr__(self) -> str:
        return f"ModelModule({type(self._untracked).__name__})"

    @property
    def tracked(self) -> ArrayModel:
        """The model with the parameters and buffers as its arrays. Its results are differentiable in them."""
        return self._untracked.with_arrays({**self._parameters, **self._buffers})

    @property
    def untracked(self) -> ArrayModel:
        """The model with numpy arrays, which share the memory of the parameters on the CPU."""
        return self._untracked.with_arrays({n: to_numpy(t) for n, t in {**self._parameters, **self._buffers}.items()})

    def __getattr__(self, name: str) -> Any:
        """An attribute of the model."""
        try:
            return super().__getattr__(name)
        except AttributeError:
            if name.startswith("_") or "_untracked" not in vars(self):
                raise
            return getattr(self.tracked, name)


def as_module(model: HolomorphicModel | torch.nn.Module) -> torch.nn.Module:
    """A model as a module with a copy of its arrays. Modules are returned as they are."""
    return ModelModule(model) if isinstance(model, ArrayModel) else cast(torch.nn.Module, model)
