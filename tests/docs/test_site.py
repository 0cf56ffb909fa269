"""The site builds without a warning, and each of its pages and pictures opens in a browser."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.browser import browser, visit

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a built site."""
    folder = tmp_path_factory.mktemp("pages")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-d", folder]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture
def pictures(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script that draws the pictures."""
    monkeypatch.syspath_prepend(str(DOCS))
    return importlib.import_module("pictures")


@pytest.mark.slow
def test_every_page_and_every_picture_opens_in_a_browser(pages: Path) -> None:
    names = sorted(str(path.relative_to(pages)) for path in pages.rglob("*.html") if path.name != "404.html")
    assert len(names) == len(list(DOCS.glob("*.md")))
    index = json.loads((pages / "search" / "search_index.json").read_text(encoding="utf-8"))
    little = {**index, "docs": index["docs"][:1]}
    with browser() as chromium:
        context = chromium.new_context()
        # otherwise each page builds the search index of the whole site; the next test searches it
        context.route("**/search_index.js", lambda route: route.fulfill(body=f"var __index = {json.dumps(little)}"))
        for name in names:
            with visit(context, (pages / name).as_uri()) as opened:
                page = opened.page
                assert page.locator("h1").count() == 1, name
                images = page.locator("article img")
                decoded = "image => image.decode().then(() => image.naturalWidth)"
                sizes = [images.nth(k).evaluate(decoded) for k in range(images.count())]
                assert all(size > 0 for size in sizes), name
                assert "\\(" not in page.locator("article").inner_text(), name
                assert not opened.errors, (name, opened.errors)
                assert not opened.foreign, (name, opened.foreign)
                if name == "spinors.html":
                    assert page.locator("math[display=block]").first.bounding_box()["height"] > 10


@pytest.mark.slow
def test_search_finds_pages_that_are_opened_from_a_folder(pages: Path) -> None:
    with browser() as chromium, visit(chromium, (pages / "index.html").as_uri()) as opened:
        opened.page.locator("input[name=query]").fill("catenoid")
        opened.page.locator(".md-search-result__link").first.wait_for(state="attached", timeout=60_000)
        assert not opened.errors
        assert not opened.foreign


def test_all_pictures_are_shown_and_small(pictures: ModuleType) -> None:
    shown = {DOCS / name for page in DOCS.glob("*.md") for name in pictures.pictures_of(page)}
    assert shown == set((DOCS / "pictures").iterdir())
    assert max(path.stat().st_size for path in shown) < 150_000
