"""Mean curvature of any parametrised surface, by automatic differentiation of its position.

The formula holds for any surface and does not assume H = 0.
"""

import warnings
from collections.abc import Callable

from jaxtyping import Complex, Float

from spinor_geom.holomorphic.blocks import in_blocks
from spinor_geom.torch_extra import Tensor, torch

Points = Complex[Tensor, " n"]
Position = Callable[[Float[Tensor, " n"], Float[Tensor, " n"]], Float[Tensor, "n 3"]]
_ENTRIES_PER_NODE = 4  # numbers in memory: the node and its derivatives


def mean_curvature(position: Position, x: Float[Tensor, " n"], y: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Mean curvature H = ½ tr(I⁻¹ II) of r = position(x, y), in 1/length, positive where it bends towards r_x × r_y.

    The position is differentiated twice in forward mode, at all points at once.
    """
    # points are independent, so one tangent vector for all of them gives the derivative of each
    along_x, along_y = (torch.ones_like(x), torch.zeros_like(y)), (torch.zeros_like(x), torch.ones_like(y))

    def slope(x: Float[Tensor, " n"], y: Float[Tensor, " n"]) -> Float[Tensor, "n 3"]:
        derivative: Tensor = torch.func.jvp(position, (x, y), along_x)[1]
        return derivative

    with warnings.catch_warnings():
        # torch compiles some rules of forward mode on first use, by a function that is deprecated in torch
        warnings.filterwarnings("ignore", message=".*torch.jit.script", category=DeprecationWarning)
        r_x, r_xx, *_ = torch.func.jvp(slope, (x, y), along_x)
        r_xy = torch.func.jvp(slope, (x, y), along_y)[1]
        r_y, r_yy, *_ = torch.func.jvp(lambda x, y: torch.func.jvp(position, (x, y), along_y)[1], (x, y), along_y)
    normal = torch.nn.functional.normalize(torch.linalg.cross(r_x, r_y), dim=-1)
    e, f, g = ((a * b).sum(-1) for a, b in ((r_x, r_x), (r_x, r_y), (r_y, r_y)))
    xx, xy, yy = ((bend * normal).sum(-1) for bend in (r_xx, r_xy, r_yy))
    mean: Tensor = (e * yy - 2 * f * xy + g * xx) / (2 * (e * g - f * f))
    return mean


def mean_curvature_of_integrals(
    integrate: Callable[[Points, Points], Float[Tensor, "n 3"]], start: Points, end: Points, *, order: int
) -> Float[Tensor, " n"]:
    """H at the ends of segments of the surface integrate(start, end), which takes `order` nodes for each segment."""

    def mean(a: Points, b: Points) -> Float[Tensor, " n"]:
        return mean_curvature(lambda x, y: integrate(a, torch.complex(x, y)), b.real, b.imag)

    curvature: Tensor = in_blocks(mean, start, end, width=_ENTRIES_PER_NODE * order)
    return curvature
