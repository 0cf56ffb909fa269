"""The harmonic route to a minimal disk: Douglas's slide on a smooth Ω, then the lift to p and q.

It takes loops without corners: milliseconds for smooth ones, and its cost grows like n·log n with the number of nodes,
so it carries rough loops of thousands of points too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from spinor_geom.deadline import is_out_of_time
from spinor_geom.discrete.minimal_surface import Disk
from spinor_geom.domain.plane_domain import FourierBoundary
from spinor_geom.errors import DomainError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, turning_angles
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.interpolation import DEGREES
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.douglas import HarmonicDisk, minimise_dirichlet_energy, resampled, slide_downhill
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.harmonic_domains import DomainCandidates, Step
from spinor_geom.plateau.harmonic_fit import Fit, even, fit_together
from spinor_geom.plateau.lift import Lift, surface_of
from spinor_geom.plateau.omega import Shape
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.solution import Iteration, Route

# Turning angle, exceeded by one point in ten, from which a loop counts as rough, and as ragged: ragged ones of at most
# so many points are left to the network first.
_ROUGH_TURN, _RAGGED_TURN = np.radians(12.0), np.radians(50.0)
_LONG = 240
# Steps after which a ragged loop is left to the network.
_RAGGED_STEPS = 80
# A loop longer than so many times its width crowds on the disk.
_DISK_ELONGATION = 2.5
# Nodes per edge of a rough loop that a distance from Γ, in edges, is met with as a rule; smooth loops start with one.
_PER_EDGE_ROUGH = ((5e-3, 6), (5e-4, 9), (0.0, 12))
_MOST_PER_EDGE, _MOST_PER_EDGE_ROUGH = 64, 96
_FEWEST_NODES, _MOST_NODES = 256, 1 << 17
# Nodes for each edge of a loop so short that they are fewer than that, and most nodes of loops that are batched.
_FEWEST_PER_EDGE, _BATCHED_NODES = 16, 2048
# Nodes farther apart than so many times what was asked for show that Ω has lost a part of the loop.
_UNEVEN = 3.0
# Quadrature nodes on each piece of a path in Ω.
_PATH_ORDER = 16
# Nodes at which the directions of an unstable slide are found.
_MOST_FOR_MODES = 512
# Newton steps of one solve.
_MOST_STEPS = 60
# Gradient at which a coarse solve stops; the last one goes on to a share of the distance allowed in edges: to a small
# one on smooth loops, where each step doubles the digits.
_COARSE, _FINEST = 1e-3, 1e-11
# And where nothing but rounding errors is left.
_ROUNDING = 1e-13
# RMS distance from Γ, in diagonals, that is rounding error.
_ROUNDED = 1e-14
_FINE_ROUGH, _FINE_SMOOTH = 3e-2, 1e-4
# On rough loops it stops too where the energy falls by less than this share of that of the distance allowed.
_NEGLIGIBLE = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicSolver:
    """One loop on the harmonic route.

    Attributes:
        loop: the loop at unit size.
        curve: Γ.
        allowed: RMS distance from Γ to reach.
        max_steps: limit on Newton steps in all.
        device: where the slide is found.
        clock: of the stages.
        on_iteration: is called at each step.
        history: the steps so far.
        begun: the fit on the unit disk, where it was made or begun together with others.
        to_rounding: whether steps go on until the gradient is rounding error.
    """

    loop: BoundaryLoop
    curve: BoundaryCurve
    allowed: float
    max_steps: int
    device: torch.device
    clock: Clock
    on_iteration: Callable[[Iteration], None] | None = None
    history: list[Iteration] = field(default_factory=list)
    begun: Fit | None = None
    to_rounding: bool = False

    @cached_property
    def _exact(self) -> CurveTensors:
        return CurveTensors.of(self.curve, self.device)

    @cached_property
    def _turning(self) -> float:
        """Turning angle that one point in ten exceeds, less what a loop of so few points has however smooth it is."""
        return float(np.quantile(turning_angles(self.loop.points), 0.9)) - 3 * np.pi / len(self.loop)

    @property
    def is_rough(self) -> bool:
        """Whether the loop bends at many of its points: its curve is a cubic spline, and one point in ten turns."""
        return self.curve.degree == min(DEGREES) and self._turning > _ROUGH_TURN

    @property
    def is_promising(self) -> bool:
        """Whether the loop is likelier to be met here than by a Cauchy network."""
        return self._turning < _RAGGED_TURN or len(self.loop) > _LONG

    @property
    def is_narrow(self) -> bool:
        """Whether fingers of the loop want a fine ∂Ω."""
        return self._domains.is_narrow

    @property
    def _last_step(self) -> int:
        return min(self.max_steps, _RAGGED_STEPS) if self._turning > _RAGGED_TURN else self.max_steps

    @property
    def suits_disk(self) -> bool:
        """Whether the unit disk is tried first."""
        return not self.is_rough and self.loop.elongation < _DISK_ELONGATION

    @property
    def _first_per_edge(self) -> int:
        if not self.is_rough:
            return 1
        wanted = self.allowed / self.loop.mean_edge_length
        return next((nodes for limit, nodes in _PER_EDGE_ROUGH if wanted >= limit), _PER_EDGE_ROUGH[-1][1])

    @property
    def _first_nodes(self) -> int:
        """On the disk: a power of two as long as that is no more than the fewest for loops of any length."""
        m = len(self.loop)
        few = 1 << int(np.ceil(np.log2(_FEWEST_PER_EDGE * m)))
        return max(min(few, _FEWEST_NODES), m)

    @property
    def _equal_steps(self) -> Float[Tensor, " n"]:
        n = even(self._first_nodes)
        return torch.arange(n, dtype=torch.float64, device=self.device) / n

    @property
    def _fine_gradient(self) -> float:
        """At which a slide along Γ itself stops."""
        if self.to_rounding:
            return _ROUNDING
        share = _FINE_ROUGH if self.is_rough else _FINE_SMOOTH
        return float(np.clip(share * self.allowed / self.loop.mean_edge_length, _FINEST, _COARSE))

    @property
    def _enough(self) -> float:
        """RMS distance from Γ at which more nodes are not tried: rounding error where the curve itself has no other."""
        if self.to_rounding and self.curve.degree > max(DEGREES):
            return min(self.allowed, _ROUNDED)
        return self.allowed

    @property
    def _negligible_energy(self) -> float:
        """Of a rough loop: a small share of what waves as long as an edge and as high as the distance allowed have."""
        return _NEGLIGIBLE * 2 * np.pi * len(self.loop) * self.allowed**2 if self.is_rough else 0.0

    @cached_property
    def _domains(self) -> DomainCandidates:
        return DomainCandidates(
            loop=self.loop,
            curve=self.curve,
            is_rough=self.is_rough,
            nodes_per_edge=self._first_per_edge,
            device=self.device,
            clock=self.clock,
        )

    def tries(self) -> Iterator[Found]:
        """A minimal disk on one Ω after the other, the cheapest first, for the caller to take or leave."""
        if self.suits_disk:
            yield from self._on_disk()
        domains = self._domains
        for shapes in domains.shapes:
            for shape in shapes:
                way = domains.near(shape)
                form = domains.unfolded(way[0].curve, shape)
                if form is not None:
                    yield from self._deformed(way, form, shape, "unfolded")
                    break
        coarse = domains.coarse
        far, near = domains.far(coarse), domains.near(coarse)
        for start in reversed(range(len(far))):
            form = domains.unfolded(far[start].curve, coarse)
            if form is not None:
                yield from self._deformed([*far[start:], *near], form, coarse, "deformed")
                return

    def on_disk(self) -> Found:
        """The minimal disk on the unit disk alone.

        Raises:
            DomainError: none was found: the loop has corners or is too long for its width, so that nodes crowd.
        """
        found = None if self.loop.corners.any() else next(self._on_disk(), None)
        if found is None:
            raise DomainError(
                "the loop has corners, or is too long for its width, for power series on the disk; use model='auto'",
                vertices=len(self.loop),
            )
        return found

    def below_on_disk(self, matching: Float[np.ndarray, "n 2"]) -> Found | None:
        """The minimal disk of less area that an unstable one on the unit disk leads to; None where there is none.

        Args:
            matching: of the unstable one.
        """
        slide = torch.tensor(matching[:, 1], device=self.device)
        form = DirichletForm.of_disk(FourierBoundary.circle(1.0, self._domains.count))
        start = slide_downhill(self._exact, form, resampled(slide, min(len(slide), _MOST_FOR_MODES)))
        return None if start is None else next(self._fitted(form, start, "disk", None), None)

    def _on_disk(self) -> Iterator[Found]:
        fit = self.begun or self._begin()
        fit_together([fit])
        if fit.best is not None:
            yield self._found(*fit.best, route="disk", limit=fit.limit)

    def _begin(self) -> Fit:
        return self._fit(DirichletForm.of_disk(FourierBoundary.circle(1.0, self._domains.count)), self._equal_steps)

    def tries_from(self, disk: Disk, rim: Int[np.ndarray, " k"]) -> Iterator[Found]:
        """The minimal disk of less energy that a discrete disk leads to, on its flattening.

        Args:
            disk: over the loop at unit size.
            rim: indices of the loop's points that are its boundary vertices.
        """
        shape = self._domains.likeliest
        form = self._domains.flattened(disk, rim, shape)
        if form is not None:
            way = [Step(curve=self.curve, nodes=shape.steps)]
            yield from self._deformed(way, form, shape, "flattened")

    def _deformed(self, way: list[Step], form: DirichletForm, shape: Shape, route: Route) -> Iterator[Found]:
        """The fit for the last of several curves, each on the Ω that the one before left."""
        slide = torch.tensor(shape.density.slide(np.arange(shape.steps) / shape.steps), device=self.device)
        for place, step in enumerate(way):
            if is_out_of_time():
                return
            slide = resampled(slide, even(step.nodes))
            disk = self._solved(CurveTensors.of(step.curve, self.device), form, slide, _COARSE)
            if disk.crowded:
                return
            slide = disk.slide
            if place == 0 or shape.unevenness(slide) > _UNEVEN:
                with self.clock.stage("flattening"):
                    form, slide = self._domains.flattened_anew(disk, form, shape)
        yield from self._fitted(form, slide, route, shape)

    def _fitted(
        self,
        form: DirichletForm,
        slide: Float[Tensor, " n"],
        route: Route,
        shape: Shape | None,
    ) -> Iterator[Found]:
        """The fit with as many nodes as the tolerance asks for, or as help.

        Args:
            form: of Ω.
            slide: to start from.
            route: for the record.
            shape: of Ω; none for the unit disk.
        """
        fit = self._fit(form, slide, shape)
        fit_together([fit])
        if fit.best is not None:
            yield self._found(*fit.best, route=route, limit=fit.limit)

    def _fit(self, form: DirichletForm, slide: Float[Tensor, " n"], shape: Shape | None = None) -> Fit:
        m = len(self.loop)
        per_edge = _MOST_PER_EDGE_ROUGH if self.is_rough else _MOST_PER_EDGE

        def renewed(disk: HarmonicDisk, form: DirichletForm) -> tuple[DirichletForm, Float[Tensor, " n"]] | None:
            assert shape is not None
            return self._domains.flattened_anew(disk, form, shape) if shape.unevenness(disk.slide) > _UNEVEN else None

        return Fit(
            curve=self._exact,
            form=form,
            slide=slide,
            nodes=even(max(len(slide), m * self._first_per_edge)),
            most_nodes=even(min(max(4 * _FEWEST_NODES, per_edge * m), _MOST_NODES)),
            is_rough=self.is_rough,
            allowed=self.allowed,
            enough=self._enough,
            mean_edge=self.loop.mean_edge_length,
            gradient=self._fine_gradient,
            negligible=self._negligible_energy,
            steps_left=lambda: max(0, self._last_step - len(self.history)),
            on_step=self._heard,
            clock=self.clock,
            renewed=None if shape is None else renewed,
        )

    def _found(self, lift: Lift, disk: HarmonicDisk, form: DirichletForm, *, route: Route, limit: str) -> Found:
        with self.clock.stage("surface"):
            surface = surface_of(lift, form.boundary, order=_PATH_ORDER)
        n = len(disk.slide)
        return Found(
            curve=self.curve,
            surface=surface,
            matching=np.column_stack([np.arange(n) / n, disk.slide.cpu().numpy()]),
            misfit=lift.misfit,
            area=lift.area,
            route=route,
            history=tuple(self.history),
            limit=limit,
        )

    def _solved(
        self,
        curve: CurveTensors,
        form: DirichletForm,
        slide: Float[Tensor, " n"],
        tolerance: float,
        *,
        near: bool = False,
    ) -> HarmonicDisk:
        left = max(0, min(_MOST_STEPS, self._last_step - len(self.history)))
        with self.clock.stage("slide"):
            return minimise_dirichlet_energy(
                curve,
                form,
                slide,
                tolerance=tolerance,
                max_steps=left,
                near=near,
                negligible=self._negligible_energy,
                on_step=self._heard,
            )

    def _heard(self, gradient: float) -> None:
        """Takes down a step of Newton's method."""
        self.hear(Iteration(index=len(self.history) + 1, method="Douglas-Newton", residual=gradient))

    def hear(self, step: Iteration) -> None:
        """Takes down a step, its own or of another route to the same disk, and tells the caller."""
        self.history.append(step)
        if self.on_iteration is not None:
            self.on_iteration(step)

    @staticmethod
    def side_by_side(solvers: Sequence[HarmonicSolver]) -> list[HarmonicSolver]:
        """Solvers with their fits on the unit disk made, together, for those that suit it."""
        started = [replace(solver, begun=solver._begin() if solver.suits_disk else None) for solver in solvers]
        fit_together([solver.begun for solver in started if solver.begun is not None], most_nodes=_BATCHED_NODES)
        return started
