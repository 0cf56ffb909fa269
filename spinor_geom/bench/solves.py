"""Cases that are measured with our solver only, and their limits: loops, pairs of rims, speed, the paper's curves."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any, Literal, TypeAlias

import numpy as np

from spinor_geom import gallery
from spinor_geom.gallery.curves import harmonics
from spinor_geom.gallery.known import KnownCurve, KnownDisk
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.training import LevenbergMarquardt

Kind: TypeAlias = Literal["accuracy", "time"]
Subject: TypeAlias = BoundaryLoop | ClosedCurve | tuple[BoundaryLoop | ClosedCurve, BoundaryLoop | ClosedCurve]
SUITES = ("curves", "rims", "speed", "paper")
QUICK = (
    "ellipse 2:1 height 0.3 at 100 points",
    "slit 50 × 0.866 at 102 points",
    "random curve 2",
    "catenoid h = 0.5 of formulas",
    "circles h = 0.7",
    "tennis seam a=0.8 at 256 points, timed",
    "Douglas-Newton, twisted circle R=1 k=3 α=0.2",
)
"""The cases of the short run."""

_SMOOTH_SECONDS, _ROUGH_SECONDS = {64: 0.05, 256: 0.08, 1000: 0.3, 5000: 2.0}, {300: 1.0, 1000: 8.0, 5000: 60.0}


@dataclass(frozen=True)
class Limit:
    """The upper limit of a record's field, or, for text and booleans, its required value; tables show `name`."""

    field: str
    name: str
    value: float | str | bool
    kind: Kind = "accuracy"


@dataclass(frozen=True, eq=False)
class Solve:
    """A call of `solve_plateau` and its limits."""

    suite: str
    name: str
    subject: Callable[[], Subject]
    limits: tuple[Limit, ...]
    options: dict[str, Any] = field(default_factory=dict)
    disks: tuple[KnownDisk, ...] = ()  # the known disks over the curve, smallest area first
    also: Literal["", "null error", "untrue"] = ""  # an additional figure


@cache
def solves() -> Mapping[str, Solve]:
    """All cases by name."""
    return {case.name: case for case in (*_curves(), *_rims(), *_speed(), *_paper())}


_CONVERGED = Limit("converged", "converged", True)
_ANNULUS = Limit("annulus", "an annulus is found", True)


def _near(tolerance: float) -> tuple[Limit, ...]:
    return (Limit("rms_per_edge", "RMS distance from Γ, in mean edges,", tolerance), _CONVERGED)


def _area(error: float) -> Limit:
    return Limit("area_error", "error of the area", error)


def _seconds(limit: float) -> Limit:
    return Limit("seconds", "seconds", limit, "time")


def _curves() -> Iterator[Solve]:
    stable = (*_near(1e-8), _area(1e-6), Limit("verdict", "verdict", "stable, index 0"))
    straight = Limit("rms_per_diameter", "RMS distance from Γ, in diameters,", 1e-5), _CONVERGED
    seam, ramp, ellipse = gallery.tennis_seam, gallery.helical_ramp, partial(gallery.ellipse, height=0.3)
    for curve, n, tolerance, limits in (
        *((curve, 128, 1e-8, stable) for curve in (gallery.twisted_circle(), seam(0.8), seam(0.75))),
        *((ellipse(ratio), 100, 1e-8, _near(1e-8)) for ratio in (2.0, 4.0, 8.0)),
        *((ellipse(ratio), n, 1e-8, _near(1e-8)) for ratio, n in ((16.0, 200), (32.0, 400))),
        *((curve, 102, 1e-3, _near(1e-3)) for curve in (gallery.slit(), gallery.slit(bend=np.pi / 2))),
        *((curve, 160, 1e-3, _near(1e-3)) for curve in (gallery.horseshoe(), ramp(1.3), ramp(2.0), ramp(3.0))),
        (gallery.schwarz_d_quadrilateral(), 96, 1e-8, (_area(1e-9),)),
        *((curve(), 144, 1e-8, (_area(1e-8),)) for curve in (gallery.schwarz_d_hexagon, gallery.schwarz_p_hexagon)),
        *((curve, 64, 1e-4, straight) for curve in (gallery.l_shape(), gallery.l_shape(rise=0.25))),
        (gallery.zigzag_rim(20), 100, 1e-4, straight),
    ):
        subject, options = partial(curve.sample, n), {"tolerance": tolerance}
        yield Solve("curves", f"{curve.name} at {n} points", subject, limits, options, curve.disks)
    for ratio, n in ((2.0, 100), (4.0, 100), (8.0, 200)):
        curve = ellipse(ratio)
        name = f"{curve.name} at {n} points, 20% noise"
        yield Solve("curves", name, partial(_noisy, curve, n, 0.2, 0), _near(1e-3))
    # half of the random curves have noise; `promises` has limits for all of them together
    for seed in range(100):
        noise = 0.15 if seed % 2 else 0.0
        subject = partial(_noisy, gallery.random_curve(seed), 120, noise, seed)
        options = {"tolerance": 1e-3 if noise else 1e-6}
        yield Solve("curves", f"random curve {seed}", subject, (), options, also="untrue")


