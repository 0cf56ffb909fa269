"""Several minimal disks of one loop: unstable ones are left for better ones, and others are looked for.

It knows no solver: one is handed in as a function that makes a solution from a discrete disk. It must go to the nearest
minimal disk, saddles of the area included, as Gauss-Newton on the boundary does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import combinations
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import LinearNDInterpolator

from spinor_geom.deadline import is_out_of_time, require_time
from spinor_geom.discrete.area_descent import Disk, descend_area, harmonic_extension
from spinor_geom.discrete.minimal_surface import FINE_CHANGE, first_disk
from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.domain.sizes import graded_size
from spinor_geom.domain.triangulation import PlaneTriangulation, triangulate_polygon
from spinor_geom.errors import DomainError, OutOfTimeError, SingularMatrixError, SpinorGeomError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.operators import cotangent_laplacian, face_areas
from spinor_geom.plateau.problem import PlateauProblem, start_indices
from spinor_geom.plateau.route_result import FAILURES
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.stability import AMPLITUDES, lowest_modes
from spinor_geom.plateau.steps import Steps

# Growth of the triangles inwards: finer than a first fill, whose area may have no descent where the surface's has.
_GROWTH = 0.1
# Two disks of one area and of one normal along Γ are the same (a minimal surface is determined by its normal along a
# curve): as many radians normals differ by, as RMS, where they are not. Twins over the tennis seam a = 0.76 are 0.18
# apart, one disk found twice 3e-4.
_SAME_NORMAL = 0.1
# Starts in all, and unstable disks that are left one after the other: three disks take 5, and a solver that finds
# another one each time is not followed for ever.
_MOST_STARTS = 24


# Makes a solution from a discrete disk over the rim; raises one of the failures where that leads to none.
Solve: TypeAlias = Callable[[Disk], PlateauSolution]


@dataclass(frozen=True, kw_only=True, eq=False)
class ThinnedLoop:
    """The points of a loop that stand for it in discrete disks."""

    loop: BoundaryLoop
    indices: Int[np.ndarray, " m"]  # of the points in it, ascending

    @classmethod
    def of(cls, problem: PlateauProblem) -> ThinnedLoop:
        """The loop of a disk, in the caller's coordinates."""
        return cls(loop=problem.loop, indices=start_indices(problem.unit))

    @cached_property
    def points(self) -> Float[np.ndarray, "m 3"]:
        """The points."""
        return np.asarray(self.loop.points[self.indices])

    @cached_property
    def _edges(self) -> Float[np.ndarray, " m"]:
        return np.asarray(np.linalg.norm(np.roll(self.points, -1, axis=0) - self.points, axis=1))

    @cached_property
    def round_mesh(self) -> PlaneTriangulation:
        """A mesh of the disk whose circle is as long as the rim, the rim's points on it by their distances."""
        length = self._edges.sum()
        along = np.append(0.0, np.cumsum(self._edges)[:-1]) / length
        circle = length / (2 * np.pi) * np.exp(2j * np.pi * along)
        return triangulate_polygon(circle, graded_size(circle, growth=_GROWTH))

    def round_disk(self) -> Disk:
        """The harmonic disk over a plane one: it has the symmetries of the loop, where a triangulation breaks them."""
        return _disk(_harmonic(self.round_mesh, self.points), self.round_mesh)

    def mean(self, values: Float[np.ndarray, " m"]) -> float:
        """Mean of values at the points by the length of their edges, without corners, where they may not exist."""
        smooth = ~self.loop.corners[self.indices]
        counted = smooth if smooth.any() else ~smooth
        weight = self._edges + np.roll(self._edges, 1)
        return float(np.average(values[counted], weights=weight[counted]))

    def domain_mesh(self, solution: PlateauSolution) -> PlaneTriangulation:
        """A mesh of a solution's Ω whose boundary vertices are the rim's points."""
        polygon = solution.loop_points_in_domain()[self.indices]
        return triangulate_polygon(polygon, graded_size(polygon, growth=_GROWTH))

    def positions(self, solution: PlateauSolution, mesh: PlaneTriangulation) -> Float[np.ndarray, "n 3"]:
        """A solution's positions at the vertices of a mesh of its Ω, with the rim's own at its boundary."""
        x = solution.surface.position(mesh.points)
        x[: mesh.boundary_size] = self.points
        return x

    def round_positions(self, solution: PlateauSolution) -> Float[np.ndarray, "n 3"]:
        """A solution's positions at the vertices of the round mesh: Ω is mapped harmonically to it."""
        mesh, target = self.domain_mesh(solution), self.round_mesh
        m = mesh.boundary_size
        circle = target.points[:m]
        # harmonic onto a convex domain, with a Delaunay mesh's positive weights: one to one
        plane = _harmonic(mesh, plane_coordinates(circle))
        x = self.positions(solution, mesh)
        moved = LinearNDInterpolator(plane, x)(target.points[m:].real, target.points[m:].imag)
        return np.concatenate([self.points, moved])


