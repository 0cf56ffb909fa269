"""What ours alone is to solve, and what is promised of it: loops of every kind, pairs of rims, the paper's curves."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.spatial.distance import pdist

from spinor_geom import gallery
from spinor_geom.errors import SpinorGeomError
from spinor_geom.experiments.paper_surfaces import boundary_distance
from spinor_geom.gallery.curves import harmonics
from spinor_geom.gallery.known import KnownCurve, KnownDisk
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.meshing.embed import mesh_patch
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.training import LevenbergMarquardt

Kind: TypeAlias = Literal["accuracy", "time"]
Subject: TypeAlias = BoundaryLoop | ClosedCurve | tuple[BoundaryLoop | ClosedCurve, BoundaryLoop | ClosedCurve]
SUITES = ("curves", "rims", "speed", "paper")

RANDOM, RANDOM_POINTS, RANDOM_NOISE = 100, 120, 0.15  # every second one has noise
OVERSTATED = 2.0  # so many times the distance that is reported, a distance contradicts it
AREA_GAP = 0.05  # relative, between the area and that of a mesh, whose edges are chords
HEIGHTS, TOO_FAR = (0.25, 0.5, 0.6, 0.66), (0.7, 1.0)  # of unit circles above and below a plane
SMOOTH_SECONDS, ROUGH_SECONDS = {64: 0.05, 256: 0.08, 1000: 0.3, 5000: 2.0}, {300: 1.0, 1000: 8.0, 5000: 60.0}
QUICK = (
    "ellipse 2:1 height 0.3 at 100 points",
    "slit 50 × 0.866 at 102 points",
    "random curve 2",
    "catenoid h = 0.5 of formulas",
    "circles h = 0.7",
    "tennis seam a=0.8 at 256 points, timed",
    "Douglas-Newton, twisted circle R=1 k=3 α=0.2",
)
"""Those of the short run."""


@dataclass(frozen=True)
class Limit:
    """The most that a field of a record may be, or what it has to be equal to; the name is for readers."""

    field: str
    name: str
    value: float | str | bool
    kind: Kind = "accuracy"


@dataclass(frozen=True, eq=False)
class Solve:
    """Something to be solved, what is promised of it, and what is looked at besides."""

    suite: str
    name: str
    subject: Callable[[], Subject]
    limits: tuple[Limit, ...]
    options: dict[str, Any] = field(default_factory=dict)  # of `solve_plateau`
    disks: tuple[KnownDisk, ...] = ()  # that it is known to bound, smallest area first
    also: Literal["", "null error", "truth"] = ""  # of its slide; of what the solution says of itself


@cache
def solves() -> Mapping[str, Solve]:
    """All of them by name."""
    return {one.name: one for one in (*_curves(), *_rims(), *_speed(), *_paper())}


def solve_figures(case: Solve, answer: PlateauSolution | NoConnectedSurface) -> dict[str, Any]:
    """What is measured of an answer, from the surface and the curve alone where nothing else is said."""
    figures: dict[str, Any] = {"annulus": isinstance(answer, PlateauSolution), "area": answer.area}
    if case.disks and answer.area is not None:
        figures["area_error"] = min(abs(answer.area / disk.area - 1) for disk in case.disks)
    if isinstance(answer, NoConnectedSurface):
        return figures | {"told": answer.reason}
    figures |= {"converged": answer.converged, "told": answer.reason}
    if len(answer.rims) > 1:
        return figures | {"rms_per_edge": answer.boundary_residual.rms_per_edge}
    rms = rms_distance(answer)
    figures |= {
        "rms_per_edge": rms / answer.loop.mean_edge_length,
        "rms_per_diameter": rms / float(pdist(answer.loop.points).max()),
        "max_per_diagonal": boundary_distance(answer.surface, answer.curve) / answer.loop.diagonal,
        "verdict": f"{answer.stability.verdict}, index {answer.stability.index}",
    }
    if case.also == "null error":
        figures["null_error"] = null_error(answer)
    elif case.also == "truth":
        figures["untrue"] = untrue(answer, figures["rms_per_edge"])
    return figures


def rms_distance(solution: PlateauSolution, samples_per_edge: int = 8) -> float:
    """RMS distance, by arc length, of the boundary from the nearest points of Γ, by the surface's public methods."""
    boundary, count = solution.domain.boundary, samples_per_edge * len(solution.loop)
    t = (np.arange(count) + 0.5) / count
    z = boundary.point(t)
    points = np.asarray(solution.surface.position(z))
    distance = np.linalg.norm(points - solution.curve.point(solution.curve.nearest(points)), axis=1)
    length = np.asarray(solution.surface.conformal_factor(z)) * np.abs(boundary.derivative(t))
    return float(np.sqrt(length @ distance**2 / length.sum()))


