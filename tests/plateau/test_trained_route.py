"""Plateau's problem by networks that are trained."""

from __future__ import annotations

import numpy as np

from spinor_geom import gallery
from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.plateau import solve_plateau
from spinor_geom.plateau.options import Options
from spinor_geom.training import RMSprop, train_by_rmsprop

CURVE = gallery.twisted_circle()
SMALL = RMSprop(depth=2, width=5, points=64, batch=32, epochs=3, order=8)


def farthest(solution, count=300):
    r = solution.surface.position(solution.domain.boundary.point(np.arange(count) / count))
    return np.linalg.norm(r - solution.curve.point(solution.curve.nearest(r)), axis=1).max()


def test_levenberg_marquardt_is_the_default_and_meets_the_curve():
    assert Options(model="mlp", optimizer="levenberg-marquardt").trainer == Options(model="mlp").trainer
    steps = []
    solution = solve_plateau(CURVE, model="mlp", on_iteration=steps.append)
    assert solution.route == "trained"
    assert solution.converged
    assert isinstance(solution.array_surface.model, ComplexMLP)
    assert farthest(solution) < 1.1e-6 * solution.loop.diagonal
    assert abs(solution.area / CURVE.disks[0].area - 1) < 1e-6
    assert solution.stability.verdict == "stable"
    assert steps == list(solution.history)
    assert [step.index for step in steps] == list(range(1, len(steps) + 1))
    # the curve is so smooth that the distilled network needs no polish
    assert [*dict.fromkeys(step.method for step in steps)][:2] == ["Douglas-Newton", "distillation"]


def test_without_a_warm_start_it_begins_at_random_on_the_disk():
    solution = solve_plateau(CURVE, model="mlp", warm_start=False)
    assert {step.method for step in solution.history} == {"polishing"}
    assert np.allclose(abs(solution.domain.boundary.vertices), 1)
    assert farthest(solution) < 1e-4 * solution.loop.diagonal


def test_rmsprop_is_the_paper_s_training_of_the_curve_at_the_size_of_the_unit_circle():
    solution = solve_plateau(CURVE, model="mlp", optimizer=SMALL)
    assert not solution.converged
    assert "all epochs were done" in solution.reason
    assert [step.method for step in solution.history] == ["RMSprop"] * 3
    size = 2 * np.sqrt(2) / solution.loop.diagonal
    own = train_by_rmsprop(gallery.twisted_circle(radius=size, amplitude=0.2 * size), options=SMALL)
    # the polynomials of Γ differ by little from the formulas
    assert np.allclose([step.residual for step in solution.history], [step.loss for step in own.history], rtol=1e-3)
