"""The modules that starting the program imports, and the public names."""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import spinor_geom

ROOT = Path(__file__).parents[2]
HEAVY = ("torch", "trimesh", "scipy", "igl", "numpy", "pymeshlab", "pyvista", "rich", "jaxtyping", "matplotlib")
HEAVY += ("dask", "distributed", "filelock")


def run_alone(program):
    command = [sys.executable, "-c", program]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True)


def test_help_and_usage_errors_import_nothing_heavy():
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
    # a sentence each, not the usage
    sentence = re.compile(r"spinor-geom.*: error: .*--help.*")
    assert [sentence.fullmatch(line) is None for line in done.stderr.splitlines()] == [False] * 10


def test_importing_the_package_imports_nothing_heavy():
    program = f"import sys, spinor_geom; dir(spinor_geom); print([name for name in {HEAVY!r} if name in sys.modules])"
    done = run_alone(program)
    assert done.stdout.strip() == "[]"


def test_public_names_are_defined_in_their_modules_and_not_hidden_by_modules_of_the_same_name():
    for name in spinor_geom.__all__:
        value = getattr(spinor_geom, name)
        assert value.__name__ == name
        assert value is getattr(importlib.import_module(value.__module__), name)
    assert set(spinor_geom.__all__) <= set(dir(spinor_geom))


def test_a_name_that_is_not_public_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'fill_holes'"):
        _ = spinor_geom.fill_holes


def test_warnings_of_libraries_are_not_shown_but_those_of_the_package_are():
    program = (
        "import warnings\n"
        "from spinor_geom.cli import loops, main\n"
        "from spinor_geom.errors import ImperfectFillWarning\n"
        "def run(arguments):\n"
        "    warnings.warn('overflow encountered', RuntimeWarning)\n"
        "    warnings.warn('a hole is open', ImperfectFillWarning)\n"
        "    return 0\n"
        "loops.run = run\n"
        "main.main(['loops', 'mesh.obj'])\n"
        "warnings.warn('after it', RuntimeWarning)\n"
    )
    shown = run_alone(program).stderr
    assert [words in shown for words in ("overflow", "a hole is open", "after it")] == [False, True, True]
