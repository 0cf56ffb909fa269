"""Two loops on their way to a minimal annulus: orientation, start, modulus, and the verdict against two disks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from jaxtyping import Float
from scipy.fft import next_fast_len
from scipy.spatial import cKDTree
from torch import Tensor

from spinor_geom.deadline import require_time
from spinor_geom.errors import (
    DomainError,
    LoopsMeetError,
    OptionError,
    SingularMatrixError,
    SpinorGeomError,
    SurfaceError,
)
from spinor_geom.mesh.boundary_loop import BoundaryLoop, turning_angles
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.mesh.interpolation import DEGREES
from spinor_geom.mesh.intersections import crossings_between, require_simple
from spinor_geom.plateau.annulus_network import AnnulusNetworkSolver
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.cone import parted_by_cone
from spinor_geom.plateau.douglas_annulus import AnnulusProblem, HarmonicAnnulus
from spinor_geom.plateau.evidence import Evidence
from spinor_geom.plateau.found import FoundAnnulus
from spinor_geom.plateau.lift_annulus import AnnularLift, annular_surface, lifted_annulus
from spinor_geom.plateau.misfit import LOCAL_TOLERANCES
from spinor_geom.plateau.network_route import Budget
from spinor_geom.plateau.plane_route import beside_in_plane, plane_annulus
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.solution import (
    Annulus,
    BoundaryResidual,
    Iteration,
    NoAnnulus,
    PlateauSolution,
    RimDisks,
    RimMatch,
)
from spinor_geom.plateau.task import Options, Task, sampled_formula
from spinor_geom.surface.spinor_surface import SpinorSurface

# Nodes on each rim where an annulus is sought, most for which matrices are factored, most of all, and most an edge.
_COARSE_NODES, _DENSE_NODES, _MOST_NODES, _MOST_PER_EDGE = 64, 256, 1 << 15, 200
# Most nodes on smooth rims: their distance falls exponentially, unless the nodes crowd.
_MOST_SMOOTH = 2048
# Nodes on a length as long as the gap is wide, where an annulus is sought.
_NODES_PER_GAP = 4
# Nodes for each edge of rough rims to begin with, and how many times more come next.
_PER_EDGE, _MORE_NODES = 6, 2
# Turning angle, exceeded by one point in ten, from which a loop counts as rough; the smooth curves that lead to it:
# their width at first, in points, and how many they are.
_ROUGH_TURN, _SMOOTHING, _AVERAGES, _DEFORMATIONS = np.radians(12.0), 2.0, 2, 4
# Of rough rims: gradient to stop at, as a share of the distance allowed in edges; fall of the energy that is none, as a
# share of that of waves of that height; steps of one solve.
_FINE_ROUGH, _NEGLIGIBLE, _MOST_STEPS = 3e-2, 1e-3, 60
# While so many nodes or fewer are enough, the distance is brought to this share of what is asked for.
_CHEAP_NODES, _WELL_BELOW = 256, 1e-3
# The other direction of the second loop is tried too if its start has at most so many times the energy.
_RIVAL = 1.3
# Gradient at which a search stops, and above which it has found nothing.
_FOUND, _SETTLED = 1e-12, 1e-3
# More nodes that do not lower the distance to this share do not help, twice in a row.
_WORTHWHILE, _PATIENCE = 0.7, 2
# Gradient above which the energy is brought down anew.
_POOR = 1e-6
# Why there is no annulus.
_RUNS_AWAY = "the energy of surfaces between the rims falls with the modulus, however large that is"
_PARTED = "the rims are so far apart that a cone parts them through which no connected minimal surface passes"
_BESIDE = "the rims lie beside each other in one plane, which a minimal surface between them would not leave"
# Quadrature nodes on each piece of a path in Ω.
_PATH_ORDER = 16
# Nodes on the cylinder beyond which a domain is made for the rims; where the largest gap is fewer times the least, and
# the mean gap wants few nodes, so many are never needed.
_CROWDED, _EVEN, _FEW_NODES = 1200.0, 4.0, 128.0


@dataclass(frozen=True, kw_only=True, eq=False)
class AnnulusTask:
    """Two loops at a common unit size.

    Attributes:
        loops: both, as they were given, and the second reversed.
        curves: through these at unit size.
        centre: of the loops.
        scale: their common diagonal.
        options: of the call.
        on_iteration: is called at each step.
        clock: of the stages.
        history: the steps so far.
    """

    loops: tuple[BoundaryLoop, BoundaryLoop, BoundaryLoop]
    curves: tuple[BoundaryCurve, BoundaryCurve, BoundaryCurve]
    centre: Float[np.ndarray, "3"]
    scale: float
    options: Options
    on_iteration: Callable[[Iteration], None] | None
    clock: Clock
    history: list[Iteration]

    @classmethod
    def of(
        cls,
        given: tuple[BoundaryLoop | ClosedCurve, BoundaryLoop | ClosedCurve],
        options: Options,
        on_iteration: Callable[[Iteration], None] | None = None,
    ) -> AnnulusTask:
        """The task of two loops or curves in formulas.

        Raises:
            OptionError: a model that has no annuli.
            SelfCrossingLoopError: a loop crosses or touches itself.
            LoopsMeetError: the loops cross or touch each other.
            RepeatedPointError: two neighbouring points of a loop are equal.
            CurveError: formulas are not those of a smooth closed curve.
        """
        if options.optimizer is not None:
            raise OptionError("no network is trained between two loops; use model='auto', 'series' or 'cauchy'")
        samples = [_sampled(one) for one in given]
        first, second = (loop for loop, _ in samples)
        for loop in (first, second):
            require_simple(loop)
        meeting = crossings_between(first.points, second.points)
        if len(meeting):
            i, j = meeting[0].tolist()
            raise LoopsMeetError(edges=[_edge(first, i), _edge(second, j)])
        points = np.concatenate([first.points, second.points])
        scale = float(np.linalg.norm(np.ptp(points, axis=0)))
        lengths = np.array([first.perimeter, second.perimeter])
        centre = lengths @ np.stack([first.centroid, second.centroid]) / lengths.sum()
        one, other = (_at_unit_size(loop, formula, centre, scale) for loop, formula in samples)
        return cls(
            loops=(first, second, second.reversed()),
            curves=(one, other, other.reversed()),
            centre=centre,
            scale=scale,
            options=options,
            on_iteration=on_iteration,
            clock=Clock(),
            history=[],
        )

    def solved(self) -> PlateauSolution | NoAnnulus:
        """The annulus of least area that was found, or that there is none."""
        plane = self._in_plane()
        if plane is not None:
            return plane
        obstacle = self._obstacle()
        if obstacle is not None:
            return self._none(obstacle)
        laurent = self.options.laurent
        if laurent is not None and laurent.modulus is not None:
            log = math.log(laurent.modulus)
            found = self._stable() if self.options.leaves_unstable else self._all_critical()
            near = min(found, key=lambda pair: abs(pair[1].log_modulus - log), default=None)
            return self._none(_RUNS_AWAY) if near is None else self._solution(*near)
        if self.options.is_series:
            return self._on_cylinder()
        fitted: PlateauSolution | None = None
        if not self.options.is_free or self._crowds:
            fitted = self._on_network()
            if fitted is not None and (not self.options.is_free or self._is_kept(fitted)):
                return fitted
        if not self.options.is_free:
            raise SurfaceError("no minimal annulus was found: none was made of triangles and flattened")
        try:
            answer = self._on_cylinder()
        except SurfaceError:
            fitted = fitted or self._on_network()
            if fitted is None:
                raise
            return fitted
        if isinstance(answer, NoAnnulus) or answer.converged:
            return answer
        fitted = fitted or self._on_network()
        if fitted is None:
            return answer
        return min(answer, fitted, key=lambda one: (not self._is_kept(one), one.boundary_residual.rms))

    def _is_kept(self, annulus: PlateauSolution) -> bool:
        """Whether an annulus near enough to the rims is not to be left for a stable one."""
        leaves = self.options.leaves_unstable
        return annulus.converged and not (leaves and annulus.stability.verdict == "unstable")

    def _on_cylinder(self) -> PlateauSolution | NoAnnulus:
        """Douglas's annulus of least area, or that there is none."""
        best = self._descended()
        if best is None:
            best = min(self._stable(), key=lambda pair: pair[1].energy, default=None)
        return self._none(_RUNS_AWAY) if best is None else self._solution(*best)

    def _on_network(self) -> PlateauSolution | None:
        """The annulus of a Cauchy network on a domain made for the rims; none where no domain was found."""
        try:
            return self._told(self._network.found())
        except (DomainError, SingularMatrixError):
            return None

    @cached_property
    def _network(self) -> AnnulusNetworkSolver:
        first, second, back = (replace(loop, points=(loop.points - self.centre) / self.scale) for loop in self.loops)
        return AnnulusNetworkSolver.between(
            (first, second, back),
            self.curves,
            options=self.options.cauchy,
            budget=Budget(
                allowed=self._allowed,
                tolerance=self.options.tolerance,
                max_iterations=self.options.max_iterations,
                on_iteration=self._heard_of,
            ),
            device=self.options.device,
            clock=self.clock,
        )

    @cached_property
    def _crowds(self) -> bool:
        """Whether a round annulus takes too many nodes: its gap is too long for its width, or too uneven."""
        first, second = (curve.coefficients[-1] for curve in self.curves[:2])
        gaps = np.concatenate([cKDTree(b).query(a)[0] for a, b in ((first, second), (second, first))])
        if gaps.max() < _EVEN * gaps.min() and self._wanted_nodes < _FEW_NODES:
            return False
        try:
            return self._network.nodes_on_cylinder > _CROWDED
        except (DomainError, SingularMatrixError):
            return False

    def every(self) -> tuple[PlateauSolution, ...]:
        """All annuli that were found, unstable ones too, by area."""
        plane = self._in_plane()
        if plane is not None:
            return (plane,)
        if self._obstacle() is not None:
            return ()
        solutions = [self._solution(reverse, annulus) for reverse, annulus in self._all_critical()]
        return tuple(sorted(solutions, key=lambda solution: solution.area))

    def _in_plane(self) -> PlateauSolution | None:
        with self.clock.stage("surface"):
            plane = plane_annulus(self.curves, self.options.device, allowed=self._allowed)
        return None if plane is None else self._told(plane)

    def _obstacle(self) -> str | None:
        """Why there cannot be an annulus, where that is certain."""
        with self.clock.stage("moduli"):
            if beside_in_plane(*self.curves[:2]):
                return _BESIDE
            return _PARTED if parted_by_cone(*self.curves[:2]) else None

    def _descended(self) -> tuple[bool, HarmonicAnnulus] | None:
        """The annulus that the energy falls to from the better start, or from both, of the second loop's directions.

        None where the modulus runs away, or no critical point is reached.
        """
        best: tuple[bool, HarmonicAnnulus] | None = None
        with self.clock.stage("slides"):
            starts = self._starts
            least = min(energy for _, energy in starts)
            for reverse, (start, energy) in zip((False, True), starts, strict=True):
                if energy <= _RIVAL * least:
                    annulus = self._problem(reverse).descended(*start, tolerance=_FOUND)
                    if annulus is None or max(annulus.gradient, abs(annulus.slope)) > _SETTLED:
                        continue
                    if best is None or annulus.energy < best[1].energy:
                        best = reverse, annulus
        return best

    @cached_property
    def _wanted_nodes(self) -> float:
        """Nodes on each rim that resolve the gap between them: its width against their length is about the modulus."""
        first, second = (curve.coefficients[-1] for curve in self.curves[:2])
        gap = float(np.mean(cKDTree(first).query(second)[0]))
        length = sum(loop.perimeter for loop in self.loops[:2]) / 2 / self.scale
        return _NODES_PER_GAP * length / max(gap, float(np.finfo(np.float64).tiny))

    @cached_property
    def _coarse_nodes(self) -> int:
        """Nodes on each rim with which an annulus is sought."""
        steps = np.ceil(np.log2(self._wanted_nodes))
        return int(2 ** np.clip(steps, np.log2(_COARSE_NODES), np.log2(_DENSE_NODES)))

    @cached_property
    def _starts(self) -> tuple[tuple[tuple[Float[Tensor, "2 n"], float], float], ...]:
        """Slides and modulus to start from, and their energy, with the second loop as it is and reversed."""
        problems = [self._problem(reverse) for reverse in (False, True)]
        starts = [problem.start(self._coarse_nodes) for problem in problems]
        return tuple((start, problem.energy(*start)) for problem, start in zip(problems, starts, strict=True))

    @cached_property
    def _way(self) -> tuple[tuple[BoundaryCurve, BoundaryCurve, BoundaryCurve], ...]:
        """Curves that lead to those of the loops: these alone, or for rough loops from smooth ones on.

        Newton's method finds its way through many sharp bends only if they grow on it.
        """
        if not self._is_rough:
            return (self.curves,)
        ways = [_grown(curve, len(loop)) for curve, loop in zip(self.curves, self.loops, strict=True)]
        return tuple(zip(*ways, strict=True))

    @cached_property
    def _is_rough(self) -> bool:
        return any(
            curve.degree == min(DEGREES)
            and np.quantile(turning_angles(loop.points), 0.9) - 3 * np.pi / len(loop) > _ROUGH_TURN
            for curve, loop in zip(self.curves, self.loops, strict=True)
        )

    def _problem(self, reverse: bool, step: int = 0) -> AnnulusProblem:
        first, *others = (CurveTensors.of(curve, self.options.device) for curve in self._way[step])
        return AnnulusProblem(curves=(first, others[reverse]), on_step=self._heard)

    def _heard(self, gradient: float) -> None:
        self._heard_of(Iteration(index=0, method="Douglas-Newton", residual=gradient))

    def _heard_of(self, one: Iteration) -> None:
        step = replace(one, index=len(self.history) + 1)
        self.history.append(step)
        if self.on_iteration is not None:
            self.on_iteration(step)

    def _all_critical(self) -> list[tuple[bool, HarmonicAnnulus]]:
        """The critical points with the second loop in the direction whose start has less energy."""
        reverse = self._starts[1][1] < self._starts[0][1]
        with self.clock.stage("moduli"):
            return [(reverse, annulus) for annulus in self._problem(reverse).all_critical(self._coarse_nodes)]

    def _stable(self) -> list[tuple[bool, HarmonicAnnulus]]:
        return [pair for pair in self._all_critical() if self._problem(pair[0]).index(pair[1]) == 0]

    def _none(self, reason: str) -> NoAnnulus:
        return NoAnnulus(
            loops=self.loops[:2],
            rim_disks=self._disks,
            reason=f"no annulus: {reason}; what is left are two disks",
            history=tuple(self.history),
            solve_timings=dict(self.clock.seconds),
        )

    @cached_property
    def _disks(self) -> RimDisks:
        options = replace(self.options, laurent=None)
        return RimDisks(solve=partial(_disks_over, self.loops[:2], self.curves[:2], options))

    def _solution(self, reverse: bool, annulus: HarmonicAnnulus) -> PlateauSolution:
        """The annulus with as many nodes as the tolerance asks for, or as help."""
        problem = self._problem(reverse, -1)
        best: tuple[AnnularLift, HarmonicAnnulus] | None = None
        error, limit, vain = SurfaceError("no minimal annulus was found"), "more nodes on the rims do not help", 0
        for finer in self._finer(reverse, annulus):
            goal = self._goal(finer)
            with self.clock.stage("lift"):
                try:
                    lift = lifted_annulus(finer, problem.curves, allowed=goal)
                except SurfaceError as failure:  # more nodes may tell the sheets apart
                    error = failure
                    continue
            vain = 0 if best is None or lift.misfit.rms < _WORTHWHILE * best[0].misfit.rms else vain + 1
            if best is None or lift.misfit.rms < best[0].misfit.rms:
                best = lift, finer
            told = best[0].misfit
            met = told.rms <= goal and told.max_per_local_edge <= LOCAL_TOLERANCES * self.options.tolerance
            if met or vain == _PATIENCE:
                break
        else:
            limit = f"{self._most_nodes} nodes on each rim are the most that are tried"
        if best is None:
            raise error
        return self._told(self._found(*best, reverse=reverse, limit=limit))

    def _goal(self, annulus: HarmonicAnnulus) -> float:
        """Distance at which no more nodes are taken."""
        if self.options.is_series:
            return 0.0
        return self._allowed * (_WELL_BELOW if annulus.slides.shape[1] < _CHEAP_NODES else 1.0)

    @property
    def _allowed(self) -> float:
        """RMS distance from the rims that is asked for, at unit size."""
        return self.options.tolerance * self._mean_edge / self.scale

    @property
    def _mean_edge(self) -> float:
        loops = self.loops[:2]
        return sum(loop.perimeter for loop in loops) / sum(map(len, loops))

    @property
    def _most_nodes(self) -> int:
        if not self._is_rough:
            return _MOST_SMOOTH
        return min(_MOST_NODES, max(_DENSE_NODES, _MOST_PER_EDGE * max(map(len, self.loops))))

    def _finer(self, reverse: bool, annulus: HarmonicAnnulus) -> Iterator[HarmonicAnnulus]:
        """The annulus over the loops' own curves, and with more and more nodes."""
        problem = self._problem(reverse, -1)
        stable = self._problem(reverse).index(annulus) == 0
        if self._is_rough:
            n = _even(_PER_EDGE * max(map(len, self.loops)))
            with self.clock.stage("slides"):
                for step in range(1, len(self._way)):
                    annulus = self._settled(self._problem(reverse, step), annulus, n, near=False)
        while True:
            yield annulus
            require_time()
            n = _even(_MORE_NODES * annulus.slides.shape[1])
            if n > self._most_nodes:
                return
            with self.clock.stage("slides"):
                if stable and n > _DENSE_NODES:
                    annulus = self._settled(problem, annulus, n, near=not self._is_rough)
                    continue
                finer: HarmonicAnnulus | None = problem.refined(annulus, n)
                if stable and finer is not None and finer.gradient > _POOR:
                    finer = problem.descended(finer.slides, annulus.log_modulus, tolerance=_FOUND)
            if finer is None:
                return
            annulus = finer

    def _settled(self, problem: AnnulusProblem, annulus: HarmonicAnnulus, n: int, *, near: bool) -> HarmonicAnnulus:
        edges = max(map(len, self.loops))
        return problem.settled(
            annulus,
            n,
            tolerance=_FINE_ROUGH * self.options.tolerance if self._is_rough else _FOUND,
            max_steps=max(0, min(_MOST_STEPS, self.options.max_iterations - len(self.history))),
            near=near,
            negligible=_NEGLIGIBLE * 2 * math.pi * edges * self._allowed**2 if self._is_rough else 0.0,
        )

    def _found(self, lift: AnnularLift, annulus: HarmonicAnnulus, *, reverse: bool, limit: str) -> FoundAnnulus:
        with self.clock.stage("surface"):
            surface = annular_surface(lift, order=_PATH_ORDER)
        first, second = (rim.slide.cpu().numpy() for rim in lift.rims)
        t = np.arange(len(first)) / len(first)
        return FoundAnnulus(
            surface=surface,
            order=(0, 1),
            reverse=reverse,
            matchings=(np.column_stack([t, first]), np.column_stack([t, second])),
            misfit=lift.misfit,
            area=lift.area,
            modulus=annulus.modulus,
            spin="antiperiodic" if lift.model.antiperiodic else "periodic",
            period=lift.period,
            route="annulus",
            limit=limit,
        )

    def _told(self, found: FoundAnnulus) -> PlateauSolution:
        """An annulus in the loops' coordinates."""
        scale, clock = self.scale, self.clock
        with clock.stage("surface"):
            surface = found.surface.transform(scale=scale, translation=self.centre)
        residual = BoundaryResidual.of(found.misfit.enlarged(scale), mean_edge=self._mean_edge, diagonal=scale)
        tolerance = self.options.tolerance
        converged, reason = residual.verdict(tolerance, steps=len(self.history), limit=found.limit)
        return PlateauSolution(
            surface=surface,
            rims=self._rims(found, surface),
            domain=surface.domain,
            boundary_residual=residual,
            area=found.area * scale**2,
            route=found.route,
            history=tuple(self.history),
            solve_timings=dict(clock.seconds),
            tolerance=tolerance,
            converged=converged,
            reason=reason,
            evidence=Evidence(surface=surface),
            annulus=Annulus(
                modulus=found.modulus,
                spin=found.spin,
                period=found.period * scale,
                reversed=found.reverse,
                order=found.order,
                rim_disks=self._disks,
            ),
        )

    def _rims(self, found: FoundAnnulus, surface: SpinorSurface) -> tuple[RimMatch, ...]:
        loops = (self.loops[0], self.loops[1 + found.reverse])
        curves = (self.curves[0], self.curves[1 + found.reverse])
        return tuple(
            RimMatch(
                loop=loops[number],
                curve=curves[number].placed(loops[number].points, self.scale),
                boundary=boundary,
                matching=matching,
            )
            for number, boundary, matching in zip(found.order, surface.domain.boundaries, found.matchings, strict=True)
        )


