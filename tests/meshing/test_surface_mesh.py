"""Meshes of whole surfaces: vertices on the surface, about the given number, with rims and corners."""

from __future__ import annotations

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.gallery.known import KnownSurface
from spinor_geom.meshing.embed import mesh_surface

KNOWN = [gallery.enneper(1.2), gallery.catenoid(), gallery.helicoid(2.0, both_sides=True), gallery.henneberg()]


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.name)
def test_vertices_are_on_the_surface_and_as_many_as_asked_for(known: KnownSurface) -> None:
    mesh = mesh_surface(known.surface, vertices=2000)
    np.testing.assert_allclose(mesh.vertices, known.position(mesh.points), atol=1e-12)
    assert len(mesh.vertices) == pytest.approx(2000, rel=0.3)
    # off by the square of the edges
    assert mesh.area == pytest.approx(known.area, rel=2e-3)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    edges = np.linalg.norm(np.concatenate([b - a, c - b, a - c]), axis=1)
    assert np.quantile(edges, 0.99) < 2.5 * np.quantile(edges, 0.01)
