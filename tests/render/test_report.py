"""The page of a fill in a real browser: drawn, each switch changes the view, nothing is fetched; its text."""

import io
import re

import numpy as np
import pytest
import trimesh

import spinor_geom
from spinor_geom.adapters.mesh_files import write_triangles
from spinor_geom.bench.holes import plane_square
from spinor_geom.bench.odd_holes import facing_rims
from spinor_geom.cli.main import main
from spinor_geom.mesh.operators import face_areas
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.render.loop_views import DISTANCE, GAUSS, MEAN, loop_views
from spinor_geom.render.report import _shown
from tests.browser import visit
from tests.fill.shapes import collar, figure_eight, obj_text, together, tube
from tests.render.test_png import green_tube


@pytest.fixture(scope="module")
def result():
    """Two rims, one of which bends, so that every field varies."""
    vertices, faces = tube(32, 5)
    angle = np.arctan2(vertices[:, 1], vertices[:, 0])
    vertices = vertices + [0, 0, 1] * (0.4 * np.cos(2 * angle))[:, None]
    return spinor_geom.fill_hole((vertices, faces), return_report=True)[1]


@pytest.fixture(scope="module")
def page(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    spinor_geom.report(result, path)
    return path


@pytest.fixture
def opened(chromium, page):
    with visit(chromium, page.as_uri(), ready=True) as now:
        assert now.page.locator("canvas:visible").count() == 1  # the mathematics is folded
        now.page.locator("summary", has_text="the Gauss map").click()
        yield now
        assert now.errors == []
        assert now.foreign == []


def canvas(opened, number):
    """(height, width, 3) pixels of a view."""
    from PIL import Image

    opened.page.wait_for_timeout(50)
    shot = opened.page.locator("canvas:visible").nth(number).screenshot()
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)


def changed(before, after):
    """Share of the pixels that differ visibly."""
    return float((np.abs(before - after).max(axis=-1) > 16).mean())


def orange(image):
    red, green, blue = np.moveaxis(image, -1, 0)
    return float(((red > 1.3 * green) & (green > 1.4 * blue) & (red > 100)).mean())


def test_the_mesh_the_domain_and_the_gauss_map_are_drawn(opened):
    assert opened.page.locator("canvas:visible").count() == 3
    for number in range(3):
        image = canvas(opened, number)
        assert orange(image) > 0.01
        assert image.std() > 10
    # the mesh itself, which its larger patch hides from before, is grey
    box = opened.page.locator("canvas").first.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    mouse = opened.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x, y + 200, steps=5)
    mouse.up()
    image = canvas(opened, 0)
    assert ((np.ptp(image, axis=-1) < 30) & (image.min(axis=-1) < 235)).mean() > 0.05


def test_each_switch_changes_the_picture_and_back(opened):
    before = canvas(opened, 0)
    for switch in ("wireframe", "conformal grid", "normals"):
        box = opened.page.get_by_label(switch, exact=True)
        box.check()
        assert changed(before, canvas(opened, 0)) > 0.002
        box.uncheck()
        assert changed(before, canvas(opened, 0)) == 0


