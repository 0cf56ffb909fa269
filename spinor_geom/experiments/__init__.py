"""The paper's experiments on data measured here, with our solvers beside its training."""

NAMES = {
    **dict.fromkeys(("twisted-circle", "tennis-seam"), "forms"),
    "prescribed": "trainings",
    **dict.fromkeys(("heat-maps", "mean-curvature", "catenoid"), "integration"),
    **dict.fromkeys(("tangents", "timing"), "trainings"),
    "branch-points": "forms",
}
"""The module of this package whose `EXPERIMENTS` has each experiment."""
