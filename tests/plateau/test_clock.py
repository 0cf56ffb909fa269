"""Stages of a solve: their times add up to the total, also for nested stages."""

from __future__ import annotations

import pytest

from spinor_geom.plateau import steps
from spinor_geom.plateau.steps import Clock


def test_a_stage_counts_without_the_stages_inside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(steps.time, "perf_counter", lambda: now[0])
    timed = Clock()

    def work(stage: str, seconds: float) -> None:
        with timed.stage(stage):
            now[0] += seconds

    with timed.stage("leaving"):
        now[0] += 1.0
        work("fit", 4.0)
        work("surface", 2.0)
        work("fit", 8.0)
        now[0] += 16.0
    with pytest.raises(TypeError), timed.stage("fails"):
        now[0] += None
    assert timed.seconds == {"leaving": 17.0, "fit": 12.0, "surface": 2.0, "fails": 0.0}
