"""The triangulation of a curve that bends least, with charged triangles and edges that are not allowed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.discrete.flattest_triangulation import FlattestTriangulation
from spinor_geom.mesh.operators import face_areas, face_normals
from tests.discrete.test_first_fill import triangulations
from tests.loops import CONVEX, L_SHAPE, polygon_area
from tests.strategies import SEEDS


def flattest(points, around=None, chords=(), charges=None):
    n = len(points)
    forbidden_chords = np.zeros((n, n), dtype=bool)
    for i, j in chords:
        forbidden_chords[i, j] = True
    around = np.full((n, 3), np.nan) if around is None else around
    triangulation = FlattestTriangulation(points, around, forbidden_chords)
    if charges:
        triangulation.triangles()  # charges may come later
        triangulation.charge(np.array(list(charges)), np.array(list(charges.values())))
    return triangulation, triangulation.triangles()


@given(n=st.integers(3, 8), share=st.floats(0, 0.8), seed=SEEDS)
def test_the_sum_of_charges_is_the_least_without_forbidden_edges(n, share, seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 3))
    inner = [(i, j) for i in range(n) for j in range(i + 2, n) if (i, j) != (0, n - 1)]
    chords = {pair for pair in inner if rng.uniform() < share / 2}
    every = [(i, k, j) for i in range(n) for k in range(i + 1, n) for j in range(k + 1, n)]
    charges = {corners: int(rng.integers(0, 4)) for corners in every if rng.uniform() < share}

    def is_allowed(some):
        return not {pair for i, k, j in some for pair in ((i, k), (k, j), (i, j))} & chords

    def charge(some):
        return sum(charges.get(corners, 0) for corners in some)

    triangulation, found = flattest(points, chords=chords, charges=charges)
    allowed = [some for some in triangulations(0, n - 1) if is_allowed(some)]
    if found is None:
        assert not allowed
    else:
        corners = {tuple(corners) for corners in found.tolist()}
        assert corners in [set(some) for some in allowed]
        assert triangulation.least == charge(corners) == min(map(charge, allowed))


@pytest.mark.parametrize("corners", [CONVEX, L_SHAPE], ids=["convex", "L"])
def test_plane_polygons_are_not_folded(corners):
    points = np.column_stack([corners, np.zeros(len(corners))])
    _, triangles = flattest(points)
    assert (face_normals(points, triangles)[:, 2] > 0).all()
    assert face_areas(points, triangles).sum() == pytest.approx(polygon_area(corners))


def test_faces_around_the_curve_count_as_neighbours():
    # a square bent by 0.4 about either diagonal; the faces beyond two edges continue triangles of one of the two
    points = np.array([[0.0, 0, 0], [1, 0, 0.4], [1, 1, 0], [0, 1, 0.4]])
    for triangles in ([[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]):
        normals = face_normals(points, np.array(triangles))
        steep = 3 * normals - 2 * normals[::-1]  # each turned on about the diagonal, by more than the bend there
        steep /= np.linalg.norm(steep, axis=1)[:, None]
        around = np.array([steep[[k in t and (k + 1) % 4 in t for t in triangles].index(True)] for k in range(4)])
        assert sorted(flattest(points, around)[1].tolist()) == triangles
