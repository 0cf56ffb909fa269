"""The package as the benchmark's own processes find it: in a clone adapters/ lies beside it."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def importable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Puts a folder first on the path in which spinor_geom has its adapters."""
    package = tmp_path / "path" / "spinor_geom"
    package.mkdir(parents=True)
    for part in (ROOT / "spinor_geom").iterdir():
        (package / part.name).symlink_to(part)
    (package / "adapters").symlink_to(ROOT / "adapters")
    (package.parent / "sick.py").write_text((Path(__file__).parent / "sick.py").read_text(encoding="utf-8"))
    monkeypatch.syspath_prepend(str(package.parent))
