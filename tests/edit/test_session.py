"""The choices of the editor: clicks, bridges, undo, the command, and which previews are up to date."""

import shlex

import numpy as np

from spinor_geom import fill_hole
from spinor_geom.cli.fill import _choice
from spinor_geom.cli.main import build_parser
from spinor_geom.edit.session import Preview, Session
from spinor_geom.fill.fill_options import FillOptions
from tests.edit.meshes import ball, prepared
from tests.fill.shapes import together, tube


def fill(session, filling):
    """Computes all previews, one after the other, and returns whose."""
    done = []
    while (job := session.next_job()) is not None:
        before = [preview.patch for preview in job.before.previews if preview.patch is not None]
        outcome, patch = filling.preview(job.loops, before, FillOptions(continuity=job.kind))
        session.finish(job, Preview.of(job.loops, job.kind, outcome, patch, filling.patched.reach))
        done.append(job.loops)
    return done


def test_a_click_changes_open_to_film_to_smooth_to_open():
    session, seen = Session([0, 1]), []
    for _ in range(4):
        session.click(1)
        seen.append(dict(session.choices))
    assert seen == [{(1,): "film"}, {(1,): "smooth"}, {}, {(1,): "film"}]
    for choices in (*seen[2::-1], {}, {}):
        session.undo()
        assert session.choices == choices


def test_all_fills_open_holes_then_makes_them_smooth_then_opens_them():
    session = Session([0, 2])  # 1 is a border
    session.click(2)
    session.click(2)
    for choices in ({(0,): "film", (2,): "smooth"}, {(0,): "smooth", (2,): "smooth"}, {}, {(0,): "film", (2,): "film"}):
        session.click_all()
        assert session.choices == choices


def test_loops_are_joined_and_a_bridge_grows_and_is_clicked_like_a_loop():
    session = Session([0, 1, 2, 3])
    session.click(2)
    session.click(2)
    session.join(2, 1)
    assert session.choices == {(1, 2): "smooth"}
    session.join(1, 1)
    session.join(1, 2)
    session.join(0, 2)
    assert session.choices == {(0, 1, 2): "film"}
    session.click(1)
    assert session.choices == {(0, 1, 2): "smooth"}
    session.click_all()
    assert session.choices == {(0, 1, 2): "smooth", (3,): "film"}
    session.click(0)
    assert session.choices == {(3,): "film"}


def test_the_command_makes_the_same_choices():
    session = Session(range(12))
    for index in (4, 5, 9, 1, 1, 2, 2, 3, 3, 11, 11, 6, 6):
        session.click(index)
    session.join(6, 8)
    session.join(9, 10)
    text = session.command(["spinor-geom", "fill", "my mesh.obj", "-o", "out.ply"])
    assert text == ("spinor-geom fill 'my mesh.obj' -o out.ply --bridge 6,8 --bridge 9-10 --film 4-5 --smooth 1-3,6,11")
    arguments = build_parser().parse_args(shlex.split(text)[1:])
    loop, continuity = _choice(arguments)
    options = session.options
    assert isinstance(loop, list)
    assert isinstance(continuity, dict)
    assert sorted({*loop} - {6}) == sorted(options["loop"])
    assert [tuple(loops) for loops in arguments.bridge] == sorted(options["bridge"])
    for index, kind in options["continuity"].items():
        assert continuity.get(index, "C0") == {"film": "C0", "smooth": "C1"}[kind]


def nested_tubes():
    """Two tubes of the same height, one in the other: the films over their ends lie in the same planes, and cross."""
    return together(tube(), (tube()[0] * [0.6, 0.6, 1.0], tube()[1]))


def test_previews_are_the_patches_of_a_fill_in_whatever_order_they_were_chosen():
    mesh = nested_tubes()
    filling = prepared(mesh)
    session = Session(range(4))
    for index in (3, 1, 0, 2):
        session.click(index)
        assert (index,) in fill(session, filling)
    session.click(0)
    again = fill(session, filling)
    assert (0,) in again
    session.click(0)
    fill(session, filling)
    session.undo()
    assert fill(session, filling) == []  # known already
    report = fill_hole(mesh, **session.options, return_report=True)[1]
    previews = session.previews()
    assert len(previews) == 4
    for loops, (preview, is_current) in previews.items():
        outcome = report.loops[loops[0]]
        assert is_current
        np.testing.assert_array_equal(preview.patch.patch.vertices, outcome.patch.vertices)
        np.testing.assert_array_equal(preview.patch.patch.faces, outcome.patch.faces)
        for name in ("kind", "area", "intersections"):
            assert getattr(preview, name) == getattr(outcome, name)


def test_a_patch_is_computed_again_only_if_one_near_it_and_before_it_changed():
    far = ball(holes=((0, 0, 1, 0.4), (0, 0, -1, 0.3)))
    session = Session([0, 1])
    filling = prepared(far)
    session.click(1)
    fill(session, filling)
    session.click(0)
    assert fill(session, filling) == [(0,)]
    filling = prepared(nested_tubes())
    session = Session(range(4))
    ends = [loop.centroid[2] for loop in filling.loops]
    inner, outer = max((2, 3), key=ends.__getitem__), max((0, 1), key=ends.__getitem__)
    session.click(inner)
    fill(session, filling)
    session.click(outer)
    assert session.previews()[(inner,)][1]
    assert fill(session, filling) == [(outer,), (inner,)]
    session.click(inner)
    assert fill(session, filling) == [(inner,)]


def test_a_loop_that_cannot_be_filled_says_why_and_cancelling_opens_what_has_no_patch():
    filling = prepared(ball())
    session = Session(range(4))
    session.click(0)
    fill(session, filling)
    session.click(1)
    session.cancel()
    assert session.choices == {(0,): "film"}
    session.undo()
    assert session.choices == {(0,): "film", (1,): "film"}
    session = Session(range(4))
    session.join(0, 3)  # too far from each other for a surface
    fill(session, filling)
    ((preview, is_current),) = session.previews().values()
    assert is_current
    assert preview.patch is None
    assert "was left open" in preview.sentences[0]
