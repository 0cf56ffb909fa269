"""Malformed files give the right mesh or a typed error that names the place in the file, in bounded memory and time."""

import json
import subprocess
import sys

import pytest

from tests.adapters.malformed import CASES

SECONDS = 20.0  # for each file, on a busy machine. All take less than one on an idle one


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """The result of each file; one process with limited memory reads them one after the other."""
    folder = tmp_path_factory.mktemp("malformed")
    command = [sys.executable, "-W", "error", "-m", "tests.adapters.malformed", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return {entry.pop("name"): entry for entry in map(json.loads, done.stdout.splitlines())}


@pytest.mark.parametrize("name", CASES)
def test_a_malformed_file_is_read_right_or_refused(outcomes, name):
    wanted, outcome = CASES[name][1], outcomes[name]
    if isinstance(wanted, tuple):
        assert outcome.get("read") == list(wanted), outcome
    assert "raw" not in outcome
    if isinstance(wanted, str):
        assert wanted in outcome.get("error", ""), outcome
        assert name in outcome["error"]
        assert len(outcome["error"]) < 1000
    assert outcome["seconds"] < SECONDS


def test_changed_files_are_read_or_refused():
    command = [sys.executable, "-W", "error", "-m", "tests.adapters.fuzz"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
