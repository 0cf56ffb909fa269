"""The twisted circle: spinors against the Weierstrass-Enneper form."""

from __future__ import annotations

from spinor_geom.experiments.baselines import FULL, QUICK, Trainings, compare
from spinor_geom.experiments.experiment import Experiment, Outcome
from spinor_geom.gallery import twisted_circle


def measure(settings: Trainings) -> Outcome:
    """Trains both forms."""
    return compare(twisted_circle(), settings, name="twisted-circle")


EXPERIMENT = Experiment(
    title="spinors against Weierstrass-Enneper on the twisted circle",
    paper="(R cos t, R sin t, α sin kt) with R = 1, k = 3, α = 0.2; networks of 10 layers of 20 units, RMSprop, 800 "
    "epochs; the spinors come near to the curve, the Weierstrass-Enneper form fails.",
    here="The same training from the same random numbers, then a network of ours and Douglas-Newton. Seen means that "
    "the Weierstrass-Enneper form stays at least twice as far from the curve. Crosses mark branch points.",
    measure=measure,
    full=FULL,
    quick=QUICK,
)