def test_each_colour_shows_on_all_views_with_its_scale(opened):
    before = [canvas(opened, number) for number in range(3)]
    bar = opened.page.locator("form output")
    assert bar.inner_text() == ""
    for colour in (MEAN, DISTANCE, GAUSS):
        opened.page.get_by_label(colour, exact=True).check()
        after = [canvas(opened, number) for number in range(3)]
        assert all(changed(old, new) > 0.01 for old, new in zip(before, after, strict=True))
        assert orange(after[0]) < 0.2 * orange(before[0])
        assert len(set(map(float, re.findall(r"[\d.e-]+", bar.inner_text())))) == 2
        assert len(np.unique(after[1].reshape(-1, 3) // 32, axis=0)) > 6


def test_the_choice_of_a_loop_shows_its_domain_and_its_figures(opened):
    before = [canvas(opened, number) for number in range(3)]
    assert opened.page.locator("section:visible h2").all_inner_texts() == ["Loop 0"]
    opened.page.select_option("select[name=loop]", "1")
    assert opened.page.locator("section:visible h2").all_inner_texts() == ["Loop 1"]
    assert all(changed(old, canvas(opened, number)) > 0.01 for number, old in enumerate(before))
    assert opened.page.locator("section:visible img").count() == 4
    shown = "[...document.querySelectorAll('section:not([hidden]) img')]"
    assert opened.page.evaluate(f"{shown}.every((i) => i.naturalWidth > 50)")


def test_mouse_wheel_and_keys_turn_move_and_zoom(opened):
    view = opened.page.locator("canvas").first
    box = view.bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    start = seen = canvas(opened, 0)
    opened.page.mouse.move(*middle)
    opened.page.mouse.down()
    opened.page.mouse.move(middle[0] + 60, middle[1] + 30)
    opened.page.mouse.up()
    for act in (
        lambda: None,
        lambda: opened.page.mouse.wheel(0, -200),
        lambda: view.press("ArrowLeft"),
        lambda: view.press("Shift+ArrowUp"),
        lambda: view.press("+"),
    ):
        act()
        now = canvas(opened, 0)
        assert changed(seen, now) > 0.01
        seen = now
    view.press("0")
    assert changed(start, canvas(opened, 0)) < 0.001


def test_the_page_shows_which_patches_are_discrete_and_why():
    _, result = spinor_geom.fill_hole(collar(figure_eight(16, 0.5), np.array([0, 0, 0.3])), return_report=True)
    text = spinor_geom.report(result)
    assert "2 of 2 loops filled" in text
    assert text.count("<td>discrete</td>") == 4  # in the list and among all figures
    assert text.count("crosses or touches itself") >= 2
    assert text.count("<canvas") == 0  # made by the script
    assert "<section" not in text


def test_a_closed_mesh_has_a_page(result, chromium, tmp_path):
    closed = spinor_geom.fill_hole(result.mesh, return_report=True)[1]
    spinor_geom.report(closed, tmp_path / "closed.html")
    with visit(chromium, (tmp_path / "closed.html").as_uri(), ready=True) as now:
        assert "no boundary loops" in now.page.inner_text("body")
        assert canvas(now, 0).std() > 10
        assert now.errors == []


def test_the_figures_are_those_of_the_report(result):
    text = spinor_geom.report(result)
    for outcome in result.loops:
        assert f"<td>{outcome.solution.area:.6g}</td>" in text
        assert f"<td>{outcome.solution.boundary_residual.rms_per_edge:.6g}</td>" in text
    assert not re.search(r'(?:src|href)="(?!data:|#)', text)
    allowed = r'xmlns[^"]*"[^"]*"|"https?://www.w3.org/[^"]*"|<metadata>.*?</metadata>'
    assert "http" not in re.sub(allowed, "", text, flags=re.DOTALL)


def test_the_command_writes_the_page_with_comparisons(tmp_path):
    mesh = tmp_path / "tube.obj"
    mesh.write_text(obj_text(*tube(16, 3)))
    target = tmp_path / "new" / "report.html"
    options = ["--loop", "0", "--compare", "--html", str(target)]
    assert main(["fill", str(mesh), "-o", str(tmp_path / "o.obj"), *options]) == 0
    text = target.read_text(encoding="utf-8")
    assert "<td>to the surface, max</td>" in text
    assert sorted(path.name for path in target.parent.iterdir()) == ["report.html"]


def test_a_coarser_mesh_of_a_mesh_that_has_shrunk_to_a_line_ends():
    ball = trimesh.creation.icosphere(subdivisions=4)
    line = TriangleMesh(np.array(ball.vertices * [1, 0, 0]), np.array(ball.faces))
    assert len(_shown(line, line.vertices[:5], 500).faces) < len(line.faces)


def test_a_large_mesh_is_shown_whole_and_as_it_is_near_its_loops(monkeypatch):
    most = 8_000
    monkeypatch.setattr("spinor_geom.render.report.MOST_FACES", most)
    vertices, faces = plane_square(100)
    middle = np.linalg.norm(vertices[faces].mean(axis=1) - vertices.mean(axis=0), axis=1) < 3
    _, result = spinor_geom.fill_hole((vertices, faces[~middle]), return_report=True)
    points = np.concatenate([outcome.loop.points for outcome in result.loops])
    shown = _shown(result.original, points, most)
    assert 0.5 * most < len(shown.faces) <= most < len(result.original.faces)
    area = face_areas(result.original.vertices, result.original.faces).sum()
    assert face_areas(shown.vertices, shown.faces).sum() == pytest.approx(area, rel=0.05)  # corners are rounded
    assert {tuple(point) for point in points.tolist()} <= {tuple(point) for point in shown.vertices.tolist()}
    assert "shown coarser than it is" in spinor_geom.report(result)


@pytest.mark.slow
def test_the_page_shows_the_colours_of_the_mesh(chromium, tmp_path):
    _, result = spinor_geom.fill_hole(green_tube(tmp_path, "colours"), return_report=True)
    spinor_geom.report(result, tmp_path / "page.html")
    with visit(chromium, (tmp_path / "page.html").as_uri(), ready=True) as now:
        for _ in range(10):  # by 0.1 each. The tube is seen along its axis at first
            now.page.locator("canvas").first.press("ArrowUp")
        red, green, blue = np.moveaxis(canvas(now, 0).astype(int), -1, 0)[:3]
        assert now.errors == []
    assert ((green > 2 * red) & (green > 2 * blue)).mean() > 0.04
    assert ((red > 2 * green) & (red > 150) & (blue < 30)).mean() < 1e-3


def test_a_bridge_is_shown_with_both_rims_and_its_discrete_annulus():
    hole = facing_rims(0.4, 24)
    first, second = hole.rim_indices
    _, report = spinor_geom.fill_hole((hole.vertices, hole.faces), bridge=(first, second), return_report=True)
    views = loop_views(report.loops[first])
    (rim,) = (layer for layer in views.plane_scene({}).layers if type(layer).__name__ == "Lines" and layer.width == 2.5)
    start, end = rim.vertices[rim.edges].swapaxes(0, 1)
    # rings of 24 points: no line leads from one to the other
    assert (np.linalg.norm(start - end, axis=1) < 0.3 * np.linalg.norm(start, axis=1)).all()
    assert np.isfinite(views.fields[DISTANCE]).all()
    assert views.fields[DISTANCE].max() < 0.05


LINKED = """() => [...document.querySelectorAll("tr.chosen, .number.chosen")].map(
    (one) => one.dataset.row ?? one.textContent)"""


def test_a_click_on_a_patch_selects_its_row_and_a_click_on_a_row_shows_its_patch(chromium, tmp_path):
    _, result = spinor_geom.fill_hole(tube(), continuity="smooth", return_report=True)
    spinor_geom.report(result, tmp_path / "report.html")
    with visit(chromium, (tmp_path / "report.html").as_uri(), ready=True) as opened:
        opened.page.locator("tr[data-row='1']").click()
        assert opened.page.evaluate(LINKED) == ["1", "1"]
        opened.page.locator("tr[data-row='0']").click()
        box = opened.page.locator("figure.wide canvas").bounding_box()
        opened.page.locator("tr[data-row='0']").click()
        opened.page.evaluate("document.querySelector('.chosen').classList.remove('chosen')")
        opened.page.mouse.click(box["x"] + box["width"] / 2 + 30, box["y"] + box["height"] / 2)
        assert sorted(opened.page.evaluate(LINKED)) == ["0", "0"]
        assert opened.errors == []


def test_a_click_on_a_rim_of_the_page_of_loops_writes_the_command(chromium, tmp_path):
    vertices, faces = tube()
    path = tmp_path / "a tube.obj"
    write_triangles(vertices, faces, path)
    assert main(["loops", str(path), "--html", str(tmp_path / "loops.html")]) == 0
    with visit(chromium, (tmp_path / "loops.html").as_uri(), ready=True) as opened:
        page, written = opened.page, "document.querySelector('[data-command]').textContent"
        assert page.evaluate(written) == "choose a loop first"
        page.locator("tr[data-row='1'] button").click()
        assert page.evaluate(written) == "spinor-geom fill 'a tube.obj' -o filled.obj --film 1"
        page.locator("tr[data-row='0']").click()  # its rim faces the viewer: a circle about the middle
        box = page.locator("figure.wide canvas").bounding_box()
        for x in range(20, int(box["width"] / 2), 12):
            page.mouse.click(box["x"] + box["width"] / 2 + x, box["y"] + box["height"] / 2)
            if "--film 0" in page.evaluate(written):
                break
        assert page.evaluate(written) == "spinor-geom fill 'a tube.obj' -o filled.obj --film 0-1"
        page.locator("tr[data-row='0'] button").click()
        assert page.evaluate(written) == "spinor-geom fill 'a tube.obj' -o filled.obj --film 1 --smooth 0"
        assert opened.errors == []


def test_the_button_of_all_loops_leaves_out_borders(chromium, tmp_path):
    path = tmp_path / "tube_and_sheet.obj"
    write_triangles(*together(tube(), plane_square(12)), path)  # the longest loop is the border of the sheet
    assert main(["loops", str(path), "--html", str(tmp_path / "loops.html")]) == 0
    with visit(chromium, (tmp_path / "loops.html").as_uri(), ready=True) as opened:
        assert "border of a sheet" in opened.page.locator("tr[data-row='0']").inner_text()
        opened.page.locator("tr[data-row='2'] button").click()
        opened.page.locator("tr[data-row='2'] button").click()
        seen = []
        for _ in range(4):
            opened.page.locator("th button").click()
            seen.append(opened.page.locator("[data-command]").inner_text().partition("filled.obj")[2])
        assert seen == [" --film 1 --smooth 2", " --smooth 1-2", "", " --film 1-2"]
        assert opened.errors == []
