from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from spinor_geom.adapters import extend, to_mesh
from spinor_geom.errors import MeshShapeError
from tests.adapters.shapes import extensions, is_closed, lid, meshes, open_cube


@given(
    data=st.data(),
    mesh=meshes(),
    floating=st.sampled_from([torch.float32, torch.float64, torch.bfloat16]),
    integer=st.sampled_from([torch.int32, torch.int64]),
    container=st.sampled_from([tuple, list]),
)
def test_prefix_is_bit_equal_and_dtypes_stay(
    data: st.DataObject, mesh: tuple, floating: torch.dtype, integer: torch.dtype, container: type
) -> None:
    vertices, faces = torch.tensor(mesh[0], dtype=floating), torch.tensor(mesh[1], dtype=integer)
    pair = container([vertices, faces])
    read = to_mesh(pair)
    assert np.array_equal(read.vertices, vertices.double().numpy())
    extension = data.draw(extensions(read))
    grown = extend(pair, extension)
    assert type(grown) is container
    assert grown[0].dtype == floating
    assert grown[1].dtype == integer
    assert torch.equal(grown[0][: len(vertices)], vertices)
    assert torch.equal(grown[1][: len(faces)], faces)
    assert torch.equal(grown[0][len(vertices) :], torch.tensor(extension.vertices).to(floating))
    assert np.array_equal(grown[1][len(faces) :].numpy(), extension.faces)


def test_gradients_reach_the_old_positions() -> None:
    vertices, faces = (torch.tensor(member) for member in open_cube())
    vertices.requires_grad_()
    grown, _ = extend((vertices, faces), lid())
    grown.sum().backward()
    assert torch.equal(vertices.grad, torch.ones_like(vertices))


def test_parameters_count_as_tensors() -> None:
    vertices, faces = (torch.tensor(member) for member in open_cube())
    grown, new_faces = extend((torch.nn.Parameter(vertices), faces), lid())
    assert is_closed(to_mesh((grown, new_faces)))


def test_integer_positions_and_narrow_indices_are_widened() -> None:
    vertices, faces = open_cube()
    grown, _ = extend((torch.tensor(vertices, dtype=torch.int32), torch.tensor(faces)), lid())
    assert grown.dtype == torch.float64
    many = torch.zeros((126, 3))
    extension = type(lid())(vertices=np.eye(3), faces=np.array([[126, 127, 128]]), face_loops=np.array([0]))
    _, indices = extend((many, torch.tensor([[0, 1, 2]], dtype=torch.int8)), extension)
    assert indices.dtype == torch.int64


def test_bad_tensors_give_typed_errors() -> None:
    with pytest.raises(MeshShapeError):
        to_mesh((torch.zeros((4, 2)), torch.tensor([[0, 1, 2]])))
    with pytest.raises(MeshShapeError):
        to_mesh((torch.zeros((4, 3)), torch.tensor([[0.0, 1.0, 2.0]])))
