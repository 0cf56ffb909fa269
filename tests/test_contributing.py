"""The statements of CONTRIBUTING.md and CITATION.cff are correct."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_files_that_are_named_exist():
    named = re.findall(r"`([\w./-]+/[\w./-]*|\w+\.(?:toml|md|yml|txt))`", TEXT)
    assert len(named) > 20
    for name in named:
        assert (ROOT / name).exists(), name
