"""The time that starting the program takes: new processes, without torch."""

import pytest

from spinor_geom.bench.starts import STARTS, imports_by_package, start_figures


def test_imports_are_summed_by_package() -> None:
    report = (
        "import time: self [us] | cumulative | imported package\n"
        "import time:       250 |        250 |     scipy.sparse\n"
        "import time:      1000 |       1250 |   scipy\n"
        "import time:        20 |         20 | zipimport\n"
        "a line of the program\n"
    )
    assert imports_by_package(report) == {"scipy": 1250, "zipimport": 20}


@pytest.mark.parametrize("name", ["help", pytest.param("fill of a small mesh", marks=pytest.mark.slow)])
def test_a_start_takes_time_and_memory_and_no_torch(name, tmp_path) -> None:
    figures = start_figures(name, tmp_path, 0)
    assert figures["torch"] is False
    assert 0 < figures["seconds"] < 60
    assert 5 < figures["memory_mib"] < 1000
    assert "spinor_geom" in figures["message"]
    assert (tmp_path / "filled.obj").exists() is (name != "help")
    assert name in STARTS
