"""Two checkouts timed side by side: cases that are slower in every round are listed, noise is not."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def guard(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return importlib.import_module("guard")


@pytest.mark.parametrize(
    ("head", "is_slower"),
    [((1.1, 2.2, 1.05), True), ((0.9, 2.2, 1.2), False), ((1.0, 2.0, 1.0), False)],
    ids=["always", "twice", "never"],
)
def test_slower_means_slower_in_every_turn(guard, head, is_slower):
    def fill(*seconds):
        answers = iter((9.0, *seconds))  # the first fill is not counted
        return lambda _: next(answers)

    row, slower = guard.measured(["a", "b"], fill(1.0, 2.0, 1.0), fill(*head), 3)
    assert slower is is_slower
    # the median of 1, 2 and 1 seconds for two meshes, in milliseconds
    assert row.startswith("500.0 | ")


@pytest.mark.slow
def test_a_checkout_is_as_fast_as_itself(guard, capsys):
    guard.main([str(ROOT), "--case", "smooth rim of 64 points", "--turns", "5"])
    row = capsys.readouterr().out.splitlines()[2]
    base, head = (float(cell) for cell in row.split("|")[2:4])
    # noise of single measurements is below 50 % even under load
    assert 0.5 < head / base < 2
