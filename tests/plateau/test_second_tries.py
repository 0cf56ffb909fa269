"""What a second try fails at must not cost the result of the first."""

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.errors import DomainError, SingularMatrixError
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.network import discretisation, network_route
from spinor_geom.plateau.network.discretisation import Discretisation


@pytest.mark.parametrize("error", [DomainError("folded"), SingularMatrixError(size=3)], ids=["domain", "matrix"])
def test_first_fit_stands_where_no_finer_disk_can_be_made(monkeypatch, error):
    def fails(*_):
        raise error

    loop = gallery.twisted_circle().sample(32)
    monkeypatch.setattr(network_route, "finer_disk", fails)
    solution = solve_plateau(loop, model="cauchy", tolerance=1e-13)
    assert not solution.converged
    assert solution.boundary_residual.rms_per_edge < 1e-3


def test_fit_stands_where_the_domain_cannot_move(monkeypatch):
    def fails(*_, **__):
        raise DomainError("the moved domain is not simple")

    loop = gallery.catenoid(0.5, turn=np.pi).rim(64)
    monkeypatch.setattr(discretisation, "_MAX_FEATURES", 60)  # more bring it no nearer, in more time
    monkeypatch.setattr(Discretisation, "moved", fails)
    solution = solve_plateau(loop, tolerance=1e-6, between="smooth")
    assert not solution.converged
    assert solution.boundary_residual.rms_per_edge < 0.1
