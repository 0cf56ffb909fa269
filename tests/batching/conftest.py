"""Processes of their own for batches: they find the package, and files whose names say so do harm to them."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# In the process that solves, the harm that a file's name announces is done when it is opened.
HARM = """
import ctypes, os, sys, time

def hook(event, arguments):
    if event != "open" or not isinstance(arguments[0], str):
        return
    name = os.path.basename(arguments[0])
    if name == "crash.obj":
        ctypes.string_at(0)
    elif name == "hang.obj":
        time.sleep(1000)
    elif name == "hog.obj":
        taken = []
        while True:
            taken.append(bytearray(b"x") * (1 << 26))
            time.sleep(0.02)
    elif name == "killed.obj":
        # once only
        flag = arguments[0] + ".tried"
        if not os.path.exists(flag):
            os.close(os.open(flag, os.O_CREAT))
            os.kill(os.getpid(), 9)

if "spinor_geom.batching.solver" in sys.orig_argv:
    sys.addaudithook(hook)
"""


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for PYTHONPATH: the package with its adapters in their place, and the harm."""
    folder = tmp_path_factory.mktemp("site")
    package = folder / "spinor_geom"
    package.mkdir()
    for entry in (ROOT / "spinor_geom").iterdir():
        (package / entry.name).symlink_to(entry)
    (package / "adapters").symlink_to(ROOT / "adapters")
    (folder / "sitecustomize.py").write_text(HARM)
    return folder
