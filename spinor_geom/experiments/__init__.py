"""The paper's experiments, made anew from measured data, with our solvers beside its own.

Each name is a module of this package, its dashes underscores, with an `EXPERIMENT`. Importing the package imports none.
"""

NAMES = (
    "twisted-circle",
    "tennis-seam",
    "prescribed",
    "heat-maps",
    "mean-curvature",
    "catenoid",
    "tangents",
    "timing",
    "branch-points",
)
