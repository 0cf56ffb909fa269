"""Holomorphic models that are frozen dataclasses of arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, ClassVar, TypeVar

import numpy as np
from jaxtyping import Complex
from numpy.typing import DTypeLike

from spinor_geom.arrays import Array, Place

M = TypeVar("M", bound="ArrayModel")


def blank(*shape: int, dtype: DTypeLike = np.complex128) -> np.ndarray:
    """Read-only zeros that take no memory, whatever the shape, for models whose arrays are replaced."""
    return np.broadcast_to(np.zeros((), dtype=dtype), shape)


class ArrayModel(ABC):
    """p and q as functions of z and of arrays: numpy arrays, or tensors on one device.

    Methods take points of the same kind as the arrays. p and q can be differentiated by tensors.
    """

    kind: ClassVar[str]  # name of the model in files
    trained: ClassVar[tuple[str, ...]]  # names of the arrays that training changes, saved in files
    fixed: ClassVar[tuple[str, ...]] = ()  # names of arrays that training does not change, saved in files
    described: ClassVar[tuple[str, ...]] = ()  # names of arrays that `config` determines, not saved

    def __repr__(self) -> str:
        shapes = ", ".join(f"{name} {tuple(array.shape)}" for name, array in self.arrays.items())
        return f"{type(self).__name__}({shapes})"

    @property
    def arrays(self) -> dict[str, Array]:
        """All arrays by name."""
        return {name: getattr(self, name) for name in (*self.trained, *self.fixed, *self.described)}

    def with_arrays(self: M, arrays: Mapping[str, Array]) -> M:
        """The model with other arrays of the same shapes, which are not checked."""
        other = object.__new__(type(self))
        unchanged = {field.name: vars(self)[field.name] for field in fields(self)}  # type: ignore[arg-type]
        vars(other).update({**unchanged, **arrays})
        return other

    def at(self: M, place: Place) -> M:
        """The model with its arrays in another place."""
        return self.with_arrays({name: place.put(array) for name, array in self.arrays.items()})

    @abstractmethod
    def value(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        """(p(z), q(z))."""

    @abstractmethod
    def derivative(self, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
        """(p'(z), q'(z))."""

    @abstractmethod
    def config(self) -> dict[str, Any]:
        """Sizes from which `from_config` makes a model of the same shape, as JSON values."""
