import numpy as np
import pytest

from spinor_geom.nurbs.spline_space import SplineSpace

WHOLE, GRADED = (0.0, 1.0), (0.0, 1 / 64, 1 / 16, 1 / 4, 1.0)


@pytest.mark.parametrize("breaks", [WHOLE, GRADED, tuple(np.linspace(0, 1, 9))])
@pytest.mark.parametrize("degree", [1, 2, 5, 9])
def test_interpolation_is_well_conditioned_and_reproduces_polynomials(degree: int, breaks: tuple[float, ...]) -> None:
    space, x = SplineSpace.on(degree, breaks), np.linspace(0, 1, 501)
    cardinal = space.basis(x) @ space.interpolation
    assert np.abs(cardinal).sum(axis=1).max() < 3  # Lebesgue constants of Chebyshev points: 2.4 at degree 9
    assert np.abs(cardinal @ space.nodes**degree - x**degree).max() < 1e-12


def test_interpolation_converges_at_the_order_of_the_degree() -> None:
    errors = []
    for pieces in (8, 16, 32):
        space = SplineSpace.on(5, tuple(np.linspace(0, 1, pieces + 1).tolist()))
        errors.append(np.abs(space.to_between @ np.exp(3 * space.nodes) - np.exp(3 * space.between)).max())
    assert np.diff(np.log2(errors)).max() < -5.3  # order 6, less at the ends, where nodes are denser
