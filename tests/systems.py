"""Marks of tests that not every system can run, each with its reason."""

import os
import sys

import pytest

signals = pytest.mark.skipif(os.name == "nt", reason="signals, sessions and limits are POSIX's")
modes = pytest.mark.skipif(os.name == "nt", reason="access modes, pipes with names and the shell are POSIX's")
links = pytest.mark.skipif(os.name == "nt", reason="on Windows not every user may make links")
undecodable = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="names of files are text on Windows and macOS"
)
