"""Makes the processes of the benchmark's tests importable."""

from pathlib import Path

import pytest


@pytest.fixture
def importable(monkeypatch):
    """Puts this folder, with its sick.py, first on the path."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