def _noisy(curve: KnownCurve, n: int, noise: float, seed: int) -> BoundaryLoop:
    loop = gallery.evenly_sampled(curve, n)
    return gallery.noisy_loop(loop, noise, seed=seed) if noise else loop


def _rims() -> Iterator[Solve]:

    def known(name: str, subject: Subject, area: float, *limits: Limit) -> Solve:
        return Solve("rims", name, lambda: subject, limits, disks=(KnownDisk(area=area),))

    for h in (0.25, 0.5, 0.6, 0.66):
        pair, area = (ring(1.0, h), ring(1.0, -h)), gallery.catenoid(h).area
        sampled, name = _sampled(pair, (64, 64)), f"catenoid h = {h:g}"
        yield known(f"{name} of 64 points a rim", sampled, area, _ANNULUS, _area(1e-6), _seconds(0.1))
        yield known(f"{name} of formulas", pair, area, _ANNULUS, _area(1e-12), _seconds(0.1))
    for h in (0.7, 1.0):  # too far apart for a catenoid
        limits = replace(_ANNULUS, value=False), Limit("area_error", "error of the two disks' area", 1e-12)
        yield known(f"circles h = {h:g}", (ring(1.0, h), ring(1.0, -h)), 2 * np.pi, *limits)
    for name, outer, hole, area in (
        ("plane ring, eccentric hole", ring(1, 0), ring(0.2, 0, centre=(0.5, 0.1)), 0.96),
        ("plane ellipse 4:1, hole near an end", ring(1, 0, stretch=4.0), ring(0.2, 0, centre=(2.5, 0.1)), 3.96),
    ):
        yield known(name, (outer, hole), area * np.pi, _ANNULUS, _area(1e-10))
    crowded = ring(1.0, 0.0, stretch=8.0), ring(0.7, 0.2, centre=(0.1, 0.05), stretch=7.6 / 0.7)
    tilted = ring(1.0, 0.35, stretch=1.3), ring(0.8, -0.35, centre=(0.2, 0.1))
    slender = ring(1.0, 0.0, stretch=4.0), ring(0.2, 0.1, centre=(2.5, 0.1))
    tilts = {f"tilted rims, noise {noise:.0%} of an edge": noise for noise in (0.0, 0.1, 0.2)}
    for name, subject in (
        ("small hole near the end of an ellipse 4:1, lifted", partial(_sampled, slender, (120, 40))),
        ("ellipse 8:1 in another", partial(_sampled, crowded, (200, 180))),
        *((name, partial(_sampled, tilted, (80, 60), noise=noise, tilt=0.4)) for name, noise in tilts.items()),
    ):
        yield Solve("rims", name, subject, (Limit("rms_per_edge", "RMS residual, in mean edges,", 1e-3),))


