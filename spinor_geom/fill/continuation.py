"""Smooth continuation: the surface over a hole on which the mean curvature goes on from the mesh around.

Of all surfaces through the rim that have the mesh's tangents there, one of least ∫H² + ℓ²|∇H|², varied with the metric
held: at rest Δ(H − ℓ²ΔH) = 0. Spheres, cylinders and planes go on as themselves. It is the likeliest surface if H is a
random field of correlation length ℓ, which is measured around the hole: a smooth mesh's curvature goes on far into the
patch, a rough one's does not.

Source: Schneider & Kobbelt (2001), Geometric fairing of irregular meshes for free-form surface design, for ΔH = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_array, diags_array

from spinor_geom.deadline import is_out_of_time
from spinor_geom.domain.delaunay import unique_edges
from spinor_geom.errors import DomainError, SingularMatrixError, SurfaceError
from spinor_geom.fill.collar import Bend, Collar, bend_across, collar_of
from spinor_geom.fill.stitch import fit_to_rim
from spinor_geom.fill.surroundings import NOTHING, Crossings, Surroundings
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import Bending, crossing_angles, face_normals, factor_symmetric, mollified_laplacian
from spinor_geom.mesh.topology import HalfEdges
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.remesh import over_domain_of_angles, remesh
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.surface.spinor_surface import SpinorSurface

# Newton's method starts after so many linear solves at most; a dome that is not found after few is not after many.
_STARTS = 3
_MOST_STEPS = 40
# Edges that are longer by more leave triangles that are too coarse for the bulge.
_MOST_STRETCHED = 2.0
# At rest: the next step is shorter than this share of an edge, as a mean.
_AT_REST = 3e-3
# A factor serves on while each step is so much shorter than the one before.
_QUICK = 0.5
# Where no longer share of a step brings the next one down, the linear problem is no guide.
_SHORTEST = 0.05

Start: TypeAlias = Literal["minimal", "discrete", "strip"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Continuation:
    """How a patch became the smooth continuation of the mesh around it.

    Attributes:
        started_from: what the patch was before: a minimal surface, a discrete one, or straight lines between two rims.
        before: its bend across the rim then.
        after: its bend across the rim now.
        steps: Newton's steps.
        remeshed: whether it was meshed anew because its triangles were stretched.
        converged: whether it is at rest.
        correlation_length: ℓ, over which the mean curvature of the mesh around changes, in mesh units.
        roughness: share of the variance of that curvature between neighbours: 0 on a smooth mesh, 1 and more in noise,
            none of which goes on.
        creased: vertices of the rim at creases of the mesh, where the patch is left free to bend.
    """

    started_from: Start
    before: Bend
    after: Bend
    steps: int
    remeshed: bool
    converged: bool
    correlation_length: float
    roughness: float
    creased: int

    @property
    def reason(self) -> str:
        """Why it is not at rest; empty where it is."""
        return "" if self.converged else f"Newton's method did not come to rest in {self.steps} steps"

    def to_dict(self) -> dict[str, Any]:
        """The figures in JSON's types."""
        return {**asdict(self), "before": self.before.to_dict(), "after": self.after.to_dict()}


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved:
    """A patch that was moved, and by how much the edge that became longer most did so since it was meshed."""

    patch: Patch
    steps: int
    converged: bool
    stretch: float
    remeshed: bool = False

    @cached_property
    def folds(self) -> int:
        """Half-edges across which the patch's normal turns by more than a right angle."""
        faces = np.asarray(self.patch.faces)
        angles = crossing_angles(HalfEdges.of(faces), face_normals(self.patch.vertices, faces))
        return int((angles > np.pi / 2).sum())


