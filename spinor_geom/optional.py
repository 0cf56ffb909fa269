"""Packages that only some features need: asked for at the place that needs them, in one sentence."""

from __future__ import annotations

import importlib.util

from spinor_geom.errors import MissingPackageError


def require(package: str, *, extra: str) -> None:
    """Checks that an optional package is installed, without importing it.

    Args:
        package: the name it is imported by.
        extra: the extra of spinor-geom that installs it.

    Raises:
        MissingPackageError: it is not installed; the message holds the command that installs it.
    """
    if importlib.util.find_spec(package) is None:
        raise MissingPackageError(package=package, extra=extra)
