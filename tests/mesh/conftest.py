"""Meshes shared by the tests of spinor_geom.mesh."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from spinor_geom.mesh.triangle_mesh import TriangleMesh

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture
def tetrahedron() -> np.ndarray:
    """Faces of a closed tetrahedron, normals outwards for (0,0,0), x, y, z."""
    return np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


@pytest.fixture(scope="session")
def real_mesh() -> Callable[[str], TriangleMesh]:
    """Reads a triangle OBJ of the project's data folder by its position indices."""

    def read(name: str) -> TriangleMesh:
        rows = [line.split() for line in (DATA / name).read_text().splitlines()]
        vertices = [[float(number) for number in row[1:4]] for row in rows if row[:1] == ["v"]]
        faces = [[int(corner.split("/")[0]) - 1 for corner in row[1:4]] for row in rows if row[:1] == ["f"]]
        return TriangleMesh(np.array(vertices), np.array(faces))

    return read
