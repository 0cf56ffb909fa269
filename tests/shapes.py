"""Checks that arrays have the shapes that annotations state: `pytest -p tests.shapes tests/mesh`.

Only arrays are checked; mypy checks the other types.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from functools import wraps
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from jaxtyping import AbstractArray, install_import_hook


def arrays_checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Wraps a function so that it raises a TypeError if an array does not match its annotation."""
    signature = inspect.signature(function)
    hints: dict[str, Any] = {}

    @wraps(function)
    def checked(*args: Any, **kwargs: Any) -> Any:
        if not hints:
            hints.update({"return": Any} | get_type_hints(function))
        if function.__name__ == "__init__" and (not is_dataclass(args[0]) or hasattr(args[0], "__post_init__")):
            return function(*args, **kwargs)  # converts what it is given, and raises errors of its own
        for name, value in signature.bind(*args, **kwargs).arguments.items():
            kind = signature.parameters[name].kind
            values = value if kind == inspect.Parameter.VAR_POSITIONAL else [value]
            for one in values:
                _require(one, hints.get(name, Any), name, function)
        value = function(*args, **kwargs)
        _require(value, hints["return"], "what is returned", function)
        return value

    return checked


def _require(value: object, hint: Any, name: str, function: Callable[..., Any]) -> None:
    if not _fits(value, hint):
        got = f"{tuple(value.shape)} of {value.dtype}" if hasattr(value, "shape") else repr(value)[:200]
        raise TypeError(f"{function.__module__}.{function.__qualname__}: {name} must be {hint}, got {got}")


def _fits(value: object, hint: Any) -> bool:
    """Whether all arrays in a value have the shapes of its annotation."""
    origin, parts = get_origin(hint), get_args(hint)
    if isinstance(value, np.ndarray) and value.dtype.char == "q":
        value = value.view(np.int64)  # jaxtyping does not know numpy's second name of int64
    if _is_shape(hint):
        return isinstance(value, hint)
    if origin in (Union, UnionType):
        shapes = [part for part in parts if _is_shape(part)]
        if shapes and hasattr(value, "dtype"):
            return any(isinstance(value, shape) for shape in shapes)
        return value is None or any(_fits(value, part) for part in parts if part is not NoneType and part not in shapes)
    if origin is tuple and isinstance(value, tuple):
        parts = parts[:1] * len(value) if parts[1:] == (...,) else parts
        return len(parts) == len(value) and all(map(_fits, value, parts))
    if origin in (list, Sequence) and isinstance(value, (list, tuple)):
        return all(_fits(one, parts[0]) for one in value)
    if origin in (dict, Mapping) and isinstance(value, Mapping):
        return all(_fits(one, parts[1]) for one in value.values())
    return True


def _is_shape(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, AbstractArray)


install_import_hook("spinor_geom", "tests.shapes.arrays_checked")
