"""Marks for tests that not every system can run, each with its reason, and for long lists of parameters."""

import os
import sys

import pytest

signals = pytest.mark.skipif(os.name == "nt", reason="signals, sessions and limits are POSIX's")
modes = pytest.mark.skipif(os.name == "nt", reason="access modes, pipes with names and the shell are POSIX's")
links = pytest.mark.skipif(os.name == "nt", reason="on Windows not every user may make links")
undecodable = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="names of files are text on Windows and macOS"
)


def every_second(values):
    """Parameters of a test with many similar ones. Every second one is marked slow."""
    return [pytest.param(value, marks=pytest.mark.slow if k % 2 else ()) for k, value in enumerate(values)]


class OnUse:
    """A package that takes a second to import, and so is imported on use. Where it is missing its tests are skipped."""

    def __init__(self, name):
        self._name = name

    def __getattr__(self, attribute):
        if attribute.startswith("_"):  # pytest looks for its own
            raise AttributeError(attribute)
        return getattr(pytest.importorskip(self._name), attribute)