def untrue(solution: PlateauSolution, rms_per_edge: float) -> str:
    """What a solution says of itself that is not so; empty where nothing is."""
    reported = solution.boundary_residual.rms_per_edge
    if not rms_per_edge <= OVERSTATED * max(reported, solution.tolerance):
        return f"its distance from Γ is {rms_per_edge:.1e} of an edge, not {reported:.1e}"
    if not solution.converged:
        return ""
    try:
        gap = abs(mesh_patch(solution).area / solution.area - 1)
    except SpinorGeomError as error:
        return f"its patch cannot be meshed: {error}"
    return f"its area and its mesh's are {gap:.0%} apart" if gap > AREA_GAP else ""


def null_error(solution: PlateauSolution) -> float:
    """Largest |φ·φ| on the circle by the largest |φ|², φ that of the harmonic map with its boundary values."""
    x: Float[np.ndarray, "n 3"] = solution.curve.point(solution.matching[:, 1] % 1)
    n = len(x)
    k = np.arange(n // 2)[:, None]
    # φ z = 2 Σ k c_k zᵏ
    phi = np.fft.ifft(np.concatenate([2 * k * np.fft.fft(x, axis=0)[: n // 2], np.zeros((n - n // 2, 3))]), axis=0)
    return float(np.abs((phi * phi).sum(1)).max() / (np.abs(phi) ** 2).sum(1).max())


_CONVERGED = Limit("converged", "converged", True)
_ANNULUS = Limit("annulus", "an annulus is found", True)


def _met(tolerance: float) -> tuple[Limit, ...]:
    return (Limit("rms_per_edge", "RMS distance from Γ, in mean edges,", tolerance), _CONVERGED)


def _area(error: float) -> Limit:
    return Limit("area_error", "error of the area", error)


def _seconds(limit: float) -> Limit:
    return Limit("seconds", "seconds", limit, "time")


def _curves() -> Iterator[Solve]:
    stable = (*_met(1e-8), _area(1e-6), Limit("verdict", "verdict", "stable, index 0"))
    near = Limit("rms_per_diameter", "RMS distance from Γ, in diameters,", 1e-5), _CONVERGED
    seam, ramp, ellipse = gallery.tennis_seam, gallery.helical_ramp, partial(gallery.ellipse, height=0.3)
    for curve, n, tolerance, limits in (
        *((curve, 128, 1e-8, stable) for curve in (gallery.twisted_circle(), seam(0.8), seam(0.75))),
        *((ellipse(ratio), 100, 1e-8, _met(1e-8)) for ratio in (2.0, 4.0, 8.0)),
        *((ellipse(ratio), n, 1e-8, _met(1e-8)) for ratio, n in ((16.0, 200), (32.0, 400))),
        *((curve, 102, 1e-3, _met(1e-3)) for curve in (gallery.slit(), gallery.slit(bend=np.pi / 2))),
        *((curve, 160, 1e-3, _met(1e-3)) for curve in (gallery.horseshoe(), ramp(1.3), ramp(2.0), ramp(3.0))),
        (gallery.schwarz_d_quadrilateral(), 96, 1e-8, (_area(1e-9),)),
        *((curve(), 144, 1e-8, (_area(1e-8),)) for curve in (gallery.schwarz_d_hexagon, gallery.schwarz_p_hexagon)),
        *((curve, 64, 1e-4, near) for curve in (gallery.l_shape(), gallery.l_shape(rise=0.25))),
        (gallery.zigzag_rim(20), 100, 1e-4, near),
    ):
        subject, options = partial(curve.sample, n), {"tolerance": tolerance}
        yield Solve("curves", f"{curve.name} at {n} points", subject, limits, options, curve.disks)
    for ratio, n in ((2.0, 100), (4.0, 100), (8.0, 200)):
        curve = ellipse(ratio)
        name = f"{curve.name} at {n} points, 20% noise"
        yield Solve("curves", name, partial(_noisy, curve, n, 0.2, 0), _met(1e-3))
    # what is promised of random ones is promised of all together
    for seed in range(RANDOM):
        noise = RANDOM_NOISE if seed % 2 else 0.0
        subject = partial(_noisy, gallery.random_curve(seed), RANDOM_POINTS, noise, seed)
        options = {"tolerance": 1e-3 if noise else 1e-6}
        yield Solve("curves", f"random curve {seed}", subject, (), options, also="truth")


def _noisy(curve: KnownCurve, n: int, noise: float, seed: int) -> BoundaryLoop:
    loop = gallery.evenly_sampled(curve, n)
    return gallery.noisy_loop(loop, noise, seed=seed) if noise else loop


def _rims() -> Iterator[Solve]:

    def known(name: str, subject: Callable[[], Subject], area: float, *limits: Limit) -> Solve:
        return Solve("rims", name, subject, limits, disks=(KnownDisk(area=area),))

    for h in HEIGHTS:
        pair, area = (ring(1.0, h), ring(1.0, -h)), gallery.catenoid(h).area
        sampled, name = partial(_sampled, pair, (64, 64)), f"catenoid h = {h:g}"
        yield known(f"{name} of 64 points a rim", sampled, area, _ANNULUS, _area(1e-6), _seconds(0.1))
        yield known(f"{name} of formulas", partial(_same, pair), area, _ANNULUS, _area(1e-12), _seconds(0.1))
    for h in TOO_FAR:
        limits = replace(_ANNULUS, value=False), Limit("area_error", "error of the two disks' area", 1e-12)
        yield known(f"circles h = {h:g}", partial(_same, (ring(1.0, h), ring(1.0, -h))), 2 * np.pi, *limits)
    for name, outer, hole, area in (
        ("plane ring, eccentric hole", ring(1, 0), ring(0.2, 0, centre=(0.5, 0.1)), 0.96),
        ("plane ellipse 4:1, hole near an end", ring(1, 0, stretch=4.0), ring(0.2, 0, centre=(2.5, 0.1)), 3.96),
    ):
        yield known(name, partial(_same, (outer, hole)), area * np.pi, _ANNULUS, _area(1e-10))
    crowded = ring(1.0, 0.0, stretch=8.0), ring(0.7, 0.2, centre=(0.1, 0.05), stretch=7.6 / 0.7)
    tilted = ring(1.0, 0.35, stretch=1.3), ring(0.8, -0.35, centre=(0.2, 0.1))
    slender = ring(1.0, 0.0, stretch=4.0), ring(0.2, 0.1, centre=(2.5, 0.1))
    for name, subject in (
        ("small hole near the end of an ellipse 4:1, lifted", partial(_sampled, slender, (120, 40))),
        ("ellipse 8:1 in another", partial(_sampled, crowded, (200, 180))),
        *(
            (f"tilted rims, noise {noise:.0%} of an edge", partial(_sampled, tilted, (80, 60), noise=noise, tilt=0.4))
            for noise in (0.0, 0.1, 0.2)
        ),
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
    """Points at equal steps, moved at random by a share of their distance; the first rim turned around the x axis."""
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
        for n, seconds in SMOOTH_SECONDS.items():
            name = f"{curve.name} at {n} points, timed"
            yield Solve("speed", name, partial(curve.sample, n), (_seconds(seconds), *_met(1e-3)))
    for n, seconds in ROUGH_SECONDS.items():
        limits = _seconds(seconds), *_met(1e-2), Limit("memory_mib", "peak memory in MiB", 6144)
        name = f"{ellipse.name} at {n} points, 15% noise, timed"
        yield Solve("speed", name, partial(_noisy, ellipse, n, 0.15, 0), limits, {"tolerance": 1e-2})


def _paper() -> Iterator[Solve]:
    """The paper's curves by power series, and by networks of its kind; what it measured besides is `reproduce`'s."""
    circle, tame, seam = gallery.twisted_circle(), gallery.tennis_seam(0.8), gallery.tennis_seam(0.75)

    def near(error: float) -> Limit:
        return Limit("max_per_diagonal", "largest distance from Γ, in diagonals,", error)

    exact = near(1e-13), Limit("null_error", "largest |φ·φ| by the largest |φ|²", 1e-13), _area(1e-13)
    for curve, disk, which, unstable in (
        (circle, circle.disks[0], "", "keep"),
        (tame, tame.disks[0], "", "keep"),
        (seam, seam.disks[-1], ", symmetric disk", "keep"),
        (seam, seam.disks[0], ", stable disk", "leave"),
    ):
        # leaving an unstable disk is a second solve, of twice as many nodes
        limits = (*exact, _seconds(0.1)) if unstable == "keep" else exact
        name = f"Douglas-Newton, {curve.name}{which}"
        options: dict[str, Any] = {"model": "series", "unstable": unstable}
        yield Solve("paper", name, partial(_same, curve), limits, options, (disk,), "null error")
    first, fine = LevenbergMarquardt(tolerance=1e-5), LevenbergMarquardt(tolerance=1e-7)
    wide = LevenbergMarquardt(tolerance=1e-7, width=40, nodes=256, distillation_steps=400)
    deep = LevenbergMarquardt(tolerance=1e-4, depth=10, width=20)
    for curve, finer in ((circle, fine), (tame, fine), (seam, wide)):
        for name, network, promised in (
            ("Levenberg-Marquardt", first, (near(1e-5), _seconds(5.0))),
            (f"Levenberg-Marquardt, {finer.width} units, {finer.nodes} nodes", finer, (near(1e-7),)),
            ("10 × 20 network", deep, (near(1e-4), _seconds(30.0))),
        ):
            options = {"model": "mlp", "optimizer": network}
            yield Solve("paper", f"{name}, {curve.name}", partial(_same, curve), promised, options)


def _same(subject: Subject) -> Subject:
    return subject
