"""The paper's experiments, repeated with its training and with our solvers."""

NAMES = {
    **dict.fromkeys(("twisted-circle", "tennis-seam"), "forms"),
    "prescribed": "trainings",
    **dict.fromkeys(("heat-maps", "mean-curvature", "catenoid"), "integration"),
    **dict.fromkeys(("tangents", "timing"), "trainings"),
    "branch-points": "forms",
}
"""The module of this package that defines each experiment."""
