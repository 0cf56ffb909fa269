"""Smooth continuation: the patch that continues the mean curvature of the mesh, with a mesh of its own if necessary."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from spinor_geom.deadline import is_out_of_time
from spinor_geom.errors import DomainError, OutOfTimeError, SingularMatrixError
from spinor_geom.fill.collar import Bend, Collar
from spinor_geom.fill.fairing import SMALLEST_ANGLE, Faired, Order, brought_to_rest, thin_plate
from spinor_geom.mesh.operators import vertex_angles
from spinor_geom.meshing.embed import Patch, over_domain_of_angles, over_own_domain, remesh

# Edges that become longer by more leave triangles too coarse for the bulge: with 4 the ends of two fingers bend by 7.6°
# across the rim, not by 5.9°; 1.4 takes 14 % more steps for the same smallest angles.
_MOST_STRETCHED = 2.0
_ROUNDS = 4  # of new meshes, which bound the time: two do as well on all holes
MOST_AREA = 2.0  # times the film's: half a sphere over its disk; a larger patch is reported

Start: TypeAlias = Literal["minimal", "discrete", "strip"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Continuation:
    """How a patch became the smooth continuation of the mesh around it.

    Attributes:
        started_from: what the patch was before: a minimal surface, a discrete one, or straight lines between two rims.
        before: its bend across the rim then.
        after: its bend across the rim now.
        order: what it minimises: "curvature" ∫H² + ℓ²|∇H|², "thin plate" ∫|Δx|² over the surface before.
        lowered: why it is a thin plate; empty where it is not.
        steps: number of Newton steps.
        remeshed: whether it was meshed anew because its triangles were stretched.
        converged: whether it is at rest: the next step would move no vertex by more than 0.01 of an edge.
        next_step: the largest displacement of a vertex in the next step, in mean edges of the patch.
        area_ratio: its area by that of the surface before.
        smallest_angle: of its triangles with an inner vertex, in degrees; None where it has none.
        smallest_rim_angle: of all its triangles; those over three rim vertices cannot be improved.
        correlation_length: ℓ, over which the mean curvature of the mesh around changes, in mesh units.
        roughness: share of the variance of that curvature between neighbours: 0 on a smooth mesh, 1 and more in noise,
            which is not continued.
        creased: number of rim vertices at creases of the mesh, where the patch may bend freely.
    """

    started_from: Start
    before: Bend
    after: Bend
    order: Order
    lowered: str
    steps: int
    remeshed: bool
    converged: bool
    next_step: float
    area_ratio: float
    smallest_angle: float | None
    smallest_rim_angle: float
    correlation_length: float
    roughness: float
    creased: int

    @classmethod
    def of(
        cls, faired: Faired, collar: Collar, *, start: Start, before: Bend, after: Bend, area_ratio: float
    ) -> Continuation:
        """The figures of a faired patch and its collar."""
        return cls(
            started_from=start,
            before=before,
            after=after,
            order=faired.order,
            lowered=faired.lowered,
            steps=faired.steps,
            remeshed=faired.remeshed,
            converged=faired.converged,
            next_step=faired.next_step,
            area_ratio=area_ratio,
            smallest_angle=faired.smallest_angles[0],
            smallest_rim_angle=faired.smallest_angles[1],
            correlation_length=collar.length,
            roughness=collar.roughness,
            creased=collar.creased,
        )

    def __repr__(self) -> str:
        bend = f"bend {self.before.rms:.3g}° to {self.after.rms:.3g}°"
        return f"Continuation({self.order}, {bend}, {self.area_ratio:.3g} times the area, {self.reason or 'at rest'})"

    @property
    def reason(self) -> str:
        """Why it is not at rest; empty where it is."""
        if self.converged:
            return ""
        return f"after {self.steps} steps the next would still move a vertex by {self.next_step:.2g} of an edge"

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on a lowered order, a large area and thin triangles."""
        found = []
        if self.lowered:
            found.append(f"the patch is a thin plate, as the continuation of the mean curvature {self.lowered}")
        if self.area_ratio > MOST_AREA:
            found.append(f"the patch has {self.area_ratio:.2g} times the area of the surface it started from")
        if self.smallest_angle is not None and self.smallest_angle < SMALLEST_ANGLE:
            found.append(f"the smallest angle of the patch's triangles is {self.smallest_angle:.2g}°")
        return tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """The figures in JSON's types."""
        return {**asdict(self), "before": self.before.to_dict(), "after": self.after.to_dict()}


