"""Pictures and pages of the meshes of a batch."""

import html
import os
import re
import shutil
from urllib.parse import unquote

import numpy as np
import pytest

from spinor_geom import batch
from spinor_geom.adapters.mesh_files import write_triangles
from spinor_geom.batching.pictures import PAGE, PICTURE, PROGRAM, SIZE
from spinor_geom.errors import MissingPackageError
from tests.batching.files import circle, curve_text, holed_text, packed_zip, record, results
from tests.browser import browser, visit
from tests.fill.shapes import tube

pytestmark = pytest.mark.usefixtures("_found")
ODD = "x 'q' & <b>#?%é.obj"


@pytest.fixture(scope="module")
def corpus(tmp_path_factory):
    """Odd names, equal names, an archive, a broken file, a curve, a closed mesh and unused vertices that are NaN."""
    folder = tmp_path_factory.mktemp("corpus") / "in"
    for name in (ODD, "roof.obj", "sub/roof.obj"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(holed_text())
    text = holed_text().replace("g south", "v nan nan nan\ng south").replace("-3 -2 -1", "3 4 5")
    (folder / "nan.obj").write_text(text)
    (folder / "far.obj").write_text(re.sub(r"^v 1 ", "v 1e7 ", holed_text(), flags=re.MULTILINE))
    (folder / "closed.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    (folder / "curve.obj").write_text(curve_text(circle(12)))
    (folder / "broken.obj").write_bytes(b"\x7fELF\0")
    write_triangles(*tube(16, 3), folder / "tube.stl")
    with pytest.warns(UserWarning, match="Duplicate name"):
        packed_zip(folder / "a.zip", [("m.obj", holed_text().encode())] * 2)
    return folder


@pytest.fixture(scope="module")
def drawn(corpus, tmp_path_factory):
    return batch(corpus, tmp_path_factory.mktemp("drawn") / "out", pictures=True, workers=1)


def test_each_filled_mesh_has_a_picture_that_links_to_its_page(drawn):
    from PIL import Image

    text = drawn.page.read_text(encoding="utf-8")
    links = re.findall(r'<a href="([^"]*)"><img src="([^"]*)"', text)
    filled = sorted(path.parent for path in drawn.output.rglob("filled.*"))
    assert len(filled) == 9
    assert sorted(drawn.output / unquote(page) for page, _ in links) == [folder / PAGE for folder in filled]
    for _, source in links:
        with Image.open(drawn.output / unquote(source)) as image:
            assert image.size == SIZE
            assert np.asarray(image.convert("RGB")).std() > 10
    assert len(re.findall("<figure><figcaption>in/broken.obj", text)) == 2  # of the failures, and of all meshes
    assert record(drawn.output, "in/curve.obj")["page"] is None
    assert max(path.stat().st_size for path in drawn.output.rglob(PAGE)) < 50_000


@pytest.mark.slow
def test_pages_of_meshes_open_from_that_of_the_batch(drawn):
    with browser() as chromium, visit(chromium, drawn.page.as_uri()) as opened:
        links = opened.page.locator(".loops a").evaluate_all("(all) => all.map((one) => one.href)")
        opened.page.evaluate("for (const one of document.images) one.loading = 'eager'")
        opened.page.wait_for_function("[...document.images].every((one) => one.naturalWidth)")
        for link in links[::4]:
            opened.page.goto(link)
            opened.page.wait_for_function("document.title.startsWith('ready')")
        assert opened.errors == []
        assert len(links) == 9


@pytest.mark.slow
def test_a_resumed_batch_draws_only_what_is_missing(drawn, corpus, tmp_path):
    output = tmp_path / "out"
    shutil.copytree(drawn.output, output)
    lost = [output / "files" / "in" / "roof.obj" / PICTURE, output / "files" / "in" / "tube.stl" / PAGE]
    written = {path: path.stat().st_mtime_ns for path in output.rglob(PICTURE)}
    for path in lost:
        path.unlink()
    again = batch(corpus, output, pictures=True, resume=True, workers=1)
    assert all(path.is_file() for path in lost)
    folders = {path.parent for path in lost}
    changed = {path for path, time in written.items() if path.stat().st_mtime_ns != time}
    assert changed == {folder / PICTURE for folder in folders}
    assert (results(output).keys(), again.progress.files) == (results(drawn.output).keys(), drawn.progress.files)
    assert (output / PROGRAM).read_bytes() == (drawn.output / PROGRAM).read_bytes()


def test_what_cannot_be_drawn_has_a_page(corpus, tmp_path, monkeypatch):
    block = "import sys\nif 'spinor_geom.render.png' in sys.orig_argv: sys.modules['pyvista'] = None\n"
    (tmp_path / "sitecustomize.py").write_text(block)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]]))
    done = batch(corpus / "roof.obj", tmp_path / "out", pictures=True, workers=1)
    assert done.complete
    found = record(done.output, "roof.obj")
    assert (found["picture"], found["page"], found["filled"]) == (None, PAGE, "filled.obj")
    (note,) = found["notes"]
    assert note.startswith("no picture was drawn: ")
    text = done.page.read_text()
    assert note in html.unescape(text)
    assert re.search(r'<a href="files/roof.obj/page.html"><svg', text)


def test_the_extra_is_asked_for_first(corpus, tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "pyvista" else object())
    with pytest.raises(MissingPackageError, match="render"):
        batch(corpus, tmp_path / "out", pictures=True)
    assert not (tmp_path / "out").exists()
