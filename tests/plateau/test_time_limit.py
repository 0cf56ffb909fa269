"""Whenever time runs out: a typed error while there is no surface, and later the best surface so far.

The clock counts how often it is read, so that each place in which time can run out is tried on any machine.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest

from spinor_geom import BoundaryLoop, deadline, gallery, solve_plateau, solve_plateau_batch
from spinor_geom.errors import OutOfTimeError
from spinor_geom.gradients.minimal_surface import minimal_surface
from spinor_geom.meshing.embed import mesh_patch
from spinor_geom.plateau.annulus import RimDisks
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from tests.fill.shapes import circle


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """Makes each reading of the clock take a second, and counts the readings."""
    counter = itertools.count()
    monkeypatch.setattr(deadline, "perf_counter", lambda: float(next(counter)))
    return lambda: next(counter)


def noisy(n: int, amount: float, *, seed: int = 0, height: float = 0.0) -> BoundaryLoop:
    ring = circle(n, height=height, bend=0.3)
    noise = amount * 2 * np.pi / n * np.random.default_rng(seed).normal(size=(n, 3))
    return BoundaryLoop.from_points(ring + noise, corners=())


def folded(seed: int) -> BoundaryLoop:
    """Three random harmonics: nodes crowd on the unit disk, and other routes follow."""
    t = 2 * np.pi * np.arange(32) / 32
    rng = np.random.default_rng(seed)
    waves = (rng.normal(size=3) * np.cos(k * t[:, None] + rng.uniform(0, 2 * np.pi, 3)) / k for k in range(1, 4))
    return BoundaryLoop.from_points(np.asarray(sum(waves)), corners=())


def box(n: int, seed: int) -> BoundaryLoop:
    return BoundaryLoop.from_points(np.random.default_rng(seed).uniform(-1, 1, (n, 3)))


def rims(distance: float) -> list[BoundaryLoop]:
    return [BoundaryLoop.from_points(circle(24, height=z, bend=0.1)) for z in (0.0, distance)]


CASES = {
    "smooth": (gallery.tennis_seam(0.8).sample(32), {}),
    "crowded": (folded(1), {}),
    "noisy, free": (noisy(60, 0.3), {"between": "free"}),
    "a polygon": (box(7, 3), {}),
    "between two": (rims(0.4), {}),
}
SLOW = {
    "unstable, and left": (gallery.enneper(1.3).rim(32), {}),
    "between two, noisy": ([noisy(20, 0.1), noisy(20, 0.1, seed=1, height=0.4)], {}),
    "by a network": (folded(5), {}),
    "after an unfolding, free": (folded(5), {"between": "free"}),
}


def cuts(looks: int) -> list[int]:
    """All readings of the clock, or, if there are many, some at equal distances and the last two."""
    return sorted({*np.linspace(1, looks, min(looks, 6)).astype(int).tolist(), max(1, looks - 1)})


@pytest.mark.parametrize("name", [*CASES, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_what_is_found_is_not_lost_when_time_is_over(name: str, clock: Callable[[], int]) -> None:
    loop, options = (CASES | SLOW)[name]
    before = clock()
    whole = solve_plateau(loop, **options)
    looks = clock() - before
    best = np.inf
    for cut in cuts(looks):
        try:
            found = solve_plateau(loop, time_limit=cut, **options)
        except OutOfTimeError:
            assert best == np.inf, f"cut {cut} of {looks} loses what an earlier one found"
            continue
        assert isinstance(found, PlateauSolution)
        assert found.converged or "time was reached" in found.reason or not whole.converged
        residual = found.boundary_residual.rms_per_edge
        # among those that meet the tolerance the one of less area is better, not the one that is nearer to Γ
        assert residual <= max(best * (1 + 1e-9), found.tolerance), f"cut {cut} of {looks} is worse than one before"
        best = min(best, residual)
    last = solve_plateau(loop, time_limit=looks + 10, **options)
    assert not isinstance(whole, NoConnectedSurface)
    assert last.area == whole.area  # time that is enough changes no bit


def test_bundles_keep_what_is_found_too(clock: Callable[[], int]) -> None:
    loops = [gallery.tennis_seam(0.8).sample(32), noisy(24, 0.2), folded(1), box(7, 3)]
    before = clock()
    whole = list(solve_plateau_batch(loops))
    looks = clock() - before
    found = [False] * len(loops)
    for cut in np.linspace(1, looks, 5).astype(int).tolist():
        for number, answer in enumerate(solve_plateau_batch(loops, time_limit=cut)):
            assert isinstance(answer, PlateauSolution) or (isinstance(answer, OutOfTimeError) and not found[number])
            found[number] |= isinstance(answer, PlateauSolution)
    assert all(found)
    assert all(isinstance(answer, PlateauSolution) for answer in whole)


def test_all_solutions_are_those_that_were_found_in_time(clock: Callable[[], int]) -> None:
    loop = gallery.enneper(1.3).rim(32)
    before = clock()
    whole = solve_plateau(loop, all_solutions=True)
    looks = clock() - before
    most = 0
    for cut in np.linspace(1, looks + 5, 4).astype(int).tolist():
        try:
            found = solve_plateau(loop, all_solutions=True, time_limit=cut)
        except OutOfTimeError:
            assert not most
            continue
        assert len(found) >= most
        most = len(found)
    assert most == len(whole) > 1


def test_a_verdict_that_time_cut_short_is_not_kept() -> None:
    (first, second) = rims(0.4)
    solution = solve_plateau([first, second])
    with deadline.time_limit(-1.0), pytest.raises(OutOfTimeError):
        _ = solution.is_area_minimum
    assert solution.is_area_minimum


def test_meshes_are_made_within_the_limit() -> None:
    solution = solve_plateau(gallery.tennis_seam(0.8).sample(32))
    with deadline.time_limit(-1.0):
        patch = mesh_patch(solution, 0.01)
    assert not patch.is_complete
    assert len(patch.vertices) < 1000  # with more time 50,000


def test_patches_for_cad_and_differentiable_meshes_have_a_limit() -> None:
    import torch

    from spinor_geom.gradients.minimal_surface import minimal_area

    loop = gallery.tennis_seam(0.8).sample(32)
    solution = solve_plateau(loop)
    whole, cut = (solution.to_nurbs(tolerance=1e-7, time_limit=seconds) for seconds in (60.0, 1e-9))
    assert whole.converged
    assert not cut.converged
    assert cut.size < whole.size
    assert "above the tolerance" in cut.reason
    points = torch.tensor(loop.points)
    for function in (minimal_area, minimal_surface):
        with pytest.raises(OutOfTimeError):
            function(points, time_limit=1e-9)


@pytest.mark.parametrize("joined", [1, 2])
def test_surfaces_over_fewer_rims_are_computed_within_the_time_limit(joined: int) -> None:
    disk = solve_plateau(BoundaryLoop.from_points(circle(16, 1.0, 0.0)))

    def over(numbers: tuple[int, ...]) -> PlateauSolution:
        if len(numbers) == joined:
            deadline.require_time()
        return disk

    compared = RimDisks(count=3, surface_over=over, seconds=0.0)
    assert (compared.all is None) == (joined == 1)
    assert compared.partitions == {}
