"""One loop on its way to a minimal disk: the routes it may take, in their order, and the verdict."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
import torch

from spinor_geom.deadline import is_out_of_time, require_time
from spinor_geom.discrete.minimal_surface import Disk, first_disk
from spinor_geom.errors import (
    DomainError,
    FirstFillError,
    OptionError,
    SingularMatrixError,
    SpinorGeomError,
    SurfaceError,
)
from spinor_geom.mesh.boundary_loop import BoundaryLoop, detect_corners
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.mesh.interpolation import DEGREES, MIN_POINTS_FOR_HIGH_DEGREE
from spinor_geom.mesh.intersections import require_simple
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.evidence import Evidence
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.harmonic_route import HarmonicSolver
from spinor_geom.plateau.network_route import Budget, Cauchy, NetworkSolver, rim_indices, roughness
from spinor_geom.plateau.plane_route import plane_disk
from spinor_geom.plateau.solution import BoundaryResidual, Iteration, PlateauSolution, RimMatch
from spinor_geom.plateau.solutions import MOST_DEPARTURES, Rim, leave_unstable, with_departures
from spinor_geom.plateau.trained_route import Optimizer, Trainer, optimizer_options
from spinor_geom.plateau.vertex_route import VertexSolver


@dataclass(frozen=True, kw_only=True)
class Laurent:
    """p and q between two loops as Laurent series on a round annulus, or between more on a disk with round holes.

    Attributes:
        modulus: a start: of all surfaces that are found, or of the stable ones unless those that are not are to be
            kept, the one is taken whose modulus (see `Annulus`) is nearest to this by ratio; none for the stable
            surface of least area.

    Raises:
        OptionError: the modulus is not positive.
    """

    modulus: float | None = None

    def __post_init__(self) -> None:
        if self.modulus is not None and not 0 < self.modulus < math.inf:
            raise OptionError(f"modulus must be positive and finite, got {self.modulus}")


Model: TypeAlias = Literal["auto", "cauchy", "series", "mlp"] | Cauchy | Laurent

# A disk that is farther from Γ than this, in mean edges, is not left where it is unstable.
_POOR = 5e-2
# Rough loops of more points go the harmonic route: the cost of the other grows like the cube of their number.
_MOST_POINTS = 1500
# So few points are a polygon; of more one in ten turns by this angle where they are no samples of a smooth curve.
_FEW_POINTS, _ROUGH_TURN = 8, np.radians(12.0)
# Parts that the sides of a polygon given by its corners alone are divided into.
_PARTS_OF_A_SIDE = 8
# Share of the steps that harmonic disks may take: the rest is the network's.
_HARMONIC_SHARE = 0.7


def require_model(model: Model) -> None:
    """Checks the option `model`.

    Raises:
        OptionError: it is none of those that `solve_plateau` takes.
    """
    if not isinstance(model, (Cauchy, Laurent)) and model not in ("auto", "cauchy", "series", "mlp"):
        raise OptionError(
            f"unknown model {model!r}; choose 'auto', 'cauchy', 'series', 'mlp', Cauchy(...) or Laurent(...)"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Options:
    """What every loop of a call is solved with.

    Attributes:
        cauchy: of the Cauchy network.
        laurent: of the Laurent series between two loops, where they were asked for.
        is_free: whether the model is chosen by the loop.
        is_series: whether it is a power series.
        optimizer: of a network that is trained; none for the others.
        warm_start: whether that takes over a solution.
        is_free_between: whether Γ need not be smooth between the points of a rough loop.
        tolerance: RMS distance from Γ, in mean loop edges.
        max_iterations: limit on steps.
        leaves_unstable: whether an unstable disk is left for a better one.
        device: of the linear algebra.
    """

    cauchy: Cauchy
    laurent: Laurent | None
    is_free: bool
    is_series: bool
    optimizer: Trainer | None
    warm_start: bool
    is_free_between: bool
    tolerance: float
    max_iterations: int
    leaves_unstable: bool
    device: torch.device

    @classmethod
    def checked(
        cls,
        model: Model,
        tolerance: float,
        max_iterations: int,
        unstable: str,
        device: str | torch.device,
        *,
        optimizer: Optimizer | None = None,
        warm_start: bool = True,
        between: str = "smooth",
    ) -> Options:
        """The options of `solve_plateau`.

        Raises:
            OptionError: an unknown model or optimizer, a value out of range, or options that exclude each other.
        """
        require_model(model)
        if model != "mlp" and (optimizer is not None or not warm_start):
            raise OptionError(f"optimizer and warm_start are options of model='mlp', got model={model!r}")
        if not tolerance > 0 or max_iterations < 1:
            raise OptionError(f"tolerance and max_iterations must be positive, got {tolerance} and {max_iterations}")
        if unstable not in ("leave", "keep"):
            raise OptionError(f"unknown choice for unstable {unstable!r}; choose 'leave' or 'keep'")
        if between not in ("smooth", "free"):
            raise OptionError(f"unknown choice for between {between!r}; choose 'smooth' or 'free'")
        return cls(
            cauchy=model if isinstance(model, Cauchy) else Cauchy(),
            laurent=model if isinstance(model, Laurent) else None,
            is_free=model == "auto" or isinstance(model, Laurent),
            is_series=model == "series",
            optimizer=optimizer_options(optimizer or "levenberg-marquardt") if model == "mlp" else None,
            warm_start=warm_start,
            is_free_between=between == "free",
            tolerance=tolerance,
            max_iterations=max_iterations,
            leaves_unstable=unstable == "leave",
            device=torch.device(device),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A loop and its solvers, which see it at unit size."""

    loop: BoundaryLoop
    options: Options
    network: NetworkSolver
    harmonic: HarmonicSolver

    @classmethod
    def of(
        cls,
        given: BoundaryLoop | ClosedCurve,
        options: Options,
        on_iteration: Callable[[Iteration], None] | None = None,
    ) -> Task:
        """The task of a loop or a curve in formulas.

        Raises:
            OptionError: a model for two loops.
            SelfCrossingLoopError: the loop crosses or touches itself.
            RepeatedPointError: two neighbouring points of the loop are equal.
            CurveError: the formulas are not those of a smooth closed curve.
        """
        if options.laurent is not None:
            raise OptionError("Laurent series span two loops; use model='auto' or 'series' for one")
        loop, formula = (given, None) if isinstance(given, BoundaryLoop) else sampled_formula(given)
        require_simple(loop)
        unit = _at_unit_size(loop)
        curve = BoundaryCurve.from_loop(unit) if formula is None else formula.placed(unit.points, 1 / loop.diagonal)
        return cls._over(loop, unit, curve, options, on_iteration)

    @classmethod
    def over(cls, loop: BoundaryLoop, curve: BoundaryCurve, options: Options) -> Task:
        """The task of a loop that is known to be simple, with Γ through it at any size and place."""
        unit = _at_unit_size(loop)
        size = float(np.linalg.norm(np.ptp(curve.coefficients[-1], axis=0)))
        return cls._over(loop, unit, curve.placed(unit.points, unit.diagonal / size), options, None)

    @classmethod
    def _over(
        cls,
        loop: BoundaryLoop,
        unit: BoundaryLoop,
        curve: BoundaryCurve,
        options: Options,
        on_iteration: Callable[[Iteration], None] | None,
    ) -> Task:
        clock = Clock()
        allowed = options.tolerance * unit.mean_edge_length
        network = NetworkSolver(
            loop=unit,
            rim=rim_indices(unit),
            curve=curve,
            options=options.cauchy,
            budget=Budget(
                allowed=allowed,
                tolerance=options.tolerance,
                max_iterations=options.max_iterations,
                on_iteration=on_iteration,
            ),
            device=options.device,
            clock=clock,
        )
        harmonic = HarmonicSolver(
            loop=unit,
            curve=curve,
            allowed=allowed,
            max_steps=math.ceil(_HARMONIC_SHARE * options.max_iterations),
            device=options.device,
            clock=clock,
            on_iteration=on_iteration,
            to_rounding=options.is_series,
        )
        return cls(loop=loop, options=options, network=network, harmonic=harmonic)

    @property
    def rim(self) -> Rim:
        """The loop with the points that discrete disks over it have."""
        return Rim(loop=self.loop, indices=self.network.rim)

    @property
    def is_harmonic(self) -> bool:
        """Whether harmonic disks may be tried: kinks of Γ are singularities of p and q, which take a network."""
        return self.options.is_free and not self.loop.corners.any()

    @property
    def passes_through_points(self) -> bool:
        """Whether Γ between the points is left to the surface: it may be, and no smooth curve is seen in them."""
        n = len(self.loop)
        if not self.options.is_free_between or n > _MOST_POINTS or self.network.curve.degree > min(DEGREES):
            return False
        # so few points do not show how smooth their curve is: less what the roundest loop of as many has
        least = 3 * np.pi / n if n < MIN_POINTS_FOR_HIGH_DEGREE else 0.0
        is_rough = n <= _FEW_POINTS or roughness(self.loop) - least > _ROUGH_TURN
        return is_rough or bool(detect_corners(self.loop.points).any()) or self.harmonic.is_narrow

    def solved(self) -> PlateauSolution:
        """The solution: plane, or the first that is found, or one of less area where that is unstable."""
        return self.in_plane() or self.curved()

    def in_plane(self) -> PlateauSolution | None:
        """The only solution where the loop is a simple curve in a plane."""
        if not self.options.is_free:
            return None
        network = self.network
        found = plane_disk(
            network.loop, network.curve, self.options.device, network.clock, allowed=network.budget.allowed
        )
        return None if found is None else self.solution(found)

    def curved(self) -> PlateauSolution:
        """The solution for a loop that is not plane."""
        if self.options.optimizer is not None:
            return self._trained(self.options.optimizer)
        if self.loop.corners.all() and not self.options.is_series:
            return self._on_sides()
        solution = self.first()
        if self.options.is_series:
            return self._left_on_disk(solution) if self.options.leaves_unstable else solution
        # whether a disk far from Γ is stable says nothing of those over Γ; one through a rough loop's points is next to
        # a discrete disk of least area
        is_near = solution.boundary_residual.rms_per_edge <= _POOR and solution.route != "vertices"
        if self.options.leaves_unstable and is_near:
            down = self.down_from_disk if self.options.is_free else self.from_disk
            solution = leave_unstable(solution, self.rim, down, max_iterations=self.options.max_iterations)
        return solution

    def _on_sides(self) -> PlateauSolution:
        """The solution over a polygon given by its corners alone: sides without points are followed by nothing."""
        finer = Task.of(subdivided(self.loop, _PARTS_OF_A_SIDE), self.options, self.harmonic.on_iteration).curved()
        (rim,) = finer.rims
        curve = self.network.curve.placed(self.loop.points, self.loop.diagonal)
        residual = replace(
            finer.boundary_residual,
            mean_edge=self.loop.mean_edge_length,
            max_per_local_edge=finer.boundary_residual.max_per_local_edge / _PARTS_OF_A_SIDE,
        )
        return replace(finer, rims=(replace(rim, loop=self.loop, curve=curve),), boundary_residual=residual)

    def _left_on_disk(self, solution: PlateauSolution) -> PlateauSolution:
        """A disk of less area than an unstable one, where the unit disk has room for one."""
        left: list[float] = []
        while solution.stability.verdict == "unstable" and len(left) < MOST_DEPARTURES:
            found = self.harmonic.below_on_disk(solution.matching)
            better = None if found is None else self.solution(found)
            if better is None or not better.area < solution.area:
                break
            left.append(solution.area)
            solution = better
        solution = with_departures(solution, left)
        if solution.stability.verdict == "unstable":
            reason = f"{solution.reason}; the disk is unstable, and no better one was found in power series"
            return replace(solution, reason=f"{reason}: model='auto' looks among others")
        return solution

    def _trained(self, optimizer: Trainer) -> PlateauSolution:
        """The solution of a trained network."""
        start: PlateauSolution | None = None
        if self.options.warm_start and optimizer.takes_start:
            start = replace(self, options=replace(self.options, optimizer=None, is_free=True)).solved()
        with self.network.clock.stage("training"):
            found = optimizer.disk(
                self.network.curve,
                start=start,
                device=self.options.device,
                on_iteration=self.network.budget.on_iteration,
            )
        return self.solution(found)

    def first(self) -> PlateauSolution:
        """The solution from the likeliest start that meets the tolerance; the best of all where none does."""
        if self.options.is_series:
            return self.solution(self.harmonic.on_disk())
        if not self.is_harmonic:
            return self.solution(self._on_network())
        best: Found | None = None
        error: SpinorGeomError | None = None
        for route in self._routes():
            if is_out_of_time():
                break
            try:
                for found in route():
                    best = _nearer(best, found)
            except (DomainError, FirstFillError, SingularMatrixError, SurfaceError) as failure:
                error = failure
            if best is not None and self._is_met(best):
                break
        if best is None:
            require_time()
            raise error or FirstFillError(
                "no minimal disk was found over the loop; check that it does not cross itself"
            )
        return self.solution(replace(best, history=tuple(self.harmonic.history)))

    def _routes(self) -> tuple[Callable[[], Iterable[Found]], ...]:
        """The ways to a disk over a loop without corners, in their order."""
        if self.passes_through_points:
            return (self._through_points,)
        ways = (self._harmonic_tries, lambda: (self._on_network(),))
        return ways if self.harmonic.is_promising else ways[::-1]

    def _through_points(self) -> Iterable[Found]:
        network = self.network
        solver = VertexSolver(
            loop=network.loop,
            allowed=network.budget.allowed,
            max_steps=network.budget.max_iterations - len(self.harmonic.history),
            device=self.options.device,
            clock=network.clock,
            on_iteration=self.harmonic.hear,
        )
        return (solver.found(tuple(self.harmonic.history)),)

    def _harmonic_tries(self) -> Iterator[Found]:
        """Harmonic disks up to the first that meets the tolerance."""
        for found in self.harmonic.tries():
            yield found
            if self._is_met(found):
                return

    def _on_network(self) -> Found:
        """The disk of a Cauchy network; the harmonic route's history takes its steps, even where it finds none."""
        with self.network.clock.stage("first fill"):
            disk = first_disk(self.network.loop.points[self.network.rim])
        budget = replace(self.network.budget, on_iteration=self.harmonic.hear)
        return replace(self.network, budget=budget).found_from(disk, tuple(self.harmonic.history))

    def _is_met(self, found: Found) -> bool:
        budget = self.network.budget
        return found.misfit.excess(allowed=budget.allowed, tolerance=budget.tolerance) <= 1

    def from_disk(self, disk: Disk, history: tuple[Iteration, ...] = ()) -> PlateauSolution:
        """The minimal disk nearest to a discrete one in the loop's coordinates, saddles included, timed by itself."""
        timed = self._timed_anew(history)
        return timed.solution(timed.network.found_from(self._at_unit_size(disk), history))

    def down_from_disk(self, disk: Disk, history: tuple[Iteration, ...] = ()) -> PlateauSolution:
        """The minimal disk to which the area falls from a discrete one, timed by itself."""
        timed, best = self._timed_anew(history), None
        if not self.loop.corners.any():
            best = next(timed.harmonic.tries_from(self._at_unit_size(disk), self.network.rim), None)
            if best is not None and self._is_met(best):
                return timed.solution(best)
        return timed.solution(_nearer(best, timed.network.found_from(self._at_unit_size(disk), history)))

    def _timed_anew(self, history: tuple[Iteration, ...]) -> Task:
        clock = Clock()
        return replace(
            self,
            network=replace(self.network, clock=clock),
            harmonic=replace(self.harmonic, clock=clock, history=list(history)),
        )

    def _at_unit_size(self, disk: Disk) -> Disk:
        return replace(disk, vertices=(disk.vertices - self.loop.centroid) / self.loop.diagonal)

    def solution(self, found: Found) -> PlateauSolution:
        """A disk in the loop's coordinates."""
        loop, clock = self.loop, self.network.clock
        with clock.stage("surface"):
            surface = found.surface.transform(scale=loop.diagonal, translation=loop.centroid)
        residual = BoundaryResidual.of(
            found.misfit.enlarged(loop.diagonal), mean_edge=loop.mean_edge_length, diagonal=loop.diagonal
        )
        tolerance = self.options.tolerance
        converged, reason = residual.verdict(tolerance, steps=len(found.history), limit=found.limit)
        return PlateauSolution(
            surface=surface,
            rims=(
                RimMatch(
                    loop=loop,
                    curve=found.curve.placed(loop.points, loop.diagonal),
                    boundary=surface.domain.boundary,
                    matching=found.matching,
                ),
            ),
            domain=surface.domain,
            boundary_residual=residual,
            area=found.area * loop.diagonal**2,
            route=found.route,
            history=found.history,
            solve_timings=dict(clock.seconds),
            tolerance=tolerance,
            converged=converged,
            reason=reason,
            # a plane disk is its Ω, whose boundary was found to be simple
            evidence=Evidence(surface=surface, is_plane=found.route == "plane"),
        )


