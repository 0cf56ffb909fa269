"""The MeshLab baseline: its result, its errors, and its side effects on MeshLab."""

import numpy as np
import pymeshlab
import pytest

from spinor_geom import gallery
from spinor_geom.discrete import minimal_surface
from spinor_geom.discrete.minimal_surface import discrete_minimal_surface
from spinor_geom.errors import FirstFillError
from spinor_geom.measures import smallest_angles
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from tests.loops import is_disk_on

SEAM = gallery.tennis_seam(0.8)


def meshlab_minimal_surface(loop, **options):
    return discrete_minimal_surface(loop, method="pymeshlab", **options)


@pytest.mark.parametrize("seed", range(3))
def test_strongly_folded_loops_come_near_to_the_other_baseline(seed):
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * np.arange(120)[:, None] / 120
    waves = [(np.cos(k * angle) * rng.normal(size=3) + np.sin(k * angle) * rng.normal(size=3)) / k for k in (1, 2, 3)]
    loop = BoundaryLoop.from_points(sum(waves))
    surface = meshlab_minimal_surface(loop, relative_change=1e-5)
    assert is_disk_on(loop, surface.vertices, surface.faces)
    # another start may end at another local minimum, but not far from it
    assert abs(surface.area / discrete_minimal_surface(loop).area - 1) < 1e-2


def test_edge_length_never_takes_more_vertices_than_either_library_is_given(monkeypatch):
    monkeypatch.setattr(minimal_surface, "MOST_POINTS", 300)
    surface = meshlab_minimal_surface(SEAM.sample(100))
    assert 200 < len(surface.vertices) < 500


def test_torn_disk_is_an_error(monkeypatch):
    monkeypatch.setattr(minimal_surface, "is_disk", lambda faces: False)
    with pytest.raises(FirstFillError, match="tore"):
        meshlab_minimal_surface(SEAM.sample(24))


def test_failing_filter_is_a_typed_error(monkeypatch):
    name = "meshing_isotropic_explicit_remeshing"
    original = getattr(pymeshlab.MeshSet, name)

    def fail(meshes, **options):
        if meshes.current_mesh().face_number() > 1:
            raise pymeshlab.PyMeshLabException("no")
        return original(meshes, **options)

    monkeypatch.setattr(pymeshlab.MeshSet, name, fail)
    with pytest.raises(FirstFillError, match="MeshLab did not fill a loop of 24 points: no"):
        meshlab_minimal_surface(SEAM.sample(24))


@pytest.mark.parametrize("known", [gallery.henneberg(), gallery.l_shape()], ids=["henneberg", "L"])
def test_triangles_are_even_on_long_loops_too(known):
    loop = known.sample(256) if hasattr(known, "sample") else known.rim(256)
    surface = meshlab_minimal_surface(loop)
    assert surface.converged
    # 24° and 32° were measured
    assert smallest_angles(surface.vertices, surface.faces).min() > 20
