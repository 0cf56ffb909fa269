"""Remarks on a whole mesh."""

import numpy as np
import pytest
import trimesh

from spinor_geom.fill.mesh_notes import is_orientable
from spinor_geom.mesh.topology import HalfEdges


def strip(half_turns: int) -> np.ndarray:
    """The faces of a closed strip of 8 quads that is twisted by half turns."""
    top, bottom = np.arange(8), np.arange(8, 16)
    ends = (bottom, top) if half_turns % 2 else (top, bottom)
    after = [np.append(side[1:], end[0]) for side, end in zip((top, bottom), ends, strict=True)]
    return np.concatenate([np.stack([top, bottom, after[0]], 1), np.stack([bottom, after[1], after[0]], 1)])


FIN = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])  # three faces at one edge, of which no two have to agree


@pytest.mark.parametrize(
    ("faces", "expected"),
    [(strip(0), True), (strip(1), False), (np.asarray(trimesh.creation.icosphere(1).faces), True), (FIN, True)],
)
def test_a_mesh_is_orientable_whatever_the_order_of_faces_and_corners(faces: np.ndarray, expected: bool) -> None:
    rng = np.random.default_rng(0)
    for _ in range(5):
        assert is_orientable(HalfEdges.of(faces)) == expected
        faces = np.where(rng.random(len(faces))[:, None] < 0.5, faces, faces[:, ::-1])[rng.permutation(len(faces))]
