"""Smooth continuation: moves a patch so that it continues the mean curvature of the mesh, and remeshes it if needed."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float

from spinor_geom.arrays import TINY
from spinor_geom.deadline import is_out_of_time
from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.domain.sizes import GRADED, EdgeLengths
from spinor_geom.errors import SpinorGeomError
from spinor_geom.fill.collar import Bend, Collar, bend_inside
from spinor_geom.fill.fairing import SMALLEST_ANGLE, Faired, Order, approached, minimised_curvature, thin_plate
from spinor_geom.mesh.operators import radii_of_curvature, side_lengths, vertex_angles
from spinor_geom.meshing.embed import Patch, over_domain_of_angles
from spinor_geom.meshing.remeshing import remesh

_ROUNDS = 6  # of minimisation and remeshing, to bound the time
# Edges are refined that are longer than `_LONG` times this multiple of the radius of curvature 1/√(κ₁² + κ₂²). With 0.2
# tubes between two rims are off by twice as much. 0.1 needs a third more faces for the same distances.
_FLATNESS, _LONG = 0.14, 1.5
# Not below this multiple of the rims' edges. With 1, ten of 484 mirrored sheets differ from their images by more than
# 1e-3 of the size, with 0.8 two, with 0.7 none, at 20 % more vertices.
_SHORTEST = 0.7
# The report has a remark if the bend inside a patch, for edges as long as those of the mesh around it, exceeds this
# multiple of the bend there by more than so many degrees. The ratio is at most 1.5 on spheres, cylinders, tori and
# scans.
_MOST_BENT, _SLIGHT_BEND = 2.0, 1.0
KINK = 5.0  # degrees by which the bend across the rim may exceed that of the mesh around it without a remark
MOST_AREA = 2.0  # ratio of the areas after and before, as of hemisphere and disk. A larger patch gets a remark

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
        lowered: why the thin plate was used, as the end of a sentence, or empty if it was not.
        is_coarse: whether its triangles are larger than asked for, because of a limit on time or on vertices, or
            because smaller ones were not as good.
        steps: number of Newton steps.
        converged: whether the next step would move no vertex by more than 0.01 of a mean edge of the patch.
        next_step: the largest displacement of a vertex in the next step, in mean edges of the patch.
        area_ratio: the area divided by that of the surface before.
        smallest_angle: of all triangles, in degrees.
        smallest_rim_angle: the smallest angle, in degrees, between two edges of the rim that belong to one triangle.
            None if there is no such triangle. No triangulation has larger angles there.
        folds: number of edges of the patch across which the normal turns by more than 90°. They end at the rim,
            or are a crease that was continued.
        correlation_length: ℓ, the length over which the mean curvature of the mesh around changes, in mesh units.
        roughness: variance of that curvature between neighbours, divided by its total variance: 0 on a smooth mesh, 1
            and more in noise, which is not continued.
        creased: number of rim vertices at creases of the mesh, where the patch may bend freely.
        crease: the angle, in degrees, between the faces at a crease that was continued through the patch, or 0.
    """

    started_from: Start
    before: Bend
    after: Bend
    inside: Bend
    around: Bend
    order: Order
    lowered: str
    is_coarse: bool
    steps: int
    converged: bool
    next_step: float
    area_ratio: float
    smallest_angle: float
    smallest_rim_angle: float | None
    folds: int
    correlation_length: float
    roughness: float
    creased: int
    crease: float

    @classmethod
    def of(
        cls,
        faired: Faired,
        collar: Collar,
        *,
        start: Start,
        before: Bend,
        after: Bend,
        area_ratio: float,
        crease: float,
    ) -> Continuation:
        """The figures of a faired patch and its collar."""
        return cls(
            started_from=start,
            before=before,
            after=after,
            around=collar.bend,
            order=faired.order,
            lowered=faired.lowered,
            is_coarse=faired.is_coarse,
            steps=faired.steps,
            converged=faired.converged,
            next_step=faired.next_step,
            area_ratio=area_ratio,
            **_angles_of(faired.patch),
            correlation_length=collar.length,
            roughness=collar.roughness,
            creased=collar.creased,
            crease=crease,
        )

    def with_angles_of(self, patch: Patch) -> Continuation:
        """The measures with the angles of a patch whose triangles were changed later."""
        return replace(self, **_angles_of(patch))

    def enlarged(self, scale: float) -> Continuation:
        """The measures after scaling mesh and patch."""
        bends = {name: getattr(self, name) for name in ("before", "after", "inside", "around")}
        return replace(
            self,
            correlation_length=scale * self.correlation_length,
            **{name: replace(bend, edge=scale * bend.edge) for name, bend in bends.items()},
        )

    def __repr__(self) -> str:
        bend = f"bend {self.before.rms:.3g}° to {self.after.rms:.3g}°"
        return f"Continuation({self.order}, {bend}, {self.area_ratio:.3g} times the area, {self.reason or 'converged'})"

    @property
    def reason(self) -> str:
        """Why it has not converged, or empty if it has."""
        if self.converged:
            return ""
        return f"after {self.steps} steps the next one would still move a vertex by {self.next_step:.2g} of an edge"

    @property
    def has_kink(self) -> bool:
        """Whether the patch bends across the rim by more than 5° more than the mesh around it."""
        return self.after.rms > self.around.rms + KINK

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on a thin plate, large triangles, a large area, a large bend, folds and thin triangles."""
        found = []
        if self.lowered:
            found.append(f"the patch is a thin plate, because the continuation of the mean curvature {self.lowered}")
        if self.is_coarse:
            why = "the limit on time or on vertices, or smaller ones were not as good"
            found.append(f"the triangles of the patch are larger than asked for ({why})")
        if self.area_ratio > MOST_AREA:
            found.append(f"the patch has {self.area_ratio:.2g} times the area of the surface it started from")
        if self.has_kink:
            degrees = f"{self.after.rms:.2g}° (RMS), the faces of the mesh around bend by {self.around.rms:.2g}°"
            found.append(f"the patch meets the mesh at {degrees}")
        # longer edges bend more, except for the still longer ones along a prism
        inside = self.inside.rms * min(1.0, self.around.edge / max(self.inside.edge, TINY))
        if inside > _MOST_BENT * self.around.rms + _SLIGHT_BEND:
            degrees = f"{inside:.2g}° from face to face, the mesh around by {self.around.rms:.2g}°"
            found.append(f"for edges as long as around it, the patch bends by {degrees}")
        if self.folds and not self.crease:
            found.append(f"teeth of the rim fold the patch at {self.folds} of its edges")
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
            "inside": self.inside.to_dict(),
            "around": self.around.to_dict(),
        }


def _angles_of(patch: Patch) -> dict[str, Any]:
    rim = patch.angles.at_rim
    return {
        "inside": bend_inside(patch),
        "smallest_angle": min(rim, patch.angles.smallest_free),
        "smallest_rim_angle": rim if np.isfinite(rim) else None,
        "folds": patch.angles.folds // 2,
    }


def continue_patch(patch: Patch, collar: Collar, lengths: EdgeLengths) -> Faired:
    """A patch that is the smooth continuation of the mesh around it, over the same rims.

    1. The patch is remeshed with edges that grow inwards, and becomes a thin plate.
    2. The curvature functional is minimised by Newton's method (`minimised_curvature`), with remeshing in between.
    3. If the result over one loop is folded or has not converged, the minimisation starts again from a patch over a
       domain whose angles at the loop complete those of the mesh to 2π. A minimal surface that turns back over the mesh
       has other angles there.
    4. If it is still folded or has not converged, the thin plate replaces it, unless that is folded too.
    5. If it has converged, the patch is remeshed with the target length, or with edges short enough for its curvature,
       and minimised again.

    Raises:
        SingularMatrixError: triangles of the patch are degenerate.
        TooManyPointsError: the lengths need too many vertices.
        OutOfTimeError: a time limit has passed before there was a first result.
    """
    plate = _plate(patch, collar)
    faired = _continued(plate, collar)
    if faired.defect and not patch.hole_sizes and not is_out_of_time():
        again = _from_domain_of_angles(patch, collar)
        if again is not None and _rank(again)[:2] <= _rank(faired)[:2]:
            faired = replace(again, steps=faired.steps + again.steps)
    if faired.defect and not plate.patch.angles.folds and not is_out_of_time():
        faired = replace(plate, lowered=faired.defect, steps=faired.steps)
    return _refined(faired, collar, lengths) if faired.converged else faired


def _from_domain_of_angles(patch: Patch, collar: Collar) -> Faired | None:
    """The continuation from a patch over a domain with angles 2π minus the mesh's at the loop. None if that fails."""
    beside = vertex_angles(collar.vertices, collar.faces)[: collar.boundary_size]
    with suppress(SpinorGeomError):
        start = over_domain_of_angles(patch, 2 * np.pi - beside, GRADED)
        if len(start.vertices) > start.boundary_size:
            return _continued(_plate(start, collar), collar)
    return None


