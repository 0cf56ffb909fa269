"""Cut-outs are disks, together with the rest they are the mesh, and the distances from them are correct."""

from pathlib import Path

import numpy as np
import pytest

from spinor_geom.adapters import read_mesh
from spinor_geom.bench import run_tables, runner
from spinor_geom.bench.cut_outs import CAPS, PER_SCAN, WINDOWS, named_cut_out, scan_names
from spinor_geom.bench.fillers import Filled
from spinor_geom.bench.measured import DISTANCE, cut_out_figures, hole_figures
from spinor_geom.bench.odd_holes import odd_holes
from spinor_geom.bench.run_tables import pieces_of, scale_of
from spinor_geom.bench.runner import Settings, measure
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.topology import is_disk
from tests.bench.test_run import in_this_process
from tests.closed import is_watertight

DATA = Path(__file__).parents[2] / "data"
SHIPPED = ("spot_cut.obj", "mountain.obj", "demosthenes_low_res.obj")


def rows(vertices, faces):
    """Faces by their corners' positions, in a fixed order."""
    corners = vertices[faces].reshape(len(faces), 9)
    return corners[np.lexsort(corners.T)]


def put_back(cut_out, vertices=None):
    """A filler that restores the removed piece, or the same triangles with other vertices."""
    hole = cut_out.hole
    points = cut_out.vertices if vertices is None else vertices
    rest = np.full(len(points), -1)
    rest[cut_out.kept] = np.arange(len(hole.vertices))
    new = np.flatnonzero(rest < 0)
    rest[new] = len(hole.vertices) + np.arange(len(new))
    faces = np.concatenate([hole.faces, rest[cut_out.faces]])
    return Filled(vertices=np.concatenate([hole.vertices, points[new]]), faces=faces)


@pytest.mark.parametrize("name", [*CAPS, *WINDOWS])
def test_rest_and_removed_piece_are_the_known_surface(name):
    cut_out = named_cut_out(name)
    hole = cut_out.hole
    assert cut_out.exact(cut_out.vertices).max() < 1e-14
    rims = [hole.loops[k] for k in hole.rim_indices]
    # every vertex of the rims once
    assert sorted(np.concatenate([rim.vertex_ids for rim in rims])) == hole.rim.tolist()
    assert len(rims) == (2 if hole.facing else 1)
    assert is_disk(cut_out.faces) == (not hole.facing)
    filled = put_back(cut_out)
    closed = name in CAPS or "torus" in name or "sphere" in name
    assert is_watertight(filled.faces) == closed
    assert len(filled.vertices) == len(np.unique(filled.faces))


@pytest.mark.parametrize("scan", SHIPPED)
def test_disks_cut_out_of_a_scan_leave_the_rest_of_it_and_a_simple_rim(scan):
    mesh = read_mesh(DATA / scan).mesh
    names = [name for name in scan_names(DATA) if name.startswith(scan.partition(".")[0])]
    assert len(names) == PER_SCAN
    for name in names[:3]:
        cut_out = named_cut_out(name, DATA)
        hole = cut_out.hole
        assert is_disk(cut_out.faces)
        (rim,) = hole.rim_indices
        assert 20 <= len(hole.loops[rim]) == len(hole.rim) <= 150
        filled = put_back(cut_out)
        np.testing.assert_array_equal(rows(filled.vertices, filled.faces), rows(mesh.vertices, mesh.faces))
        # the scan's own boundaries are elsewhere, as they were
        assert len(hole.loops) == len(find_boundary_loops(mesh)) + 1


