"""Smooth continuation: the surface over a hole on which the mean curvature goes on from the mesh around.

Of all surfaces through the rim that have the mesh's tangents there, one of least ∫H² + ℓ²|∇H|², varied with the metric
held: at rest Δ(H − ℓ²ΔH) = 0. Spheres, cylinders and planes go on as themselves. It is the likeliest surface if H is a
random field of correlation length ℓ, which is measured around the hole: a smooth mesh's curvature goes on far into the
patch, a rough one's does not.

Source: Schneider & Kobbelt (2001), Geometric fairing of irregular meshes for free-form surface design, for ΔH = 0.
"""

from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_array, diags_array

from spinor_geom.deadline import is_out_of_time
from spinor_geom.domain.delaunay import unique_edges
from spinor_geom.errors import DomainError, OutOfTimeError, SingularMatrixError
from spinor_geom.fill.collar import Bend, Collar, bend_across
from spinor_geom.mesh.operators import (
    Bending,
    crossing_angles,
    factor_symmetric,
    internal_angles,
    mollified_laplacian,
    vertex_angles,
)
from spinor_geom.mesh.topology import HalfEdges
from spinor_geom.meshing.embed import Patch, over_domain_of_angles, over_own_domain, remesh

# Figures below are of 111 holes: 70 of generated kinds, and rims of scans and of meshes with known trouble.
# Newton's method starts after so many linear solves at most. After one only a triangle of 4.9° is left on one scan, and
# one rim more is not at rest; six bring one shredded rim to rest, for 13 % more steps.
_STARTS = 3
_MOST_STEPS = 40  # 20 stop two rims that fold; none takes 80
# Edges that are longer by more leave triangles too coarse for the bulge: with 4 the ends of two fingers bend by
# 7.6° across the rim, not by 5.9°; 1.4 takes 14 % more steps for the same smallest angles.
_MOST_STRETCHED = 2.0
_AT_REST = 0.01  # at rest: the next step moves no vertex by more than this share of an edge; half takes 12 % more steps
_ROUNDS = 4  # of new meshes, which bound the time: two do as well on all of these holes
# Degrees: a patch with thinner triangles is meshed anew, and what is left of them is reported. 20 takes half as long
# again, and as many patches keep angles below 10.
_SMALLEST_ANGLE = 10.0
MOST_AREA = 2.0  # times the film's: half a sphere over its disk; a larger patch is reported
# Deuflhard (2004), Newton Methods for Nonlinear Problems: a factor serves on while each step is at most half the one
# before, where the simplified method still converges (a quarter takes 37 % more time); below the least share of a step
# the linear problem is no guide: of 131 patches half of it takes 14 % more steps, twice 7 % fewer, for the same shapes.
_QUICK, _SHORTEST = 0.5, 0.05