def _continued(plate: Faired, collar: Collar) -> Faired:
    """The continuation from a thin plate, with edges that grow inwards."""
    start = plate.patch if plate.is_good else _graded(plate.patch, collar)
    return _minimised(start, collar, partial(_graded, collar=collar))


def _graded(patch: Patch, collar: Collar) -> Patch:
    """A patch with edges that grow inwards."""
    return _remeshed(patch, collar, GRADED)


def _finer(patch: Patch, collar: Collar) -> Patch:
    """A patch with edges that grow inwards up to a share of its radius of curvature."""
    return _remeshed(patch, collar, GRADED, _wanted(patch))


def _remeshed(
    patch: Patch, collar: Collar, lengths: EdgeLengths, wanted: Float[np.ndarray, " n"] | None = None
) -> Patch:
    """A patch with edges of other lengths, or the patch itself if that fails, or would have no inner vertices."""
    with suppress(SpinorGeomError):
        new = remesh(patch, lengths, collar.rim_edges, wanted=wanted)
        if len(new.vertices) > new.boundary_size:
            return new
    return patch


def _plate(patch: Patch, collar: Collar) -> Faired:
    """The thin plate, with edges that grow inwards. Over one loop those of the patch itself if they are good."""
    is_graded = not patch.hole_sizes and patch.angles.smallest_free >= SMALLEST_ANGLE
    plate = thin_plate(patch if is_graded else _graded(patch, collar), collar)
    return plate if plate.is_good else thin_plate(_graded(plate.patch, collar), collar)