def continue_patch(patch: Patch, collar: Collar, target: float, *, is_conformal: bool) -> Faired:
    """Moves a patch's inner vertices to the smooth continuation of the mesh around it.

    1. The patch is brought to rest.
    2. If it is folded or not at rest, a patch over one loop starts again over a domain with the angles that the mesh
       leaves at the loop. Those of a minimal surface are wrong where that turns back over the mesh.
    3. A patch that is not at rest, has angles below 10° or edges more than twice as long is remeshed for edges of the
       target length and brought to rest again.
    4. If it is still folded or not at rest, the thin plate replaces it, if that has no such defect.

    Raises:
        SingularMatrixError: triangles of the patch are degenerate.
    """
    faired = brought_to_rest(patch, collar)
    is_poor = faired.defect or (faired.stretch > _MOST_STRETCHED and not is_conformal)
    if is_poor and not patch.hole_sizes and not is_out_of_time():
        again = _from_domain_of_angles(patch, collar, target)
        if again is not None and _rank(again)[:2] <= _rank(faired)[:2]:
            faired, is_conformal = replace(again, steps=faired.steps + again.steps, remeshed=True), True
    faired = _remeshed(faired, collar, target, is_conformal=is_conformal)
    if faired.defect and not is_out_of_time():
        plate = replace(thin_plate(patch, collar), lowered=faired.defect)
        if plate.is_thin:
            plate = _remeshed(plate, collar, target, is_conformal=is_conformal)
        if not plate.defect:
            return replace(plate, steps=faired.steps)
    return faired


def _from_domain_of_angles(patch: Patch, collar: Collar, target: float) -> Faired | None:
    """Starts from a domain with the angles that the mesh leaves at the loop; None where there is no simple one."""
    beside = vertex_angles(collar.vertices, collar.faces)[: collar.boundary_size]
    try:
        start = over_domain_of_angles(patch, 2 * np.pi - beside, target)
    except (DomainError, OutOfTimeError, SingularMatrixError):
        return None
    return brought_to_rest(start, collar) if len(start.vertices) > start.boundary_size else None


def _remeshed(faired: Faired, collar: Collar, target: float, *, is_conformal: bool) -> Faired:
    """Remeshes a patch by its present shape and brings it to rest, as often as needed and while it gets better."""
    for _ in range(_ROUNDS):
        is_good = faired.converged and not faired.is_thin and faired.stretch <= _MOST_STRETCHED
        if is_good or is_out_of_time():
            break
        better = _remeshed_once(faired, collar, target, is_conformal=is_conformal)
        if better is None:
            break
        faired, is_conformal = better, False
    return faired


def _remeshed_once(faired: Faired, collar: Collar, target: float, *, is_conformal: bool) -> Faired | None:
    """The better one of new meshes over a domain of the present shape and over its own; None if neither is better."""
    domains = []
    if not faired.patch.hole_sizes:
        with suppress(DomainError, OutOfTimeError, SingularMatrixError):
            domains.append(over_own_domain(faired.patch))
    if is_conformal:
        domains.append(faired.patch)
    best = None
    for domain in domains:
        try:
            finer = remesh(domain, target)
        except OutOfTimeError:
            break
        except DomainError:  # chords between points of the rim intersect in this domain
            continue
        if len(finer.vertices) == finer.boundary_size:
            continue
        again = thin_plate(finer, collar) if faired.order == "thin plate" else brought_to_rest(finer, collar)
        again = replace(again, steps=faired.steps + again.steps, remeshed=True, lowered=faired.lowered)
        before = best or faired
        needs_finer = best is None and faired.stretch > _MOST_STRETCHED
        if _rank(again) < _rank(before) or (needs_finer and _rank(again)[:2] <= _rank(before)[:2]):
            best = again
        if best is not None and not best.defect and not best.is_thin:
            break
    return best


def _rank(faired: Faired) -> tuple[bool, float, float]:
    """Least is best: no folds, then at rest or nearer to it, then no thin triangles."""
    left = 0.0 if faired.converged else faired.next_step
    return bool(faired.folds), left, -min(faired.smallest_angles[1], SMALLEST_ANGLE)
