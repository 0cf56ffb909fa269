"""Tasks in separate processes: their crashes, hangs and output do not affect the benchmark."""

import os

import numpy as np
import pytest

from spinor_geom.bench.runner import run_isolated
from spinor_geom.bench.tasks import forget_peak_memory, peak_memory

pytestmark = pytest.mark.usefixtures("importable")


def answers(*tasks, time_limit=60.0):
    found = []
    run_isolated(tasks, module="sick", time_limit=time_limit, on_record=lambda task, record: found.append(record))
    return found


def test_a_crash_is_one_task_s_and_what_is_written_spoils_no_answer():
    spoken, crashed, silent = answers({"say": "to the descriptor"}, {"exit": 3}, {})
    assert spoken["status"] == silent["status"] == "done"
    assert spoken["process"] != silent["process"]
    assert (crashed["status"], crashed["reason"]) == ("crashed", "its process died with status 3")
    assert all(text in spoken["output"] for text in ("to the descriptor", "and printed"))
    assert "output" not in silent


@pytest.mark.skipif(not os.path.exists("/proc/self/clear_refs"), reason="only Linux forgets a peak")
def test_the_peak_of_the_memory_is_that_of_the_task():
    forget_peak_memory()
    before = peak_memory()
    block = np.ones(1 << 24)  # 128 MiB
    high = peak_memory()
    del block
    forget_peak_memory()
    assert high > before + 100
    assert peak_memory() < high - 100
