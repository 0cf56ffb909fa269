"""The harmonic route to a minimal disk: Douglas's slide on a smooth Ω, then the lift to p and q.

It takes loops without corners: milliseconds for smooth ones, and its cost grows like n·log n with the number of nodes,
so it carries rough loops of thousands of points too.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from scipy.fft import next_fast_len
from torch import Tensor

from spinor_geom.discrete.first_fill import unfolded_loop
from spinor_geom.domain.plane_domain import FourierBoundary
from spinor_geom.errors import DomainError, FirstFillError, SurfaceError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, turning_angles
from spinor_geom.mesh.curve import DEGREES, BoundaryCurve
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.douglas import HarmonicDisk, minimise_dirichlet_energy, resampled
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.lift import Lift, lifted, surface_of
from spinor_geom.plateau.omega import (
    NodeDensity,
    reflattened,
    resolved_form,
    rounded_boundary,
)
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.solution import Iteration, Route

# Turning angle, exceeded by one point in ten, from which a loop counts as rough.
_ROUGH_TURN = np.radians(12.0)
# A loop longer than so many times its width crowds on the disk.
_DISK_ELONGATION = 2.5
# Points that Ω is made from; loops longer than so many times their width get twice as many.
_POINTS = 128
_MOST_VERTICES = 128
_NARROW = 12.0
# Steps of ∂Ω for each of them, and the width, in points, of the Gaussian that rounds ∂Ω: it has to be analytic.
_STEPS_PER_POINT = 4
_ROUNDING_ROUGH, _ROUNDING_SMOOTH = 0.7, 0.35
# Gaussian width, in points, of the smooth loop that a rough one is deformed from, and the number of deformations.
_SMOOTHING = 2.0
_DEFORMATIONS = 4
# Width of the Gaussian, as a share of the loop, that leaves of it not much more than an ellipse.
_WIDEST = 0.25
# Shares of a new flattening that are tried until Ω is simple.
_SHARES_OF_FLATTENING = (1.0, 0.7, 0.4)
# Nodes per loop edge: first for rough loops, most for all; smooth loops start with one.
_FIRST_PER_EDGE, _MOST_PER_EDGE = 4, 64
_FEWEST_NODES, _MOST_NODES = 256, 1 << 17
_MORE_NODES = 1.5
# Where so many times more nodes do not halve the residual, it is not their number that limits it.
_PATIENCE = 3
# Nodes farther apart than so many times what was asked for show that Ω has lost a part of the loop.
_UNEVEN = 3.0
# Quadrature nodes on each piece of a path in Ω.
_PATH_ORDER = 16
# Gradient at which a coarse solve stops; the last one goes on to this share of the distance allowed, within bounds.
_COARSE, _SHARE_OF_ALLOWED, _FINEST, _LEAST_FINE = 1e-3, 1e-3, 1e-11, 1e-5


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
    """

    loop: BoundaryLoop
    curve: BoundaryCurve
    allowed: float
    max_steps: int
    device: torch.device
    clock: Clock
    on_iteration: Callable[[Iteration], None] | None = None
    history: list[Iteration] = field(default_factory=list)

    @cached_property
    def _exact(self) -> CurveTensors:
        return CurveTensors.of(self.curve, self.device)

    @cached_property
    def _rough(self) -> bool:
        turning = float(np.quantile(turning_angles(self.loop.points), 0.9))
        return self.curve.degree == min(DEGREES) and turning > _ROUGH_TURN

    @property
    def _rounding(self) -> float:
        return _ROUNDING_ROUGH if self._rough else _ROUNDING_SMOOTH

    @property
    def _count(self) -> int:
        return min(len(self.loop), _MOST_VERTICES)

    def tries(self) -> Iterator[Found]:
        """A minimal disk on one Ω after the other, the cheapest first, for the caller to take or leave."""
        if not self._rough and self.loop.elongation < _DISK_ELONGATION:
            disk = DirichletForm.of_disk(FourierBoundary.circle(1.0, self._count))
            even = torch.arange(_FEWEST_NODES, dtype=torch.float64, device=self.device) / _FEWEST_NODES
            yield from self._fitted(disk, even, "disk", None)
        shape = _Shape.of(self.curve, _POINTS if self.loop.elongation < _NARROW else 2 * _POINTS)
        yield from self._deformed(self._near(shape), shape, "unfolded")
        yield from self._deformed([*self._far(shape), *self._near(shape)], shape, "deformed")

    def _near(self, shape: _Shape) -> list[BoundaryCurve]:
        """Γ, or where it is rough curves that lead to it from one so smooth that the points of Ω resolve it.

        Newton's method finds its way through many sharp bends only if they grow on it, and Ω grows with them.
        """
        if not self._rough:
            return [self.curve]
        smooth = self.curve.smoothed(_SMOOTHING / min(shape.points, len(self.loop)))
        return [smooth.towards(self.curve, share) for share in np.linspace(0, 1, _DEFORMATIONS + 1)]

    def _far(self, shape: _Shape) -> list[BoundaryCurve]:
        """Curves that lead to a smooth one from an ellipse: averages of Γ over ever shorter parts of it."""
        widths = _WIDEST * 0.5 ** np.arange(np.log2(_WIDEST * shape.points / _SMOOTHING))
        return [self.curve.smoothed(width) for width in widths]

    def _deformed(self, way: list[BoundaryCurve], shape: _Shape, route: Route) -> Iterator[Found]:
        """The fit for the last of several curves, each on the Ω that the one before left."""
        even = np.arange(shape.points) / shape.points
        try:
            with self.clock.stage("first fill"):
                polygon = unfolded_loop(way[0].point(shape.density.slide(even)))
            boundary = rounded_boundary(
                polygon, even, steps=shape.steps, width=self._rounding / shape.points, count=self._count
            )
            with self.clock.stage("flattening"):
                form = resolved_form(boundary, shape.steps, self.device)
        except (DomainError, FirstFillError):
            return
        slide = torch.tensor(shape.density.slide(np.arange(shape.steps) / shape.steps), device=self.device)
        for place, curve in enumerate(way):
            if place == len(way) - 1:  # the last one is Γ itself, its nodes follow its edges
                slide = resampled(slide, _even(max(len(slide), _FIRST_PER_EDGE * len(self.loop) if self._rough else 0)))
            disk = self._solved(CurveTensors.of(curve, self.device), form, slide, _COARSE)
            if disk.crowded:
                return
            slide = disk.slide
            if place == 0 or shape.unevenness(slide) > _UNEVEN:
                with self.clock.stage("flattening"):
                    form, slide = self._flattened_anew(disk, form, shape)
        yield from self._fitted(form, slide, route, shape)

    def _flattened_anew(
        self, disk: HarmonicDisk, form: DirichletForm, shape: _Shape
    ) -> tuple[DirichletForm, Float[Tensor, " n"]]:
        """Ω from a harmonic disk, as much of it as stays simple, and the disk's slide along it."""
        for share in _SHARES_OF_FLATTENING:
            again = reflattened(
                disk,
                form,
                shape.density,
                share=share,
                steps=shape.steps,
                width=self._rounding / shape.points,
                count=self._count,
            )
            if again is None:
                break
            boundary, t, s = again
            try:
                new = resolved_form(boundary, shape.steps, self.device)
            except DomainError:
                continue
            even = np.arange(len(t)) / len(t)
            slide = np.interp(even, np.concatenate([t - 1, t, t + 1]), np.concatenate([s - 1, s, s + 1]))
            return new, torch.tensor(slide, device=self.device)
        return form, disk.slide

    def _fitted(
        self, form: DirichletForm, slide: Float[Tensor, " n"], route: Route, shape: _Shape | None
    ) -> Iterator[Found]:
        """The fit with as many nodes as the tolerance asks for, or as help."""
        m = len(self.loop)
        nodes = max(len(slide), m)
        best: tuple[Lift, HarmonicDisk, DirichletForm] | None = None
        fine = float(np.clip(_SHARE_OF_ALLOWED * self.allowed, _FINEST, _LEAST_FINE))
        last_gain, most = 0, max(4 * _FEWEST_NODES, _MOST_PER_EDGE * m)
        limit = "more nodes on the domain's boundary do not help"
        for attempt in itertools.count():
            n = _even(nodes)
            disk = self._solved(self._exact, form, resampled(slide, n), fine)
            if disk.crowded:
                limit = "the nodes crowd on the domain's boundary"
                break
            slide = disk.slide
            try:
                with self.clock.stage("lift"):
                    lift = lifted(disk, form, self._exact)
            except SurfaceError:  # more nodes may tell the sheets apart
                lift = None
            if lift is not None and (best is None or lift.rms < best[0].rms):
                if best is None or lift.rms < best[0].rms / 2:
                    last_gain = attempt
                best = lift, disk, form
            nodes = int(_MORE_NODES * n)
            if (best is not None and best[0].rms <= self.allowed) or attempt - last_gain >= _PATIENCE:
                break
            if nodes > min(most, _MOST_NODES):
                limit = f"{n} nodes are the most that are tried"
                break
            if len(self.history) >= self.max_steps:
                limit = "the limit on steps was reached"
                break
            if shape is not None and shape.unevenness(slide) > _UNEVEN:
                form, slide = self._flattened_anew(disk, form, shape)
        if best is not None:
            yield self._found(*best, route=route, limit=limit)

    def _found(self, lift: Lift, disk: HarmonicDisk, form: DirichletForm, *, route: Route, limit: str) -> Found:
        with self.clock.stage("surface"):
            surface = surface_of(lift, form.boundary, order=_PATH_ORDER)
        n = len(disk.slide)
        return Found(
            surface=surface,
            matching=np.column_stack([np.arange(n) / n, disk.slide.cpu().numpy()]),
            rms=lift.rms,
            max=lift.max,
            area=lift.area,
            route=route,
            history=tuple(self.history),
            limit=limit,
        )

    def _solved(
        self, curve: CurveTensors, form: DirichletForm, slide: Float[Tensor, " n"], tolerance: float
    ) -> HarmonicDisk:
        def heard(gradient: float) -> None:
            step = Iteration(index=len(self.history) + 1, method="Douglas-Newton", residual=gradient)
            self.history.append(step)
            if self.on_iteration is not None:
                self.on_iteration(step)

        left = max(0, self.max_steps - len(self.history))
        with self.clock.stage("slide"):
            return minimise_dirichlet_energy(curve, form, slide, tolerance=tolerance, max_steps=left, on_step=heard)

    def _smooth_curve(self, points: int) -> BoundaryCurve:
        """Γ, or where it is rough an average of it that so many points resolve."""
        return self.curve.smoothed(_SMOOTHING / min(points, len(self.loop))) if self._rough else self.curve


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shape:
    """How ∂Ω is parametrised and resolved."""

    density: NodeDensity
    points: int

    @classmethod
    def of(cls, curve: BoundaryCurve, points: int) -> _Shape:
        return cls(density=NodeDensity(curve, points), points=points)

    @property
    def steps(self) -> int:
        return _STEPS_PER_POINT * self.points

    def unevenness(self, slide: Float[Tensor, " n"]) -> float:
        """Largest distance of neighbouring nodes over what the density asks for."""
        t = self.density.parameter(slide.cpu().numpy())
        return float(np.diff(np.append(t, t[0] + 1)).max()) * len(t)


def _even(nodes: int) -> int:
    """An even number of nodes, not smaller, that is fast to transform."""
    return 2 * next_fast_len((nodes + 1) // 2)
