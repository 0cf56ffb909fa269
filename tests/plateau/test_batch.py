"""Many loops at once: each is solved as if it were alone, and results and errors are in the order of the loops."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings

from spinor_geom import boundary_loops, gallery, read_mesh
from spinor_geom.errors import LoopsMeetError, OptionError, SpinorGeomError, UnknownMeshTypeError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau import solve_plateau, solve_plateau_batch
from tests.loops import CONVEX, planar
from tests.strategies import SEEDS

BOW_TIE = BoundaryLoop.from_points([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0)])
FOLDED = BoundaryLoop.from_points([(0, 0, 0), (1, 0, 0), (0.5, 0, 0), (0, 1, 1)])


def saddle(points: int, seed: int) -> BoundaryLoop:
    """A curve around a saddle, not quite regular."""
    random = np.random.default_rng(seed)
    t = 2 * np.pi * (np.arange(points) + 0.3 * random.random(points)) / points
    height, width = random.uniform(0.1, 0.6), random.uniform(0.5, 1)
    return BoundaryLoop.from_points(np.stack([np.cos(t), width * np.sin(t), height * np.cos(2 * t)], 1))


@settings(max_examples=3)
@given(seed=SEEDS)
def test_every_solution_is_the_one_of_its_loop_alone(seed):
    loops = [saddle(n, seed + n) for n in (5, 6, 6, 7, 20, 64)]
    loops += [planar(CONVEX, 12), gallery.ellipse(6).sample(40)]
    for loop, solution in zip(loops, solve_plateau_batch(loops), strict=True):
        alone = solve_plateau(loop)
        assert not isinstance(solution, SpinorGeomError)
        assert (solution.loop, solution.route, solution.converged) == (loop, alone.route, alone.converged)
        assert abs(solution.area / alone.area - 1) < 1e-7
        assert (solution.surface.normal(0j) @ alone.surface.normal(0j) if solution.route == "disk" else 1) > 1 - 1e-5
        assert len(solution.history) == len(alone.history)
        assert set(solution.timings) == set(alone.timings)


def test_errors_are_returned_at_the_indices_of_their_loops():
    loop = saddle(9, 0)
    wrong = {1: BOW_TIE, 3: FOLDED, 4: 3, 6: [loop, loop]}
    answers = list(solve_plateau_batch([wrong.get(i, loop.points if i == 5 else saddle(9, i)) for i in range(7)]))
    for i, loops in wrong.items():
        with pytest.raises((type(answers[i]), LoopsMeetError)):
            solve_plateau(loops)
    assert [type(answers[i]) for i in (4, 6)] == [UnknownMeshTypeError, OptionError]
    assert all(answers[i].converged for i in (0, 2, 5))
    assert answers[5].area == answers[0].area


def test_loops_are_taken_as_they_are_needed():
    taken = []

    def endless():
        for seed in itertools.count():
            taken.append(seed)
            yield saddle(6, seed)

    solutions = list(itertools.islice(solve_plateau_batch(endless()), 3))
    assert all(solution.converged for solution in solutions)
    assert len(taken) <= 128


def test_small_holes_of_a_real_mesh_take_few_steps_on_the_disk():
    holes = [loop for loop in boundary_loops(read_mesh("data/spot_cut.obj")) if len(loop) == 6]
    assert len(holes) > 50
    for solution in solve_plateau_batch(holes, between="smooth"):
        # steps along conformal maps of the disk led nodes to crowd where there were few, and never ended
        assert (solution.route, solution.converged) == ("disk", True)
        assert len(solution.history) <= 20
