"""A real browser for the tests of pages and pictures: Chromium, through playwright.

Without a browser a test is skipped with a reason; with SPINOR_GEOM_BROWSER=required it fails instead.
"""

from __future__ import annotations

import os
import shutil
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome")
# WebGL without a graphics card
_ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_LOCAL = ("file:", "data:", "blob:", "about:", "http://127.0.0.1:")


@dataclass(frozen=True, kw_only=True, eq=False)
class Visit:
    """A page that a browser has open.

    Attributes:
        page: playwright's page.
        errors: the errors of the page: exceptions, console errors, requests that failed.
        foreign: requested addresses outside this machine. The requests are not answered.
    """

    page: Any
    errors: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)


@contextmanager
def browser():
    """A headless browser that can draw WebGL.

    Yields:
        playwright's browser.
    """
    executable = next(filter(None, map(shutil.which, _NAMES)), None)
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        executable = None
    if executable is None:
        message = f"no browser: install playwright and one of {', '.join(_NAMES)}"
        if os.environ.get("SPINOR_GEOM_BROWSER") == "required":
            pytest.fail(message)
        pytest.skip(message)
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=executable, args=_ARGUMENTS)
        try:
            yield chromium
        finally:
            chromium.close()


@contextmanager
def visit(browser, address, *, ready=False):
    """Opens an address, records the errors and requests of the page, and blocks the network.

    Args:
        browser: from `browser`, or a context of it.
        address: a URL, of a file as well.
        ready: waits until the page's views say that they stand, by the page's title.

    Yields:
        The open page.
    """
    page = browser.new_page()
    page.set_viewport_size({"width": 1280, "height": 900})
    opened = Visit(page=page)

    def answer(route):
        if route.request.url.startswith(_LOCAL):
            route.fallback()
        else:
            opened.foreign.append(route.request.url)
            route.abort()

    page.route("**/*", answer)
    page.on("pageerror", lambda error: opened.errors.append(str(error)))
    page.on("console", lambda message: opened.errors.append(message.text) if message.type == "error" else None)
    page.on("requestfailed", lambda request: opened.errors.append(f"{request.url}: {request.failure}"))
    try:
        page.goto(address, wait_until="load")
        if ready:
            page.wait_for_function("document.title.startsWith('ready: ')", timeout=60_000)
        yield opened
    finally:
        page.close()
