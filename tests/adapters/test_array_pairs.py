import numpy as np
import pytest
import torch

from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import MeshShapeError
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.adapters.shapes import extension, lid, nothing, open_cube


@pytest.mark.parametrize("of", [np.asarray, torch.from_numpy])
def test_integer_positions_and_narrow_indices_are_widened(of):
    vertices, faces = open_cube(np.int32)
    grown = np.asarray(extend((of(vertices), of(faces)), lid())[0])
    assert grown.dtype == np.float64
    assert np.array_equal(grown[:-1], vertices)
    assert grown[-1, 2] == 1 + 1 / 3
    # 126 vertices: int8 holds indices to 127
    many, few = np.tile(np.eye(3), (42, 1)), np.array([[0, 1, 2]], dtype=np.int8)
    one = extension(np.eye(3), [126, 127, 128])
    assert extend((of(many), of(few)), one)[1].tolist() == [[0, 1, 2], [126, 127, 128]]


def test_a_triangle_mesh_is_itself_and_attributes_of_another_width_are_refused():
    mesh = TriangleMesh(*open_cube(), vertex_attributes={"color": np.zeros((8, 3))})
    assert to_mesh(mesh) is mesh
    with pytest.raises(MeshShapeError, match="'color' has 3 columns"):
        extend(mesh, lid(color=np.zeros((1, 4))))
    assert len(extend(mesh, nothing()).vertices) == 8


def test_gradients_reach_the_old_positions():
    vertices, faces = (torch.tensor(member) for member in open_cube())
    vertices.requires_grad_()
    grown, _ = extend((vertices, faces), lid())
    grown.sum().backward()
    assert torch.equal(vertices.grad, torch.ones_like(vertices))


def test_half_precision_stays():
    vertices, faces = (torch.tensor(member) for member in open_cube())
    grown, _ = extend([vertices.bfloat16(), faces], lid())
    assert grown.dtype == torch.bfloat16
    assert torch.equal(grown[8], torch.tensor(lid().vertices[0]).bfloat16())
