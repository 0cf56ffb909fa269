"""Smooth continuation: moves a patch so that it continues the mean curvature of the mesh, and remeshes it if needed."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from spinor_geom.deadline import is_out_of_time
from spinor_geom.errors import DomainError, OutOfTimeError, SingularMatrixError, TooManyPointsError
from spinor_geom.fill.collar import Bend, Collar, bend_inside
from spinor_geom.fill.fairing import SMALLEST_ANGLE, Faired, Order, minimised_curvature, smallest_angles, thin_plate
from spinor_geom.mesh.operators import vertex_angles
from spinor_geom.meshing.embed import Patch, over_domain_of_angles
from spinor_geom.meshing.remeshing import remesh

# A patch with edges stretched by more than this is remeshed, because its triangles are too coarse. With 4 the ends of
# two fingers bend by 7.6° across the rim instead of 5.9°; 1.4 takes 14 % more steps for the same smallest angles.
_MOST_STRETCHED = 2.0
_ROUNDS = 4  # of remeshing, to bound the time: two give the same results on all test holes
# The report has a remark if the bend inside a patch exceeds this multiple of the bend of the mesh around it by more
# than so many degrees. The ratio is at most 1.5 on spheres, cylinders, tori and scans.
_MOST_BENT, _SLIGHT_BEND = 2.0, 1.0
_KINK = 5.0  # degrees by which the bend across the rim may exceed that of the mesh around it without a remark
MOST_AREA = 2.0  # ratio of the areas after and before, as of hemisphere and disk; a larger patch gets a remark

# errors of remeshing and of the continuation after it; the patch before is kept then
_NO_NEW_MESH = (DomainError, SingularMatrixError, TooManyPointsError)

Start: TypeAlias = Literal["minimal", "discrete", "strip"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Continuation:
    """Measures of the smooth continuation of a mesh by a patch.

    Attributes:
        started_from: the surface before: a minimal one, a discrete one, or a strip of straight lines between two rims.
        before: the bend across the rim before the continuation.
        after: the bend across the rim after it.
        inside: the bend between neighbouring faces of the patch, at edges that do not touch the rim.
        around: the bend between neighbouring faces of the mesh, in three rings around the hole.
        order: the functional minimised: "curvature" ∫H² + ℓ²|∇H|², "thin plate" ∫|Δx|² over the surface before.
        lowered: why the thin plate was used, as the end of a sentence; empty if it was not.
        steps: number of Newton steps.
        remeshed: whether it was remeshed because it was folded, not converged, or had thin or stretched triangles.
        converged: whether the next step would move no vertex by more than 0.01 of a mean edge of the patch.
        next_step: the largest displacement of a vertex in the next step, in mean edges of the patch.
        area_ratio: the area divided by that of the surface before.
        smallest_angle: of all triangles, in degrees.
        smallest_rim_angle: the smallest angle, in degrees, between two edges of the rim that belong to one triangle;
            None if there is no such triangle. No triangulation has larger angles there.
        correlation_length: ℓ, the length over which the mean curvature of the mesh around changes, in mesh units.
        roughness: variance of that curvature between neighbours, divided by its total variance: 0 on a smooth mesh, 1
            and more in noise, which is not continued.
        creased: number of rim vertices at creases of the mesh, where the patch may bend freely.
    """

    started_from: Start
    before: Bend
    after: Bend
    inside: Bend
    around: Bend
    order: Order
    lowered: str
    steps: int
    remeshed: bool
    converged: bool
    next_step: float
    area_ratio: float
    smallest_angle: float
    smallest_rim_angle: float | None
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
            inside=bend_inside(faired.patch),
            around=collar.bend,
            order=faired.order,
            lowered=faired.lowered,
            steps=faired.steps,
            remeshed=faired.remeshed,
            converged=faired.converged,
            next_step=faired.next_step,
            area_ratio=area_ratio,
            **_angles_of(faired.patch),
            correlation_length=collar.length,
            roughness=collar.roughness,
            creased=collar.creased,
        )

    def with_angles_of(self, patch: Patch, *, remeshed: bool) -> Continuation:
        """The measures with the angles of a patch whose triangles were changed later."""
        return replace(self, remeshed=remeshed, **_angles_of(patch))

    def enlarged(self, scale: float) -> Continuation:
        """The measures after scaling mesh and patch."""
        return replace(self, correlation_length=scale * self.correlation_length)

    def __repr__(self) -> str:
        bend = f"bend {self.before.rms:.3g}° to {self.after.rms:.3g}°"
        return f"Continuation({self.order}, {bend}, {self.area_ratio:.3g} times the area, {self.reason or 'converged'})"

    @property
    def reason(self) -> str:
        """Why it has not converged; empty if it has."""
        if self.converged:
            return ""
        return f"after {self.steps} steps the next one would still move a vertex by {self.next_step:.2g} of an edge"

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on a thin plate, a large area, a large bend and thin triangles."""
        found = []
        if self.lowered:
            found.append(f"the patch is a thin plate, because the continuation of the mean curvature {self.lowered}")
        if self.area_ratio > MOST_AREA:
            found.append(f"the patch has {self.area_ratio:.2g} times the area of the surface it started from")
        if self.after.rms > self.around.rms + _KINK:
            degrees = f"{self.after.rms:.2g}° (RMS), the faces of the mesh around bend by {self.around.rms:.2g}°"
            found.append(f"the patch meets the mesh at {degrees}")
        if self.inside.rms > _MOST_BENT * self.around.rms + _SLIGHT_BEND:
            degrees = f"{self.inside.rms:.2g}° from face to face, the mesh around by {self.around.rms:.2g}°"
            found.append(f"the patch bends by {degrees}")
        if self.smallest_angle < SMALLEST_ANGLE:
            where = ", between two edges of the rim" if self.smallest_angle == self.smallest_rim_angle else ""
            found.append(f"the smallest angle of the patch's triangles is {self.smallest_angle:.2g}°{where}")
        return tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """The figures in JSON's types."""
        return {
            **asdict(self),
            "before": self.before.to_dict(),
            "after": self.after.to_dict(),
            "around": self.around.to_dict(),
        }


