"""From which vertex of Ω's triangulation the integral to a point starts."""

from __future__ import annotations

from typing import Any

import igl
import numpy as np
import torch
from jaxtyping import Complex, Int
from torch import Tensor

from spinor_geom.domain.delaunay import flat_coordinates
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import DomainError
from spinor_geom.mesh.arrays import igl_arrays


def find_anchors(z: Complex[Tensor, "*pts"], domain: PlaneDomain) -> Int[Tensor, "*pts"]:
    """For points of Ω the vertices of its triangulation that they see along straight segments inside Ω.

    That is the nearest corner of the triangle that holds the point, or of the nearest triangle: the nearest vertex of
    all may lie across a gap of Ω. Inner corners come before those on ∂Ω: near ∂Ω the poles are near too. It works
    inside the transforms of torch.func too, and has no derivative. A point that is not finite is a DomainError.
    """
    index: Tensor = _Lookup.apply(z, domain)  # type: ignore[no-untyped-call] # torch leaves `apply` untyped
    return index


class _Lookup(torch.autograd.Function):
    """A function of the values only: the transforms of torch.func reach plain tensors through it."""

    @staticmethod
    def forward(z: Tensor, domain: PlaneDomain) -> Tensor:
        points = z.detach().cpu().resolve_conj().reshape(-1).numpy()
        if not np.isfinite(points).all():
            raise DomainError(f"points of Ω must be finite, point {int(np.argmin(np.isfinite(points)))} is not")
        mesh = domain.triangulation
        triangles = igl_arrays(flat_coordinates(mesh.points), mesh.faces)
        _, face, _ = igl.point_mesh_squared_distance(flat_coordinates(points), *triangles)
        corners = mesh.faces[np.asarray(face).reshape(-1)]
        distance = np.abs(mesh.points[corners] - points[:, None])
        on_boundary = corners < mesh.boundary_size
        closest = np.where(on_boundary, distance + 2 * distance.max(initial=0.0), distance).argmin(axis=1)
        index = np.take_along_axis(corners, closest[:, None], axis=1)
        return torch.from_numpy(index).reshape(z.shape).to(z.device)

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
    def vmap(info: Any, in_dims: tuple[int | None, None], z: Tensor, domain: PlaneDomain) -> tuple[Tensor, int | None]:
        return find_anchors(z, domain), in_dims[0]