def ring(
    radius: float, height: float, *, centre: tuple[float, float] = (0.0, 0.0), stretch: float = 1.0
) -> ClosedCurve:
    """An ellipse in a horizontal plane."""
    return harmonics(np.array([[*centre, height], [radius * stretch, -1j * radius, 0]]))


def _sampled(
    pair: tuple[ClosedCurve, ClosedCurve], counts: tuple[int, int], *, noise: float = 0.0, tilt: float = 0.0
) -> tuple[BoundaryLoop, BoundaryLoop]:
    """Loops with points at equal parameter steps, and noise in edges; the first is rotated around the x axis."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(tilt), -np.sin(tilt)], [0.0, np.sin(tilt), np.cos(tilt)]])
    loops = []
    for seed, (curve, count) in enumerate(zip(pair, counts, strict=True)):
        points = curve.point(np.arange(count) / count)
        edge = np.linalg.norm(points[1] - points[0])
        points = points + noise * edge * np.random.default_rng(seed).normal(size=points.shape)
        loops.append(BoundaryLoop.from_points(points if seed or not tilt else points @ turn.T, corners=()))
    return loops[0], loops[1]


def _speed() -> Iterator[Solve]:
    ellipse = gallery.ellipse(2.0, 0.3)
    for curve in (gallery.twisted_circle(), ellipse, gallery.tennis_seam(0.8)):
        for n, seconds in _SMOOTH_SECONDS.items():
            name = f"{curve.name} at {n} points, timed"
            yield Solve("speed", name, partial(curve.sample, n), (_seconds(seconds), *_near(1e-3)))
    for n, seconds in _ROUGH_SECONDS.items():
        limits = _seconds(seconds), *_near(1e-2), Limit("memory_mib", "peak memory in MiB", 6144)
        name = f"{ellipse.name} at {n} points, 15% noise, timed"
        yield Solve("speed", name, partial(_noisy, ellipse, n, 0.15, 0), limits, {"tolerance": 1e-2})


def _paper() -> Iterator[Solve]:
    """The paper's curves by power series and by networks of its kind; `experiments` has its trainings."""
    circle, tame, seam = gallery.twisted_circle(), gallery.tennis_seam(0.8), gallery.tennis_seam(0.75)

    def solve(name: str, curve: KnownCurve, *limits: Limit, **more: Any) -> Solve:
        return Solve("paper", name, lambda: curve, limits, **more)

    def near(error: float) -> Limit:
        return Limit("max_per_diagonal", "largest distance from Γ, in diagonals,", error)

    exact = near(1e-13), Limit("null_error", "largest |φ·φ| by the largest |φ|²", 1e-13), _area(1e-13)
    for curve, disk, which, unstable in (
        (circle, circle.disks[0], "", "keep"),
        (tame, tame.disks[0], "", "keep"),
        (seam, seam.disks[-1], ", symmetric disk", "keep"),
        (seam, seam.disks[0], ", stable disk", "leave"),
    ):
        # a stable disk takes a second solve, with twice as many nodes
        limits = (*exact, _seconds(0.1)) if unstable == "keep" else exact
        options = {"model": "series", "unstable": unstable}
        name = f"Douglas-Newton, {curve.name}{which}"
        yield solve(name, curve, *limits, options=options, disks=(disk,), also="null error")
    first, fine = LevenbergMarquardt(tolerance=1e-5), LevenbergMarquardt(tolerance=1e-7)
    wide = LevenbergMarquardt(tolerance=1e-7, width=40, nodes=256, distillation_steps=400)
    deep = LevenbergMarquardt(tolerance=1e-4, depth=10, width=20)
    for curve, finer in ((circle, fine), (tame, fine), (seam, wide)):
        for name, network, promised in (
            ("Levenberg-Marquardt", first, (near(1e-5), _seconds(5.0))),
            (f"Levenberg-Marquardt, {finer.width} units, {finer.nodes} nodes", finer, (near(1e-7),)),
            ("10 × 20 network", deep, (near(1e-4), _seconds(30.0))),
        ):
            yield solve(f"{name}, {curve.name}", curve, *promised, options={"model": "mlp", "optimizer": network})
