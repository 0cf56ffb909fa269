"""The area of a minimal surface, and positions on it, as differentiable functions of its boundary curves' points."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Complex, Float, Int
from numpy.typing import ArrayLike

from spinor_geom import deadline
from spinor_geom.errors import (
    NotDifferentiableError,
    OptionError,
    OutOfTimeError,
    SurfaceError,
    UncertainGradientWarning,
)
from spinor_geom.gradients.area import as_given
from spinor_geom.gradients.curve_chain import by_points
from spinor_geom.gradients.jacobi import JacobiFields
from spinor_geom.gradients.nearest_points import nearest
from spinor_geom.gradients.rim_nodes import RimNodes
from spinor_geom.gradients.slide_adjoint import SlideAdjoint
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.meshing.embed import mesh_over_points
from spinor_geom.plateau.options import Model
from spinor_geom.plateau.route_result import typed_failures
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.solve import solve_plateau
from spinor_geom.plateau.threads import one_thread
from spinor_geom.torch_extra import Tensor, torch

Corners: TypeAlias = Literal["auto"] | Sequence[ArrayLike | Literal["auto"]] | ArrayLike


def minimal_area(
    points: Tensor | Sequence[Tensor],
    *,
    corners: Corners = (),
    model: Model = "auto",
    tolerance: float = 1e-6,
    time_limit: float = math.inf,
) -> Float[Tensor, ""]:
    """Area of the minimal surface over ordered points, or between several rims, differentiable in the points.

    The curve through the points is a spline of degree 5 at any positions of the points, as with
    `solve_plateau(..., between="quintic")`, so that area and gradient are continuous. The gradient is ∮ ν·δΓ ds, see
    `PlateauSolution.area_gradient`. It takes a small part of the time of the solve. Second derivatives and
    `torch.func.vmap` are not available.

    Args:
        points: (m, 3) real positions in mesh units, on any device, or one such tensor for each rim.
        corners: indices of the points that are corners, for several rims one entry for each. "auto" detects them, so
            that the area jumps where a moved point becomes a corner.
        model: as for `solve_plateau`.
        tolerance: as for `solve_plateau`. The relative error of the gradient is about that of the boundary.
        time_limit: as for `solve_plateau`, in seconds. The derivative is computed after it.

    Returns:
        The area, a float64 scalar on the device of the points.

    Raises:
        OptionError: the points are not real tensors, or the corners do not match them.
        SurfaceError: no connected surface spans the rims.
        SpinorGeomError: the errors of `solve_plateau`.

    Warns:
        UncertainGradientWarning: the residual of the surface is above the tolerance.

    Source: the first variation of area; Dierkes, Hildebrandt & Sauvigny, "Minimal Surfaces" (2010), section 2.1.
    """
    rims = as_rims(points)
    area: Tensor = _Area.apply(solved(rims, corners, model, tolerance, time_limit), *rims)  # type: ignore[no-untyped-call]
    return area


def as_rims(points: Any) -> tuple[Tensor, ...]:
    """The tensors of the rims. Raises an OptionError for other arguments."""
    rims = (points,) if isinstance(points, Tensor) else tuple(points)
    for rim in rims:
        if not isinstance(rim, Tensor) or not rim.is_floating_point():
            raise OptionError(f"points must be a real tensor of shape (m, 3), or one for each rim, got {rim!r:.60}")
    if not rims:
        raise OptionError("points must be a tensor of shape (m, 3), or one for each rim, got no rim")
    return rims


def solved(
    rims: Sequence[Tensor], corners: Corners, model: Model, tolerance: float, time_limit: float
) -> PlateauSolution:
    """The solution over tensors of points, with the errors and warnings of `minimal_area`."""
    given: Any = corners
    of_rims = [given] if len(rims) == 1 else [given] * len(rims) if isinstance(given, str) or not len(given) else given
    if len(of_rims) != len(rims):
        raise OptionError(f"corners must have one entry for each of {len(rims)} rims, got {len(of_rims)}")
    loops = [
        BoundaryLoop.from_points(rim.detach().double().cpu().numpy(), corners=own)
        for rim, own in zip(rims, of_rims, strict=True)
    ]
    for loop, rim in zip(loops, rims, strict=True):
        if len(loop) != len(rim):
            raise OptionError("the last point of a rim is equal to the first; remove it")
    device = rims[0].device if rims[0].device.type != "cpu" else None
    solution = solve_plateau(
        loops, model=model, tolerance=tolerance, between="quintic", time_limit=time_limit, device=device
    )
    if isinstance(solution, NoConnectedSurface):
        raise SurfaceError(f"{solution.reason}; move the rims towards each other")
    if not solution.converged:
        missed = f"the surface has not converged, so that its derivatives are approximate ({solution.reason})"
        warnings.warn(missed, UncertainGradientWarning, stacklevel=3)
    return solution


def require_first_order() -> None:
    """Raises a NotDifferentiableError in a backward pass with create_graph=True, which needs second derivatives."""
    if torch.is_grad_enabled():
        raise NotDifferentiableError("second derivatives of minimal surfaces are not available; leave out create_graph")


class _Area(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, solution: PlateauSolution, *rims: Tensor) -> Tensor:
        ctx.solution, ctx.rims = solution, [(rim.dtype, rim.device) for rim in rims]
        return torch.tensor(solution.area, dtype=torch.float64, device=rims[0].device)

    @staticmethod
    def backward(ctx: Any, by_area: Tensor) -> tuple[Tensor | None, ...]:
        require_first_order()
        gradients = zip(ctx.solution.area_gradient, ctx.rims, strict=True)
        return (None, *(by_area * torch.as_tensor(rows).to(device).to(dtype) for rows, (dtype, device) in gradients))


# Distance of the eigenvalue from 1 below which a surface counts as degenerate: that of the last catenoid, exactly 1, is
# computed as 1.002.
_DEGENERATE = 5e-3


def minimal_surface(
    points: Tensor | Sequence[Tensor],
    *,
    corners: Corners = (),
    model: Model = "auto",
    tolerance: float = 1e-6,
    time_limit: float = math.inf,
    target_edge_length: float | Literal["auto"] = "auto",
) -> tuple[Float[Tensor, "n 3"], Int[Tensor, "f 3"]]:
    """A mesh (vertices, faces) of the minimal surface over points. Its vertices are differentiable in the points.

    The mesh is that of `mesh_patch`, but the points are the only vertices of its rims. They come first, in the given
    order and direction. When the points move, an inner vertex moves along the normal, and stays on the minimal surface
    to first order. The displacement solves Jacobi's equation, and `backward` solves its adjoint once. Second
    derivatives and `torch.func.vmap` are not available.

    Args:
        points: as for `minimal_area`.
        corners: as for `minimal_area`.
        model: as for `minimal_area`.
        tolerance: as for `minimal_area`.
        time_limit: as for `minimal_area`, for the surface and its mesh.
        target_edge_length: as for `mesh_patch`.

    Returns:
        Vertices in float64 and faces, on the device of the points.

    Raises:
        SpinorGeomError: the errors of `minimal_area` and `mesh_patch`.
        OutOfTimeError: the time limit was reached before the mesh was complete.
        NotDifferentiableError: by `backward`, if the surface is unstable or nearly so, see `require_isolated`.

    Warns:
        UncertainGradientWarning: as `minimal_area`, by `backward`, if the stability is undecided.

    Source: Barbosa & do Carmo, Amer. J. Math. 98 (1976), for the second variation and its operator.
    """
    rims = as_rims(points)
    with deadline.time_limit(time_limit):
        solution = solved(rims, corners, model, tolerance, time_limit)
        patch = mesh_over_points(solution, target_edge_length)
    if not patch.is_complete:
        raise OutOfTimeError
    size = patch.boundary_size
    given = np.concatenate(as_given(solution, np.split(np.arange(size), np.cumsum(patch.rims)[:-1])))
    numbers = np.arange(len(patch.vertices))
    numbers[given] = np.arange(size)
    positions = np.concatenate([patch.vertices[given], patch.vertices[size:]])
    faces = torch.tensor(numbers[patch.faces], device=rims[0].device)
    vertices: Tensor = _Positions.apply(solution, patch.points[size:], positions, *rims)  # type: ignore[no-untyped-call]
    return vertices, faces


def nearest_on_surface(
    points: Tensor | Sequence[Tensor],
    places: Float[Tensor, "k 3"],
    *,
    corners: Corners = (),
    model: Model = "auto",
    tolerance: float = 1e-6,
    time_limit: float = math.inf,
) -> Float[Tensor, "k 3"]:
    """The points of the minimal surface over `points` that are nearest to given places, differentiable in `points`.

    When the points move, a position moves along the normal, as for `minimal_surface`. `places` are constants.

    Args:
        points: as for `minimal_area`.
        places: positions in mesh units.
        corners: as for `minimal_area`.
        model: as for `minimal_area`.
        tolerance: as for `minimal_area`.
        time_limit: as for `minimal_area`.

    Raises:
        OptionError: a place is nearest to the boundary of the surface.
        SurfaceError: the nearest point was not found.
        SpinorGeomError: the errors of `minimal_surface`.
    """
    rims = as_rims(points)
    solution = solved(rims, corners, model, tolerance, time_limit)
    z = nearest(solution, places.detach().double().cpu().numpy())
    positions: Tensor = _Positions.apply(solution, z, solution.array_surface.position(z), *rims)  # type: ignore[no-untyped-call]
    return positions


def require_isolated(solution: PlateauSolution) -> None:
    """Checks that a solution depends smoothly on its boundary: its second variation has no eigenvalue near 0.

    Raises a NotDifferentiableError if the surface is unstable, or nearly so. Warns with an UncertainGradientWarning if
    the stability is undecided, or follows only from a total curvature just below 2π.
    """
    stability = solution.stability
    if stability.verdict == "unstable":
        raise NotDifferentiableError(
            "the surface is unstable, so that a solve over moved points may find another one; use its area_gradient, "
            "which is valid for any critical point"
        )
    if stability.eigenvalue is not None and abs(stability.eigenvalue - 1) < _DEGENERATE:
        raise NotDifferentiableError(
            f"the surface is degenerate (the eigenvalue {stability.eigenvalue:.6g} of its second variation is nearly "
            "1), so that it may jump when points move; move the rims towards each other, or points away from this place"
        )
    # the eigenvalue of a spherical cap of area 2π(1 − ε) is a lower bound, and above 1 + ε
    by_curvature = stability.eigenvalue is None and (stability.total_curvature or 0.0) > 2 * np.pi * (1 - _DEGENERATE)
    if stability.verdict == "undecided" or by_curvature:
        known = (
            f"nearly degenerate: its total curvature is {stability.total_curvature:.6g}"
            if by_curvature
            else "undecided"
        )
        reason = f"the stability of the surface is {known}; its positions may not be differentiable"
        warnings.warn(reason, UncertainGradientWarning, stacklevel=2)


class _Positions(torch.autograd.Function):
    """Positions at points z inside Ω. If `positions` begins with the points of the rims, these come first."""

    @staticmethod
    def forward(
        ctx: Any, solution: PlateauSolution, z: Complex[np.ndarray, " v"], positions: np.ndarray, *rims: Tensor
    ) -> Tensor:
        ctx.solution, ctx.z, ctx.rims = solution, z, [(rim.dtype, rim.device) for rim in rims]
        return torch.tensor(positions, device=rims[0].device)

    @staticmethod
    def backward(ctx: Any, by_positions: Tensor) -> tuple[Tensor | None, ...]:
        require_first_order()
        gradient = by_positions.double().cpu().numpy()
        split = len(gradient) - len(ctx.z)
        own = position_gradient(ctx.solution, ctx.z, gradient[split:])
        if split:
            on_rims = np.split(gradient[:split], np.cumsum([len(rows) for rows in own])[:-1])
            own = tuple(a + b for a, b in zip(own, on_rims, strict=True))
        pairs = zip(own, ctx.rims, strict=True)
        return (None, None, None, *(torch.tensor(rows).to(device, dtype) for rows, (dtype, device) in pairs))


def normal_fields(solution: PlateauSolution, z: Complex[np.ndarray, " v"]) -> SlideAdjoint | JacobiFields:
    """Normal displacements at points inside Ω: by `SlideAdjoint` if ∂Ω consists of circles, else by least squares."""
    on_circles = solution.route in ("disk", "annulus", "circles")
    return (SlideAdjoint if on_circles else JacobiFields)(solution=solution, z=z, rims=RimNodes.all_of(solution))


def position_gradient(
    solution: PlateauSolution, z: Complex[np.ndarray, " v"], by_positions: Float[np.ndarray, "v 3"]
) -> tuple[Float[np.ndarray, "_ 3"], ...]:
    """The gradients in the points of each given loop, from that in positions inside Ω, which move along the normal.

    Raises a NotDifferentiableError as `require_isolated`, or if a position is a branch point.
    """
    require_isolated(solution)
    by_u = (by_positions * np.asarray(solution.array_surface.normal(z))).sum(axis=1)
    if not np.isfinite(by_u).all():
        raise NotDifferentiableError("a vertex is a branch point of the surface, which has no normal there; move it")
    with one_thread(), typed_failures():
        fields = normal_fields(solution, z)
        weights = fields.by_boundary(by_u)
        parts = zip(solution.rims, fields.rims, weights, strict=True)
        return as_given(solution, [by_points(rim.curve, nodes.places, own) for rim, nodes, own in parts])
