"""What a second try fails at must not cost the result of the first."""

from dataclasses import replace

import numpy as np
import pytest

from spinor_geom import gallery
from spinor_geom.errors import DomainError, FirstFillError, SingularMatrixError
from spinor_geom.plateau import network_route, solve_plateau, task
from spinor_geom.plateau.harmonic_route import HarmonicSolver
from spinor_geom.plateau.network import Discretisation
from spinor_geom.plateau.network_route import NetworkSolver


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
    monkeypatch.setattr(Discretisation, "moved", fails)
    solution = solve_plateau(loop, tolerance=1e-6)
    assert not solution.converged
    assert solution.boundary_residual.rms_per_edge < 0.1


SMALL = gallery.twisted_circle().sample(40)


def test_network_takes_over_where_the_harmonic_route_finds_nothing(monkeypatch):
    monkeypatch.setattr(HarmonicSolver, "tries", lambda _: iter(()))
    solution = solve_plateau(SMALL)
    assert solution.route == "network"
    assert solution.converged


def poor_tries(factor):
    """Tries whose distances from Γ are called larger than they are."""
    tries = HarmonicSolver.tries

    def poor(self):
        for found in tries(self):
            yield replace(found, misfit=found.misfit.enlarged(factor))

    return poor


def test_network_that_comes_nearer_is_taken_with_the_steps_of_both(monkeypatch):
    monkeypatch.setattr(HarmonicSolver, "tries", poor_tries(1e9))
    solution = solve_plateau(SMALL)
    assert solution.route == "network"
    assert solution.converged
    methods = [step.method for step in solution.history]
    assert methods.index("Gauss-Newton") == methods.count("Douglas-Newton") > 0
    assert [step.index for step in solution.history] == list(range(1, len(methods) + 1))


@pytest.mark.parametrize(
    "error",
    [DomainError("folded"), FirstFillError("no fill"), SingularMatrixError(size=3)],
    ids=["domain", "fill", "matrix"],
)
def test_poor_harmonic_disk_stands_where_the_network_fails(monkeypatch, error):
    def fails(*_):
        raise error

    monkeypatch.setattr(HarmonicSolver, "tries", poor_tries(1e9))
    monkeypatch.setattr(NetworkSolver, "found_from", fails)
    solution = solve_plateau(SMALL)
    assert solution.route != "network"
    assert not solution.converged
    monkeypatch.setattr(HarmonicSolver, "tries", lambda _: iter(()))
    with pytest.raises(type(error)):
        solve_plateau(SMALL)


def test_poor_harmonic_disk_stands_where_there_is_no_first_fill(monkeypatch):
    def fails(_):
        raise FirstFillError("no fill")

    monkeypatch.setattr(HarmonicSolver, "tries", poor_tries(1e9))
    monkeypatch.setattr(task, "first_disk", fails)
    assert solve_plateau(SMALL).route != "network"


@pytest.mark.parametrize("factor", [1.0, 1e8], ids=["met", "missed by less than a hundredth of an edge"])
def test_network_is_asked_where_the_tolerance_is_missed_and_only_there(monkeypatch, factor):
    asked = []

    def fails(*_):
        asked.append(1)
        raise DomainError("folded")

    monkeypatch.setattr(HarmonicSolver, "tries", poor_tries(factor))
    monkeypatch.setattr(NetworkSolver, "found_from", fails)
    solution = solve_plateau(SMALL, tolerance=1e-6)
    assert solution.boundary_residual.rms_per_edge < 1e-2
    assert solution.converged == (factor == 1)
    assert len(asked) == (factor > 1)


def test_steps_of_routes_that_found_nothing_count(monkeypatch):
    tries = HarmonicSolver.tries

    def in_vain(self):
        for _ in tries(self):
            pass
        yield from ()

    monkeypatch.setattr(HarmonicSolver, "tries", in_vain)
    heard = []
    solution = solve_plateau(SMALL, unstable="keep", on_iteration=heard.append)
    assert solution.route == "network"
    assert tuple(heard) == solution.history
    assert {step.method for step in heard} == {"Douglas-Newton", "Gauss-Newton"}
    assert [step.index for step in heard] == list(range(1, len(heard) + 1))
    limited = solve_plateau(SMALL, unstable="keep", max_iterations=5)
    assert len(limited.history) == 5
    assert "limit on steps" in limited.reason
