"""`spinor-geom morph`: turns a surface through its associate family."""

from __future__ import annotations

import argparse
from pathlib import Path

from spinor_geom.cli.console import ExitStatus
from spinor_geom.cli.fill import require_writable
from spinor_geom.render.morph import checked_suffix, morph


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Loads a surface, or takes it from the gallery, and writes an animation or a page."""
    from spinor_geom.gallery import named_surface
    from spinor_geom.surface import SpinorSurface

    # before a surface is solved
    checked_suffix(arguments.output)
    require_writable(arguments.output)
    path = Path(arguments.surface)
    surface = SpinorSurface.load(path) if path.suffix or path.exists() else named_surface(arguments.surface)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    morph(surface, arguments.output, frames=arguments.frames)
    return ExitStatus.DONE