def continue_patch(patch: Patch, collar: Collar, target: float, *, is_conformal: bool) -> Moved:
    """Moves a patch's inner vertices to the smooth continuation of the mesh around it.

    Where it does not come to rest or is folded, a patch over one loop starts again, over a domain that has the angles
    which the mesh leaves at the loop: those of a minimal surface are others where it turns back over the mesh. A patch
    whose edges have become more than twice as long is meshed anew and goes on.

    Args:
        patch: with inner vertices.
        collar: the mesh around it.
        target: edge length with which it may be meshed anew.
        is_conformal: whether its domain has its shape.

    Raises:
        SingularMatrixError: the patch's triangles are degenerate.
        TooManyPointsError: the edge length asks for more vertices than anyone can use.
    """
    moved = _at_rest(patch, collar)
    is_poor = moved.folds or not moved.converged or (moved.stretch > _MOST_STRETCHED and not is_conformal)
    if is_poor and not patch.hole_sizes and not is_out_of_time():
        again = _at_rest_over_angles(patch, collar, target)
        if again is not None and (again.folds, not again.converged) <= (moved.folds, not moved.converged):
            moved, is_conformal = replace(again, steps=moved.steps + again.steps, remeshed=True), True
    if moved.stretch > _MOST_STRETCHED and is_conformal and not is_out_of_time():
        again = _at_rest(remesh(moved.patch, target), collar)
        moved = replace(again, steps=moved.steps + again.steps, remeshed=True)
    return moved


def _at_rest_over_angles(patch: Patch, collar: Collar, target: float) -> Moved | None:
    """From a domain with the angles that the mesh leaves at the loop; None where none is simple, or wide enough."""
    try:
        start = over_domain_of_angles(patch, 2 * np.pi - collar.angles, target)
    except (DomainError, SingularMatrixError):
        return None
    return _at_rest(start, collar) if len(start.vertices) > start.boundary_size else None


def _at_rest(patch: Patch, collar: Collar) -> Moved:
    m, steps = collar.boundary_size, 0
    problem = _Problem(np.asarray(patch.faces), collar, len(patch.vertices))
    near = np.concatenate([patch.vertices[m:], collar.vertices])
    for _ in range(_STARTS):
        near = problem.smoothed(near)
        x, more, converged = problem.rest(near)
        steps += more
        if converged or is_out_of_time():
            break
    vertices = np.concatenate([patch.vertices[:m], x[: problem.free]])
    edges = unique_edges(np.asarray(patch.faces), len(vertices))
    before, after = (np.linalg.norm(v[edges[:, 0]] - v[edges[:, 1]], axis=1) for v in (patch.vertices, vertices))
    stretch = float((after / np.maximum(before, np.finfo(np.float64).tiny)).max())
    return Moved(patch=replace(patch, vertices=vertices), steps=steps, converged=converged, stretch=stretch)


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

    def rest(self, x: Float[np.ndarray, "v 3"]) -> tuple[Float[np.ndarray, "v 3"], int, bool]:
        """Newton's steps until the next is too short to matter: where they end, their number, whether it rests."""
        n, steps, share = self.free, 0, 1.0
        bending = Bending.of(x, self._faces)
        edge = float(np.sqrt(bending.areas[:n].mean()))
        factor = factor_symmetric(self._stiffness(x, bending))
        step = -factor.solve(self._imbalance(x, bending))
        length = float(np.sqrt(np.mean(step**2)))
        while length > _AT_REST * edge:
            if steps == _MOST_STEPS or share < _SHORTEST or is_out_of_time():
                return x, steps, False
            moved = x.copy()
            moved[:n] += share * step[:, None] * bending.normals[:n]
            there = Bending.of(moved, self._faces)
            following = -factor.solve(self._imbalance(moved, there))
            following_length = float(np.sqrt(np.mean(following**2)))
            if not following_length < (1 - share / 4) * length:
                share /= 2
                continue
            steps += 1
            if share < 1 or following_length > _QUICK * length:
                factor = factor_symmetric(self._stiffness(moved, there))
                following = -factor.solve(self._imbalance(moved, there))
                following_length = float(np.sqrt(np.mean(following**2)))
            x, bending, step, length, share = moved, there, following, following_length, 1.0
        x = x.copy()
        x[:n] += step[:, None] * bending.normals[:n]
        return x, steps, True

    def _slope(self, bending: Bending) -> csc_array:
        """L/A from the inside vertices that bend to the free ones."""
        return csc_array(
            bending.laplacian[: self.free, : self.inside] @ diags_array(self._bends / bending.areas[: self.inside])
        )

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


