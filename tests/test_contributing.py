"""The statements of CONTRIBUTING.md and CITATION.cff are correct."""

from __future__ import annotations

import re
from pathlib import Path

import yaml

from spinor_geom.version import RELEASE

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_files_that_are_named_exist() -> None:
    named = re.findall(r"`([\w./-]+/[\w./-]*|\w+\.(?:toml|md|yml|txt))`", TEXT)
    assert len(named) > 20
    for name in named:
        assert (ROOT / name).exists(), name


def test_the_commands_are_those_of_ci() -> None:
    run = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    _, needed = re.findall(r"^```sh\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
    for command in re.split(r" && |\n", needed.strip()):
        assert command.replace("format .", "format --check .") in run + readme, command


def test_hooks_are_what_ci_runs() -> None:
    (repository,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    assert [hook["entry"] for hook in repository["hooks"]] == ["ruff format", "ruff check --fix"]


def test_workflows_run_the_checks_and_build_the_wheels_that_are_configured_here() -> None:
    workflows = {
        path.stem: yaml.safe_load(path.read_text(encoding="utf-8")) for path in ROOT.glob(".github/workflows/*")
    }
    assert set(workflows) == {"checks", "wheels"}
    for name, command in (("checks", "bash .ci/run"), ("wheels", "cibuildwheel")):
        steps = workflows[name]["jobs"][name]["steps"]
        assert any(command in step.get("run", "") for step in steps)
        # the version names the commit after the last tag
        assert steps[0]["with"]["fetch-depth"] == 0


def test_the_citation_names_program_and_paper_and_the_next_release() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["version"] == RELEASE
    paper = citation["preferred-citation"]
    assert [author["family-names"] for author in paper["authors"]] == ["Sun", "Chern"]
    for page in ("plateau.md", "spinors.md"):
        assert f"*{paper['title']}* ({paper['year']})" in (ROOT / "docs" / page).read_text(encoding="utf-8")
