"""The tennis seam: spinors against the Weierstrass-Enneper form, and which of its minimal disks each method finds."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure
from numpy.typing import NDArray

from spinor_geom.experiments.baselines import ENNEPER, FULL, NETWORK, QUICK, SERIES, SPINOR, Trainings, compare
from spinor_geom.experiments.experiment import Experiment, Outcome
from spinor_geom.gallery import KnownCurve, KnownDisk, tennis_seam
from spinor_geom.plateau import solve_plateau

# a disk is the one whose area differs by less than this share of the least difference between two, or of its own
_SHARE_OF_GAP, _SHARE_OF_AREA = 0.2, 1e-3
LEFT, CAUCHY, ALONE = "Douglas-Newton, unstable left", "Cauchy network", "Levenberg-Marquardt, random start"


@dataclass(frozen=True, kw_only=True)
class SeamSettings:
    """Which seams, and how networks are trained.

    Attributes:
        parameters: a of each seam.
        trainings: of the networks.
    """

    parameters: tuple[float, ...]
    trainings: Trainings


def measure(settings: SeamSettings) -> Outcome:
    """Runs every method on every seam."""
    rows: list[dict[str, Any]] = []
    arrays: dict[str, NDArray[Any]] = {}
    pictures: dict[str, Figure] = {}
    verdicts, failed = [], True
    for a in settings.parameters:
        curve = tennis_seam(a)
        found = compare(curve, settings.trainings, name=f"tennis-seam-{a:g}")
        areas = {
            **{row["method"]: row["area"] for row in found.rows if row["area"] is not None},
            LEFT: solve_plateau(curve, model="series").area,
            CAUCHY: solve_plateau(curve, model="cauchy", unstable="keep").area,
            ALONE: solve_plateau(curve, model="mlp", optimizer=settings.trainings.network, warm_start=False).area,
        }
        disks = {method: which_disk(area, curve.disks) for method, area in areas.items()}
        rows += [{**row, "disk": disks.get(row["method"])} for row in found.rows]
        rows += [
            {"curve": curve.name, "method": method, "area": areas[method], "disk": disks[method]}
            for method in (LEFT, CAUCHY, ALONE)
        ]
        verdicts.append(f"{found.verdict} {_known(curve)} {_found(disks)}")
        arrays |= dict(found.arrays)
        pictures |= dict(found.pictures)
        failed &= found.holds
    return Outcome(rows=rows, holds=failed, verdict=" ".join(verdicts), arrays=arrays, pictures=pictures)


def which_disk(area: float, disks: Sequence[KnownDisk]) -> str:
    """Which known disk has an area: the stable one, the unstable one, or none."""
    gap = min((b.area - a.area for a, b in itertools.pairwise(disks)), default=None)
    for disk in disks:
        allowed = _SHARE_OF_AREA * disk.area if gap is None else _SHARE_OF_GAP * gap
        if abs(area - disk.area) < allowed:
            return "stable" if disk.stable else "unstable"
    return "none"


def _found(disks: Mapping[str, str]) -> str:
    """Which methods found which disk, as sentences."""
    told = {
        "stable": "The stable one was found by",
        "unstable": "The unstable one was found by",
        "none": "No known disk has the area found by",
    }
    by_disk = {disk: [method for method, which in disks.items() if which == disk] for disk in told}
    return " ".join(f"{told[disk]}: {'; '.join(methods)}." for disk, methods in by_disk.items() if methods)


def _known(curve: KnownCurve) -> str:
    told = ", ".join(f"{'a stable' if d.stable else 'an unstable'} one of area {d.area:.12g}" for d in curve.disks)
    return f"Known critical disks: {told}."


EXPERIMENT = Experiment(
    title="spinors against Weierstrass-Enneper on tennis seams, and which disk is found",
    paper="The seam of a tennis ball, 'sphere and cylinder' without parameters; networks of 10 layers of 20 units, "
    f"RMSprop, 800 epochs; {SPINOR.split(', ')[1]}s come near to the curve, {ENNEPER.split(', ')[1]} fails.",
    here="(a cos t + b cos 3t, a sin t - b sin 3t, 2√(ab) sin 2t), b = 1 - a, on the unit sphere: at a = 0.8 one disk "
    "is known, at a = 0.75 the symmetric one is unstable and two mirror images of less area are stable. "
    f"'{SERIES}' keeps the symmetric disk it finds first; '{LEFT}' leaves it where it is unstable, and '{NETWORK}' "
    "takes over from there. A disk counts as found where its area is. Crosses mark branch points. Seen means that the "
    "Weierstrass-Enneper form stays at least twice as far from every seam.",
    measure=measure,
    full=SeamSettings(parameters=(0.8, 0.75), trainings=FULL),
    quick=SeamSettings(parameters=(0.8, 0.75), trainings=QUICK),
)
