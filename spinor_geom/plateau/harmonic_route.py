"""The harmonic route to a minimal disk: Douglas's slide on a smooth Ω, then the lift to p and q.

It takes loops without corners: milliseconds for smooth ones, and its cost grows like n·log n with the number of nodes.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from scipy.fft import next_fast_len
from torch import Tensor

from spinor_geom.discrete.first_fill import unfolded_loop
from spinor_geom.discrete.minimal_surface import Disk
from spinor_geom.domain.flattening import flatten
from spinor_geom.domain.plane_domain import FourierBoundary
from spinor_geom.errors import DomainError, SurfaceError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.interpolation import DEGREES
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.douglas import (
    HarmonicDisk,
    minimise_dirichlet_energies,
    minimise_dirichlet_energy,
    resampled,
    slide_downhill,
)
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.lift import Lift, lifted, surface_of
from spinor_geom.plateau.omega import NodeDensity, Shape, flattened_anew, resolved
from spinor_geom.plateau.problem import CurveTensors
from spinor_geom.plateau.roughness import is_rough
from spinor_geom.plateau.solution import Iteration, RouteName
from spinor_geom.plateau.steps import Steps

# A loop longer than so many times its width crowds on the disk: at 2.4 it is met to 1e-8 edges, at 4 no more.
_DISK_ELONGATION = 2.5
# Nodes per edge of a rough loop that a distance from Γ, in edges, is met with as a rule; smooth loops start with one.
_PER_EDGE_ROUGH = ((5e-3, 6), (5e-4, 9), (0.0, 12))
# Points that Ω is made from: the cost of Λ on it is their number cubed.
_FEWEST_POINTS, _POINTS = 32, 128
_CROWDED = "the nodes crowd on the domain's boundary"
# Most nodes for each edge: beyond rough loops take minutes, and smooth ones gain nothing.
_MOST_PER_EDGE, _MOST_NODES = 64, 1 << 17
# Nodes of the shortest loops on the disk, for each edge and in all; loops with as many are batched.
_FEWEST_PER_EDGE, _FEWEST_NODES = 16, 256
# How many times more nodes come next: on rough loops the distance falls not much faster than their number grows.
_MORE_NODES, _MOST_MORE = 1.5, 3.0
# Where so many times more nodes do not halve the residual, it is not their number that limits it.
_PATIENCE = 3
# Nodes farther apart than so many times what was asked for show that Ω has lost a part of the loop.
_UNEVEN = 3.0
# Quadrature nodes on each piece of a path in Ω.
_PATH_ORDER = 16
# Nodes at which the directions of an unstable slide are found: the cost is their number cubed.
_MOST_FOR_MODES = 512
# Newton steps of one solve.
_MOST_STEPS = 60
# Gradient at which a coarse solve stops; the last one goes on to a share of the distance allowed in edges: to a small
# one on smooth loops, where each step doubles the digits. And where nothing but rounding errors is left.
_COARSE, _FINEST, _ROUNDING = 1e-3, 1e-11, 1e-13
_FINE_ROUGH, _FINE_SMOOTH = 3e-2, 1e-4
# RMS distance from Γ, in diagonals, that is rounding error.
_ROUNDED = 1e-14
# On rough loops it stops too where the energy falls by less than this share of that of the distance allowed.
_NEGLIGIBLE = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicSolver:
    """One loop on the harmonic route.

    Attributes:
        loop: the loop at unit size.
        curve: Γ.
        allowed: RMS distance from Γ to reach.
        steps: of Newton's method.
        device: where the slide is found.
        clock: of the stages.
        to_rounding: whether steps go on until the gradient is rounding error.
        start: the harmonic disk on the unit disk, where it was found before.
    """

    loop: BoundaryLoop
    curve: BoundaryCurve
    allowed: float
    steps: Steps
    device: torch.device
    clock: Clock
    to_rounding: bool = False
    start: HarmonicDisk | None = None

    def on_disk(self) -> Found:
        """The minimal disk on the unit disk.

        Raises:
            DomainError: none was found: the loop has corners or is too long for its width, so that nodes crowd.
        """
        refusal = DomainError(
            "the loop has corners, or is too long for its width, for power series on the disk; use model='auto'",
            vertices=len(self.loop),
        )
        if self.loop.corners.any():
            raise refusal
        slide = self._equal_steps if self.start is None else self.start.slide
        try:
            return self._fitted(self._unit_disk, slide, "disk", first=self.start)
        except DomainError as error:
            raise refusal from error

    def below_on_disk(self, matching: Float[np.ndarray, "n 2"]) -> Found | None:
        """The minimal disk of less area that an unstable one on the unit disk leads to; None where there is none.

        Args:
            matching: of the unstable one.
        """
        slide = torch.tensor(matching[:, 1], device=self.device)
        start = slide_downhill(self._exact, self._unit_disk, resampled(slide, min(len(slide), _MOST_FOR_MODES)))
        if start is None:
            return None
        try:
            return self._fitted(self._unit_disk, start, "disk")
        except DomainError:
            return None

    def unfolded(self) -> Found:
        """The minimal disk on the loop's unfolded least-area triangulation.

        Raises:
            FirstFillError: the loop has no such triangulation.
            DomainError: it is not simple or too narrow, or nodes crowd.
        """
        even = np.arange(self._density.points) / self._density.points
        with self.clock.stage("first fill"):
            polygon = unfolded_loop(self.curve.point(self._density.slide(even)), saws=True)
        return self._on_domain(polygon, even, "unfolded")

    def flattened(self, disk: Disk, rim: Int[np.ndarray, " k"]) -> Found:
        """The minimal disk of less energy that a discrete disk leads to, on its flattening.

        Args:
            disk: over the loop at unit size.
            rim: indices of the loop's points that are its boundary vertices.

        Raises:
            DomainError: the flattening is not simple or too narrow, or nodes crowd.
        """
        with self.clock.stage("flattening"):
            polygon = flatten(disk.vertices, disk.faces, len(rim)).boundary
        return self._on_domain(polygon, self._density.parameter(self.curve.breaks[rim]), "flattened")

    @cached_property
    def _exact(self) -> CurveTensors:
        return CurveTensors.of(self.curve, self.device)

    @cached_property
    def _is_rough(self) -> bool:
        return is_rough(self.loop, self.curve)

    @property
    def _count(self) -> int:
        return points_of_domain(self.loop)

    @cached_property
    def _density(self) -> NodeDensity:
        return NodeDensity(self.curve, self._count)

    @property
    def _unit_disk(self) -> DirichletForm:
        return DirichletForm.of_disk(FourierBoundary.circle(1.0, self._count))

    @property
    def _equal_steps(self) -> Float[Tensor, " n"]:
        n = _even(first_nodes(self.loop))
        return torch.arange(n, dtype=torch.float64, device=self.device) / n

    @property
    def _first_per_edge(self) -> int:
        if not self._is_rough:
            return 1
        wanted = self.allowed / self.loop.mean_edge_length
        return next(nodes for limit, nodes in _PER_EDGE_ROUGH if wanted >= limit)

    @property
    def _fine_gradient(self) -> float:
        """At which a slide along Γ itself stops."""
        if self.to_rounding:
            return _ROUNDING
        share = _FINE_ROUGH if self._is_rough else _FINE_SMOOTH
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
        return _NEGLIGIBLE * 2 * np.pi * len(self.loop) * self.allowed**2 if self._is_rough else 0.0

    def _on_domain(self, polygon: Complex[np.ndarray, " k"], t: Float[np.ndarray, " k"], route: RouteName) -> Found:
        """The minimal disk on the smooth Ω next to a polygon, and on what its own flattening makes of that.

        Args:
            polygon: near to ∂Ω.
            t: parameters of its vertices.
            route: for the record.
        """
        with self.clock.stage("flattening"):
            # points that stand for single vertices are to be followed
            is_fine = self._is_rough and len(self.loop) <= self._density.points
            shape, form = resolved(polygon, t, self._density, is_fine, count=self._count, device=self.device)
        slide = torch.tensor(self._density.slide(np.arange(shape.steps) / shape.steps), device=self.device)
        disk = self._slid(form, slide, _COARSE)
        if disk.crowded:
            raise DomainError(_CROWDED, vertices=len(self.loop))
        with self.clock.stage("flattening"):
            form, slide = flattened_anew(disk, form, shape)
        return self._fitted(form, slide, route, shape)

    def _fitted(
        self,
        form: DirichletForm,
        slide: Float[Tensor, " n"],
        route: RouteName,
        shape: Shape | None = None,
        *,
        first: HarmonicDisk | None = None,
    ) -> Found:
        """The fit with as many nodes as the tolerance asks for, or as help.

        Args:
            form: of Ω.
            slide: to start from.
            route: for the record.
            shape: of Ω; none for the unit disk.
            first: the harmonic disk with that slide, where it is known.

        Raises:
            DomainError: the nodes crowd.
            SurfaceError: all harmonic disks are branched.
        """
        m = len(self.loop)
        nodes = max(len(slide), m * self._first_per_edge)
        best: tuple[Lift, HarmonicDisk, DirichletForm] | None = None
        branched: SurfaceError | None = None
        last_gain, most = 0, _even(min(max(4 * _FEWEST_NODES, _MOST_PER_EDGE * m), _MOST_NODES))
        limit = "more nodes on the domain's boundary do not help"
        for attempt in itertools.count():
            n = _even(nodes)
            disk = first
            if disk is None or attempt > 0:
                near = attempt > 0 and not self._is_rough
                disk = self._slid(form, resampled(slide, n), self._fine_gradient, near=near)
            if disk.crowded:
                limit = _CROWDED
                break
            slide = disk.slide
            try:
                with self.clock.stage("lift"):
                    lift = lifted(disk, form, self._exact, allowed=self.allowed)
            except SurfaceError as error:  # more nodes may tell the sheets apart
                branched, excess = error, 1.0
            else:
                excess = self._excess(lift, self.allowed)
                if best is None or lift.misfit.rms < best[0].misfit.rms:
                    if best is None or lift.misfit.rms < best[0].misfit.rms / 2:
                        last_gain = attempt
                    best = lift, disk, form
            nodes = min(most, int(np.clip(excess, _MORE_NODES, _MOST_MORE if self._is_rough else _MORE_NODES) * n))
            if (best is not None and self._excess(best[0], self._enough) <= 1) or attempt - last_gain >= _PATIENCE:
                break
            if n >= most:
                limit = f"{n} nodes are the most that are tried"
                break
            if self.steps.are_spent:
                limit = "the limit on steps or on time was reached"
                break
            if shape is not None and shape.unevenness(slide) > _UNEVEN:
                form, slide = flattened_anew(disk, form, shape)
        if best is None:
            raise branched or DomainError(limit, vertices=m)
        return self._found(*best, route=route, limit=limit)

    def _excess(self, lift: Lift, allowed: float) -> float:
        return lift.misfit.excess(allowed=allowed, tolerance=allowed / self.loop.mean_edge_length)

    def _found(self, lift: Lift, disk: HarmonicDisk, form: DirichletForm, *, route: RouteName, limit: str) -> Found:
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
            history=tuple(self.steps.history),
            limit=limit,
        )

    def _slid(
        self, form: DirichletForm, slide: Float[Tensor, " n"], tolerance: float, *, near: bool = False
    ) -> HarmonicDisk:
        with self.clock.stage("slide"):
            return minimise_dirichlet_energy(
                self._exact,
                form,
                slide,
                tolerance=tolerance,
                max_steps=min(_MOST_STEPS, self.steps.left),
                near=near,
                negligible=self._negligible_energy,
                on_step=self._take,
            )

    def _take(self, gradient: float) -> None:
        self.steps.take(Iteration(index=len(self.steps.history) + 1, method="Douglas-Newton", residual=gradient))

    @staticmethod
    def side_by_side(solvers: Sequence[HarmonicSolver]) -> list[HarmonicDisk | None]:
        """The disks on the unit disk, found together, of those solvers that have as many nodes; none for the others."""
        disks: list[HarmonicDisk | None] = [None] * len(solvers)
        for nodes in sorted({first_nodes(solver.loop) for solver in solvers}):
            some = [i for i, solver in enumerate(solvers) if first_nodes(solver.loop) == nodes]
            chosen = [solvers[i] for i in some]
            if len(chosen) < 2 or nodes > _FEWEST_NODES:
                continue
            begin = time.perf_counter()
            together = minimise_dirichlet_energies(
                CurveTensors.batch([solver._exact for solver in chosen]),
                DirichletForm.of_disk(FourierBoundary.circle()),
                chosen[0]._equal_steps.expand(len(chosen), -1),
                tolerances=[solver._fine_gradient for solver in chosen],
                max_steps=min(_MOST_STEPS, *(solver.steps.left for solver in chosen)),
                on_step=[solver._take for solver in chosen],
            )
            seconds = (time.perf_counter() - begin) / len(chosen)
            for i, disk in zip(some, together, strict=True):
                solvers[i].clock.add("slide", seconds)
                disks[i] = disk
        return disks


def suits_unit_disk(loop: BoundaryLoop, curve: BoundaryCurve) -> bool:
    """Whether the unit disk is likely to do."""
    return loop.elongation < _DISK_ELONGATION and not is_rough(loop, curve)


def points_of_domain(loop: BoundaryLoop) -> int:
    """Points that Ω is made from, but for those that narrow places want."""
    return int(np.clip(len(loop), _FEWEST_POINTS, _POINTS))


def first_nodes(loop: BoundaryLoop) -> int:
    """Nodes on the disk to begin with: of short loops a power of two."""
    few = 1 << int(np.ceil(np.log2(_FEWEST_PER_EDGE * len(loop))))
    return max(min(few, _FEWEST_NODES), len(loop))


def _even(nodes: int) -> int:
    """An even number of nodes, not smaller, that is fast to transform."""
    return 2 * next_fast_len((nodes + 1) // 2)
