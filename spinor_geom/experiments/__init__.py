"""The paper's experiments, repeated with its training and with our solvers."""

NAMES = {
    **dict.fromkeys(("twisted-circle", "tennis-seam"), "forms"),
    **dict.fromkeys(("heat-maps", "mean-curvature", "catenoid"), "integration"),
    **dict.fromkeys(("prescribed", "tangents"), "trainings"),
    "branch-points": "forms",
}
"""The module of this package that defines each experiment."""