def _at_unit_size(loop: BoundaryLoop) -> BoundaryLoop:
    """The loop with its centroid at 0 and diagonal 1, where every tolerance is a ratio."""
    return BoundaryLoop(
        points=(loop.points - loop.centroid) / loop.diagonal, vertex_ids=loop.vertex_ids, corners=loop.corners
    )


def subdivided(loop: BoundaryLoop, parts: int) -> BoundaryLoop:
    """A loop with its edges divided into equal parts, and the same corners."""
    share = np.arange(parts) / parts
    edge = np.roll(loop.points, -1, axis=0) - loop.points
    points = (loop.points[:, None] + share[:, None] * edge[:, None]).reshape(-1, 3)
    return BoundaryLoop.from_points(points, corners=parts * np.flatnonzero(loop.corners))


def sampled_formula(given: ClosedCurve) -> tuple[BoundaryLoop, BoundaryCurve]:
    """The polynomials of a curve in formulas, and the loop of their ends."""
    curve = BoundaryCurve.from_formula(given)
    return BoundaryLoop.from_points(curve.coefficients[-1], corners=np.flatnonzero(curve.corners)), curve


def _nearer(best: Found | None, found: Found) -> Found:
    """The one of two disks that is nearer to Γ, with the steps of both."""
    if best is None or found.misfit.rms < best.misfit.rms:
        return found
    return replace(best, history=found.history)
