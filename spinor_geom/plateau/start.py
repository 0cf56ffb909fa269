"""The start of a fit: spinors lifted from the frames of a discrete disk along its boundary."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from spinor_geom.domain.delaunay import Rims, rim_successors
from spinor_geom.surface.frames import phi_from_frames, spinors_from_phi


def lifted_spinors(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    boundary: Complex[np.ndarray, " m"],
    device: torch.device,
) -> Complex[Tensor, "m 2"]:
    """P and q on each boundary edge of a discrete disk; see `lifted_frames`."""
    return torch.stack(spinors_from_phi(lifted_frames(vertices, faces, boundary, device)), dim=-1)


def lifted_frames(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    boundary: Complex[np.ndarray, " m"],
    device: torch.device,
    *,
    sizes: Rims | None = None,
) -> Complex[Tensor, "m 3"]:
    """φ on each boundary edge of a discrete disk or annulus, as its frames there say.

    Args:
        vertices: the first m are the boundary, in order.
        faces: counter-clockwise.
        boundary: the images of the boundary vertices in Ω.
        device: of the result.
        sizes: numbers of the vertices of several boundaries, one after the other; none for a single one.
    """
    m = len(boundary)
    after = rim_successors(sizes or (m,))
    start, end = faces, np.roll(faces, -1, axis=1)
    on_boundary = (start < m) & (end == after[start % m])
    face, side = np.nonzero(on_boundary)
    owner = np.empty(m, dtype=np.int64)
    owner[faces[face, side]] = face
    corner = vertices[faces[owner]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    tangent = vertices[after] - vertices[:m]
    # a face without area has no normal: any direction across the edge will do for a start
    flat = np.linalg.norm(normal, axis=1) <= 1e-14 * np.sum(tangent**2, axis=1)
    normal[flat] = np.cross(tangent[flat], np.eye(3)[np.abs(tangent[flat]).argmin(axis=1)])
    edge = boundary[after] - boundary
    return phi_from_frames(
        torch.tensor(tangent, device=device),
        torch.tensor(normal, device=device),
        torch.tensor(edge, device=device),
        torch.tensor(np.linalg.norm(tangent, axis=1) / np.abs(edge), device=device),
    )