def leave_unstable(
    solution: PlateauSolution, lower: Callable[[PlateauSolution], PlateauSolution | None], where: str
) -> PlateauSolution:
    """The last of the disks to which an unstable one is left, one of less area after the other; its reason says so.

    `lower` finds a disk of less area than an unstable one, or none; `where` it looks is the end of a sentence.
    """
    left: list[float] = []
    if is_out_of_time():
        return replace(solution, reason=f"{solution.reason}; time was over before its stability was examined")
    while solution.stability.verdict == "unstable" and len(left) < _MOST_STARTS:
        try:
            better = lower(solution)
        except OutOfTimeError:
            better, where = None, "within the time that was allowed"
        if better is None:
            break
        left.append(solution.area)
        solution = better
    reason = solution.reason
    if left:
        reason += "; left an unstable disk of area " + ", then one of ".join(f"{area:.6g}" for area in left)
    if solution.stability.verdict == "unstable":
        reason += f"; the disk is unstable, and no better one was found {where}"
    return solution if reason == solution.reason else replace(solution, reason=reason)


def lower_beside(solution: PlateauSolution, rim: ThinnedLoop, solve: Solve, steps: Steps) -> PlateauSolution | None:
    """The first disk of less area beside an unstable one, no farther from Γ; None where no try leads to one.

    The disk is moved along an eigenvector of its second variation to the least area, the area descends from there, and
    the solver starts from the discrete disk that this leads to.
    """
    for direction in _departures(solution, rim):
        for disk in direction:
            if steps.are_spent:
                return None
            try:
                again = solve(disk)
            except FAILURES:
                continue
            if _is_lower(again, solution):
                if again.converged or again.boundary_residual.rms <= solution.boundary_residual.rms:
                    return again
                break  # from farther along the solver would only come here again
    return None


def find_disks(rim: ThinnedLoop, solve: Solve) -> tuple[PlateauSolution, ...]:
    """Minimal disks of one loop, sorted by area.

    Starts: the unfolded least-area triangulation, and the harmonic disk over a plane one. Every unstable disk is left
    to both sides along each of its eigenvectors. Where Γ bounds no degenerate disk, Σ(−1)^index = 1 over all disks;
    while the sum is larger, the averages of pairs of stable disks are starts too, because between two minima there is a
    saddle.

    Returns:
        Different disks, all converged; the nearest one alone where none converged.

    Raises:
        DomainError, FirstFillError, SingularMatrixError: no start led to a solution; that of the first one.

    Source: Dierkes, Hildebrandt & Tromba, Global Analysis of Minimal Surfaces (2010), for the sum over the indices.
    """
    search = _Search(rim=rim, solve=solve)
    search.start(lambda: first_disk(rim.points))
    search.start(rim.round_disk)
    search.leave_all()
    for pair in search.open_pairs():
        search.start(partial(search.ridge, *pair))
        search.leave_all()
    found = search.result()
    if not is_out_of_time():
        return found
    return tuple(replace(one, reason=f"{one.reason}; time was over before all starts were tried") for one in found)


@dataclass(kw_only=True, eq=False)
class _Entry:
    """A disk that was found, its normals at the rim's points, and whether it was left along its eigenvectors."""

    solution: PlateauSolution
    normals: Float[np.ndarray, "m 3"]
    left: bool = False

    @property
    def residual(self) -> float:
        return self.solution.boundary_residual.rms_per_edge

    @property
    def sign(self) -> int:
        """(−1)^index; 0 where the index is not known."""
        index = self.solution.stability.index
        return 0 if index is None else 1 - 2 * (index % 2)


