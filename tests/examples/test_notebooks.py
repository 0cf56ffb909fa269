"""The notebooks run from their first cells to their last, and are kept without outputs."""

from __future__ import annotations

import os
from pathlib import Path

import nbformat
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
# pictures, and the page that is written
NOTEBOOKS = {"plateau.ipynb": (3, "family.html"), "fill.ipynb": (0, "report.html")}


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_the_notebook_is_kept_without_outputs(name: str) -> None:
    notebook = nbformat.read(EXAMPLES / name, as_version=4)
    nbformat.validate(notebook)
    assert all(not cell.outputs and cell.execution_count is None for cell in notebook.cells if cell.cell_type == "code")


@pytest.mark.slow  # a kernel that imports everything
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_the_notebook_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from nbclient import NotebookClient

    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("OMP_NUM_THREADS", os.environ.get("OMP_NUM_THREADS", "1"))
    notebook = nbformat.read(EXAMPLES / name, as_version=4)
    NotebookClient(notebook, timeout=240, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert not [output for output in shown if output.output_type == "error"]
    pictures = [output.data["image/png"] for output in shown if "image/png" in output.get("data", {})]
    count, page = NOTEBOOKS[name]
    assert len(pictures) == count
    assert all(len(picture) > 10_000 for picture in pictures)
    assert (tmp_path / page).stat().st_size > 10_000
