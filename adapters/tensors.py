"""Pairs (vertices, faces) of torch tensors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from spinor_geom.adapters.arrays import rebuilt_pair
from spinor_geom.adapters.extending import check_extension
from spinor_geom.mesh.extension import MeshExtension
from spinor_geom.mesh.triangle_mesh import TriangleMesh

if TYPE_CHECKING:
    import torch


class TensorPairAdapter:
    """A tuple or list (V, F) of torch tensors: positions (V, 3) and vertex indices (F, 3), on any device."""

    name = "a pair (V, F) of torch tensors"
    types = ("pair of torch.Tensor",)

    def to_mesh(self, obj: tuple[torch.Tensor, torch.Tensor] | list[torch.Tensor]) -> TriangleMesh:
        """The mesh of the two tensors, copied to the CPU and cut off from autograd."""
        vertices, faces = obj
        return TriangleMesh(_array(vertices), _array(faces))

    def extend(self, obj: Any, extension: MeshExtension) -> Any:
        """A new tuple or list of two new tensors on the old ones' devices, with the old ones as their first rows.

        Gradients flow back to the old positions. Both tensors keep their dtype (new positions are rounded to it),
        unless it cannot hold what is added: integer positions become float64, and too narrow indices int64.
        """
        import torch

        vertices, faces = obj
        check_extension(extension, vertices=len(vertices), attributes={})
        floating = vertices.dtype if vertices.dtype.is_floating_point else torch.float64
        fits = int(extension.faces.max(initial=0)) <= torch.iinfo(faces.dtype).max
        indices = faces.dtype if fits else torch.int64
        new_vertices = torch.tensor(extension.vertices, dtype=floating, device=vertices.device)
        new_faces = torch.tensor(extension.faces, dtype=indices, device=faces.device)
        return rebuilt_pair(
            obj, torch.cat([vertices.to(floating), new_vertices]), torch.cat([faces.to(indices), new_faces])
        )


def _array(tensor: torch.Tensor) -> np.ndarray:
    tensor = tensor.detach().cpu()
    # numpy has no bfloat16; float64 holds every shorter floating type exactly
    return (tensor.double() if tensor.dtype.is_floating_point else tensor).numpy()
