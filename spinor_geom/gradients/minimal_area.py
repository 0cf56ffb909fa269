"""The area of a minimal surface as a differentiable function of the points of its boundary curves."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

from jaxtyping import Float
from numpy.typing import ArrayLike

from spinor_geom.errors import NotDifferentiableError, OptionError, SurfaceError, UncertainGradientWarning
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.options import Model
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.solve import solve_plateau
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
    """Area of the minimal surface over ordered points, or between several rims; differentiable in the points.

    The curve through the points is a spline of degree 5 at any positions of the points, as with
    `solve_plateau(..., between="quintic")`, so that area and gradient are continuous. The gradient is ∮ ν·δΓ ds, see
    `PlateauSolution.area_gradient`; it takes a small part of the time of the solve. Second derivatives and
    `torch.func.vmap` are not available.

    Args:
        points: (m, 3) real positions in mesh units, on any device; or one such tensor for each rim.
        corners: indices of the points that are corners; for several rims one entry for each. "auto" detects them, so
            that the area jumps where a moved point becomes a corner.
        model: as for `solve_plateau`.
        tolerance: as for `solve_plateau`; the relative error of the gradient is about that of the boundary. For smooth
            curves the residual is at most 1e-8 of an edge with any tolerance.
        time_limit: as for `solve_plateau`, in seconds; the derivative is computed after it.

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
    """The tensors of the rims; raises an OptionError for other arguments."""
    rims = (points,) if isinstance(points, Tensor) else tuple(points)
    for rim in rims:
        if not isinstance(rim, Tensor) or not rim.is_floating_point():
            raise OptionError(f"points must be a real tensor of shape (m, 3), or one for each rim, got {rim!r:.60}")
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
