"""Fills holes of meshes and solves Plateau's problem with exact minimal surfaces from two holomorphic functions.

The public names are those of `__init__.pyi`. They are imported on first use, so that `import spinor_geom` is fast.
"""

import ast as _ast
import importlib as _importlib
from pathlib import Path as _Path
from typing import Any as _Any

_MODULES = {
    name.name: statement.module
    for statement in _ast.parse(_Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(statement, _ast.ImportFrom)
    for name in statement.names
}

__all__ = sorted(_MODULES)


def __getattr__(name: str) -> _Any:
    """Imports a public name from its module on first use."""
    try:
        module = _MODULES[name]
    except KeyError:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
    value = getattr(_importlib.import_module(str(module)), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, imported or not, and those of every module."""
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
