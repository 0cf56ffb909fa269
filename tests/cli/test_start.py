"""What starting the program imports, and the public names."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import spinor_geom

ROOT = Path(__file__).parents[2]
HEAVY = ("torch", "trimesh", "scipy", "igl", "numpy", "pymeshlab", "pyvista", "rich", "jaxtyping", "matplotlib")
HEAVY += ("dask", "distributed", "filelock")


def run_alone(program: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True)


def test_help_and_usage_errors_import_nothing_heavy() -> None:
    program = (
        "import sys\n"
        "from spinor_geom.cli.main import main\n"
        "for command in ('', 'fill', 'loops', 'compare', 'reproduce', 'bench', 'batch', 'morph', 'view', 'render'):\n"
        "    for arguments in ([command, '--help'], [command]):\n"
        "        try:\n"
        "            main([word for word in arguments if word])\n"
        "        except SystemExit:\n"
        "            pass\n"
        f"print('LOADED', [name for name in {HEAVY!r} if name in sys.modules])\n"
    )
    done = run_alone(program)
    assert done.stdout.rstrip().endswith("LOADED []")
    assert done.stdout.count("usage: spinor-geom") == 10
    assert done.stderr.count("usage: spinor-geom") == 10


def test_importing_the_package_imports_nothing_heavy() -> None:
    program = f"import sys, spinor_geom; dir(spinor_geom); print([name for name in {HEAVY!r} if name in sys.modules])"
    done = run_alone(program)
    assert done.stdout.strip() == "[]"


def test_modules_of_a_command_are_no_garbage_to_look_through() -> None:
    program = (
        "import gc\n"
        "from spinor_geom.cli.main import main\n"
        "assert main(['loops', 'data/trimesh_reference.obj']) == 0\n"
        "print(gc.isenabled(), gc.get_freeze_count() > 10_000)\n"
    )
    done = run_alone(program)
    assert done.stdout.splitlines()[-1] == "True True"


def test_public_names_are_what_their_modules_define_and_no_module_of_the_same_name_hides_them() -> None:
    for name in spinor_geom.__all__:
        value = getattr(spinor_geom, name)
        assert value.__name__ == name
        assert value is getattr(importlib.import_module(value.__module__), name)
    assert set(spinor_geom.__all__) <= set(dir(spinor_geom))


def test_a_name_that_is_not_public_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'fill_holes'"):
        _ = spinor_geom.fill_holes
