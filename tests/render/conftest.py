"""A browser for all tests of pages; to start one takes longer than to look at a page."""

import pytest

from tests.browser import browser


@pytest.fixture(scope="package")
def chromium():
    with browser() as started:
        yield started
