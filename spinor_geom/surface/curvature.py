"""Fundamental forms of any parametrised surface, by automatic differentiation of its position.

Nothing here knows about p and q: it measures what `position` says, and so can confirm or refute that it is minimal.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Complex, Float
from torch import Tensor
from torch.func import jvp

Points = Complex[Tensor, " n"]
Position = Callable[[Float[Tensor, "*pts"], Float[Tensor, "*pts"]], Float[Tensor, "*pts 3"]]
_NODES = 1 << 15  # nodes of rules at once: they carry derivatives of two orders


@dataclass(frozen=True, kw_only=True, eq=False)
class FundamentalForms:
    """First and second fundamental form of a surface r(x, y) at some points."""

    first: Float[Tensor, "*pts 2 2"]  # ((r_x·r_x, r_x·r_y), (r_x·r_y, r_y·r_y))
    second: Float[Tensor, "*pts 2 2"]  # ((r_xx·n, r_xy·n), (r_xy·n, r_yy·n))
    normal: Float[Tensor, "*pts 3"]  # n = (r_x × r_y)/|r_x × r_y|

    @property
    def mean(self) -> Float[Tensor, "*pts"]:
        """Mean curvature H = ½ tr(I⁻¹ II), in 1/length; positive where the surface bends towards n."""
        (g_xx, g_xy, _, g_yy), (b_xx, b_xy, _, b_yy) = (f.flatten(-2).unbind(-1) for f in (self.first, self.second))
        return (g_xx * b_yy - 2 * g_xy * b_xy + g_yy * b_xx) / (2 * (g_xx * g_yy - g_xy * g_xy))


def fundamental_forms(position: Position, x: Float[Tensor, "*pts"], y: Float[Tensor, "*pts"]) -> FundamentalForms:
    """Fundamental forms of r = position(x, y), all points at once; it is differentiated twice in forward mode."""
    # one tangent for the whole batch gives every point's derivative, because points do not mix
    along_x, along_y = (torch.ones_like(x), torch.zeros_like(y)), (torch.zeros_like(x), torch.ones_like(y))

    def slope(x: Float[Tensor, "*pts"], y: Float[Tensor, "*pts"]) -> Float[Tensor, "*pts 3"]:
        derivative: Tensor = jvp(position, (x, y), along_x)[1]
        return derivative

    with warnings.catch_warnings():
        # torch compiles some rules of forward mode on first use, by a function that it has itself deprecated
        warnings.filterwarnings("ignore", message=".*torch.jit.script", category=DeprecationWarning)
        r_x, r_xx, *_ = jvp(slope, (x, y), along_x)
        r_xy = jvp(slope, (x, y), along_y)[1]
        r_y, r_yy, *_ = jvp(lambda x, y: jvp(position, (x, y), along_y)[1], (x, y), along_y)
    normal = torch.nn.functional.normalize(torch.linalg.cross(r_x, r_y), dim=-1)
    tangents, bends = torch.stack([r_x, r_y], dim=-2), torch.stack([r_xx, r_xy, r_xy, r_yy], dim=-2)
    second = (bends * normal[..., None, :]).sum(-1).reshape(*x.shape, 2, 2)
    return FundamentalForms(first=tangents @ tangents.mT, second=second, normal=normal)


def mean_curvature_of_integrals(
    integrate: Callable[[Points, Points], Float[Tensor, "n 3"]], start: Points, end: Points, *, order: int
) -> Float[Tensor, " n"]:
    """H, in 1/length, at the ends of segments that a rule draws, by automatic differentiation; starts are constants."""

    def mean(a: Points, b: Points) -> Float[Tensor, " n"]:
        return fundamental_forms(lambda x, y: integrate(a, torch.complex(x, y)), b.real, b.imag).mean

    blocks = (torch.split(z, max(1, _NODES // order)) for z in (start, end))
    return torch.cat([mean(a, b) for a, b in zip(*blocks, strict=True)])
