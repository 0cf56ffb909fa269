"""Packages that only some features need: asked for at the place that needs them, in one sentence."""

from __future__ import annotations

import importlib.util

from spinor_geom.errors import MissingPackageError


def require(package: str, *, extra: str) -> None:
    """Checks, without importing it, that a package is installed; else a MissingPackageError names the extra to get."""
    if importlib.util.find_spec(package) is None:
        raise MissingPackageError(package=package, extra=extra)
