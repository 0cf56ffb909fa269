"""From which vertex of Ω's triangulation the integral to a point starts."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from jaxtyping import Complex, Int
from scipy.spatial import cKDTree
from torch import Tensor

from spinor_geom.domain.delaunay import plane_coordinates, rim_successors
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import DomainError

# triangles tried first at each point: those with the nearest centres
_CANDIDATES = 12
# how far outside a triangle, relative to it, a point may lie by round-off
_SLACK = 1e-12
# entries of a points × triangles table computed at once
_BLOCK = 1 << 21


class Anchors:
    """Finds, for points of Ω, a vertex of the triangulation that they see along a straight segment inside Ω.

    That is the nearest corner of the triangle that holds the point, not the nearest vertex of all: that one may lie
    across a gap of Ω. Inner corners come before those on ∂Ω: near ∂Ω the poles are near too. A point outside all
    triangles (between ∂Ω and its polygon) belongs to the triangle at the nearest boundary edge.
    """

    def __init__(self, domain: PlaneDomain) -> None:
        mesh = domain.triangulation
        self._points, self._faces = mesh.points, mesh.faces
        self._corners = mesh.points[mesh.faces]
        self._on_boundary = mesh.faces < mesh.boundary_size
        centres = self._corners.mean(axis=1)
        self._centres = cKDTree(plane_coordinates(centres))
        start, end = mesh.faces, np.roll(mesh.faces, -1, axis=1)
        after = rim_successors(mesh.rims)
        on_rim = start < mesh.boundary_size
        self._rim_faces, side = np.nonzero(on_rim & (end == after[np.where(on_rim, start, 0)]))
        rim = (mesh.points[start] + mesh.points[end])[self._rim_faces, side] / 2
        self._rim = cKDTree(plane_coordinates(rim))

    def nearest(self, z: Complex[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Index of the anchor of each point.

        Raises:
            DomainError: a point is NaN or infinite.
        """
        if not np.isfinite(z).all():
            raise DomainError(f"points of Ω must be finite, point {int(np.argmin(np.isfinite(z)))} is not")
        plane = plane_coordinates(z)
        k = min(_CANDIDATES, len(self._faces))
        candidates = self._centres.query(plane, k=k)[1].reshape(len(z), k)
        face = self._containing(z, candidates)
        missing = np.flatnonzero(face < 0)
        everything = np.arange(len(self._faces))
        step = max(1, _BLOCK // len(everything))
        for start in range(0, len(missing), step):
            some = missing[start : start + step]
            face[some] = self._containing(z[some], np.broadcast_to(everything, (len(some), len(everything))))
        outside = np.flatnonzero(face < 0)
        face[outside] = self._rim_faces[self._rim.query(plane[outside])[1]]
        distance = np.abs(self._corners[face] - z[:, None])
        closest = np.where(self._on_boundary[face], distance + 2 * distance.max(initial=0.0), distance).argmin(axis=1)
        anchor = self._faces[face, closest]
        return np.asarray(anchor, dtype=np.int64)

    def _containing(self, z: Complex[np.ndarray, " n"], candidates: Int[np.ndarray, "n k"]) -> Int[np.ndarray, " n"]:
        """The first candidate triangle that holds each point, −1 where none does."""
        corners = self._corners[candidates]  # (n, k, 3)
        side, to = np.roll(corners, -1, axis=2) - corners, z[:, None, None] - corners
        double_area = (np.conj(side[..., 0]) * -side[..., 2]).imag
        inside = ((np.conj(side) * to).imag >= -_SLACK * double_area[..., None]).all(axis=2)
        found = np.take_along_axis(candidates, inside.argmax(axis=1)[:, None], axis=1)[:, 0]
        return np.where(inside.any(axis=1), found, -1)

    def nearest_tensor(self, z: Complex[Tensor, "*pts"]) -> Int[Tensor, "*pts"]:
        """`nearest` for a tensor of any shape, also inside the transforms of torch.func; it has no derivative."""
        index: Tensor = _Lookup.apply(z, self)  # type: ignore[no-untyped-call] # torch leaves `apply` untyped
        return index


class _Lookup(torch.autograd.Function):
    """A function of the values only: the transforms of torch.func reach plain tensors through it."""

    @staticmethod
    def forward(z: Tensor, anchors: Anchors) -> Tensor:
        flat = z.detach().cpu().resolve_conj().reshape(-1).numpy()
        return torch.from_numpy(anchors.nearest(flat)).reshape(z.shape).to(z.device)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        ctx.mark_non_differentiable(output)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Any) -> tuple[None, None]:
        return None, None

    @staticmethod
    def jvp(ctx: Any, *grad_inputs: Any) -> None:
        return None

    @staticmethod
    def vmap(info: Any, in_dims: tuple[int | None, None], z: Tensor, anchors: Anchors) -> tuple[Tensor, int | None]:
        return anchors.nearest_tensor(z), in_dims[0]
