"""Makes test runs repeatable, and lets processes that tests start find this clone's package."""

import os
import pathlib

import hypothesis

os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, [str(pathlib.Path(__file__).parent), os.environ.get("PYTHONPATH")])
)

# before numpy and torch are imported: workers that each take all cores only wait for one another
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_NUM_THREADS", "1")

# the same examples in every run, so that more of them find no more, and no failure because a machine is busy
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=30)
hypothesis.settings.load_profile("repeatable")
