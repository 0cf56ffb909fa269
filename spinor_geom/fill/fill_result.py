"""The report of `fill_hole`: one outcome for every boundary loop, and the filled mesh."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from spinor_geom.fill.continuation import Continuation
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh
from spinor_geom.meshing.embed import Patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.shown import Shown, shortened

_CROSSINGS = ("self_intersections", "mesh_intersections", "patch_intersections")
_AREA_ERROR = 0.02  # relative difference of the areas of surface and mesh from which a note reports both
_STATES = {
    "minimal": "is not within the tolerance",
    "discrete": "is closed by a discrete surface",
    "smooth": "is filled by a smooth continuation with a defect",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopOutcome:
    """The result for one boundary loop.

    Attributes:
        index: its index in `boundary_loops(mesh)`, longest perimeter first.
        loop: the loop itself.
        requested: False if the caller's options exclude it, or if it is left open as a border.
        filled: whether it has a patch.
        reason: why it was left open, or why its patch has not `converged`, or empty. The mesh of an exact surface is
            coarser than asked for if the time limit ends its refinement.
        is_border: whether it was left open as the border of a sheet: its patch would lie on the mesh.
        solution: the exact surface from which the patch was made. For an open loop, the one that was found.
        patch: the patch, with the positions of its vertices in Ω, or None if the loop is open. Ω is
            flattened for a discrete patch. In a patch that was remeshed, triangles may overlap in Ω.
        continuation: measures of the smooth continuation, or None if there was none.
        joined_to: the index of the next loop of its bridge, of the first for the last one. None without a bridge. Only
            the outcome of the first loop of a bridge has the patch and its measures.
        vertices_added: number of new vertices of its patch.
        faces_added: number of new faces of its patch.
        first_face: the index of its patch's first face among the triangles of the filled mesh, or None without a patch.
        edges_split: number of inner patch edges between two rim vertices that were split, because they were edges of
            the mesh, or because their faces intersected the mesh.
        displacement: the largest distance, in mesh units, by which a vertex of the patch was moved off the surface
            because of intersections, or 0 if none was moved.
        faces_replaced: number of faces of regions that were triangulated again without inner vertices, because they
            still intersected something. They change the area of the patch by at most 5 %.
        self_intersections: pairs of faces of its patch that intersect.
        mesh_intersections: pairs of a face of its patch and one of the mesh that intersect.
        patch_intersections: pairs of a face of its patch and one of an earlier loop's patch that intersect.
        is_searched: whether intersections were searched for. False if the time limit ended the search.
        remarks: sentences on intersections, islands in the hole, and why a patch was not continued. Face indices are
            those of the triangles of the filled mesh.
        choice: with continuity "auto", which patch was chosen and why. Empty otherwise.
        timings: seconds by stage ("solve", "mesh", "crossings", "continuation" or "clearance", "attributes", or
            "failed" for a stage that raised an error).
    """

    index: int
    loop: BoundaryLoop
    requested: bool
    filled: bool
    reason: str
    is_border: bool = False
    solution: PlateauSolution | None = None
    patch: Patch | None = None
    continuation: Continuation | None = None
    joined_to: int | None = None
    vertices_added: int = 0
    faces_added: int = 0
    first_face: int | None = None
    edges_split: int = 0
    displacement: float = 0.0
    faces_replaced: int = 0
    self_intersections: int = 0
    mesh_intersections: int = 0
    patch_intersections: int = 0
    is_searched: bool = True
    remarks: tuple[str, ...] = ()
    choice: str = ""
    timings: Mapping[str, float]

    def __repr__(self) -> str:
        area = "" if self.area is None else f", area {self.area:.6g}"
        found = f"{self.intersections} intersections" if self.is_searched else "not searched for intersections"
        crossings = "" if self.intersection_free else f", {found}"
        reason = f": {self.reason}" if self.reason else ""
        name = f"loop {self.index}, {len(self.loop)} points, {self.state}"
        return shortened(f"LoopOutcome({name}{area}{crossings}{reason})")

    @property
    def kind(self) -> Literal["minimal", "discrete", "smooth"] | None:
        """The kind of its patch: an exact minimal surface, a discrete one, or a continuation, or None if it is open."""
        if not self.filled:
            return None
        if self.continuation is not None:
            return "smooth"
        return "discrete" if self.solution is None else "minimal"

    @property
    def state(self) -> str:
        """The kind of its patch, or "border", "open" if no patch was possible, or "left open" if none was requested."""
        return self.kind or ("border" if self.is_border else "open" if self.requested else "left open")

    @property
    def face_range(self) -> tuple[int, int] | None:
        """The faces of its patch, [start, stop) among the triangles of the filled mesh, or None without a patch."""
        return None if self.first_face is None else (self.first_face, self.first_face + self.faces_added)

    @property
    def converged(self) -> bool:
        """Whether the patch is an exact minimal surface within the tolerance, or a good continuation."""
        return self.kind in ("minimal", "smooth") and not self.reason

    @property
    def area(self) -> float | None:
        """Area of the exact surface, else of the patch, in squared mesh units. None for the other loops of a bridge."""
        if self._is_beside_patch:
            return None
        if self.patch is not None and self.kind in ("discrete", "smooth"):
            return self.patch.area
        return None if self.solution is None else float(self.solution.area)

    @property
    def mesh_area(self) -> float | None:
        """Area of the patch's triangles, in squared mesh units, or None without a patch."""
        return None if self.patch is None else self.patch.area

    @property
    def areas_differ(self) -> bool:
        """Whether the areas of an exact surface and of its mesh differ by more than 2 %."""
        if self.kind != "minimal" or self.solution is None or self.patch is None:
            return False
        return bool(abs(self.patch.area - self.solution.area) > _AREA_ERROR * self.solution.area)

    @property
    def _is_beside_patch(self) -> bool:
        """Whether another outcome has the patch of its bridge."""
        return self.filled and self.patch is None

    @property
    def shortcomings(self) -> tuple[str, ...]:
        """Sentences for the warning that `fill_hole` gives without a report."""
        name = f"loop {self.index} ({len(self.loop)} vertices)"
        state = "was left open" if self.kind is None else _STATES[self.kind]
        if self.kind == "minimal" and self.solution is not None and self.solution.converged:
            state = "has a coarser mesh than asked for"
        is_short = self.is_border or (self.requested and not self.converged)
        return (*([f"{name} {state}: {self.reason}"] if is_short else []), *(f"{name}: {n}" for n in self.remarks))

    @property
    def notes(self) -> tuple[str, ...]:
        """The remarks, and others on areas: that of a mesh, and those of disks over the rims of a bridge.

        The disks are solved on first use.
        """
        solution = self.solution
        if solution is None or self.patch is None or self.kind != "minimal":
            return self.remarks
        notes = self.remarks
        if self.areas_differ:
            moved = f"vertices were moved off the surface by up to {self.displacement:.3g}, because of intersections"
            curved = "between the points of the loop the boundary of the surface is not straight"
            note = (
                f"the area of the surface is {solution.area:.6g}, that of its mesh {self.patch.area:.6g}: "
                f"{moved if self.displacement else curved}"
            )
            notes = (*notes, note)
        disk_area = None if solution.annulus is None else solution.annulus.disk_area
        if disk_area is None or solution.area < disk_area:
            return notes
        note = (
            f"the bridge is a local minimum of the area only: its area is {solution.area:.6g}, that of "
            f"{'two ' if len(solution.rims) == 2 else ''}disks over its rims {disk_area:.6g}"
        )
        return (*notes, note)

    @property
    def intersections(self) -> int:
        """Number of pairs of intersecting faces, at least one of them of the patch."""
        return self.self_intersections + self.mesh_intersections + self.patch_intersections

    @property
    def intersection_free(self) -> bool:
        """Whether intersections were searched for, and none was found."""
        return self.is_searched and not self.intersections

    def to_dict(self) -> dict[str, Any]:
        """The outcome in JSON's types. Figures of a surface are None without one."""
        solution, continuation = (None, None) if self._is_beside_patch else (self.solution, self.continuation)
        residual = None if solution is None else solution.boundary_residual
        stability = solution and solution.stability
        timings = {} if solution is None else {f"solve.{name}": time for name, time in solution.timings.items()}
        return {
            "index": self.index,
            "vertices": len(self.loop),
            "perimeter": float(self.loop.perimeter),
            "requested": self.requested,
            "filled": self.filled,
            "kind": self.kind,
            "border": self.is_border,
            "joined_to": self.joined_to,
            "converged": self.converged,
            "reason": self.reason,
            "choice": self.choice,
            "residual_rms_per_edge": None if residual is None else float(residual.rms_per_edge),
            "residual_max_per_edge": None if residual is None else float(residual.max_per_edge),
            "area": self.area,
            "mesh_area": self.mesh_area,
            "stability": stability and {key: getattr(stability, key) for key in ("verdict", "eigenvalue", "index")},
            "continuation": None if continuation is None else continuation.to_dict(),
            "annulus": None if solution is None or solution.annulus is None else solution.annulus.to_dict(),
            "area_minimum": None if solution is None else bool(solution.is_area_minimum),
            **{name: getattr(self, name) for name in ("vertices_added", "faces_added", "edges_split")},
            **{name: getattr(self, name) if self.is_searched else None for name in _CROSSINGS},
            "is_searched": self.is_searched,
            "face_range": None if self.face_range is None else list(self.face_range),
            "displacement": self.displacement,
            "faces_replaced": self.faces_replaced,
            "notes": list(self.notes),
            "timings": {**self.timings, **timings},
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class FillResult(Shown):
    """A filled mesh with its report.

    Attributes:
        mesh: the filled mesh, of the same type as the input (a `MeshFile` for a path).
        original: the input as triangles.
        extension: the new vertices and faces.
        loops: one outcome for every boundary loop of the input, longest perimeter first.
        notes: sentences on changes made while reading the file, and on the mesh (that it is closed or not orientable,
            that merging vertices would close loops).
        watertight: whether every edge of the filled mesh has exactly two faces, with opposite half-edges, computed from
            the faces.
        timings: seconds by stage ("read", "loops", "fill", "stitch", "total").
    """

    mesh: Any
    original: TriangleMesh
    extension: MeshExtension
    loops: tuple[LoopOutcome, ...]
    notes: tuple[str, ...] = ()
    watertight: bool
    timings: Mapping[str, float]

    def __repr__(self) -> str:
        return f"FillResult({self.summary})"

    @property
    def summary(self) -> str:
        """The figures of the whole mesh."""
        filled, count = sum(outcome.filled for outcome in self.loops), len(self.loops)
        watertight = "watertight" if self.watertight else "not watertight"
        pairs, is_searched = (sum(getattr(o, name) for o in self.loops) for name in ("intersections", "is_searched"))
        intersections = "no intersections" if is_searched == count else "not searched for all intersections"
        if pairs:
            intersections = f"{'' if is_searched == count else 'at least '}{pairs} intersecting pairs of faces"
        added = f"{len(self.extension.faces)} faces added"
        return f"{filled} of {count} loops filled, {added}, {watertight}, {intersections}"

    @property
    def closed(self) -> bool:
        """Whether every requested loop is filled (true where none was requested)."""
        return all(outcome.filled for outcome in self.loops if outcome.requested)

    @property
    def complete(self) -> bool:
        """Whether every requested loop has `converged`."""
        return all(outcome.converged for outcome in self.loops if outcome.requested)

    @property
    def shortcomings(self) -> tuple[str, ...]:
        """The shortcomings of all loops."""
        return tuple(text for outcome in self.loops for text in outcome.shortcomings)

    @property
    def intersection_free(self) -> bool:
        """Whether no patch intersects itself, the mesh or another patch. Intersections of the input do not count.

        False if the time limit ended the search for them.
        """
        return all(outcome.intersection_free for outcome in self.loops)

    def to_dict(self) -> dict[str, Any]:
        """The report in JSON's types, without the mesh itself."""
        return {
            "closed": self.closed,
            "complete": self.complete,
            "watertight": self.watertight,
            "intersection_free": self.intersection_free,
            "vertices": len(self.original.vertices),
            "faces": len(self.original.faces),
            "vertices_added": len(self.extension.vertices),
            "faces_added": len(self.extension.faces),
            "notes": list(self.notes),
            "loops": [outcome.to_dict() for outcome in self.loops],
            "timings": dict(self.timings),
        }
