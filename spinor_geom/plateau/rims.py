"""Loops on their way to a minimal surface between them: directions, start, moduli, and the verdict against disks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import torch
from jaxtyping import Float
from scipy.fft import next_fast_len
from scipy.spatial import cKDTree
from torch import Tensor

from spinor_geom.deadline import require_time
from spinor_geom.errors import (
    DomainError,
    OptionError,
    SingularMatrixError,
    SpinorGeomError,
    SurfaceError,
)
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve, ClosedCurve
from spinor_geom.plateau.annulus_network import AnnulusNetworkSolver
from spinor_geom.plateau.capacity_path import all_on_path, mean_modulus
from spinor_geom.plateau.circles import ROUND_OFF
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.cone import parted_by_cone
from spinor_geom.plateau.douglas_rims import RimsProblem
from spinor_geom.plateau.evidence import Evidence
from spinor_geom.plateau.found import FoundBetween
from spinor_geom.plateau.lift_rims import Lift, lifted, lifted_surface
from spinor_geom.plateau.misfit import LOCAL_TOLERANCES
from spinor_geom.plateau.moduli_search import ModuliSearch
from spinor_geom.plateau.network_route import Budget
from spinor_geom.plateau.options import Options
from spinor_geom.plateau.plan import minimal_disk, plan
from spinor_geom.plateau.plane_route import beside_in_plane, plane_between
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.rim_curves import at_unit_size, grown, is_rough, require_apart, sampled
from spinor_geom.plateau.rim_starts import Placement, Rim, seen_starts, start_between, start_over
from spinor_geom.plateau.rims_energy import HarmonicSurface
from spinor_geom.plateau.rims_through_points import surface_through
from spinor_geom.plateau.solution import (
    Annulus,
    BoundaryResidual,
    Iteration,
    NoConnectedSurface,
    PlateauSolution,
    RimDisks,
    RimMatch,
)
from spinor_geom.plateau.task import Task
from spinor_geom.surface.spinor_surface import SpinorSurface

# Nodes on each rim where an annulus is sought, most for which matrices are factored, most of all, and most an edge.
_COARSE_NODES, _DENSE_NODES, _MOST_NODES, _MOST_PER_EDGE = 64, 256, 1 << 15, 200
# Nodes on each of three rims or more where a surface is sought, and on all together for which matrices are factored.
_FEWEST_NODES, _DENSE_IN_ALL = 32, 1536
# Most nodes on smooth rims: their distance falls exponentially, unless the nodes crowd.
_MOST_SMOOTH = 2048
# Nodes on a length as long as the gap is wide, where an annulus is sought.
_NODES_PER_GAP = 4
# Nodes for each edge of rough rims to begin with, and how many times more come next.
_PER_EDGE, _MORE_NODES = 6, 2
# Of rough rims: gradient to stop at, as a share of the distance allowed in edges; fall of the energy that is none, as a
# share of that of waves of that height; steps of one solve.
_FINE_ROUGH, _NEGLIGIBLE, _MOST_STEPS = 3e-2, 1e-3, 60
# Powers of one circle's coordinate on another that are left away over rough rims: far below what their nodes resolve.
_NEGLIGIBLE_POWER = 1e-8
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
_FALLS_APART = "the energy of surfaces between the rims falls until they fall apart, whatever was tried"
_PARTED = "the rims are so far apart that a cone parts them through which no connected minimal surface passes"
_BESIDE = "the rims lie beside each other in one plane, which a minimal surface between them would not leave"
# Quadrature nodes on each piece of a path in Ω.
_PATH_ORDER = 16
# Nodes on the cylinder beyond which a domain is made for the rims; where the largest gap is fewer times the least, and
# the mean gap wants few nodes, so many are never needed.
_CROWDED, _EVEN, _FEW_NODES = 1200.0, 4.0, 128.0


@dataclass(frozen=True, kw_only=True, eq=False)
class RimsTask:
    """Two loops or more at a common unit size.

    Attributes:
        loops: as they were given.
        curves: through these at unit size, and reversed.
        centre: of the loops.
        scale: their common diagonal.
        options: of the call.
        on_iteration: is called at each step.
        clock: of the stages.
        history: the steps so far.
    """

    loops: tuple[BoundaryLoop, ...]
    curves: tuple[tuple[BoundaryCurve, BoundaryCurve], ...]
    centre: Float[np.ndarray, "3"]
    scale: float
    options: Options
    on_iteration: Callable[[Iteration], None] | None
    clock: Clock
    history: list[Iteration]

    @classmethod
    def of(
        cls,
        given: Sequence[BoundaryLoop | ClosedCurve],
        options: Options,
        on_iteration: Callable[[Iteration], None] | None = None,
    ) -> RimsTask:
        """The task of loops or curves in formulas.

        Raises:
            OptionError: a model that has no surfaces over several rims.
            SelfCrossingLoopError: a loop crosses or touches itself.
            LoopsMeetError: two loops cross or touch each other.
            RepeatedPointError: two neighbouring points of a loop are equal.
            CurveError: formulas are not those of a smooth closed curve.
        """
        if options.trainer is not None:
            raise OptionError("no network is trained between two loops; use model='auto', 'series' or 'cauchy'")
        if len(given) > 2 and not options.is_free and not options.is_series:
            raise OptionError("no Cauchy network is fitted between three loops or more; use model='auto' or 'series'")
        samples = [sampled(one) for one in given]
        loops = tuple(loop for loop, _ in samples)
        require_apart(loops)
        scale = float(np.linalg.norm(np.ptp(np.concatenate([loop.points for loop in loops]), axis=0)))
        lengths = np.array([loop.perimeter for loop in loops])
        centre = lengths @ np.stack([loop.centroid for loop in loops]) / lengths.sum()
        curves = [at_unit_size(loop, formula, centre, scale) for loop, formula in samples]
        return cls(
            loops=loops,
            curves=tuple((curve, curve.reversed()) for curve in curves),
            centre=centre,
            scale=scale,
            options=options,
            on_iteration=on_iteration,
            clock=Clock(),
            history=[],
        )

    def solved(self) -> PlateauSolution | NoConnectedSurface:
        """The surface of least area that was found, or that there is none."""
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
            moduli = [math.log(mean_modulus(placed.surface.domain)) for placed in found]
            near = min(zip(moduli, found, strict=True), key=lambda pair: abs(pair[0] - log), default=None)
            return self._none() if near is None else self._solution(near[1])
        passed = self._through_points() if self.options.is_free and self.options.between == "free" else None
        if passed is not None and passed.converged:
            return passed
        if self.options.is_series or len(self.loops) > 2:
            return self._on_circles()
        fitted: PlateauSolution | None = None
        if not self.options.is_free or self._crowds:
            fitted = self._on_network()
            if fitted is not None and (not self.options.is_free or self._is_kept(fitted)):
                return fitted
        if not self.options.is_free:
            raise SurfaceError("no minimal annulus was found: none was made of triangles and flattened")
        try:
            answer = self._on_circles()
        except SurfaceError:
            fitted = fitted or self._on_network()
            if fitted is None:
                raise
            return fitted
        if isinstance(answer, NoConnectedSurface) or answer.converged:
            return answer
        fitted = fitted or self._on_network()
        if fitted is None:
            return answer
        return min(answer, fitted, key=lambda one: (not self._is_kept(one), one.boundary_residual.rms))

    def _is_kept(self, annulus: PlateauSolution) -> bool:
        """Whether an annulus near enough to the rims is not to be left for a stable one."""
        leaves = self.options.leaves_unstable
        return annulus.converged and not (leaves and annulus.stability.verdict == "unstable")

    def _on_circles(self) -> PlateauSolution | NoConnectedSurface:
        """Douglas's surface of least area over a circular domain, or that there is none."""
        best = self._descended()
        if best is None and len(self.loops) == 2:
            best = min(self._stable(), key=lambda placed: placed.surface.energy, default=None)
        if best is not None:
            return self._solution(best)
        return self._none()

    def _through_points(self) -> PlateauSolution | None:
        """The surface through the points of rough rims; none over smooth ones, or where their teeth cross in Ω."""
        placed = self._descended() if self._is_rough else None
        if placed is None:
            return None
        problem = self._problem(placed)
        with self.clock.stage("lift"):
            smooth = lifted(placed.surface, problem.curves, allowed=self._allowed)
            circles = lifted_surface(smooth, order=_PATH_ORDER).domain.boundaries
        points, starts = [], []
        for rim, back, slide, circle in zip(placed.rims, placed.back, smooth.rims, circles, strict=True):
            loop = self.loops[rim.number].reversed() if back else self.loops[rim.number]
            average = self._way[0][rim.number]
            match = RimMatch(
                loop=loop,
                curve=average.reversed() if back else average,
                boundary=circle,
                matching=_matching(slide.slide),
            )
            points.append((loop.points - self.centre) / self.scale)
            starts.append(torch.as_tensor(match.points_in_domain(), device=self.options.device))
        try:
            with self.clock.stage("fit"):
                passed = surface_through(smooth, starts, points, allowed=self._allowed, on_step=self._heard_newton)
        except DomainError:
            return None
        found = FoundBetween(
            surface=passed.surface,
            order=tuple(rim.number for rim in placed.rims),
            back=placed.back,
            matchings=tuple(
                np.column_stack([boundary.parameters[:-1], curve.breaks[:-1]])
                for boundary, curve in zip(passed.surface.domain.boundaries, passed.curves, strict=True)
            ),
            curves=passed.curves,
            misfit=passed.misfit,
            area=passed.surface.area(),
            modulus=mean_modulus(placed.surface.domain),
            antiperiodic=smooth.model.antiperiodic,
            period=passed.period,
            route="vertices",
            limit="no minimal surface near that over averages of the rims passes through their points more nearly",
        )
        return self._told(found)

    def _heard_newton(self, distance: float) -> bool:
        self._heard_of(Iteration(index=0, method="Newton", residual=distance))
        return len(self.history) < self.options.max_iterations

    def _on_network(self) -> PlateauSolution | None:
        """The annulus of a Cauchy network on a domain made for two rims; none where no domain was found."""
        try:
            return self._told(self._network.found())
        except (DomainError, SingularMatrixError):
            return None

    @cached_property
    def _network(self) -> AnnulusNetworkSolver:
        first, second = (replace(loop, points=(loop.points - self.centre) / self.scale) for loop in self.loops)
        (one, _), (other, back) = self.curves
        return AnnulusNetworkSolver.between(
            (first, second, second.reversed()),
            (one, other, back),
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
        first, second = self._vertices
        gaps = np.concatenate([cKDTree(b).query(a)[0] for a, b in ((first, second), (second, first))])
        if gaps.max() < _EVEN * gaps.min() and self._wanted_nodes < _FEW_NODES:
            return False
        try:
            return self._network.nodes_on_cylinder > _CROWDED
        except (DomainError, SingularMatrixError):
            return False

    @property
    def _vertices(self) -> list[Float[np.ndarray, "_ 3"]]:
        return [curve.coefficients[-1] for curve, _ in self.curves]

    def every(self) -> tuple[PlateauSolution, ...]:
        """All surfaces that were found, unstable ones too, by area."""
        plane = self._in_plane()
        if plane is not None:
            return (plane,)
        if self._obstacle() is not None:
            return ()
        solutions = [self._solution(placed) for placed in self._all_critical()]
        return tuple(sorted(solutions, key=lambda solution: solution.area))

    def _in_plane(self) -> PlateauSolution | None:
        with self.clock.stage("surface"):
            plane = plane_between(self.curves, self.options.device, allowed=self._allowed)
        return None if plane is None else self._told(plane)

    def _obstacle(self) -> str | None:
        """Why there cannot be a surface, where that is certain."""
        given = [curve for curve, _ in self.curves]
        with self.clock.stage("moduli"):
            if beside_in_plane(given):
                return _BESIDE
            return _PARTED if len(given) == 2 and parted_by_cone(*given) else None

    def _descended(self) -> Placement | None:
        """The surface that the energy falls to from the better start, or from several of nearly the same energy.

        None where it falls apart, or no critical point is reached.
        """
        best: Placement | None = None
        with self.clock.stage("slides"):
            least = min((start.surface.energy for start in self._starts), default=0.0)
            for start in self._starts:
                if start.surface.energy <= _RIVAL * least:
                    lower = self._lower(start)
                    if lower is not None and (best is None or lower.surface.energy < best.surface.energy):
                        best = lower
            if best is None:
                return None
            nodes = max(best.surface.slides.shape[1], _COARSE_NODES)
            return replace(best, surface=self._problem(best).refined(best.surface, nodes))

    def _lower(self, start: Placement) -> Placement | None:
        """What the energy falls to from a start, with as many nodes as resolve the gaps between the circles.

        None where it falls apart, of three rims or more with twice as many nodes too.
        """
        problem, n, fallen = self._problem(start), start.surface.slides.shape[1], 0
        while True:
            lower = problem.descended(problem.resampled(start.surface, n), tolerance=_POOR)
            if lower is not None and lower.size <= _SETTLED:
                return replace(start, surface=lower)
            n, fallen = 2 * n, fallen + (lower is None)
            if len(self.loops) == 2 or fallen == 2 or n > _DENSE_NODES:
                return None

    @cached_property
    def _wanted_nodes(self) -> float:
        """Nodes on each of two rims that resolve the gap: its width against their length is about the modulus."""
        first, second = self._vertices
        gap = float(np.mean(cKDTree(first).query(second)[0]))
        length = sum(loop.perimeter for loop in self.loops) / 2 / self.scale
        return _NODES_PER_GAP * length / max(gap, float(np.finfo(np.float64).tiny))

    @cached_property
    def _coarse_nodes(self) -> int:
        """Nodes on each of two rims with which an annulus is sought."""
        steps = np.ceil(np.log2(self._wanted_nodes))
        return int(2 ** np.clip(steps, np.log2(_COARSE_NODES), np.log2(_DENSE_NODES)))

    @cached_property
    def _starts(self) -> tuple[Placement, ...]:
        """Where to start from: two rims with the second as it is and reversed."""
        rims = self._rims[0]
        if len(rims) == 2:
            return tuple(start_between(*rims, self._coarse_nodes, back=back) for back in (False, True))
        seen = seen_starts(rims, _FEWEST_NODES)
        return tuple(seen) or tuple(start_over(rims, _FEWEST_NODES, first=0, back=back) for back in (False, True))

    @cached_property
    def _way(self) -> tuple[tuple[BoundaryCurve, ...], ...]:
        """Curves that lead to those of the loops: these alone, or for rough loops from smooth ones on.

        Newton's method finds its way through many sharp bends only if they grow on it.
        """
        given = tuple(curve for curve, _ in self.curves)
        if not self._is_rough:
            return (given,)
        ways = [grown(curve, len(loop)) for curve, loop in zip(given, self.loops, strict=True)]
        return tuple(zip(*ways, strict=True))

    @cached_property
    def _is_rough(self) -> bool:
        return any(is_rough(curve, loop) for (curve, _), loop in zip(self.curves, self.loops, strict=True))

    @cached_property
    def _rims(self) -> tuple[tuple[Rim, ...], ...]:
        """All rims on each step of their way, in both directions."""
        device = self.options.device
        last = [ways[1] for ways in self.curves]
        return tuple(
            tuple(
                Rim(number=k, ways=(CurveTensors.of(curve, device), CurveTensors.of(back, device)))
                for k, (curve, back) in enumerate(
                    zip(curves, last if curves is self._way[-1] else [c.reversed() for c in curves], strict=True)
                )
            )
            for curves in self._way
        )

    def _problem(self, placed: Placement, step: int = 0) -> RimsProblem:
        rims = self._rims[step]
        curves = tuple(rims[rim.number].ways[back] for rim, back in zip(placed.rims, placed.back, strict=True))
        negligible = _NEGLIGIBLE_POWER if self._is_rough else ROUND_OFF
        return RimsProblem(curves=curves, negligible=negligible, on_step=self._heard)

    def _heard(self, gradient: float) -> None:
        self._heard_of(Iteration(index=0, method="Douglas-Newton", residual=gradient))

    def _heard_of(self, one: Iteration) -> None:
        step = replace(one, index=len(self.history) + 1)
        self.history.append(step)
        if self.on_iteration is not None:
            self.on_iteration(step)

    def _all_critical(self) -> list[Placement]:
        """Critical points: over two rims all with the second loop in the direction whose start has less energy.

        Over more the one of least energy and those on its path.
        """
        if len(self.loops) > 2:
            best = self._descended()
            if best is None:
                return []
            problem, n = self._problem(best), best.surface.slides.shape[1]
            with self.clock.stage("moduli"):
                # on half of the nodes, whose steps cost an eighth
                found = all_on_path(problem, problem.refined(best.surface, n // 2))
                return [replace(best, surface=problem.refined(surface, n)) for surface in found]
        start = min(self._starts, key=lambda start: start.surface.energy)
        with self.clock.stage("moduli"):
            search = ModuliSearch(problem=self._problem(start), start=start.surface)
            return [replace(start, surface=surface) for surface in search.all_critical()]

    def _stable(self) -> list[Placement]:
        return [placed for placed in self._all_critical() if self._problem(placed).index(placed.surface) == 0]

    def _none(self, reason: str | None = None) -> NoConnectedSurface:
        two = len(self.loops) == 2
        kind, left = ("annulus", "two disks") if two else ("surface of one piece", "surfaces of fewer rims each")
        if reason is None:
            reason = _RUNS_AWAY if two else _FALLS_APART
        return NoConnectedSurface(
            loops=self.loops,
            rim_disks=self._disks,
            reason=f"no {kind}: {reason}; what is left are {left}",
            history=tuple(self.history),
            solve_timings=dict(self.clock.seconds),
        )

    @cached_property
    def _disks(self) -> RimDisks:
        options = self.options if self.options.laurent is None else replace(self.options, model="auto")
        curves = tuple(curve for curve, _ in self.curves)
        return RimDisks(solve=partial(_disks_over, self.loops, curves, options), joined=self._area_over)

    def _area_over(self, numbers: tuple[int, ...]) -> float | None:
        """The area of the surface over some of the loops; None where none was found."""
        some = replace(
            self,
            loops=tuple(self.loops[k] for k in numbers),
            curves=tuple(self.curves[k] for k in numbers),
            options=self.options if self.options.laurent is None else replace(self.options, model="auto"),
            on_iteration=None,
            clock=Clock(),
            history=[],
        )
        try:
            answer = some.solved()
        except SpinorGeomError:
            return None
        return answer.area if isinstance(answer, PlateauSolution) else None

    def _solution(self, placed: Placement) -> PlateauSolution:
        """The surface with as many nodes as the tolerance asks for, or as help."""
        problem = self._problem(placed, -1)
        best: tuple[Lift, HarmonicSurface] | None = None
        error, limit, vain = SurfaceError("no minimal surface was found"), "more nodes on the rims do not help", 0
        for finer in self._finer(placed):
            goal = self._goal(finer)
            with self.clock.stage("lift"):
                try:
                    lift = lifted(finer, problem.curves, allowed=goal)
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
        return self._told(self._found(*best, placed=placed, limit=limit))

    def _goal(self, surface: HarmonicSurface) -> float:
        """Distance at which no more nodes are taken."""
        if self.options.is_series:
            return 0.0
        return self._allowed * (_WELL_BELOW if surface.slides.shape[1] < _CHEAP_NODES else 1.0)

    @property
    def _allowed(self) -> float:
        """RMS distance from the rims that is asked for, at unit size."""
        return self.options.tolerance * self._mean_edge / self.scale

    @property
    def _mean_edge(self) -> float:
        return sum(loop.perimeter for loop in self.loops) / sum(map(len, self.loops))

    @property
    def _most_nodes(self) -> int:
        if not self._is_rough:
            return _MOST_SMOOTH
        return min(_MOST_NODES, max(_DENSE_NODES, _MOST_PER_EDGE * max(map(len, self.loops))))

    def _finer(self, placed: Placement) -> Iterator[HarmonicSurface]:
        """The surface over the loops' own curves, and with more and more nodes."""
        problem, surface = self._problem(placed, -1), placed.surface
        stable = self._problem(placed).index(surface) == 0
        if self._is_rough:
            n = _even(_PER_EDGE * max(map(len, self.loops)))
            with self.clock.stage("slides"):
                for step in range(1, len(self._way)):
                    surface = self._settled(self._problem(placed, step), surface, n, near=False)
        while True:
            yield surface
            require_time()
            n = _even(_MORE_NODES * surface.slides.shape[1])
            if n > self._most_nodes:
                return
            with self.clock.stage("slides"):
                if stable and (n > _DENSE_NODES or n * len(self.loops) > _DENSE_IN_ALL):
                    surface = self._settled(problem, surface, n, near=not self._is_rough)
                    continue
                finer: HarmonicSurface | None = problem.refined(surface, n)
                if stable and finer is not None and finer.gradient > _POOR:
                    finer = problem.descended(finer, tolerance=_FOUND)
            if finer is None:
                return
            surface = finer

    def _settled(self, problem: RimsProblem, surface: HarmonicSurface, n: int, *, near: bool) -> HarmonicSurface:
        edges = max(map(len, self.loops))
        return problem.settled(
            surface,
            n,
            tolerance=_FINE_ROUGH * self.options.tolerance if self._is_rough else _FOUND,
            max_steps=max(0, min(_MOST_STEPS, self.options.max_iterations - len(self.history))),
            near=near,
            negligible=_NEGLIGIBLE * 2 * math.pi * edges * self._allowed**2 if self._is_rough else 0.0,
        )

    def _found(self, lift: Lift, harmonic: HarmonicSurface, *, placed: Placement, limit: str) -> FoundBetween:
        with self.clock.stage("surface"):
            surface = lifted_surface(lift, order=_PATH_ORDER)
        return FoundBetween(
            surface=surface,
            order=tuple(rim.number for rim in placed.rims),
            back=placed.back,
            matchings=tuple(_matching(rim.slide) for rim in lift.rims),
            misfit=lift.misfit,
            area=lift.area,
            modulus=mean_modulus(harmonic.domain),
            antiperiodic=lift.model.antiperiodic,
            period=lift.period,
            route="annulus" if len(lift.rims) == 2 else "circles",
            limit=limit,
        )

    def _told(self, found: FoundBetween) -> PlateauSolution:
        """A surface in the loops' coordinates."""
        scale, clock = self.scale, self.clock
        with clock.stage("surface"):
            surface = found.surface.transform(scale=scale, translation=self.centre)
        residual = BoundaryResidual.of(found.misfit.enlarged(scale), mean_edge=self._mean_edge, diagonal=scale)
        tolerance = self.options.tolerance
        converged, reason = residual.verdict(tolerance, steps=len(self.history), limit=found.limit)
        backward = dict(zip(found.order, found.back, strict=True))
        return PlateauSolution(
            surface=surface,
            rims=self._matches(found, surface),
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
                antiperiodic=found.antiperiodic,
                period=found.period * scale,
                backward=tuple(backward[number] for number in range(len(self.loops))),
                order=found.order,
                rim_disks=self._disks,
            ),
        )

    def _matches(self, found: FoundBetween, surface: SpinorSurface) -> tuple[RimMatch, ...]:
        matches: list[RimMatch] = []
        curves = found.curves
        for number, back, boundary, matching in zip(
            found.order, found.back, surface.domain.boundaries, found.matchings, strict=True
        ):
            loop = self.loops[number].reversed() if back else self.loops[number]
            curve = self.curves[number][back] if curves is None else curves[len(matches)]
            curve = curve.placed(loop.points, self.scale)
            matches.append(RimMatch(loop=loop, curve=curve, boundary=boundary, matching=matching))
        return tuple(matches)


def _disks_over(
    loops: tuple[BoundaryLoop, ...], curves: tuple[BoundaryCurve, ...], options: Options
) -> tuple[PlateauSolution, ...] | None:
    """The minimal disks over loops that are known to be simple; None where one was not found."""
    try:
        tasks = [Task.over(*rim, options) for rim in zip(loops, curves, strict=True)]
        return tuple(minimal_disk(task, plan(task)) for task in tasks)
    except SpinorGeomError:
        return None


def _matching(slide: Float[Tensor, " n"]) -> Float[np.ndarray, "n 2"]:
    """The pairs of `RimMatch` for curve parameters at equal steps."""
    return np.column_stack([np.arange(len(slide)) / len(slide), slide.cpu().numpy()])


def _even(nodes: float) -> int:
    """An even number of nodes, not smaller, that is fast to transform."""
    return 2 * next_fast_len(math.ceil(nodes / 2))