def _minimised(patch: Patch, collar: Collar, remeshed: Callable[[Patch], Patch]) -> Faired:
    """A patch minimised, and remeshed in between, until it is good or hardly improves."""
    best = faired = minimised_curvature(patch, collar)
    steps = faired.steps
    with suppress(SpinorGeomError):
        for _ in range(_ROUNDS):
            if faired.is_good or is_out_of_time():
                break
            if not faired.converged:
                faired = approached(faired.patch, collar)
                steps += faired.steps
            faired = minimised_curvature(remeshed(faired.patch), collar)
            steps += faired.steps
            if _rank(faired) >= _rank(best):
                break
            # on 48 rims where Newton's method failed, no patch whose next step was not halved became good
            is_slow = not faired.converged and faired.next_step > best.next_step / 2
            best = faired
            if is_slow:
                break
    return replace(best, steps=steps)


def _refined(faired: Faired, collar: Collar, lengths: EdgeLengths) -> Faired:
    """A continued patch with the final edge lengths, or the patch itself if that is worse or has them."""
    if lengths == GRADED and _is_fine(faired.patch):
        return faired
    finer = partial(_finer, collar=collar) if lengths == GRADED else partial(_remeshed, collar=collar, lengths=lengths)
    with suppress(SpinorGeomError):
        fine = finer(faired.patch)
        again = thin_plate(fine, collar) if faired.order == "thin plate" else _minimised(fine, collar, finer)
        if _rank(again)[:2] <= _rank(faired)[:2]:
            steps = faired.steps + again.steps
            return replace(again, steps=steps, lowered=faired.lowered, is_coarse=fine is faired.patch)
    return replace(faired, is_coarse=lengths != GRADED or is_out_of_time())


def _wanted(patch: Patch) -> Float[np.ndarray, " n"]:
    """Lengths of edges at the vertices for the curvature of a patch, at least 0.7 of the mean length of rims' edges."""
    m = patch.boundary_size
    rim = np.linalg.norm(patch.vertices[rim_successors(patch.rims)] - patch.vertices[:m], axis=1)
    wanted = _FLATNESS * radii_of_curvature(patch.vertices, np.asarray(patch.faces))
    wanted[:m] = rim.mean()
    return np.clip(wanted, _SHORTEST * rim.mean(), rim.sum())


def _is_fine(patch: Patch) -> bool:
    """Whether the edges are short enough for the curvature."""
    faces, wanted = np.asarray(patch.faces), _wanted(patch)
    mean = (wanted[faces] + wanted[faces[:, [1, 2, 0]]]) / 2
    return bool((side_lengths(patch.vertices, faces) < _LONG * mean).all())


def _rank(faired: Faired) -> tuple[bool, float, float]:
    """A sort key, least for the best patch: folds, then the next step unless converged, then the smallest angle."""
    left = 0.0 if faired.converged else faired.next_step
    # to a tenth of a degree, because another round takes too long for less
    angles = faired.patch.angles
    return bool(angles.folds), left, -round(min(angles.smallest_free, SMALLEST_ANGLE), 1)
