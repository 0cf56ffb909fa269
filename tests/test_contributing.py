"""The statements of CONTRIBUTING.md and CITATION.cff are correct."""

from __future__ import annotations

import re
from pathlib import Path

import yaml

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


def test_the_citation_names_program_and_paper_and_leaves_the_version_to_the_package() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert "version" not in citation
    paper = citation["preferred-citation"]
    assert [author["family-names"] for author in paper["authors"]] == ["Sun", "Chern"]
    for page in ("plateau.md", "spinors.md"):
        assert f"*{paper['title']}* ({paper['year']})" in (ROOT / "docs" / page).read_text(encoding="utf-8")