def _disks_over(
    loops: tuple[BoundaryLoop, BoundaryLoop], curves: tuple[BoundaryCurve, BoundaryCurve], options: Options
) -> tuple[PlateauSolution, PlateauSolution] | None:
    """The minimal disks over two loops that are known to be simple; None where one was not found."""
    try:
        first, second = (Task.over(*rim, options).solved() for rim in zip(loops, curves, strict=True))
    except SpinorGeomError:
        return None
    return first, second


def _grown(curve: BoundaryCurve, points: int) -> list[BoundaryCurve]:
    """Curves from a smooth average to a rough one."""
    widths = np.geomspace(_SMOOTHING / min(points, _COARSE_NODES // 2), _SMOOTHING / points, _AVERAGES)
    averages = [curve.smoothed(width) for width in widths]
    return [
        *averages,
        *(averages[-1].towards(curve, share) for share in np.arange(1, _DEFORMATIONS + 1) / _DEFORMATIONS),
    ]


def _even(nodes: float) -> int:
    """An even number of nodes, not smaller, that is fast to transform."""
    return 2 * next_fast_len(math.ceil(nodes / 2))


def _sampled(given: BoundaryLoop | ClosedCurve) -> tuple[BoundaryLoop, BoundaryCurve | None]:
    """The loop, or that of a formula's polynomials with them."""
    return (given, None) if isinstance(given, BoundaryLoop) else sampled_formula(given)


def _edge(loop: BoundaryLoop, number: int) -> list[int]:
    return [int(loop.vertex_ids[number]), int(loop.vertex_ids[(number + 1) % len(loop)])]


def _at_unit_size(
    loop: BoundaryLoop, formula: BoundaryCurve | None, centre: Float[np.ndarray, "3"], scale: float
) -> BoundaryCurve:
    """The curve through a loop, with the loops' common centre at 0 and their diagonal 1."""
    points = (loop.points - centre) / scale
    if formula is not None:
        return formula.placed(points, 1 / scale)
    return BoundaryCurve.from_loop(BoundaryLoop(points=points, vertex_ids=loop.vertex_ids, corners=loop.corners))
