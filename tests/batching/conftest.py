"""Worker processes for the tests of batches: they find the package, and files with certain names make them fail."""

import os

import pytest

# In the process that solves, the harm that a file's name announces is done when it is opened.
HARM = """
import ctypes, os, sys

def hook(event, arguments):
    if event != "open" or not isinstance(arguments[0], str):
        return
    name = os.path.basename(arguments[0])
    if name == "crash.obj":
        ctypes.string_at(0)
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
def harmful_site(tmp_path_factory):
    """The value of PYTHONPATH for the worker processes."""
    folder = tmp_path_factory.mktemp("harm")
    (folder / "sitecustomize.py").write_text(HARM)
    return os.pathsep.join([str(folder), os.environ["PYTHONPATH"]])


@pytest.fixture(scope="module")
def _found(harmful_site):
    """Processes find the package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", harmful_site)
        patch.setenv("OMP_NUM_THREADS", "1")
        yield
