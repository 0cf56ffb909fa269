"""The folder `adapters` of the clone: its example runs."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_example_fills_a_mesh_of_its_own_type():
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "adapters/example.py"]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout == "Cloth: 10 triangles, 12 when filled\nwatertight: True\n"
