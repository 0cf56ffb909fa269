"""The folder `adapters` of the clone: its example runs, and its table is complete."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from spinor_geom.adapters.mesh_files import FORMATS

ROOT = Path(__file__).parents[2]
README = (ROOT / "adapters" / "README.md").read_text(encoding="utf-8")


def test_the_example_fills_a_mesh_of_its_own_type() -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "adapters/example.py"]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout == "Cloth: 10 triangles, 12 when filled\nwatertight: True\n"


def test_the_table_has_every_adapter_and_where_it_is() -> None:
    rows = re.findall(r"^\|.*\| `(\w+Adapter)` \| `(\w+)\.py` \|$", README, re.MULTILINE)
    modules = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "spinor_geom" / "adapters").glob("*.py")}
    ours = [(name, stem) for stem, text in modules.items() for name in re.findall(r"^class (\w+Adapter)\b", text, re.M)]
    assert sorted(rows) == sorted(ours)


def test_the_table_has_every_format() -> None:
    assert f"| files: {', '.join(FORMATS)} |" in README
