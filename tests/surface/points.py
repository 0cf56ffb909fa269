"""Points of plane domains."""

import numpy as np


def inside(domain, n, seed=0):
    """Random points of Ω, up to its boundary."""
    rng = np.random.default_rng(seed)
    mesh = domain.triangulation
    faces = mesh.points[mesh.faces[rng.integers(len(mesh.faces), size=n)]]
    return (faces * rng.dirichlet([1, 1, 1], size=n)).sum(axis=1)
