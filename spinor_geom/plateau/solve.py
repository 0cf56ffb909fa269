"""Plateau's problem for one loop, from the first fill to the verdict."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, overload

import numpy as np
import torch

from spinor_geom.discrete.minimal_surface import Disk, first_disk
from spinor_geom.errors import (
    DomainError,
    FirstFillError,
    OptionError,
    SelfCrossingLoopError,
    SingularMatrixError,
    SpinorGeomError,
)
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.intersections import loop_crossings
from spinor_geom.plateau.certificates import area_in_domain, crossing_faces
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.harmonic_route import HarmonicSolver
from spinor_geom.plateau.network_route import Budget, Cauchy, NetworkSolver, rim_indices
from spinor_geom.plateau.plane_route import plane_disk
from spinor_geom.plateau.solution import BoundaryResidual, Iteration, PlateauSolution
from spinor_geom.plateau.solutions import Rim, find_disks, leave_unstable
from spinor_geom.plateau.stability import assess_stability
from spinor_geom.plateau.threads import one_thread

Model: TypeAlias = Literal["auto", "cauchy"] | Cauchy

# A harmonic disk that is left farther from Γ than this, in mean edges, does not spare the network.
_POOR = 1e-2
# Share of the steps that harmonic disks may take: the rest is the network's.
_HARMONIC_SHARE = 0.7


@overload
def solve_plateau(
    loop: BoundaryLoop,
    *,
    model: Model = "auto",
    tolerance: float = 1e-3,
    max_iterations: int = 400,
    unstable: Literal["leave", "keep"] = "leave",
    all_solutions: Literal[False] = False,
    device: str | torch.device = "cpu",
    on_iteration: Callable[[Iteration], None] | None = None,
) -> PlateauSolution: ...


@overload
def solve_plateau(
    loop: BoundaryLoop,
    *,
    model: Model = "auto",
    tolerance: float = 1e-3,
    max_iterations: int = 400,
    unstable: Literal["leave", "keep"] = "leave",
    all_solutions: Literal[True],
    device: str | torch.device = "cpu",
    on_iteration: Callable[[Iteration], None] | None = None,
) -> tuple[PlateauSolution, ...]: ...


def solve_plateau(
    loop: BoundaryLoop,
    *,
    model: Model = "auto",
    tolerance: float = 1e-3,
    max_iterations: int = 400,
    unstable: Literal["leave", "keep"] = "leave",
    all_solutions: bool = False,
    device: str | torch.device = "cpu",
    on_iteration: Callable[[Iteration], None] | None = None,
) -> PlateauSolution | tuple[PlateauSolution, ...]:
    """A minimal disk over a closed curve: exactly minimal, its boundary on Γ as nearly as the model allows.

    Γ is the spline through all of the loop's points, with its corners kept. A plane loop bounds the plane region inside
    it, exactly. Loops without corners take Douglas's route: the slide along Γ that makes the harmonic disk over Ω
    conformal, by Newton's method, and p and q from its boundary; Ω is the unit disk where that serves the loop, else a
    domain made for it. Loops with corners, and those that route does not bring near to Γ, take a Cauchy network: a
    discrete disk over the loop is flattened with its boundary lengths kept, which gives Ω; p and q start from the
    disk's frames along ∂Ω and are fitted by Gauss-Newton with the slide along Γ eliminated, in rounds, each with more
    Cauchy units where the residual is. Minimal disks need not be minima of the area: one that is unstable is left along
    an eigenvector of its second variation for one of less area.

    Args:
        loop: the curve, from a mesh or `BoundaryLoop.from_points`.
        model: "auto" for what suits the loop; "cauchy" for a Cauchy network whatever the loop, or its options.
        tolerance: RMS distance of the surface's boundary from Γ, in mean loop edges, below which the result counts as
            converged.
        max_iterations: limit on steps in all; with `all_solutions` on those from each start.
        unstable: "keep" returns an unstable disk, which is only a critical point of the area, as it was found.
        all_solutions: look for several disks over the loop, unstable ones too; see `find_disks`. It takes several times
            as long, and more disks may exist than are found.
        device: where the linear algebra runs; the surface is returned there.
        on_iteration: called after each step.

    Returns:
        The solution; with `all_solutions` all that were found, sorted by area, each with its Morse index.

    Raises:
        OptionError: an unknown model or a value out of range.
        FirstFillError: no discrete disk over the loop was found.
        DomainError: no simple plane domain was found.
        SelfCrossingLoopError: the loop crosses or touches itself.
        RepeatedPointError: two neighbouring points of the loop are equal.
        SingularMatrixError: the discrete disk over the loop is degenerate.

    Source: Sun & Chern (2026) for the representation; Douglas, "Solution of the problem of Plateau" (1931).
    """
    require_model(model)
    options = Cauchy() if isinstance(model, str) else model
    if not tolerance > 0 or max_iterations < 1:
        raise OptionError(f"tolerance and max_iterations must be positive, got {tolerance} and {max_iterations}")
    if unstable not in ("leave", "keep"):
        raise OptionError(f"unknown choice for unstable {unstable!r}; choose 'leave' or 'keep'")
    crossings = loop_crossings(loop.points)
    if len(crossings):
        edges = np.stack([loop.vertex_ids, np.roll(loop.vertex_ids, -1)], axis=1)[crossings[0]]
        raise SelfCrossingLoopError(edges=edges.tolist(), count=len(crossings))
    with one_thread():
        task = _Task.of(loop, options, tolerance, max_iterations, torch.device(device), on_iteration)
        rim = Rim(loop=loop, indices=task.network.rim)
        if model == "auto" and (plane := task.in_plane()) is not None:
            return (plane,) if all_solutions else plane
        if all_solutions:
            return find_disks(rim, task.from_disk)
        solution = task.first(harmonic=model == "auto")
        if unstable == "leave":
            down = task.down_from_disk if model == "auto" else task.from_disk
            solution = leave_unstable(solution, rim, down, max_iterations=max_iterations)
        return solution


def require_model(model: Model) -> None:
    """Checks the option `model`.

    Raises:
        OptionError: it is none of those that `solve_plateau` takes.
    """
    if not isinstance(model, Cauchy) and model not in ("auto", "cauchy"):
        raise OptionError(f"unknown model {model!r}; choose 'auto', 'cauchy' or Cauchy(...)")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    """A loop and its solvers, which see it at unit size."""

    loop: BoundaryLoop
    tolerance: float
    network: NetworkSolver
    harmonic: HarmonicSolver

    @classmethod
    def of(
        cls,
        loop: BoundaryLoop,
        options: Cauchy,
        tolerance: float,
        max_iterations: int,
        device: torch.device,
        on_iteration: Callable[[Iteration], None] | None,
    ) -> _Task:
        unit, clock = _at_unit_size(loop), Clock()
        curve = BoundaryCurve.from_loop(unit)
        allowed = tolerance * unit.mean_edge_length
        budget = Budget(allowed=allowed, max_iterations=max_iterations, on_iteration=on_iteration)
        network = NetworkSolver(
            loop=unit, rim=rim_indices(unit), curve=curve, options=options, budget=budget, device=device, clock=clock
        )
        harmonic = HarmonicSolver(
            loop=unit,
            curve=curve,
            allowed=allowed,
            max_steps=math.ceil(_HARMONIC_SHARE * max_iterations),
            device=device,
            clock=clock,
            on_iteration=on_iteration,
        )
        return cls(loop=loop, tolerance=tolerance, network=network, harmonic=harmonic)

    def in_plane(self) -> PlateauSolution | None:
        """The only solution where the loop is a simple curve in a plane."""
        found = plane_disk(self.network.loop, self.network.curve, self.network.device, self.network.clock)
        return None if found is None else self.solution(found)

    def first(self, *, harmonic: bool) -> PlateauSolution:
        """The solution from the likeliest start that meets the tolerance; the best of all where none does."""
        # a kink of Γ is a singularity of p and q, which the network has poles for
        if not harmonic or self.network.loop.corners.any():
            return self.solution(self._on_network(()))
        best: Found | None = None
        error: SpinorGeomError | None = None
        for on_network in (False, True) if self.harmonic.is_promising else (True, False):
            history = () if best is None else best.history
            try:
                tries = [self._on_network(history)] if on_network else self._harmonic_tries(history)
                for found in tries:
                    best = _nearer(best, found)
            except (DomainError, FirstFillError, SingularMatrixError) as failure:
                error = failure
            if best is not None and self._is_near(best):
                break
        if best is None:
            raise error or FirstFillError(
                "no minimal disk was found over the loop; check that it does not cross itself"
            )
        return self.solution(best)

    def _on_network(self, history: tuple[Iteration, ...]) -> Found:
        with self.network.clock.stage("first fill"):
            disk = first_disk(self.network.loop.points[self.network.rim])
        return self.network.found_from(disk, history)

    def _harmonic_tries(self, history: tuple[Iteration, ...]) -> Iterator[Found]:
        """Harmonic disks up to the first that is near to Γ."""
        for found in replace(self.harmonic, history=list(history)).tries():
            yield found
            if self._is_near(found):
                return

    def _is_near(self, found: Found) -> bool:
        return found.rms <= max(self.network.budget.allowed, _POOR * self.network.loop.mean_edge_length)

    def from_disk(self, disk: Disk, history: tuple[Iteration, ...] = ()) -> PlateauSolution:
        """The minimal disk nearest to a discrete one in the loop's coordinates, saddles included, timed by itself."""
        timed = self._timed_anew(history)
        return timed.solution(timed.network.found_from(self._at_unit_size(disk), history))

    def down_from_disk(self, disk: Disk, history: tuple[Iteration, ...] = ()) -> PlateauSolution:
        """The minimal disk to which the area falls from a discrete one, timed by itself."""
        timed, best = self._timed_anew(history), None
        if not self.loop.corners.any():
            best = next(timed.harmonic.tries_from(self._at_unit_size(disk), self.network.rim), None)
            if best is not None and best.rms <= self.network.budget.allowed:
                return timed.solution(best)
        return timed.solution(_nearer(best, timed.network.found_from(self._at_unit_size(disk), history)))

    def _timed_anew(self, history: tuple[Iteration, ...]) -> _Task:
        clock = Clock()
        return replace(
            self,
            network=replace(self.network, clock=clock),
            harmonic=replace(self.harmonic, clock=clock, history=list(history)),
        )

    def _at_unit_size(self, disk: Disk) -> Disk:
        return replace(disk, vertices=(disk.vertices - self.loop.centroid) / self.loop.diagonal)

    def solution(self, found: Found) -> PlateauSolution:
        """A disk in the loop's coordinates, with its verdict."""
        loop, clock = self.loop, self.network.clock
        with clock.stage("surface"):
            surface = found.surface.transform(scale=loop.diagonal, translation=loop.centroid)
        with clock.stage("stability"):
            stability = assess_stability(surface)
        with clock.stage("certificates"):
            area, crossings = area_in_domain(surface), crossing_faces(surface)
        residual = BoundaryResidual(
            rms=found.rms * loop.diagonal,
            max=found.max * loop.diagonal,
            mean_edge=loop.mean_edge_length,
            diagonal=loop.diagonal,
        )
        converged = residual.rms_per_edge <= self.tolerance
        reached = f"residual {residual.rms_per_edge:.1e} of the mean edge after {len(found.history)} steps"
        return PlateauSolution(
            surface=surface,
            loop=loop,
            curve=self.network.curve.placed(loop.points, loop.diagonal),
            domain=surface.domain,
            matching=found.matching,
            boundary_residual=residual,
            area=found.area * loop.diagonal**2,
            area_in_domain=area,
            self_intersections=crossings,
            route=found.route,
            history=found.history,
            timings=clock.seconds,
            tolerance=self.tolerance,
            converged=converged,
            reason=reached if converged else f"{reached}, above the tolerance {self.tolerance:.1e}: {found.limit}",
            stability=stability,
        )


def _at_unit_size(loop: BoundaryLoop) -> BoundaryLoop:
    """The loop with its centroid at 0 and diagonal 1, where every tolerance is a ratio."""
    return BoundaryLoop(
        points=(loop.points - loop.centroid) / loop.diagonal, vertex_ids=loop.vertex_ids, corners=loop.corners
    )


def _nearer(best: Found | None, found: Found) -> Found:
    """The one of two disks that is nearer to Γ, with the steps of both."""
    if best is None or found.rms < best.rms:
        return found
    return replace(best, history=found.history)