@dataclass(frozen=True, kw_only=True, eq=False)
class MadePatch:
    """A patch on its way into the mesh: its loops, and what its `LoopOutcome` will tell of it."""

    patch: Patch
    rims: Sequence[BoundaryLoop]
    solution: PlateauSolution | None
    reason: str
    edges_split: int = 0
    crossings: Crossings = NOTHING
    continuation: Continuation | None = None
    remarks: tuple[str, ...] = ()

    @property
    def start(self) -> Start:
        """What the patch is before its continuation."""
        if self.solution is not None:
            return "minimal"
        return "strip" if self.patch.hole_sizes else "discrete"

    @property
    def surface(self) -> SpinorSurface | None:
        """The exact surface that the patch is a mesh of."""
        return None if self.solution is None or self.continuation is not None else self.solution.surface

    @cached_property
    def rim(self) -> Int[np.ndarray, " m"]:
        """Mesh vertices of its boundary vertices."""
        return np.concatenate([loop.vertex_ids for loop in self.rims])

    def joinable(self, surroundings: Surroundings) -> MadePatch:
        """The patch with its edges split that the mesh or another patch has."""
        patch, split = fit_to_rim(self.rim, self.patch, surroundings.taken, self.surface)
        return replace(self, patch=patch, edges_split=self.edges_split + split)


def continued(first: MadePatch, target: float, surroundings: Surroundings) -> MadePatch:
    """The smooth continuation of the mesh around a patch, or the patch itself with the reason why it stays.

    A patch without inner vertices has nothing that could move, and stays without a word; so does one whose
    continuation crosses more than it does. `target` is the edge length, should it be meshed anew.

    Raises:
        SurfaceError: a strip stays, which is no surface to be kept.
        TooManyPointsError: the edge length asks for more vertices than anyone can use.
    """
    if len(first.patch.vertices) == len(first.rim):
        return _staying(first)
    collar = collar_of(surroundings, first.rim, first.patch)
    try:
        moved = continue_patch(first.patch, collar, target, is_conformal=first.start != "discrete")
    except SingularMatrixError as error:
        return _staying(first, str(error))
    before, after = bend_across(collar, first.patch), bend_across(collar, moved.patch)
    if not moved.converged and after.rms >= before.rms:
        steps = f"{moved.steps} steps left a bend of {after.rms:.3g}° (RMS)"
        return _staying(first, f"{steps} across the rim, where it has {before.rms:.3g}°")
    continuation = Continuation(
        started_from=first.start,
        before=before,
        after=after,
        steps=moved.steps,
        remeshed=moved.remeshed,
        converged=moved.converged,
        correlation_length=collar.length,
        roughness=collar.roughness,
        creased=collar.creased,
    )
    smooth = replace(first, patch=moved.patch, reason=continuation.reason, continuation=continuation)
    smooth = smooth.joinable(surroundings)
    crossings = surroundings.crossings(smooth.patch)
    if len(crossings) > len(first.crossings):
        return _staying(first, ", ".join(crossings.notes), link=", as then")
    return replace(smooth, crossings=crossings)


def _staying(first: MadePatch, why: str = "", *, link: str = ":") -> MadePatch:
    remarks = (f"the patch was not continued smoothly{link} {why}",) if why else ()
    if first.start == "strip":
        raise SurfaceError("; ".join([first.reason, *remarks]))
    return replace(first, remarks=remarks)
