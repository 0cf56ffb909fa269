import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.adapters import read_mesh
from spinor_geom.adapters.stl import encode_stl, read_stl
from spinor_geom.mesh.topology import boundary_edges
from tests.adapters.shapes import extension, is_closed, lid, open_cube, reading

parsed, _ = reading(read_stl, ".stl")


def cube_stl(encoding):
    data = trimesh.Trimesh(*open_cube(), process=False).export(file_type="stl_ascii" if encoding == "text" else "stl")
    return data.encode() if isinstance(data, str) else data


@pytest.mark.parametrize("encoding", ["text", "binary"])
def test_soup_is_kept_and_merging_makes_it_a_surface(tmp_path, encoding):
    soup = parsed(cube_stl(encoding))
    vertices, faces = open_cube()
    assert np.array_equal(soup.mesh.vertices, vertices[faces].reshape(-1, 3))
    assert len(boundary_edges(soup.mesh.faces)) == 30
    merged = soup.merged()
    assert len(merged.mesh.vertices) == 8
    assert len(boundary_edges(merged.mesh.faces)) == 4
    where = {tuple(point): index for index, point in enumerate(merged.mesh.vertices.tolist())}
    old = np.append(np.array([where[tuple(point)] for point in vertices.tolist()]), 8)
    closed = merged.extended(extension(lid().vertices, old[lid().faces]))
    assert is_closed(closed.mesh)
    closed.write(tmp_path / "closed.stl")
    back = read_mesh(tmp_path / "closed.stl")
    assert back.contents.is_text_stl == (encoding == "text")
    assert np.array_equal(back.mesh.vertices[back.mesh.faces[:10]].reshape(-1, 3), soup.mesh.vertices)
    assert is_closed(back.mesh)


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_round_trip_is_bit_exact(seed, text):
    random = np.random.default_rng(seed)
    corners = random.normal(size=(5, 3, 3)).astype(np.float64 if text else np.float32)
    words = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {' '.join(map(repr, corner))}\n" for corner in facet)
        + "endloop\nendfacet\n"
        for facet in corners.tolist()
    )
    binary = np.zeros(5, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    binary["corners"] = corners
    solid = f"solid vertex 1 2 3\n{words}endsolid\n".encode()
    data = solid if text else b"solid".ljust(80) + b"\5\0\0\0" + binary.tobytes()
    contents = read_stl(data)
    assert contents.vertices.tobytes() == corners.astype(float).tobytes()
    assert read_stl(encode_stl(contents)).vertices.tobytes() == contents.vertices.tobytes()
