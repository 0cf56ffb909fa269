"""The MeshLab baseline: what it says of itself, what it refuses, and what it leaves behind."""

import numpy as np
import pymeshlab
import pytest

from spinor_geom import gallery
from spinor_geom.discrete import discrete_minimal_surface, meshlab
from spinor_geom.discrete.meshlab import meshlab_minimal_surface
from spinor_geom.errors import FirstFillError, OptionError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from tests.loops import L_SHAPE, is_disk_on, noisy_ellipse, planar

SEAM = gallery.tennis_seam(0.8)


@pytest.mark.parametrize("seed", range(3))
def test_strongly_folded_loops_come_near_to_the_other_baseline(seed):
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * np.arange(120)[:, None] / 120
    waves = [(np.cos(k * angle) * rng.normal(size=3) + np.sin(k * angle) * rng.normal(size=3)) / k for k in (1, 2, 3)]
    loop = BoundaryLoop.from_points(sum(waves))
    surface = meshlab_minimal_surface(loop, target_edge_length=None, relative_change=1e-5)
    assert is_disk_on(loop, surface.vertices, surface.faces)
    # another start may end at another local minimum, but not far from it
    assert abs(surface.area / discrete_minimal_surface(loop).area - 1) < 1e-2


def test_long_loop_is_not_given_more_vertices_than_it_can_use(monkeypatch):
    monkeypatch.setattr(meshlab, "_VERTICES", 300)
    surface = meshlab_minimal_surface(SEAM.sample(200), target_edge_length=None, relative_change=1e-4)
    assert 200 < len(surface.vertices) < 800


def test_edge_length_that_takes_too_many_vertices_is_refused():
    with pytest.raises(OptionError, match=r"more than 500000 vertices; give at least 0\.0"):
        meshlab_minimal_surface(SEAM.sample(24), target_edge_length=1e-4, relative_change=1e-5)


def test_torn_disk_is_an_error(monkeypatch):
    original = meshlab._remesh_once
    monkeypatch.setattr(meshlab, "_remesh_once", lambda *arguments: (lambda v, f: (v, f[1:]))(*original(*arguments)))
    with pytest.raises(FirstFillError, match="tore"):
        meshlab_minimal_surface(SEAM.sample(24), target_edge_length=None, relative_change=1e-5)


def test_failing_filter_is_a_typed_error(monkeypatch):
    def fail(*arguments):
        raise pymeshlab.PyMeshLabException("no")

    monkeypatch.setattr(meshlab, "_smooth", fail)
    with pytest.raises(FirstFillError, match="MeshLab did not fill a loop of 24 points: no"):
        meshlab_minimal_surface(SEAM.sample(24), target_edge_length=None, relative_change=1e-5)


def test_callers_remeshing_keeps_its_defaults():
    """MeshLab keeps remeshing options from call to call within a process."""

    def remeshed():
        meshes = pymeshlab.MeshSet(verbose=False)
        surface = discrete_minimal_surface(planar(L_SHAPE, 24))
        meshes.add_mesh(pymeshlab.Mesh(surface.vertices, surface.faces.astype(np.int32)))
        meshes.meshing_isotropic_explicit_remeshing(targetlen=pymeshlab.PureValue(0.1))
        return meshes.current_mesh().vertex_matrix()

    before = remeshed()
    meshlab_minimal_surface(noisy_ellipse(40), target_edge_length=None, relative_change=1e-3)
    np.testing.assert_array_equal(remeshed(), before)
    assert len(before) > 300
