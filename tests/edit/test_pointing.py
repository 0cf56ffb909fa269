"""What is under the pointer, and meshes of fewer triangles."""

import numpy as np
import pytest

from spinor_geom.edit.pointing import plane_depth, rim_at, triangles_at

# two squares in pixels, one in the other, at depths 0.4 and 0.2
SQUARE = np.array([[0.0, 0, 0], [100, 0, 0], [100, 100, 0], [0, 100, 0]])
BEGINS = np.concatenate([SQUARE + np.array([0, 0, 0.4]), 0.5 * SQUARE + np.array([25, 25, 0.2])])
ENDS = BEGINS[[1, 2, 3, 0, 5, 6, 7, 4]]


@pytest.mark.parametrize(
    ("here", "depth", "segment"),
    [
        ((50, 3), 1.0, 0),
        ((50, -9), 1.0, 0),
        ((50, -15), 1.0, None),
        ((50, 3), 0.3, None),  # something is in front of it
        ((50, 30), 0.3, 4),
        ((50, 12.4), 0.3, None),
        ((50, 13.2), 1.0, 4),  # the nearer one
        ((12, 50), 0.3, None),
    ],
)
def test_the_nearest_visible_rim_is_pointed_at(here, depth, segment):
    assert rim_at(np.array(here, dtype=float), BEGINS, ENDS, lambda x, y: depth) == segment


def test_the_depth_of_an_opening_is_that_of_its_plane():
    tilted = SQUARE + np.outer(SQUARE @ [0.01, 0.02, 0], [0, 0, 1])
    assert plane_depth(np.array([30.0, 40]), tilted) == pytest.approx(1.1)


def test_triangles_contain_what_is_inside_whatever_their_orientation():
    corners = SQUARE[[[0, 1, 2], [0, 2, 1], [0, 2, 3]]]
    np.testing.assert_array_equal(triangles_at(np.array([60.0, 20]), corners), [0, 1])
    np.testing.assert_array_equal(triangles_at(np.array([20.0, 60]), corners), [2])
    assert len(triangles_at(np.array([20.0, 60]), np.zeros((0, 3, 3)))) == 0