Start: TypeAlias = Literal["minimal", "discrete", "strip"]
Order: TypeAlias = Literal["curvature", "thin plate"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Continuation:
    """How a patch became the smooth continuation of the mesh around it.

    Attributes:
        started_from: what the patch was before: a minimal surface, a discrete one, or straight lines between two rims.
        before: its bend across the rim then.
        after: its bend across the rim now.
        order: what it is: "curvature" minimizes ∫H² + ℓ²|∇H|², "thin plate" the integral of |Δx|² over the film.
        lowered: why it is a thin plate; empty where it is not.
        steps: Newton's steps.
        remeshed: whether it was meshed anew because its triangles were stretched.
        converged: whether it is at rest: the next step would move no vertex by more than 0.01 of an edge.
        next_step: the largest displacement of a vertex in the next step, in mean edges of the patch.
        area_ratio: its area by that of the surface it started from.
        smallest_angle: of its triangles with an inner vertex, in degrees; None where it has none.
        smallest_rim_angle: of all its triangles; the angles of those over three rim vertices are given by the rim.
        correlation_length: ℓ, over which the mean curvature of the mesh around changes, in mesh units.
        roughness: share of the variance of that curvature between neighbours: 0 on a smooth mesh, 1 and more in noise,
            none of which goes on.
        creased: vertices of the rim at creases of the mesh, where the patch is left free to bend.
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
        """What the caller should know of its order, area and triangles, a sentence each."""
        found = []
        if self.lowered:
            found.append(f"the patch is a thin plate, as the continuation of the mean curvature {self.lowered}")
        if self.area_ratio > MOST_AREA:
            found.append(f"the patch has {self.area_ratio:.2g} times the area of the surface it started from")
        if self.smallest_angle is not None and self.smallest_angle < _SMALLEST_ANGLE:
            found.append(f"the smallest angle of the patch's triangles is {self.smallest_angle:.2g}°")
        return tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """The figures in JSON's types."""
        return {**asdict(self), "before": self.before.to_dict(), "after": self.after.to_dict()}


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved:
    """A patch that was moved, and by how much the edge that became longer most did so since it was meshed."""

    patch: Patch
    steps: int
    next_step: float  # largest displacement of a vertex, in mean edges
    stretch: float
    remeshed: bool = False
    order: Order = "curvature"
    lowered: str = ""

    @property
    def converged(self) -> bool:
        """Whether the next step moves no vertex by more than a hundredth of an edge."""
        return self.next_step <= _AT_REST

    @cached_property
    def folds(self) -> int:
        """Half-edges across which the patch's normal turns by more than a right angle."""
        half_edges = HalfEdges.of(np.asarray(self.patch.faces))
        return int((crossing_angles(half_edges, self.patch.vertices) > np.pi / 2).sum())

    @cached_property
    def smallest_angles(self) -> tuple[float | None, float]:
        """Of the triangles with an inner vertex, None where there are none, and of all, in degrees."""
        faces = np.asarray(self.patch.faces)
        angles = np.degrees(internal_angles(self.patch.vertices, faces).min(axis=1))
        inner = angles[(faces >= self.patch.boundary_size).any(axis=1)]
        return float(inner.min()) if len(inner) else None, float(angles.min())

    @property
    def is_thin(self) -> bool:
        """Whether it has a triangle with too small an angle."""
        return self.smallest_angles[1] < _SMALLEST_ANGLE

    @property
    def defect(self) -> str:
        """Why a patch of lower order is better; empty where none is."""
        if not self.converged:
            return f"did not come to rest: the next step would move a vertex by {self.next_step:.2g} of an edge"
        return "is folded" if self.folds else ""


def continue_patch(patch: Patch, collar: Collar, target: float, *, is_conformal: bool) -> Moved:
    """Moves a patch's inner vertices to the smooth continuation of the mesh around it.

    Where it does not come to rest or is folded, a patch over one loop starts again, over a domain that has the angles
    which the mesh leaves at the loop: those of a minimal surface are others where it turns back over the mesh. A patch
    whose edges have become more than twice as long, or that has angles below 10°, is meshed anew for edges of the
    target length and goes on. Where the result is still not at rest or is folded, it is replaced by the thin plate, if
    that has no such defect. A SingularMatrixError tells that its triangles are degenerate.
    """
    moved = _at_rest(patch, collar)
    is_poor = moved.folds or not moved.converged or (moved.stretch > _MOST_STRETCHED and not is_conformal)
    if is_poor and not patch.hole_sizes and not is_out_of_time():
        again = _at_rest_over_angles(patch, collar, target)
        is_alike = again is not None and (again.folds, again.converged) == (moved.folds, moved.converged)
        if again is not None and (is_alike or _poorness(again, collar) <= _poorness(moved, collar)):
            moved, is_conformal = replace(again, steps=moved.steps + again.steps, remeshed=True), True
    moved = _meshed_anew(moved, collar, target, is_conformal=is_conformal)
    defect = moved.defect
    if defect and not is_out_of_time():
        plate = replace(_thin_plate(patch, collar), lowered=defect)
        if plate.is_thin:
            plate = _meshed_anew(plate, collar, target, is_conformal=is_conformal)
        if not plate.defect:
            return replace(plate, steps=moved.steps)
    return moved


def _meshed_anew(moved: Moved, collar: Collar, target: float, *, is_conformal: bool) -> Moved:
    """The patch with triangles of its present shape, again moved, as often as that is needed and better."""
    for _ in range(_ROUNDS):
        if not (moved.stretch > _MOST_STRETCHED or moved.is_thin or not moved.converged) or is_out_of_time():
            break
        better = _next_mesh(moved, collar, target, is_conformal=is_conformal)
        if better is None:
            break
        moved, is_conformal = better, False
    return moved


def _next_mesh(moved: Moved, collar: Collar, target: float, *, is_conformal: bool) -> Moved | None:
    """Meshed once over a domain of its present shape, or else its own, and moved; None where neither is better."""
    domains = []
    if not moved.patch.hole_sizes:
        with suppress(DomainError, OutOfTimeError, SingularMatrixError):
            domains.append(over_own_domain(moved.patch))
    if is_conformal:
        domains.append(moved.patch)
    best = None
    for domain in domains:
        try:
            finer = remesh(domain, target)
        except OutOfTimeError:
            break
        except DomainError:  # chords between the rim's places cross there
            continue
        if len(finer.vertices) == finer.boundary_size:
            continue
        is_plate = moved.order == "thin plate"
        again = _thin_plate(finer, collar) if is_plate else _at_rest(finer, collar)
        again = replace(again, steps=moved.steps + again.steps, remeshed=True, lowered=moved.lowered)
        was = best or moved
        is_finer = was is moved and moved.stretch > _MOST_STRETCHED
        if _rank(again) < _rank(was) or (is_finer and _rank(again)[:2] <= _rank(was)[:2]):
            best = again
        if best is not None and best.converged and not best.folds and not best.is_thin:
            break
    return best


def _poorness(moved: Moved, collar: Collar) -> tuple[int, float]:
    """How many of two defects it has, folds and no rest, and with any the RMS bend across the rim, in degrees."""
    defects = bool(moved.folds) + (not moved.converged)
    return defects, bend_across(collar, moved.patch).rms if defects else 0.0


def _rank(moved: Moved) -> tuple[bool, float, float]:
    """What is better comes first: no folds, at rest or nearer to it, no thin triangles."""
    left = 0.0 if moved.converged else moved.next_step
    return bool(moved.folds), left, -min(moved.smallest_angles[1], _SMALLEST_ANGLE)


def _thin_plate(patch: Patch, collar: Collar) -> Moved:
    """Where ∫|Δx|² is least, Δ being that of the patch: a linear problem."""
    m = collar.boundary_size
    problem = _Problem(np.asarray(patch.faces), collar, len(patch.vertices))
    x = problem.smoothed(np.concatenate([patch.vertices[m:], collar.vertices]))
    return replace(_moved(patch, x[: problem.free], 0, 0.0), order="thin plate")


def _at_rest_over_angles(patch: Patch, collar: Collar, target: float) -> Moved | None:
    """From a domain with the angles that the mesh leaves at the loop; None where none is simple, or wide enough."""
    beside = vertex_angles(collar.vertices, collar.faces)[: collar.boundary_size]
    try:
        start = over_domain_of_angles(patch, 2 * np.pi - beside, target)
    except (DomainError, OutOfTimeError, SingularMatrixError):
        return None
    return _at_rest(start, collar) if len(start.vertices) > start.boundary_size else None


def _at_rest(patch: Patch, collar: Collar) -> Moved:
    m, steps = collar.boundary_size, 0
    problem = _Problem(np.asarray(patch.faces), collar, len(patch.vertices))
    start = near = np.concatenate([patch.vertices[m:], collar.vertices])
    best, least = near, np.inf
    for attempt in range(_STARTS + 1):
        # last from the patch itself: one meshed anew lies nearer than its linear problem leads
        near = problem.smoothed(near) if attempt < _STARTS else start
        x, more, left = problem.rest(near)
        steps += more
        if left < least:
            best, least = x, left
        if least <= _AT_REST or is_out_of_time():
            break
    return _moved(patch, best[: problem.free], steps, least)


def _moved(patch: Patch, inner: Float[np.ndarray, "k 3"], steps: int, next_step: float) -> Moved:
    vertices = np.concatenate([patch.vertices[: patch.boundary_size], inner])
    edges = unique_edges(np.asarray(patch.faces), len(vertices))
    before, after = (np.linalg.norm(v[edges[:, 0]] - v[edges[:, 1]], axis=1) for v in (patch.vertices, vertices))
    stretch = float((after / np.maximum(before, np.finfo(np.float64).tiny)).max())
    return Moved(patch=replace(patch, vertices=vertices), steps=steps, next_step=next_step, stretch=stretch)


class _Problem:
    """Equations for the patch's inner vertices; these come first, then the collar's."""

    def __init__(self, faces: Int[np.ndarray, "f 3"], collar: Collar, count: int) -> None:
        m = collar.boundary_size
        self.free, self.inside = count - m, count
        numbers = np.concatenate([np.arange(m) + self.free, np.arange(self.free)])
        self._faces = np.concatenate([numbers[faces], collar.faces + self.free])
        bends = np.concatenate([np.ones(self.free, dtype=bool), collar.bends])
        self._bends = bends[:count]
        self._beyond = collar.curvature
        self._squared_length = collar.length**2
        # ∇H is known on faces with three curvatures
        known = bends[self._faces].all(axis=1)
        self._known = None if known.all() else self._faces[known]

    def smoothed(self, x: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 3"]:
        """The free vertices where ∫|Δx|² is least, Δ being that of x."""
        n, bending = self.free, Bending.of(x, self._faces)
        bilaplacian = self._slope(bending) @ bending.laplacian[: self.inside]
        moved = factor_symmetric(bilaplacian[:, :n]).solve(-(bilaplacian[:, n:] @ x[n:]))
        return np.concatenate([moved, x[n:]])

    def rest(self, x: Float[np.ndarray, "v 3"]) -> tuple[Float[np.ndarray, "v 3"], int, float]:
        """Newton's steps until the next is too short to matter: where they end, their number, the next one's length.

        That is the largest displacement of a vertex, in mean edges.
        """
        n, steps, share = self.free, 0, 1.0
        bending = Bending.of(x, self._faces)
        edge = float(np.sqrt(bending.areas[:n].mean()))
        factor = factor_symmetric(self._stiffness(x, bending))
        step = -factor.solve(self._imbalance(x, bending))
        length = float(np.sqrt(np.mean(step**2)))
        while np.abs(step).max() > _AT_REST * edge:
            if steps == _MOST_STEPS or share < _SHORTEST or is_out_of_time():
                break
            moved = x.copy()
            moved[:n] += share * step[:, None] * bending.normals[:n]
            there = Bending.of(moved, self._faces)
            following = -factor.solve(self._imbalance(moved, there))
            following_length = float(np.sqrt(np.mean(following**2)))
            # Deuflhard's monotonicity test, restricted so that shares do not shrink for nothing
            # a fall of a quarter of what the linear problem promises: an eighth does as well, a half loses 12 patches
            if not following_length < (1 - share / 4) * length:
                share /= 2
                continue
            steps += 1
            if share < 1 or following_length > _QUICK * length:
                factor = factor_symmetric(self._stiffness(moved, there))
                following = -factor.solve(self._imbalance(moved, there))
                following_length = float(np.sqrt(np.mean(following**2)))
            x, bending, step, length, share = moved, there, following, following_length, 1.0
        left = float(np.abs(step).max() / edge)
        if left <= _AT_REST:
            x = x.copy()
            x[:n] += step[:, None] * bending.normals[:n]
        return x, steps, left

    def _slope(self, bending: Bending) -> csc_array:
        """L/A from the inside vertices that bend to the free ones."""
        weight = diags_array(self._bends / bending.areas[: self.inside])
        return csc_array(bending.laplacian[: self.free, : self.inside] @ weight)

    def _gradient_form(self, x: Float[np.ndarray, "v 3"], bending: Bending) -> csc_array:
        if self._known is None:
            return bending.laplacian
        form = mollified_laplacian(x, self._known)
        form.resize((len(x), len(x)))
        return form

    def _stiffness(self, x: Float[np.ndarray, "v 3"], bending: Bending) -> csc_array:
        """Derivative of the imbalance by displacements along the normals, but for terms of lower order."""
        s = self.inside
        slope = self._slope(bending)
        weight = diags_array(bending.areas[:s])
        if self._squared_length:
            weight = weight + self._squared_length * self._gradient_form(x, bending)[:s, :s]
        return csc_array(0.5 * (slope @ weight @ slope.T))

    def _imbalance(self, x: Float[np.ndarray, "v 3"], bending: Bending) -> Float[np.ndarray, " k"]:
        """L(H + ℓ²LH/A) at the free vertices."""
        s = self.inside
        curvature = np.where(self._bends, bending.curvature[:s], 0.0)
        force = bending.areas[:s] * curvature
        if self._squared_length:
            whole = np.concatenate([curvature, self._beyond])
            force = force + self._squared_length * (self._gradient_form(x, bending) @ whole)[:s]
        pull = np.zeros(len(x))
        pull[:s] = self._bends * force / bending.areas[:s]
        return np.asarray((bending.laplacian @ pull)[: self.free])