@dataclass(kw_only=True, eq=False)
class _Search:
    """Different disks of one loop, and what has been tried to find them."""

    rim: ThinnedLoop
    solve: Solve
    entries: list[_Entry] = field(default_factory=list)
    poor: list[PlateauSolution] = field(default_factory=list)
    errors: list[SpinorGeomError] = field(default_factory=list)
    starts: int = 0

    def start(self, make_disk: Callable[[], Disk]) -> PlateauSolution | None:
        """The solution from a disk that is yet to be made, kept if it converged and is new; None if there is none."""
        self.starts += 1
        if self.starts > _MOST_STARTS or is_out_of_time():
            return None
        try:
            solution = self.solve(make_disk())
        except (*FAILURES, OutOfTimeError) as error:
            self.errors.append(error)
            return None
        if not solution.converged:
            self.poor.append(solution)
            return solution
        points = solution.loop_points_in_domain()[self.rim.indices]
        new = _Entry(solution=solution, normals=solution.surface.normal(points))
        known = next((entry for entry in self.entries if self._are_one(entry, new)), None)
        if known is None:
            self.entries.append(new)
        elif new.residual < known.residual:
            known.solution, known.normals = new.solution, new.normals
        return solution

    def _are_one(self, a: _Entry, b: _Entry) -> bool:
        apart = abs(a.solution.area - b.solution.area)
        turned = self.rim.mean(((a.normals - b.normals) ** 2).sum(axis=1)) ** 0.5
        return apart <= _area_error(a.solution, b.solution) and turned <= _SAME_NORMAL

    def leave_all(self) -> None:
        """Starts to both sides of every unstable disk along its eigenvectors, and of those that this finds."""
        while waiting := [e for e in self.entries if not e.left and e.solution.stability.verdict == "unstable"]:
            waiting[0].left = True
            unstable = waiting[0].solution
            for direction in _departures(unstable, self.rim):
                for disk in direction:
                    found = self.start(partial(replace, disk))
                    if found is not None and _is_lower(found, unstable):
                        break

    def ridge(self, first: _Entry, second: _Entry) -> Disk:
        """The average of two disks, nearly minimal."""
        one, other = (self.rim.round_positions(entry.solution) for entry in (first, second))
        mesh = self.rim.round_mesh
        # more steps than one would slide off the ridge
        return descend_area(
            (one + other) / 2, mesh.faces, mesh.boundary_size, relative_change=FINE_CHANGE, max_iterations=1
        )

    def open_pairs(self) -> Iterator[tuple[_Entry, _Entry]]:
        """Pairs of stable disks, nearest in area to the least first, while the list is not complete."""
        used: set[tuple[int, int]] = set()
        while sum(entry.sign for entry in self.entries) > 1:
            minima = [entry for entry in self.entries if entry.solution.stability.index == 0]
            stable = sorted(minima, key=lambda entry: entry.solution.area)
            pairs = [pair for pair in combinations(stable, 2) if (id(pair[0]), id(pair[1])) not in used]
            if not pairs or self.starts >= _MOST_STARTS:
                return
            used.add((id(pairs[0][0]), id(pairs[0][1])))
            yield pairs[0]

    def result(self) -> tuple[PlateauSolution, ...]:
        """The solutions by area."""
        different: list[_Entry] = []
        # once more, the best first: poor fits may not have been known for the same disk
        for entry in sorted(self.entries, key=lambda entry: entry.residual):
            if not any(self._are_one(entry, other) for other in different):
                different.append(entry)
        if different:
            return tuple(sorted((entry.solution for entry in different), key=lambda solution: solution.area))
        if self.poor:
            return (min(self.poor, key=lambda solution: solution.boundary_residual.rms),)
        require_time()
        raise self.errors[0]


def _departures(solution: PlateauSolution, rim: ThinnedLoop) -> Iterator[Iterator[Disk]]:
    """For each unstable eigenvector and each side discrete disks beside an unstable disk, the most promising first."""
    try:
        mesh = rim.domain_mesh(solution)
    except DomainError:  # points that slid together make no polygon: there is no mesh to move
        return
    m = mesh.boundary_size
    if len(mesh.points) == m:  # nothing that could move
        return
    x = rim.positions(solution, mesh)
    normal = solution.surface.normal(mesh.points)
    normal[:m] = 0  # it may not exist at corners
    try:
        _, modes = lowest_modes(solution.surface, mesh, solution.stability.index or 1)
    except SingularMatrixError:  # nor do triangles without area tell where to
        return
    for mode in modes.T:
        # a mode's own sign is arbitrary
        mode = mode * np.sign(mode[np.abs(mode).argmax()])
        for side in (1.0, -1.0):
            yield _beside(x, side * rim.loop.diagonal * mode[:, None] * normal, mesh)


def _beside(
    x: Float[np.ndarray, "n 3"], displacement: Float[np.ndarray, "n 3"], mesh: PlaneTriangulation
) -> Iterator[Disk]:
    """Disks that a displacement leads to: by area descent where the mesh has one, then without."""
    faces = mesh.faces
    areas = np.array([face_areas(x + a * displacement, faces).sum() for a in AMPLITUDES])
    if areas.min() < face_areas(x, faces).sum():
        start = x + AMPLITUDES[areas.argmin()] * displacement
        try:
            descent = descend_area(start, faces, mesh.boundary_size, relative_change=FINE_CHANGE)
        except SingularMatrixError:  # triangles collapsed on the way
            pass
        else:
            yield _disk(descent.vertices, mesh)
    # large ones: from beyond a new disk Newton's method goes to it, from short of it back to the old one
    for amplitude in AMPLITUDES[:3]:
        yield _disk(x + amplitude * displacement, mesh)


def _is_lower(solution: PlateauSolution, other: PlateauSolution) -> bool:
    """Whether its area is surely less."""
    return solution.area < other.area - _area_error(solution, other)


def _area_error(a: PlateauSolution, b: PlateauSolution) -> float:
    """Difference of area that two fits of one disk may have: the first variation of area is at most ∮ |δr| ds."""
    residuals = a.boundary_residual.rms + b.boundary_residual.rms
    return float(np.sqrt(np.finfo(np.float64).eps)) * max(a.area, b.area) + residuals * a.loop.perimeter


def _harmonic(mesh: PlaneTriangulation, boundary: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "n k"]:
    """Values at a plane mesh's vertices, harmonic inside."""
    return harmonic_extension(cotangent_laplacian(plane_coordinates(mesh.points), mesh.faces), boundary)


def _disk(vertices: Float[np.ndarray, "n 3"], mesh: PlaneTriangulation) -> Disk:
    area = float(face_areas(vertices, mesh.faces).sum())
    return Disk(vertices=vertices, faces=mesh.faces, areas=(area,), converged=False)
