"""Pages with scenes to rotate: complete, with the data of their meshes."""

import base64
import itertools
import json
import re
import zlib

import numpy as np
import pytest

from spinor_geom.render.page import Views, document
from spinor_geom.render.scene import Faces, Scene
from tests.browser import visit

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]])
FACES = np.array([[0, 1, 2]])
TRIANGLE = Faces(vertices=VERTICES, faces=FACES, edges=True)


def data_of(text):
    (data,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', text)
    return json.loads(zlib.decompress(base64.b64decode(data)))


def array(text, place, kind):
    return np.frombuffer(base64.b64decode(data_of(text)["arrays"][place]), dtype=kind)


@pytest.mark.parametrize("shift", [0.0, 1e7])  # far away positions lose all digits in single precision
def test_a_page_holds_its_meshes_and_their_colours(shift):
    views = Views()
    field = np.array([1.0, np.nan, 3.0])
    layer = Faces(vertices=VERTICES + shift, faces=FACES, fields={"distance": field}, edges=True)
    figure = views.figure(Scene(title="a mesh", layers=[layer]))
    text = document("title", [figure, views.script()])
    (view,) = data_of(text)["views"]
    assert f'id="{view["place"]}"' in figure
    (layer,) = view["layers"]
    vertices = array(text, layer["vertices"], "<f4").reshape(-1, 3)
    assert np.linalg.norm(vertices, axis=1).max() == pytest.approx(1)
    np.testing.assert_allclose(view["reach"] * (vertices - vertices[0]), VERTICES, atol=1e-6)
    np.testing.assert_array_equal(array(text, layer["elements"], "<u4").reshape(-1, 3), FACES)
    np.testing.assert_array_equal(array(text, layer["fields"]["distance"], "<f4"), field.astype(np.float32))
    assert 1 <= view["scales"]["distance"]["low"] < view["scales"]["distance"]["high"] <= 3


@pytest.mark.parametrize("evil", ["</script><script>alert(1)</script>", "<!--<script>"])
def test_no_title_ends_the_script_or_the_page_or_hides_their_end(evil):
    views = Views()
    figure = views.figure(Scene(title=evil, layers=[TRIANGLE]))
    text = document(evil, [figure, views.script()])
    assert text.count("</script>") == text.count("<script") == 3
    assert "<!--" not in text
    assert "<title></script>" not in text
    assert data_of(text)["views"][0]["title"] == evil


@pytest.mark.slow
def test_the_first_of_very_many_views_is_still_drawn(chromium, tmp_path):
    views = Views()
    figures = [views.figure(Scene(layers=[TRIANGLE])) for _ in range(17)]  # browsers keep 16 contexts
    path = tmp_path / "many.html"
    path.write_text(document("many", [*figures, views.script()]), encoding="utf-8")
    with visit(chromium, path.as_uri(), ready=True) as opened:
        colours = opened.page.evaluate(
            """[...document.querySelectorAll("canvas")].map((canvas) => {
            const seen = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
            return new Set(new Uint32Array(seen.buffer)).size; })"""
        )
        assert len(colours) == 17
        assert min(colours) > 1
        assert opened.errors == []


def test_numbers_that_would_overlap_appear_when_one_zooms_in(chromium, tmp_path):
    places = np.column_stack([np.linspace(0, 1, 60), np.full(60, 0.5), np.full(60, 0.25)])
    views, path = Views(), tmp_path / "numbers.html"
    labels = [(at, str(number)) for number, at in enumerate(places)]
    scene = Scene(layers=[TRIANGLE], labels=labels)
    path.write_text(document("numbers", [views.figure(scene), views.script()]), encoding="utf-8")
    boxes = """[...document.querySelectorAll(".number")].filter((one) => !one.hidden)
        .map((one) => [one.textContent, one.getBoundingClientRect().left, one.getBoundingClientRect().right])"""
    with visit(chromium, path.as_uri(), ready=True) as opened:

        def shown():
            found = sorted(opened.page.evaluate(boxes), key=lambda box: box[1])
            assert all(one[2] < other[1] for one, other in itertools.pairwise(found))
            return {box[0] for box in found}

        before = shown()
        assert "0" in before
        assert 5 < len(before) < 50
        opened.page.locator("canvas").hover()
        opened.page.mouse.wheel(0, -500)
        opened.page.wait_for_timeout(100)
        assert shown() - before
        assert opened.errors == []
