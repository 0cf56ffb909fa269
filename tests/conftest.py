"""Fixtures of tests that start processes of their own."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for PYTHONPATH: the package with its adapters in their place, as installing it would leave it."""
    folder = tmp_path_factory.mktemp("site")
    package = folder / "spinor_geom"
    package.mkdir()
    for entry in (ROOT / "spinor_geom").iterdir():
        (package / entry.name).symlink_to(entry)
    (package / "adapters").symlink_to(ROOT / "adapters")
    return folder
