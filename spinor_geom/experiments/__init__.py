"""The paper's experiments, made anew from measured data, with our solvers beside its own."""

NAMES = {
    "twisted-circle": "forms",
    "tennis-seam": "forms",
    "prescribed": "trainings",
    "heat-maps": "quadrature",
    "mean-curvature": "quadrature",
    "catenoid": "quadrature",
    "tangents": "trainings",
    "timing": "trainings",
    "branch-points": "forms",
}
"""The module of this package that has each of them in its `EXPERIMENTS`."""
