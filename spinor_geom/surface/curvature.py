"""Fundamental forms of any parametrised surface, by automatic differentiation of its position.

Nothing here knows about p and q: it measures what `position` says, and so can confirm or refute that it is minimal.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import cast

import torch
from jaxtyping import Float
from torch import Tensor
from torch.func import jvp

Position = Callable[[Float[Tensor, "*pts"], Float[Tensor, "*pts"]], Float[Tensor, "*pts 3"]]


@dataclass(frozen=True, kw_only=True, eq=False)
class FundamentalForms:
    """First and second fundamental form of a surface r(x, y) at some points.

    Attributes:
        first: ((r_x·r_x, r_x·r_y), (r_x·r_y, r_y·r_y)).
        second: ((r_xx·n, r_xy·n), (r_xy·n, r_yy·n)).
        normal: n = (r_x × r_y)/|r_x × r_y|.
    """

    first: Float[Tensor, "*pts 2 2"]
    second: Float[Tensor, "*pts 2 2"]
    normal: Float[Tensor, "*pts 3"]

    @property
    def mean(self) -> Float[Tensor, "*pts"]:
        """Mean curvature H = ½ tr(I⁻¹ II), in 1/length; positive where the surface bends towards n."""
        e, f, g = _entries(self.first)
        l, m, n = _entries(self.second)  # noqa: E741 - the names of the field
        return (e * n - 2 * f * m + g * l) / (2 * (e * g - f * f))

    @property
    def gauss(self) -> Float[Tensor, "*pts"]:
        """Gauss curvature K = det II/det I, in 1/length²."""
        e, f, g = _entries(self.first)
        l, m, n = _entries(self.second)  # noqa: E741 - the names of the field
        return (l * n - m * m) / (e * g - f * f)


def fundamental_forms(position: Position, x: Float[Tensor, "*pts"], y: Float[Tensor, "*pts"]) -> FundamentalForms:
    """Fundamental forms of r = position(x, y), all points at once.

    Args:
        position: evaluates the surface point by point; differentiable twice in forward mode.
        x: first coordinates.
        y: second coordinates, same shape.
    """
    with warnings.catch_warnings():
        # torch compiles some rules of forward mode on first use, by a function that it has itself deprecated
        warnings.filterwarnings("ignore", message=".*torch.jit.script", category=DeprecationWarning)
        r_x, r_xx = _derivatives(position, x, y, (1.0, 0.0), (1.0, 0.0))
        r_y, r_yy = _derivatives(position, x, y, (0.0, 1.0), (0.0, 1.0))
        _, r_xy = _derivatives(position, x, y, (1.0, 0.0), (0.0, 1.0))
    normal = torch.nn.functional.normalize(torch.linalg.cross(r_x, r_y), dim=-1)
    return FundamentalForms(
        first=_symmetric(_dot(r_x, r_x), _dot(r_x, r_y), _dot(r_y, r_y)),
        second=_symmetric(_dot(r_xx, normal), _dot(r_xy, normal), _dot(r_yy, normal)),
        normal=normal,
    )


def _derivatives(
    position: Position,
    x: Float[Tensor, "*pts"],
    y: Float[Tensor, "*pts"],
    first: tuple[float, float],
    second: tuple[float, float],
) -> tuple[Float[Tensor, "*pts 3"], Float[Tensor, "*pts 3"]]:
    """The derivative of the position along `first`, and the derivative of that along `second`."""
    inner = partial(_along, position, first)
    value, derivative, *_ = jvp(inner, (x, y), (torch.full_like(x, second[0]), torch.full_like(y, second[1])))
    return value, derivative


def _along(
    position: Position, direction: tuple[float, float], x: Float[Tensor, "*pts"], y: Float[Tensor, "*pts"]
) -> Float[Tensor, "*pts 3"]:
    # one tangent for the whole batch gives every point's derivative, because points do not mix
    _, derivative, *_ = jvp(position, (x, y), (torch.full_like(x, direction[0]), torch.full_like(y, direction[1])))
    return cast(Tensor, derivative)


def _dot(a: Float[Tensor, "*pts 3"], b: Float[Tensor, "*pts 3"]) -> Float[Tensor, "*pts"]:
    return (a * b).sum(dim=-1)


def _symmetric(
    a: Float[Tensor, "*pts"], b: Float[Tensor, "*pts"], c: Float[Tensor, "*pts"]
) -> Float[Tensor, "*pts 2 2"]:
    return torch.stack([torch.stack([a, b], dim=-1), torch.stack([b, c], dim=-1)], dim=-2)


def _entries(form: Float[Tensor, "*pts 2 2"]) -> tuple[Float[Tensor, "*pts"], ...]:
    return form[..., 0, 0], form[..., 0, 1], form[..., 1, 1]
