"""Every Python block and every command of the documentation runs, and draws the pictures that the pages show."""

from __future__ import annotations

import importlib
import inspect
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tarfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest
from sybil import Sybil
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser

import spinor_geom
from spinor_geom.bench.machine import Record, Task
from spinor_geom.cli.main import main
from tests.likeness import SAME, difference

pytestmark = pytest.mark.usefixtures("drawn_by_one_process")
ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
# its Python blocks are scripts, as their workers import them
SCRIPTS = "batch.md"
# without drawings and what other tests run as well: the README, the commands, the benchmark
QUICK = ("architecture.md", "blender.md", "choosing.md", "how-it-works.md", "limits.md")
PAGES = [
    pytest.param(page.name, marks=() if page.name in QUICK else pytest.mark.slow) for page in sorted(DOCS.glob("*.md"))
]
PACKAGES = {"blender.md": ["bpy"], "cad.md": ["build123d", "compas"]}  # without wheels on some systems
STUBS = {"dask_jobqueue.py": "SLURMCluster", "dask_kubernetes/operator.py": "KubeCluster"}
# commands of the job script, with one worker on this machine
COMMANDS = {"srun": 'exec "$@"', "spinor-geom": f'exec {sys.executable} -m spinor_geom.cli.main "$@"'}
# replaces the cluster of a queue by one worker on this machine
STUB = """from distributed import LocalCluster

class {name}(LocalCluster):
    def __init__(self, **options):
        assert options
        super().__init__(n_workers=1, threads_per_worker=1, dashboard_address=None)

    def adapt(self, maximum_jobs):
        assert maximum_jobs > 0
"""


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with the data of a clone and the inputs that the pages name."""
    shutil.copytree(ROOT / "data", tmp_path / "data")
    for name in ("pictures", "out", "scans", "frames"):
        (tmp_path / name).mkdir()
    curve = ROOT / "data" / "squiggle_on_sphere.obj"
    shutil.copy(curve, tmp_path / "scans" / "one.obj")
    shutil.copy(curve, tmp_path / "frames" / "two.obj")
    with tarfile.open(tmp_path / "more.tar.gz", "w:gz") as archive:
        archive.add(curve, "three.obj")
    (tmp_path / "list.csv").write_text("path\nscans/one.obj\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_shell(block: Any) -> None:
    """Runs the commands or the script of a block; extras to be installed must exist."""
    if block.parsed.startswith("#!"):
        if os.name == "nt":
            pytest.skip("a job's script is for a shell of POSIX")
        run_job(block.parsed)
        return
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for line in block.parsed.splitlines():
        words = shlex.split(line, comments=True)
        if "pip" in words:
            extras = re.search(r" '\.\[([\w,]+)\]'", line)
            assert extras, line
            for extra in extras[1].split(","):
                assert re.search(rf"^{extra} = \[", project, re.MULTILINE), line
            continue
        assert words[0] == "spinor-geom", line
        assert main(words[1:]) in (0, 1), line


def run_job(script: str) -> None:
    for name, command in COMMANDS.items():
        stub = Path("bin", name)
        stub.parent.mkdir(exist_ok=True)
        stub.write_text(f"#!/bin/sh\n{command}\n")
        stub.chmod(0o755)
    assert script.count("--nworkers 16") == 1
    path = os.pathsep.join([str(stub.parent.absolute()), str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, "SLURM_JOB_ID": "1", "OMP_NUM_THREADS": "1"}
    command = ["bash", "-euc", script.replace("--nworkers 16", "--nworkers 1")]
    # a queue stops the processes that a job leaves
    with subprocess.Popen(command, env=environment, start_new_session=True) as job:
        try:
            assert job.wait(timeout=240) == 0
        finally:
            os.killpg(job.pid, signal.SIGKILL)


def not_measured(tasks: Iterable[Task], *, on_record: Callable[[Task, Record], None], **_: object) -> None:
    """Replaces minutes of measuring: every task of a benchmark times out."""
    for task in tasks:
        on_record(task, {"status": "timed out", "reason": "not measured"})


def require_printed(page: Path, output: str) -> None:
    """Checks that the numbers in the comments of print calls are in the output."""
    for comment in re.findall(r"^ *print\(.*\)  # ([^:\n]*)", page.read_text(encoding="utf-8"), re.MULTILINE):
        for number in re.findall(r"\d[\d.]*", comment):
            assert number in output, (number, comment)


@pytest.mark.parametrize("name", PAGES)
def test_the_blocks_of_a_page_run_in_order(
    name: str, clone: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for package in PACKAGES.get(name, []):
        pytest.importorskip(package)
    monkeypatch.setattr("spinor_geom.bench.runner.run_isolated", not_measured)
    shell = CodeBlockParser(language="sh", evaluator=run_shell)
    document = Sybil(parsers=[shell] if name == SCRIPTS else [PythonCodeBlockParser(), shell]).parse(DOCS / name)
    document.namespace["__name__"] = "__main__"
    for example in document.examples():
        example.evaluate()
    require_printed(DOCS / name, capsys.readouterr().out)
    shown = re.findall(r"\]\((pictures/[\w.-]+)\)", (DOCS / name).read_text(encoding="utf-8"))
    assert set(shown) == {f"pictures/{path.name}" for path in (clone / "pictures").iterdir()}
    assert all(difference(clone / name, DOCS / name) < SAME for name in shown)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(3))
def test_scripts_run_on_a_cluster_of_this_machine(number: int, clone: Path) -> None:
    scripts = list(Sybil(parsers=[PythonCodeBlockParser()]).parse(DOCS / SCRIPTS).examples())
    assert len(scripts) == 3
    (clone / "script.py").write_text(scripts[number].parsed)
    for path, cluster in STUBS.items():
        stub = clone / "stubs" / path
        stub.parent.mkdir(parents=True, exist_ok=True)
        stub.write_text(STUB.format(name=cluster))
    environment = {
        **os.environ,
        "PYTHONPATH": f"{os.environ['PYTHONPATH']}{os.pathsep}{clone / 'stubs'}",
        "OMP_NUM_THREADS": "1",
    }
    subprocess.run([sys.executable, "script.py"], check=True, cwd=clone, env=environment, timeout=240)
    tables = list(clone.glob("*/loops.csv"))
    assert len(tables) == 1
    assert "done" in tables[0].read_text(encoding="utf-8")


@pytest.mark.parametrize("page", [ROOT / "README.md", *sorted(DOCS.glob("*.md"))], ids=lambda page: page.name)
def test_commands_and_extras_named_in_the_text_exist(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert "spinor-geom[" not in text  # not released: it is installed from a clone
    for extra in ",".join(re.findall(r"'\.\[([\w,]+)\]'", text)).split(","):
        assert not extra or re.search(rf"^{extra} = \[", project, re.MULTILINE), extra
    for words in map(shlex.split, re.findall(r"`spinor-geom ([^`]+)`", text)):
        with pytest.raises(SystemExit, match="0"):
            main([words[0], "--help"])
        shown = capsys.readouterr().out
        for option in (word for word in words if word.startswith("-")):
            assert re.search(rf"(?<!\S){option}\b", shown), (words, option)


def test_the_reference_has_every_public_name_with_its_description() -> None:
    text = (DOCS / "reference.md").read_text(encoding="utf-8")
    listed = re.findall(r"^### \[(\w+)\]\(\.\./([\w/]+)\.py\)\n\n(.+)$", text, re.MULTILINE)
    assert set(spinor_geom.__all__) <= {name for name, _, _ in listed}
    assert len(listed) == text.count("\n### ")
    for name, place, description in listed:
        documented = inspect.getdoc(getattr(importlib.import_module(place.replace("/", ".")), name))
        assert documented is not None
        assert " ".join(documented.split("\n\n")[0].split()) == description, name