def test_distances_are_those_from_the_sphere():
    cut_out = named_cut_out("icosphere-3-0.3")
    exact = cut_out_figures(put_back(cut_out), cut_out)
    assert exact["vertex_distance"] < 1e-15
    # of chords: at most the height of an arc of 9°, per diameter
    assert 1e-5 < exact["surface_distance"] < 1 - np.cos(np.radians(4.5))
    assert exact["bend"] == pytest.approx(exact["removed_bend"], rel=1e-12)
    assert (exact["crossings"], exact["mesh_crossings"], exact["open_rim_edges"]) == (0, 0, 0)
    off = cut_out_figures(put_back(cut_out, 1.01 * cut_out.vertices), cut_out)
    assert off["distance"] * cut_out.diameter == pytest.approx(0.01, rel=1e-12)
    # a lid: a fan around the point above the middle of the rim
    rim = cut_out.hole.loops[cut_out.hole.rim_indices[0]].vertex_ids
    fan = np.stack([np.roll(rim, -1), rim, np.full(len(rim), len(cut_out.hole.vertices))], axis=1)
    vertices = np.vstack([cut_out.hole.vertices, [0, 0, 0.3]])
    lid = cut_out_figures(Filled(vertices=vertices, faces=np.concatenate([cut_out.hole.faces, fan])), cut_out)
    assert lid["distance"] * cut_out.diameter == pytest.approx(0.7, rel=1e-12)
    assert lid["bend"] > 10 * lid["removed_bend"]


def test_a_filler_that_moves_or_renumbers_the_mesh_is_measured_on_its_patch():
    cut_out = named_cut_out("torus-outside-0.4")
    filled = put_back(cut_out)
    count = len(cut_out.hole.vertices)
    moved = filled.vertices.copy()
    moved[:count] *= 1.001
    figures = cut_out_figures(Filled(vertices=moved, faces=filled.faces, in_order=True), cut_out)
    assert not figures["old_faces_kept"]
    assert figures["triangles"] == len(cut_out.faces)
    # faces of a lattice are the same after a shift, and are others
    shift = (np.arange(len(filled.vertices)) + 1) % len(filled.vertices)
    vertices = np.empty_like(filled.vertices)
    vertices[shift] = filled.vertices
    figures = cut_out_figures(Filled(vertices=vertices, faces=shift[filled.faces]), cut_out)
    assert figures["old_faces_kept"]
    assert figures["triangles"] == len(cut_out.faces)
    assert figures["distance"] < 1e-15


RIMS = {"open-cone": [8], "torus-window": [3], "prism": [4, 3], "facing-triangles": [3, 3], "holey-cube": [3, 3]}
RIMS |= {"quad-hole": [4], "squiggle": [86], "fin": [24], "bow-tie": [12, 12]}


@pytest.mark.parametrize(("name", "rims"), RIMS.items())
def test_cases_of_other_projects_have_the_rims_they_are_known_for(name, rims):
    hole = odd_holes()[name]
    assert [len(hole.loops[place]) for place in hole.rim_indices] == rims
    assert hole.expected
    # an edge with three faces ends in the rim
    figures = hole_figures(Filled(vertices=hole.vertices, faces=hole.faces), hole, None)
    assert (figures["nonmanifold_edges"] > 0) == (name == "fin")


def test_a_run_of_cut_outs_shows_which_method_is_nearest(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "run_isolated", in_this_process)
    settings = Settings.short(cases=("torus-outside-0.4", "open-cone"), methods=("spinor-fill", "trimesh"))
    run = measure(settings, tmp_path)
    ours, theirs = (r for r in run.records if r["suite"] == "cut-outs")
    assert ours["status"] == theirs["status"] == "done"
    # a soap film lies flatter than the torus
    assert 0.01 < ours["distance"] < 0.2
    by_title = {table.title: table for table in run_tables.tables(run.records)}
    fillers = by_title["Cut-outs: fillers compared with what was removed"]
    tests = by_title["Odd rims, and test cases of other projects"]
    assert fillers.rows[0][:2] == ("spinor-fill", "1 of 1")
    assert fillers.rows[1][1] == "0 of 1"
    assert fillers.columns[-1] == "curved"
    assert fillers.rows[0][-1].startswith("**")
    assert tests.rows[0][1].startswith("closed, ")
    run_tables.write(run)
    text = (tmp_path / run_tables.PAGE).read_text(encoding="utf-8")
    assert "From left to right: removed, spinor-fill." in text
    pieces = pieces_of(tmp_path / "views" / "torus-outside-0.4")
    removed, patch = pieces.values()
    assert removed.fields[DISTANCE].max() < 1e-7
    assert scale_of(pieces).high == pytest.approx(np.quantile(patch.fields[DISTANCE], 0.95))
    # side by side
    assert removed.vertices[:, 0].max() < patch.vertices[:, 0].min()
