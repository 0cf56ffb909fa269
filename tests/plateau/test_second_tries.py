"""What a second try fails at must not cost the result of the first."""

import pytest

from spinor_geom import gallery
from spinor_geom.errors import DomainError, SingularMatrixError
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.network import network_route


@pytest.mark.parametrize("error", [DomainError("folded"), SingularMatrixError(size=3)], ids=["domain", "matrix"])
def test_first_fit_stands_where_no_finer_disk_can_be_made(monkeypatch, error):
    def fails(*_):
        raise error

    loop = gallery.l_shape(0.5).sample(32)
    monkeypatch.setattr(network_route, "finer_disk", fails)
    solution = solve_plateau(loop, model="cauchy", tolerance=1e-13)
    assert not solution.converged
    assert solution.boundary_residual.rms_per_edge < 1e-3
