"""Every command and code block of the README runs."""

import re
import shlex
import shutil
from pathlib import Path

import pytest
from sybil import Sybil
from sybil.parsers.markdown import PythonCodeBlockParser

from spinor_geom.adapters import read_mesh
from spinor_geom.cli.main import main
from spinor_geom.fill.loop_choice import boundary_loops
from tests.docs.test_pages import not_measured, require_printed
from tests.likeness import SAME, difference

pytestmark = pytest.mark.usefixtures("drawn_by_one_process")
ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
MESH = "data/trimesh_reference.obj"


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A working directory with the data of a clone."""
    shutil.copytree(ROOT / "data", tmp_path / "data")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def shell_commands():
    """Every command of the README's shell blocks, in order."""
    blocks = re.findall(r"^```sh\n(.*?)^```$", README.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [shlex.split(part) for block in blocks for part in block.replace("\\\n", " ").split("&&")]


@pytest.mark.slow
def test_the_first_command_leaves_mesh_report_and_picture(clone):
    (fill,) = (command for command in shell_commands() if command[0] == "spinor-geom")
    assert main(fill[1:]) == 0
    left = {path.name: path.stat().st_size for path in (clone / "out").iterdir()}
    assert set(left) == {"filled.obj", "report.json", "picture.png"}
    assert all(size > 0 for size in left.values())
    assert boundary_loops(clone / "out" / "filled.obj") == []


@pytest.mark.slow
def test_the_picture_is_that_of_the_program(clone, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import pictures

    drawn = pictures.continuation_picture(clone)
    drawn.save(clone / "drawn.png")
    assert difference(clone / "drawn.png", ROOT / "docs" / "continuation.png") < SAME


@pytest.mark.slow
def test_commands_in_the_text_run(clone, monkeypatch):
    inline = re.findall(r"`spinor-geom ([^`]+)`", " ".join(README.read_text(encoding="utf-8").split()))
    (clone / "scans").mkdir()
    shutil.copy(ROOT / "data" / "squiggle_on_sphere.obj", clone / "scans" / "curve.obj")
    # no window, and nothing that takes minutes
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("spinor_geom.cli.pictures.draw_apart", lambda *_, **__: None)
    monkeypatch.setattr("spinor_geom.bench.runner.run_isolated", not_measured)
    monkeypatch.setattr("spinor_geom.experiments.experiment.reproduce", lambda *_, **__: ())
    ran = [words[0] for words in map(shlex.split, inline) if main([w.replace("MESH", MESH) for w in words]) in (0, 1)]
    assert {"loops", "view", "render", "bench", "morph", "batch", "reproduce"} <= set(ran)
    for name in ("mesh.png", "catenoid.html", "scans/summary.html", "bench/report.html"):
        assert (clone / "out" / name).stat().st_size > 0


def test_python_blocks_run_one_after_the_other(clone, capsys):
    (clone / "out").mkdir()
    document = Sybil(parsers=[PythonCodeBlockParser()]).parse(README)
    document.namespace["__name__"] = "__main__"  # as in a script
    examples = list(document.examples())
    assert len(examples) >= 2
    for example in examples:
        example.evaluate()
    require_printed(README, capsys.readouterr().out)
    assert read_mesh(clone / "out" / "filled.ply").path is not None


def test_files_that_the_readme_names_exist():
    text = README.read_text(encoding="utf-8")
    for name in [*re.findall(r"\b(?:data|benchmarks|docs)/[\w./-]+\w", text), "constraints-cpu.txt", "LICENSE"]:
        assert (ROOT / name).exists(), name
