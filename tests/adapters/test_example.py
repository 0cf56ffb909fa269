"""The folder `adapters` of the clone: its example runs, and its table is complete."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from spinor_geom import adapters
from spinor_geom.adapters.mesh_files import FORMATS
from spinor_geom.adapters.registry import _adapters

ROOT = Path(__file__).parents[2]
README = (ROOT / "adapters" / "README.md").read_text(encoding="utf-8")


def test_the_example_fills_a_mesh_of_its_own_type() -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "adapters/example.py"]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout == "Cloth: 10 triangles, 12 when filled\nwatertight: True\n"


def test_the_table_has_every_adapter_and_where_it_is() -> None:
    rows = re.findall(r"^\|.*\| `(\w+Adapter)` \| `(\w+)\.py` \|$", README, re.MULTILINE)
    ours = {type(one) for one in _adapters.values() if type(one).__module__.startswith(adapters.__name__)}
    assert sorted(rows) == sorted((one.__name__, one.__module__.rpartition(".")[2]) for one in ours)


def test_the_table_has_every_format() -> None:
    assert f"| files: {', '.join(FORMATS)} |" in README
