"""The page on architecture lists the layers of the import contract."""

import re
from pathlib import Path

import pytest

import spinor_geom

tomllib = pytest.importorskip("tomllib", reason="Python 3.10 has none")
ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def layers() -> list[str]:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    return next(contract["layers"] for contract in contracts if contract["name"] == "imports go one way")


def test_the_page_names_all_packages_in_the_order_of_the_contract() -> None:
    table = PAGE.partition("## Layers")[2].partition("\n## ")[0]
    named = [name for row in re.findall(r"^\| (.*?) \|", table, re.MULTILINE) for name in re.findall(r"`(\w+)`", row)]
    packages = [path.name for path in Path(spinor_geom.__file__).parent.iterdir() if (path / "__init__.py").exists()]
    assert set(packages) <= set(named)
    assert [name for name in layers() if name in named] == named
