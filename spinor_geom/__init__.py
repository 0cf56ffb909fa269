"""Fills holes of meshes and solves Plateau's problem with exact minimal surfaces from two holomorphic functions.

The public names are those of `__init__.pyi`. They are imported on first use, so that `import spinor_geom` is fast.
"""

import ast
import importlib
from pathlib import Path
from typing import Any

_MODULES = {
    name.name: statement.module
    for statement in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(statement, ast.ImportFrom)
    for name in statement.names
}

__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """Imports a public name from its module on first use."""
    try:
        module = _MODULES[name]
    except KeyError:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
    value = getattr(importlib.import_module(str(module)), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, imported or not."""
    return sorted({*globals(), *_MODULES})
