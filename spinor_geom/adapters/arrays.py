"""Pairs (vertices, faces) of numpy arrays, as libigl's functions have them, or of torch tensors, and our own mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from spinor_geom.adapters.contents import grown_attributes
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, Within, require_existing_vertices

if TYPE_CHECKING:
    import torch


class TriangleMeshAdapter:
    """`TriangleMesh`, the package's own type."""

    name = "TriangleMesh"
    types = ("spinor_geom.TriangleMesh",)

    def to_mesh(self, obj: TriangleMesh) -> TriangleMesh:
        """The mesh itself."""
        return obj

    def extend(self, obj: TriangleMesh, extension: MeshExtension) -> TriangleMesh:
        """The mesh with the extension appended."""
        return TriangleMesh(
            np.concatenate([obj.vertices, extension.vertices]),
            np.concatenate([obj.faces, extension.faces]),
            vertex_attributes=grown_attributes(obj.vertex_attributes, extension, vertices=len(obj.vertices)),
            labels=obj.labels,
        )

    def merged(self, obj: TriangleMesh, within: Within) -> TriangleMesh:
        """The mesh with vertices merged."""
        return obj.merged(within)[0]


class ArrayPairAdapter:
    """A tuple or list (V, F) of numpy arrays: positions (V, 3) and vertex indices (F, 3)."""

    name = "a pair (V, F) of numpy arrays"
    types = ("pair of numpy.ndarray",)

    def to_mesh(self, obj: tuple[np.ndarray, np.ndarray] | list[np.ndarray]) -> TriangleMesh:
        """The mesh of the two arrays."""
        vertices, faces = obj
        return TriangleMesh(np.asarray(vertices), np.asarray(faces))

    def extend(self, obj: Any, extension: MeshExtension) -> Any:
        """A new tuple or list of two new arrays, with the old ones as their first rows.

        Both arrays keep their dtype (new positions are rounded to it), unless it cannot hold what is added: integer
        positions become float64, and index types too narrow for the new indices are widened.
        """
        vertices, faces = (np.asarray(member) for member in obj)
        require_existing_vertices(extension.faces, vertices=len(vertices) + len(extension.vertices))
        floating = vertices.dtype if vertices.dtype.kind == "f" else np.dtype(np.float64)
        highest, indices = int(extension.faces.max(initial=0)), faces.dtype
        if highest > np.iinfo(indices).max:
            indices = np.promote_types(indices, np.min_scalar_type(highest))
        return _rebuilt_pair(
            obj,
            np.concatenate([vertices.astype(floating), extension.vertices.astype(floating)]),
            np.concatenate([faces.astype(indices), extension.faces.astype(indices)]),
        )

    def merged(self, obj: Any, within: Within) -> Any:
        """A new tuple or list of two new arrays of the same dtypes."""
        vertices, faces = (np.asarray(member) for member in obj)
        kept, new_index = self.to_mesh(obj).merge_map(within)
        return _rebuilt_pair(obj, vertices[kept], new_index[faces].astype(faces.dtype))


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
        require_existing_vertices(extension.faces, vertices=len(vertices) + len(extension.vertices))
        floating = vertices.dtype if vertices.dtype.is_floating_point else torch.float64
        indices = faces.dtype if extension.faces.max(initial=0) <= torch.iinfo(faces.dtype).max else torch.int64
        new_vertices = torch.tensor(extension.vertices, dtype=floating, device=vertices.device)
        new_faces = torch.tensor(extension.faces, dtype=indices, device=faces.device)
        return _rebuilt_pair(
            obj, torch.cat([vertices.to(floating), new_vertices]), torch.cat([faces.to(indices), new_faces])
        )

    def merged(self, obj: Any, within: Within) -> Any:
        """A new tuple or list of two new tensors, of the same dtypes and devices; gradients flow back to the old."""
        import torch

        vertices, faces = obj
        kept, new_index = self.to_mesh(obj).merge_map(within)
        numbers = torch.from_numpy(new_index).to(faces.device)
        rows = torch.from_numpy(np.flatnonzero(kept)).to(vertices.device)
        return _rebuilt_pair(obj, vertices[rows], numbers[faces.long()].to(faces.dtype))


def _rebuilt_pair(pair: Any, vertices: Any, faces: Any) -> Any:
    """The two members in a container like `pair`: a tuple, a named tuple or a list."""
    if hasattr(pair, "_make"):
        return pair._make([vertices, faces])
    return type(pair)([vertices, faces])


def _array(tensor: torch.Tensor) -> np.ndarray:
    tensor = tensor.detach().cpu()
    # numpy has no bfloat16; float64 holds every shorter floating type exactly
    return (tensor.double() if tensor.dtype.is_floating_point else tensor).numpy()
