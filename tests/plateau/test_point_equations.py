"""Newton's equations for integrals along paths: solutions of least norm."""

import numpy as np

import spinor_geom as sg
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.vertices.point_equations import PointEquations
from spinor_geom.surface.formulas import null_vector
from tests.holomorphic.test_cauchy_sums import random_complex


def equations(paths: int, features: int = 90) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random functions, of very different sizes, for paths around a rim, and right sides."""
    rng = np.random.default_rng(0)
    sizes = np.geomspace(1, 1e-3, features)[:, None]
    by_p, by_q = (sizes * random_complex(rng, features, paths) for _ in range(2))
    return by_p, by_q, rng.normal(size=(paths, 3))


def changes(by_p: np.ndarray, by_q: np.ndarray, readout: np.ndarray) -> np.ndarray:
    """Re of the null vectors of 2pδp, 2qδq and pδq + qδp, integrated."""
    pp, pq = (by_p.conj().T @ readout).T / 2
    qp, qq = (by_q.conj().T @ readout).T / 2
    return 2 * null_vector(pp, qq, (pq + qp) / 2).real


def test_steps_remove_the_error_with_the_least_norm() -> None:
    by_p, by_q, error = equations(20)
    step = PointEquations.of(by_p, by_q, np.roll(np.arange(20), 1)).step(error, None)
    # the damping leaves its share of the error, times the condition number 1e4 of the functions
    assert np.abs(changes(by_p, by_q, step) + error).max() < 1e-4
    # orthogonal to all changes that keep the integrals
    rng = np.random.default_rng(1)
    other = random_complex(rng, 90, 2)
    free = other + PointEquations.of(by_p, by_q).step(changes(by_p, by_q, other), None)
    assert abs((step.conj() * free).real.sum()) < 1e-3 * np.linalg.norm(step) * np.linalg.norm(free)


def test_the_new_readouts_are_the_nearest_to_given_ones() -> None:
    by_p, by_q, error = equations(20)
    linear = PointEquations.of(by_p, by_q)
    away = random_complex(np.random.default_rng(2), 90, 2)
    step = linear.step(error, away)
    assert np.abs(changes(by_p, by_q, step) + error).max() < 1e-4  # as above
    # from the given ones they differ by what the equations require
    np.testing.assert_allclose(step + away, linear.step(error - changes(by_p, by_q, away), None), atol=1e-9)


def test_saw_teeth_are_met() -> None:
    """Of 20°, on a wavy circle: damping of the edges alone keeps half an edge."""
    n = 100
    t = 2 * np.pi * np.arange(n) / n
    r = 1 + 0.5 * (-1.0) ** np.arange(n) * np.pi / n / np.tan(np.radians(10))
    points = np.column_stack([r * np.cos(t), r * np.sin(t), 0.3 * np.sin(2 * t)])
    solution = sg.solve_plateau(BoundaryLoop.from_points(points, corners=[]), between="free")
    assert solution.route == "vertices"
    assert solution.boundary_residual.rms_per_edge < 1e-2  # ten times the tolerance, for other machines' rounding