def _angles_of(patch: Patch) -> dict[str, Any]:
    rim, others = smallest_angles(patch)
    return {"smallest_angle": min(rim, others), "smallest_rim_angle": rim if np.isfinite(rim) else None}


def continue_patch(patch: Patch, collar: Collar, target: float) -> Faired:
    """Moves a patch's inner vertices to the smooth continuation of the mesh around it.

    1. The curvature functional is minimised by Newton's method (`minimised_curvature`).
    2. If the result over one loop is folded or has not converged, the minimisation starts again from a patch over a
       domain whose angles at the loop complete those of the mesh to 2π. A minimal surface that turns back over the mesh
       has other angles there.
    3. A patch that has not converged, has angles below 10°, or edges more than twice as long as before is remeshed with
       edges of the target length, and minimised again. Angles between two rim edges of one triangle cannot change.
    4. If it is still folded or has not converged, the thin plate replaces it, unless that is folded too.

    Raises:
        SingularMatrixError: triangles of the patch are degenerate.
        TooManyPointsError: the target length needs too many vertices.
        OutOfTimeError: the time limit was reached before there was a result.
    """
    faired = minimised_curvature(patch, collar)
    if faired.defect and not patch.hole_sizes and not is_out_of_time():
        again = _from_domain_of_angles(patch, collar, target)
        if again is not None and _rank(again)[:2] <= _rank(faired)[:2]:
            faired = replace(again, steps=faired.steps + again.steps, remeshed=True)
    faired = _remeshed(faired, collar, target)
    if faired.defect and not is_out_of_time():
        try:
            plate = replace(thin_plate(patch, collar), lowered=faired.defect)
        except OutOfTimeError:
            return faired
        if plate.is_thin and not plate.folds:
            plate = _remeshed(plate, collar, target)
        if not plate.defect:
            return replace(plate, steps=faired.steps)
    return faired


def _from_domain_of_angles(patch: Patch, collar: Collar, target: float) -> Faired | None:
    """The continuation from a patch over a domain with angles 2π minus the mesh's at the loop; None if that fails."""
    beside = vertex_angles(collar.vertices, collar.faces)[: collar.boundary_size]
    with suppress(*_NO_NEW_MESH, OutOfTimeError):
        start = over_domain_of_angles(patch, 2 * np.pi - beside, target)
        if len(start.vertices) > start.boundary_size:
            return minimised_curvature(start, collar)
    return None


def _remeshed(faired: Faired, collar: Collar, target: float) -> Faired:
    """Remeshes a patch and minimises again, until it is good or no longer improves."""
    for _ in range(_ROUNDS):
        is_stretched = faired.stretch > _MOST_STRETCHED
        if (faired.converged and not faired.is_thin and not is_stretched) or is_out_of_time():
            break
        try:
            finer = remesh(faired.patch, target, collar.rim_edges)
            if len(finer.vertices) == finer.boundary_size:
                break
            again = thin_plate(finer, collar) if faired.order == "thin plate" else minimised_curvature(finer, collar)
        except (*_NO_NEW_MESH, OutOfTimeError):
            break
        again = replace(again, steps=faired.steps + again.steps, remeshed=True, lowered=faired.lowered)
        if not (_rank(again) < _rank(faired) or (is_stretched and _rank(again)[:2] <= _rank(faired)[:2])):
            break
        faired = again
    return faired


def _rank(faired: Faired) -> tuple[bool, float, float]:
    """A sort key, least for the best patch: folds, then the next step unless converged, then the smallest angle."""
    left = 0.0 if faired.converged else faired.next_step
    return bool(faired.folds), left, -min(faired.smallest_angles[1], SMALLEST_ANGLE)
