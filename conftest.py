"""Makes test runs repeatable, and lets processes that tests start find this clone's package."""

import os
import pathlib
import sys
from collections.abc import Iterator
from typing import Any

import hypothesis
import pytest

os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, [str(pathlib.Path(__file__).parent), os.environ.get("PYTHONPATH")])
)

# the package is compiled once, not by each process that tests start
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# before numpy and torch are imported: workers that each take all cores only wait for one another
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_NUM_THREADS", "1")

# the same examples in every run, and no failure because a machine is busy; CI runs twice as many
for name, count in (("repeatable", 10), ("thorough", 20)):
    hypothesis.settings.register_profile(name, derandomize=True, deadline=None, max_examples=count)
hypothesis.settings.load_profile("repeatable")

MAY_BE_MISSING = ("torch", "pymeshlab")  # without wheels for the latest versions of Python; never missing in CI


def _is_missing(error: BaseException | None) -> bool:
    package = getattr(error, "package", None) or getattr(error, "name", None)  # of our errors, and of Python's
    optional = os.environ.get("SPINOR_GEOM_PEERS") != "required" and package in MAY_BE_MISSING
    return isinstance(error, ImportError) and optional


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Iterator[None]:
    """Skips a file of tests that imports a package that may be missing."""
    report: Any = yield
    error = report.call.excinfo and report.call.excinfo.value
    while error is not None and not _is_missing(error):
        error = error.__cause__
    if error is not None:
        report.outcome, report.longrepr = "skipped", (str(collector.path), 0, f"Skipped: {error}")
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Iterator[None]:
    """Skips a test that uses a package that may be missing."""
    try:
        return (yield)
    except ImportError as error:
        if _is_missing(error):
            pytest.skip(str(error))
        raise


pytest_runtest_setup = pytest_runtest_call


@pytest.fixture(scope="session")
def painter() -> Iterator[Any]:
    """A process that draws; to start one takes longer than to draw."""
    from spinor_geom.render.png import Painter

    made = Painter()
    yield made
    made.end()


@pytest.fixture
def drawn_by_one_process(painter: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of a test are drawn by the same process as those of others."""
    from spinor_geom.render import png

    apart = png.draw_apart

    def draw(*job: Any, **options: Any) -> None:
        (apart if "module" in options else painter.run)(*job, **options)  # windows have processes of their own

    monkeypatch.setattr(png, "draw_apart", draw)
