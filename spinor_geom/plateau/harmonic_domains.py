"""Where the harmonic route looks for its Ω: candidates for a loop, and curves that lead from each to Γ."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from spinor_geom.discrete.first_fill import unfolded_loop
from spinor_geom.discrete.minimal_surface import Disk
from spinor_geom.domain.flattening import flatten
from spinor_geom.errors import DomainError, FirstFillError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.dirichlet import DirichletForm
from spinor_geom.plateau.douglas import HarmonicDisk
from spinor_geom.plateau.omega import NodeDensity, Shape, reflattened, resolved_form, rounded_boundary

# Points that Ω is made from, and most vertices of it.
_FEWEST_POINTS, _POINTS = 32, 128
# Steps of ∂Ω for each of them, and the width, in points, of the Gaussian that rounds ∂Ω: it has to be analytic.
_STEPS_PER_POINT, _STEPS_PER_POINT_FINE = 4, (8, 12)
_ROUNDING_ROUGH, _ROUNDING_SMOOTH, _ROUNDING_FINE = 0.7, 0.35, 0.2
# Width of a loop, as a density of nodes, from which its fingers want the fine ∂Ω: on a coarser one they close up.
_NARROW = 1.7
# Gaussian width, in points, of the smooth loop that a rough one is deformed from, and the number of deformations.
_SMOOTHING = 2.0
# Ratio of consecutive widths from there to as many edges, and nodes on each width.
_WIDTH_RATIO, _NODES_PER_WIDTH = 4.0, 8.0
_DEFORMATIONS = 4
# Width of the Gaussian, as a share of the loop, that leaves of it not much more than an ellipse.
_WIDEST = 0.25
# Shares of a new flattening that are tried until Ω is simple.
_SHARES_OF_FLATTENING = (1.0, 0.7, 0.4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Step:
    """A curve on the way to Γ, and the nodes that its slide takes."""

    curve: BoundaryCurve
    nodes: int


@dataclass(frozen=True, kw_only=True, eq=False)
class DomainCandidates:
    """Smooth domains for one loop.

    Attributes:
        loop: the loop at unit size.
        curve: Γ.
        is_rough: whether it bends sharply at many of its points.
        nodes_per_edge: that its slide starts with.
        device: of the forms.
        clock: of the stages.
    """

    loop: BoundaryLoop
    curve: BoundaryCurve
    is_rough: bool
    nodes_per_edge: int
    device: torch.device
    clock: Clock

    @property
    def count(self) -> int:
        """Points that Ω is made from."""
        return int(np.clip(len(self.loop), _FEWEST_POINTS, _POINTS))

    @cached_property
    def density(self) -> NodeDensity:
        """How densely nodes lie along Γ."""
        return NodeDensity(self.curve, self.count)

    @property
    def is_narrow(self) -> bool:
        """Whether fingers of the loop want a fine ∂Ω."""
        return self.density.narrowest > _NARROW

    @property
    def shapes(self) -> tuple[tuple[Shape, ...], ...]:
        """∂Ω's resolutions, the likelier first, of each kind the cheaper first.

        The fine ones resolve each vertex of a rough loop of few points.
        """
        coarse, fine = (self.coarse,), self.fine
        if self.is_narrow:
            return (fine,)
        return (fine, coarse) if self.is_rough and len(self.loop) <= self.density.points else (coarse, fine)

    @property
    def coarse(self) -> Shape:
        """∂Ω's usual resolution."""
        rounding = _ROUNDING_ROUGH if self.is_rough else _ROUNDING_SMOOTH
        return Shape(density=self.density, steps_per_point=_STEPS_PER_POINT, rounding=rounding)

    @property
    def fine(self) -> tuple[Shape, ...]:
        """Resolutions that follow ∂Ω's points more closely."""
        return tuple(
            Shape(density=self.density, steps_per_point=steps, rounding=_ROUNDING_FINE)
            for steps in _STEPS_PER_POINT_FINE
        )

    @property
    def likeliest(self) -> Shape:
        """The resolution that is tried where only one is."""
        return self.fine[0] if self.is_narrow else self.coarse

    def unfolded(self, curve: BoundaryCurve, shape: Shape) -> DirichletForm | None:
        """Ω from the unfolded least-area triangulation of a curve; None where it is not simple or too narrow."""
        even = np.arange(shape.points) / shape.points
        try:
            with self.clock.stage("first fill"):
                polygon = unfolded_loop(curve.point(shape.density.slide(even)), saws=True)
            return self._rounded(polygon, even, shape)
        except (DomainError, FirstFillError):
            return None

    def flattened(self, disk: Disk, rim: Int[np.ndarray, " k"], shape: Shape) -> DirichletForm | None:
        """Ω from a flattened discrete disk; None where it is not simple or too narrow.

        Args:
            disk: over the loop at unit size.
            rim: indices of the loop's points that are its boundary vertices.
            shape: of ∂Ω.
        """
        try:
            with self.clock.stage("flattening"):
                polygon = flatten(disk.vertices, disk.faces, len(rim)).boundary
            return self._rounded(polygon, shape.density.parameter(self.curve.breaks[rim]), shape)
        except DomainError:
            return None

    def _rounded(self, polygon: Complex[np.ndarray, " k"], t: Float[np.ndarray, " k"], shape: Shape) -> DirichletForm:
        """Λ of the Ω whose analytic boundary follows a polygon with given parameters of its vertices."""
        with self.clock.stage("flattening"):
            boundary = rounded_boundary(polygon, t, steps=shape.steps, width=shape.rounding_width, count=self.count)
            return resolved_form(boundary, shape.steps, self.device)

    def near(self, shape: Shape) -> list[Step]:
        """Γ, or where it is rough curves that lead to it from one so smooth that the points of Ω resolve it.

        Newton's method finds its way through many sharp bends only if they grow on it, and Ω grows with them.
        """
        m = len(self.loop)
        if not self.is_rough or (shape.steps_per_point > _STEPS_PER_POINT and m <= shape.points):
            return [Step(curve=self.curve, nodes=shape.steps)]
        nodes = max(shape.steps, self.nodes_per_edge * m)
        smoothest, least = _SMOOTHING / min(shape.points, m), _SMOOTHING / m
        count = 1 + int(np.ceil(np.log(smoothest / least) / np.log(_WIDTH_RATIO)))
        averages = [self._average(width, shape) for width in np.geomspace(smoothest, least, count)]
        rest = [
            averages[-1].curve.towards(self.curve, share) for share in np.arange(1, _DEFORMATIONS + 1) / _DEFORMATIONS
        ]
        return [*averages, *(Step(curve=curve, nodes=nodes) for curve in rest)]

    def far(self, shape: Shape) -> list[Step]:
        """Curves that lead to Γ from not much more than an ellipse: averages over ever shorter parts of it."""
        widths = _WIDEST * 0.7 ** np.arange(int(np.log(_SMOOTHING / shape.points / _WIDEST) / np.log(0.7)) + 1)
        return [self._average(width, shape) for width in widths]

    def _average(self, width: float, shape: Shape) -> Step:
        return Step(curve=self.curve.smoothed(width), nodes=max(shape.steps, int(_NODES_PER_WIDTH / width)))

    def flattened_anew(
        self, disk: HarmonicDisk, form: DirichletForm, shape: Shape
    ) -> tuple[DirichletForm, Float[Tensor, " n"]]:
        """Ω from a harmonic disk, as much of it as stays simple, and the disk's slide along it."""
        for share in _SHARES_OF_FLATTENING:
            again = reflattened(
                disk,
                form,
                shape.density,
                share=share,
                steps=shape.steps,
                width=shape.rounding_width,
                count=self.count,
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
