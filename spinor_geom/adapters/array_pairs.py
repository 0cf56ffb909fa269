"""Pairs (vertices, faces) of numpy arrays, as in libigl, or of torch tensors, and `TriangleMesh`."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.vertex_data import append_attributes
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, Within, require_existing_vertices


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
            vertex_attributes=append_attributes(obj.vertex_attributes, extension, vertices=len(obj.vertices)),
            labels=obj.labels,
        )

    def merged(self, obj: TriangleMesh, within: Within) -> TriangleMesh:
        """The mesh with vertices merged."""
        return obj.merged(within)[0]


class PairAdapter:
    """A tuple or list (V, F) of numpy arrays or of torch tensors: positions (V, 3) and vertex indices (F, 3).

    Results are tuples or lists of new members of the same dtypes, on the same devices. A dtype that cannot represent
    the new rows is replaced: integer positions by float64, too narrow indices by int64. Results are differentiable in
    old positions.
    """

    name = "a pair (V, F) of numpy arrays, or of torch tensors"
    types = ("pair of numpy.ndarray", "pair of torch.Tensor")

    def to_mesh(self, obj: Any) -> TriangleMesh:
        """The mesh of the two members."""
        vertices, faces = obj
        is_real = not isinstance(vertices, np.ndarray) and vertices.dtype.is_floating_point
        stored = partial(_stored_in_tensor, vertices.dtype) if is_real else None
        return TriangleMesh(_array(vertices), _array(faces), stored=stored)

    def extend(self, obj: Any, extension: MeshExtension) -> Any:
        """A new pair whose first rows are the old ones."""
        vertices, faces = map(_array, obj)
        require_existing_vertices(extension.faces, vertices=len(vertices) + len(extension.vertices))
        keeps_indices = extension.faces.max(initial=0) <= np.iinfo(faces.dtype).max
        return _like_pair(
            obj,
            _followed_by(obj[0], extension.vertices, keeps_dtype=vertices.dtype.kind == "f"),
            _followed_by(obj[1], extension.faces, keeps_dtype=keeps_indices),
        )

    def merged(self, obj: Any, within: Within) -> Any:
        """A new pair with vertices merged."""
        kept, new_index = self.to_mesh(obj).merge_map(within)
        vertices, faces = obj
        new_faces = new_index[_array(faces)]
        if isinstance(faces, np.ndarray):
            return _like_pair(obj, vertices[kept], new_faces.astype(faces.dtype))
        import torch

        return _like_pair(obj, vertices[torch.tensor(kept, device=vertices.device)], torch.tensor(new_faces).to(faces))


def _array(values: Any) -> np.ndarray:
    """An array unchanged, or a tensor as an array."""
    if isinstance(values, np.ndarray):
        return values
    tensor = values.detach().cpu()
    # numpy has no bfloat16, and float64 holds every shorter floating type exactly
    return np.asarray(tensor.double() if tensor.dtype.is_floating_point else tensor)


def _stored_in_tensor(
    dtype: Any, points: Float[np.ndarray, "n 3"], _: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "n 3"]:
    import torch

    return np.asarray(torch.tensor(points).to(dtype).double())


def _followed_by(values: Any, rows: np.ndarray, *, keeps_dtype: bool) -> Any:
    """An array or tensor followed by new rows, in its own dtype or in theirs."""
    if isinstance(values, np.ndarray):
        dtype = values.dtype if keeps_dtype else rows.dtype
        return np.concatenate([values.astype(dtype), rows.astype(dtype)])
    import torch

    added = torch.tensor(rows, device=values.device)
    return torch.cat([values, added.to(values)] if keeps_dtype else [values.to(added), added])


def _like_pair(pair: Any, vertices: Any, faces: Any) -> Any:
    """The two members in a container like `pair`: a tuple, a named tuple or a list."""
    make = getattr(type(pair), "_make", type(pair))
    return make([vertices, faces])
