"""Pages with views that turn: whole, and true to the meshes they are of."""

import base64
import json
import re

import numpy as np
import pytest

from spinor_geom.errors import RenderError
from spinor_geom.render.layers import Faces, Scale
from spinor_geom.render.page import Scene, Views, document, picture, three_js
from tests.browser import browser, visit

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]])
FACES = np.array([[0, 1, 2]])


def shown(title, mesh):
    return Scene(title=title, layers=(mesh,), scales={name: Scale.of(own) for name, own in mesh.fields.items()})


def views_of(text):
    (data,) = re.findall(r'<script type="application/json" id="views">(.*?)</script>', text, re.DOTALL)
    return json.loads(data)


def array(text, place, kind):
    (data,) = re.findall(r'<script type="application/json" id="arrays">(.*?)</script>', text, re.DOTALL)
    return np.frombuffer(base64.b64decode(json.loads(data)[place]), dtype=kind)


def test_a_page_holds_its_meshes_and_their_colours():
    views = Views()
    field = np.array([1.0, np.nan, 3.0])
    figure = views.figure(
        shown("a mesh", Faces(vertices=VERTICES, faces=FACES, fields={"distance": field}, edges=True))
    )
    text = document("title", [figure, views.script()])
    (view,) = views_of(text)
    assert f'id="{view["place"]}"' in figure
    (layer,) = view["layers"]
    np.testing.assert_array_equal(array(text, layer["vertices"], "<f4").reshape(-1, 3), VERTICES.astype(np.float32))
    np.testing.assert_array_equal(array(text, layer["elements"], "<u4").reshape(-1, 3), FACES)
    np.testing.assert_array_equal(array(text, layer["fields"]["distance"], "<f4"), field.astype(np.float32))
    assert 1 <= view["scales"]["distance"]["low"] < view["scales"]["distance"]["high"] <= 3


@pytest.mark.parametrize("evil", ["</script><script>alert(1)</script>", "<!--<script>"])
def test_no_title_ends_the_script_or_the_page_or_hides_their_end(evil):
    views = Views()
    figure = views.figure(shown(evil, Faces(vertices=VERTICES, faces=FACES, edges=True)))
    text = document(evil, [figure, views.script()])
    assert text.count("</script>") == text.count("<script") == 5
    assert "<!--" not in text
    assert "<title></script>" not in text
    assert views_of(text)[0]["title"] == evil


def test_a_field_without_values_is_grey_and_pictures_are_in_the_page():
    views = Views()
    nothing = np.full(3, np.nan)
    views.figure(shown("", Faces(vertices=VERTICES, faces=FACES, fields={"none": nothing}, edges=True)))
    (view,) = views_of(views.script())
    assert (view["scales"]["none"]["low"], view["scales"]["none"]["high"]) == (0.0, 1.0)
    assert picture(b"\x89PNG", 'a "b"').startswith('<img alt="a &quot;b&quot;" src="data:image/png;base64,iVBORw')


def test_an_array_that_several_layers_have_is_in_the_page_once():
    views = Views()
    for title in ("a", "b"):
        views.figure(shown(title, Faces(vertices=VERTICES, faces=FACES, edges=True)))
    text = views.script()
    assert text.count(base64.b64encode(VERTICES.astype("<f4").tobytes()).decode()) == 1
    first, second = (view["layers"][0] for view in views_of(text))
    assert (first["vertices"], first["elements"]) == (second["vertices"], second["elements"])


def test_the_library_that_draws_comes_with_its_licence_and_only_with_that():
    text = three_js()
    assert text.startswith("/**\n * @license\n")
    assert "SPDX-License-Identifier: MIT" in text
    assert text.count("\n") == 5  # the notice and one line
    assert "TrackballControls" not in text
    assert "</script" not in text


def test_a_page_without_the_library_is_a_typed_error(monkeypatch):
    monkeypatch.setattr("trimesh.viewer.scene_to_html", lambda _: "<html></html>")
    with pytest.raises(RenderError, match=r"three\.js.*not found in trimesh"):
        three_js()


def test_the_first_of_very_many_views_is_still_drawn(tmp_path):
    views = Views()
    figures = [views.figure(shown("", Faces(vertices=VERTICES, faces=FACES))) for _ in range(20)]
    path = tmp_path / "many.html"
    path.write_text(document("many", [*figures, views.script()]), encoding="utf-8")
    with browser() as chromium, visit(chromium, path.as_uri(), ready=True) as opened:
        colours = opened.page.evaluate(
            """[...document.querySelectorAll("canvas")].map((canvas) => {
            const seen = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
            return new Set(new Uint32Array(seen.buffer)).size; })"""
        )
        assert len(colours) == 20
        assert min(colours) > 1
        assert opened.errors == []
