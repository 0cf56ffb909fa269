"""The paper's experiments, repeated with its training and with our solvers."""

NAMES = {
    **dict.fromkeys(("twisted-circle", "tennis-seam"), "forms"),
    "prescribed": "trainings",
    **dict.fromkeys(("heat-maps", "mean-curvature", "catenoid"), "integration"),
    **dict.fromkeys(("tangents", "timing"), "trainings"),
    "branch-points": "forms",
}
"""For each experiment, the module of this package that has it in `EXPERIMENTS`."""
