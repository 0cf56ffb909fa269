"""Makes the top-level folder adapters/ importable as spinor_geom.adapters, and test runs repeatable."""

import importlib.util
import os
import pathlib
import sys

import hypothesis

# before numpy and torch are imported: workers that each take all cores only wait for one another
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_NUM_THREADS", "1")

# the same examples in every run, and no failure because a machine is busy
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")

root = pathlib.Path(__file__).parent
sys.path.insert(0, str(root))

if importlib.util.find_spec("spinor_geom.adapters") is None:
    spec = importlib.util.spec_from_file_location(
        "spinor_geom.adapters", root / "adapters" / "__init__.py", submodule_search_locations=[str(root / "adapters")]
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
