"""Every code block of the documentation runs: Python, and the commands of shell blocks.

Pictures are drawn where the site is built (`test_site.py`), and are left out here.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path
from typing import Any

import pytest
from sybil import Sybil
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser

import spinor_geom
from spinor_geom.cli.main import build_parser, main
from spinor_geom.render.portrait import Portrait

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
# scripts, whose workers import them: they run as such
SCRIPTS = ("batch.md", "slurm.md")
SLOW = ("gallery.md", "plateau.md")
PAGES = [
    pytest.param(page.name, marks=pytest.mark.slow if page.name in SLOW else ())
    for page in sorted(DOCS.glob("*.md"))
    if page.name not in SCRIPTS
]
STUBS = {
    "dask_jobqueue.py": "SLURMCluster",
    "dask_kubernetes/operator.py": "KubeCluster",
}
# in the place of a queue's cluster: a worker on this machine, whatever is asked for
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
    """A folder with what the pages' code finds in a clone, and files for the inputs that they name."""
    (tmp_path / "data").symlink_to(ROOT / "data")
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
    """Runs the commands of a block; those of installation, batches and benchmarks are only parsed."""
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for line in block.parsed.splitlines():
        words = shlex.split(line, comments=True)
        if "pip" in words:
            for extra in filter(None, ",".join(re.findall(r"\[([\w,]+)\]", line)).split(",")):
                assert re.search(rf"^{extra} = \[", project, re.MULTILINE), line
            continue
        assert words[0] == "spinor-geom", line
        if words[1] in ("batch", "bench"):
            build_parser().parse_args(words[1:])
        elif main(words[1:]) not in (0, 1):
            raise AssertionError(line)


@pytest.mark.parametrize("name", PAGES)
def test_the_blocks_of_a_page_run_one_after_the_other(name: str, clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = []
    monkeypatch.setattr(Portrait, "write", lambda self, path, **options: drawn.append(path))
    document = Sybil(parsers=[PythonCodeBlockParser(), CodeBlockParser(language="sh", evaluator=run_shell)]).parse(
        DOCS / name
    )
    document.namespace["__name__"] = "__main__"
    for example in document.examples():
        example.evaluate()
    shown = re.findall(r"\]\((pictures/[\w.-]+)\)", (DOCS / name).read_text(encoding="utf-8"))
    assert set(shown) == {*drawn, *(f"pictures/{path.name}" for path in (clone / "pictures").iterdir())}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "number"), [("batch.md", 0), ("batch.md", 1), ("batch.md", 2), ("slurm.md", 0)])
def test_scripts_run_on_a_cluster_of_this_machine(name: str, number: int, clone: Path) -> None:
    document = Sybil(parsers=[PythonCodeBlockParser()]).parse(DOCS / name)
    (clone / "script.py").write_text(list(document.examples())[number].parsed)
    for path, cluster in STUBS.items():
        stub = clone / "stubs" / path
        stub.parent.mkdir(parents=True, exist_ok=True)
        stub.write_text(STUB.format(name=cluster))
    environment = {**os.environ, "PYTHONPATH": f"{os.environ['PYTHONPATH']}:{clone / 'stubs'}", "OMP_NUM_THREADS": "1"}
    subprocess.run([sys.executable, "script.py"], check=True, cwd=clone, env=environment, timeout=240)
    tables = list(clone.glob("*/loops.csv"))
    assert len(tables) == 1
    assert "done" in tables[0].read_text(encoding="utf-8")


def test_every_script_has_its_run() -> None:
    blocks = {
        name: len(list(Sybil(parsers=[PythonCodeBlockParser()]).parse(DOCS / name).examples())) for name in SCRIPTS
    }
    assert blocks == {"batch.md": 3, "slurm.md": 1}


@pytest.mark.parametrize("name", SCRIPTS)
def test_the_commands_of_scripts_are_commands(name: str) -> None:
    for block in re.findall(r"^```sh\n(.*?)^```$", (DOCS / name).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
        for line in block.splitlines():
            build_parser().parse_args(shlex.split(line)[1:])


def test_the_reference_has_every_public_name() -> None:
    listed = re.findall(r"^::: \S+\.(\w+)$", (DOCS / "reference.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert set(spinor_geom.__all__) <= set(listed)


def test_the_gallery_has_twelve_surfaces_each_with_its_code_and_its_picture() -> None:
    sections = re.split(r"^## ", (DOCS / "gallery.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    assert len(sections) == 12
    for section in sections:
        (picture,) = re.findall(r"\]\((pictures/[\w.-]+)\)", section)
        (code,) = re.findall(r"^```python\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)
        assert f'"{picture}"' in code


def test_no_page_asks_for_anything_from_elsewhere() -> None:
    for page in DOCS.glob("*.md"):
        assert not re.search(r"!\[[^\]]*\]\(https?:", page.read_text(encoding="utf-8")), page
