"""The search for several minimal disks of one loop, and for disks of less area near unstable ones.

The solver is an argument: a function from a discrete disk to a solution. It must converge to the nearest minimal disk,
stable or not, as Gauss-Newton on the boundary does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import combinations
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import LinearNDInterpolator

from spinor_geom.arrays import EPS
from spinor_geom.deadline import is_out_of_time, require_time
from spinor_geom.discrete.area_descent import Disk, descend_area, harmonic_extension
from spinor_geom.discrete.minimal_surface import FINE_CHANGE, FINE_GROWTH, first_disk
from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.domain.sizes import SizeField
from spinor_geom.domain.triangulation import PlaneTriangulation, triangulate_polygon
from spinor_geom.errors import DomainError, OutOfTimeError, SingularMatrixError, SpinorGeomError
from spinor_geom.mesh.boundary_loop import BoundaryLoop, turning_angles
from spinor_geom.mesh.operators import cotangent_laplacian, face_areas
from spinor_geom.plateau.problem import PlateauProblem, start_indices
from spinor_geom.plateau.route_result import FAILURES
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.stability import AMPLITUDES, EQUAL_NORMALS, lowest_modes
from spinor_geom.plateau.steps import Steps

# A solver: the solution from a discrete disk over the loop. It raises one of `FAILURES` if there is none.
Solve: TypeAlias = Callable[[Disk], PlateauSolution]


@dataclass(frozen=True, kw_only=True, eq=False)
class ThinnedLoop:
    """A loop and the subset of its points that bounds discrete disks."""

    loop: BoundaryLoop
    indices: Int[np.ndarray, " m"]  # ascending

    @classmethod
    def of(cls, problem: PlateauProblem) -> ThinnedLoop:
        """The loop of a disk, in the caller's coordinates."""
        return cls(loop=problem.loop, indices=start_indices(problem.unit))

    @cached_property
    def points(self) -> Float[np.ndarray, "m 3"]:
        """Positions of the points."""
        return np.asarray(self.loop.points[self.indices])

    @cached_property
    def _edges(self) -> Float[np.ndarray, " m"]:
        return np.asarray(np.linalg.norm(np.roll(self.points, -1, axis=0) - self.points, axis=1))

    @cached_property
    def round_mesh(self) -> PlaneTriangulation:
        """A mesh of the round disk with the loop's perimeter. Boundary vertices are placed by arc length."""
        length = self._edges.sum()
        along = np.append(0.0, np.cumsum(self._edges)[:-1]) / length
        circle = length / (2 * np.pi) * np.exp(2j * np.pi * along)
        return triangulate_polygon(circle, SizeField(growth=FINE_GROWTH))

    def round_disk(self) -> Disk:
        """The harmonic disk over the round mesh, which has the symmetries of the loop."""
        return _disk(_harmonic(self.round_mesh, self.points), self.round_mesh)

    def mean(self, values: Float[np.ndarray, " m"]) -> float:
        """Mean of values at the points, weighted by arc length, without corners, where normals may not exist."""
        smooth = ~self.loop.corners[self.indices]
        counted = smooth if smooth.any() else ~smooth
        weight = self._edges + np.roll(self._edges, 1)
        return float(np.average(values[counted], weights=weight[counted]))

    def domain_mesh(self, solution: PlateauSolution) -> PlaneTriangulation:
        """A mesh of a solution's Ω whose boundary vertices are the rim's points."""
        polygon = solution.loop_points_in_domain()[self.indices]
        return triangulate_polygon(polygon, SizeField(growth=FINE_GROWTH))

    def positions(self, solution: PlateauSolution, mesh: PlaneTriangulation) -> Float[np.ndarray, "n 3"]:
        """A solution's positions at the vertices of a mesh of its Ω, with those of the rim at the boundary."""
        x = solution.array_surface.position(mesh.points)
        x[: mesh.boundary_size] = self.points
        return x

    def round_positions(self, solution: PlateauSolution) -> Float[np.ndarray, "n 3"]:
        """A solution's positions at the vertices of the round mesh: Ω is mapped harmonically to it."""
        mesh, target = self.domain_mesh(solution), self.round_mesh
        m = mesh.boundary_size
        circle = target.points[:m]
        # injective: harmonic onto a convex domain, with positive weights
        plane = _harmonic(mesh, plane_coordinates(circle))
        x = self.positions(solution, mesh)
        moved = LinearNDInterpolator(plane, x)(target.points[m:].real, target.points[m:].imag)
        return np.concatenate([self.points, moved])


def replace_unstable(
    solution: PlateauSolution, lower: Callable[[PlateauSolution], PlateauSolution | None], where: str
) -> PlateauSolution:
    """Replaces an unstable surface by surfaces of less area until one is stable. `reason` reports them.

    `lower` returns a surface of less area than an unstable one, or None. `where` describes its search, as the end of a
    sentence.
    """
    replaced: list[float] = []  # areas
    end = ""
    try:
        require_time()
        while solution.stability.verdict == "unstable":
            better = None
            try:
                better = lower(solution)
            except OutOfTimeError:
                where = "within the time limit"
            if better is None:
                end = f"; the surface is unstable, and no better one was found {where}"
                break
            replaced.append(solution.area)
            solution = better
    except OutOfTimeError:
        end = "; the time limit was reached before its stability was computed"
    reason = solution.reason
    if replaced:
        times = ", then one of ".join(f"{area / solution.area:.6g}" for area in replaced)
        reason += f"; replaces an unstable surface of {times} times the area"
    return replace(solution, reason=reason + end) if replaced or end else solution


def lower_beside(solution: PlateauSolution, rim: ThinnedLoop, solve: Solve, steps: Steps) -> PlateauSolution | None:
    """A disk of less area than an unstable one that is no farther from Γ, or None if no start leads to one.

    The unstable disk is displaced along an eigenvector of its second variation to the least area. Area descent from
    there gives the discrete disk from which the solver starts.
    """
    for direction in _displaced(solution, rim):
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
                break  # larger displacements lead to the same disk
    return None


def on_side_of_normal(solution: PlateauSolution, rim: ThinnedLoop, solve: Solve) -> PlateauSolution:
    """Of a stable disk and its counterpart on the other side of the harmonic disk, the one the normal points to.

    Which of the two a solve finds changes with any move of the points, the side does not. A boundary of total curvature
    of at most 4π bounds one disk only. Otherwise the counterpart is solved if the area has a maximum on the way there.
    The disk is returned as it is if it is not stable, or where time is out.

    Source: Nitsche, "A new uniqueness theorem for minimal surfaces", Arch. Rational Mech. Anal. 52 (1973).
    """
    with suppress(*FAILURES, OutOfTimeError):
        if turning_angles(rim.loop.points).sum() <= 4 * np.pi or solution.stability.verdict != "stable":
            return solution
        mesh, one, middle = rim.round_mesh, rim.round_positions(solution), rim.round_disk().vertices
        other = 2 * middle - one
        a, b, c = np.moveaxis(one[mesh.faces], 1, 0)
        ahead = (np.cross(b - a, c - a) * (middle - one)[mesh.faces].sum(axis=1)).sum() > 0
        areas = [face_areas(x, mesh.faces).sum() for x in (one, middle, other)]
        # over twice the way a parabola rises by four times as much, and less than twice with a maximum in the middle
        if ahead and 3 * areas[1] > 2 * areas[0] + areas[2]:
            descent = descend_area(other, mesh.faces, mesh.boundary_size, relative_change=FINE_CHANGE)
            found = solve(_disk(descent.vertices, mesh))
            if found.converged and found.stability.verdict == "stable":
                return found
    return solution


def find_disks(rim: ThinnedLoop, solve: Solve) -> tuple[PlateauSolution, ...]:
    """Minimal disks of one loop, sorted by area.

    Starts are a first discrete disk, the harmonic disk over a round one, and displacements of every unstable disk in
    both directions of its eigenvectors. If Γ bounds no degenerate disk, Σ(−1)^index = 1 over all disks. While the sum
    is larger, averages of pairs of stable disks are starts too, because there is a saddle between two minima.

    Returns:
        Different disks, all converged, or only the one nearest to Γ if none converged.

    Raises:
        DomainError, FirstFillError, SingularMatrixError: no start gave a solution. It is the error of the first start.

    Source: Dierkes, Hildebrandt & Tromba, Global Analysis of Minimal Surfaces (2010), for the sum over the indices.
    """
    search = _Search(rim=rim, solve=solve)
    with suppress(OutOfTimeError):  # the stability of a disk was not computed in time
        search.start(lambda: first_disk(rim.points))
        search.start(rim.round_disk)
        search.start_from_unstable()
        for pair in search.open_pairs():
            search.start(partial(search.ridge, *pair))
            search.start_from_unstable()
    found = search.result()
    if not is_out_of_time():
        return found
    return tuple(
        replace(one, reason=f"{one.reason}; the time limit was reached before all starts were tried") for one in found
    )


@dataclass(kw_only=True, eq=False)
class _Entry:
    """A disk, its normals at the rim's points, and whether starts from its unstable directions were tried."""

    solution: PlateauSolution
    normals: Float[np.ndarray, "m 3"]
    searched: bool = False

    @property
    def residual(self) -> float:
        return self.solution.boundary_residual.rms_per_edge

    @property
    def sign(self) -> int:
        """(−1)^index, or 0 if the index is not known."""
        index = self.solution.stability.index
        return 0 if index is None else 1 - 2 * (index % 2)


@dataclass(kw_only=True, eq=False)
class _Search:
    """The different disks found so far, and the failed starts."""

    rim: ThinnedLoop
    solve: Solve
    entries: list[_Entry] = field(default_factory=list)
    poor: list[PlateauSolution] = field(default_factory=list)
    errors: list[SpinorGeomError] = field(default_factory=list)

    def start(self, make_disk: Callable[[], Disk]) -> PlateauSolution | None:
        """Solves from a start and keeps a new converged solution, or None if there is no solution."""
        if is_out_of_time():
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
        new = _Entry(solution=solution, normals=solution.array_surface.normal(points))
        known = next((entry for entry in self.entries if self._are_one(entry, new)), None)
        if known is None:
            self.entries.append(new)
        elif new.residual < known.residual:
            known.solution, known.normals = new.solution, new.normals
        return solution

    def _are_one(self, a: _Entry, b: _Entry) -> bool:
        # a minimal surface is determined by its normal along a curve
        apart = abs(a.solution.area - b.solution.area)
        turned = self.rim.mean(((a.normals - b.normals) ** 2).sum(axis=1)) ** 0.5
        return apart <= _area_error(a.solution, b.solution) and turned <= EQUAL_NORMALS

    def start_from_unstable(self) -> None:
        """Starts from displacements of every unstable disk, including those that this search finds."""
        while waiting := [e for e in self.entries if not e.searched and e.solution.stability.verdict == "unstable"]:
            waiting[0].searched = True
            unstable = waiting[0].solution
            for direction in _displaced(unstable, self.rim):
                for disk in direction:
                    found = self.start(partial(replace, disk))
                    if found is not None and _is_lower(found, unstable):
                        break

    def ridge(self, first: _Entry, second: _Entry) -> Disk:
        """The average of two disks after one step of area descent. More steps would lead to one of the minima."""
        one, other = (self.rim.round_positions(entry.solution) for entry in (first, second))
        mesh = self.rim.round_mesh
        return descend_area(
            (one + other) / 2, mesh.faces, mesh.boundary_size, relative_change=FINE_CHANGE, max_iterations=1
        )

    def open_pairs(self) -> Iterator[tuple[_Entry, _Entry]]:
        """Pairs of stable disks, those of least area first, while Σ(−1)^index > 1."""
        used: set[tuple[int, int]] = set()
        while sum(entry.sign for entry in self.entries) > 1:
            minima = [entry for entry in self.entries if entry.solution.stability.index == 0]
            stable = sorted(minima, key=lambda entry: entry.solution.area)
            pairs = [pair for pair in combinations(stable, 2) if (id(pair[0]), id(pair[1])) not in used]
            if not pairs:
                return
            used.add((id(pairs[0][0]), id(pairs[0][1])))
            yield pairs[0]

    def result(self) -> tuple[PlateauSolution, ...]:
        """The solutions by area."""
        different: list[_Entry] = []
        # compared again, smallest residual first, because poor fits of one disk may count as different disks
        for entry in sorted(self.entries, key=lambda entry: entry.residual):
            if not any(self._are_one(entry, other) for other in different):
                different.append(entry)
        if different:
            return tuple(sorted((entry.solution for entry in different), key=lambda solution: solution.area))
        if self.poor:
            return (min(self.poor, key=lambda solution: solution.boundary_residual.rms),)
        require_time()
        raise self.errors[0]


def _displaced(solution: PlateauSolution, rim: ThinnedLoop) -> Iterator[Iterator[Disk]]:
    """Disks displaced from an unstable one, for each unstable eigenvector and direction, the best ones first."""
    try:
        mesh = rim.domain_mesh(solution)
    except DomainError:  # points of the boundary coincide
        return
    m = mesh.boundary_size
    if len(mesh.points) == m:  # no inner vertices
        return
    x = rim.positions(solution, mesh)
    normal = solution.array_surface.normal(mesh.points)
    normal[:m] = 0
    try:
        _, modes = lowest_modes(solution.array_surface, mesh, solution.stability.index or 1)
    except SingularMatrixError:  # triangles without area
        return
    for mode in modes.T:
        # the sign of an eigenvector is arbitrary
        mode = mode * np.sign(mode[np.abs(mode).argmax()])
        for side in (1.0, -1.0):
            yield _beside(x, side * rim.loop.diagonal * mode[:, None] * normal, mesh)


def _beside(
    x: Float[np.ndarray, "n 3"], displacement: Float[np.ndarray, "n 3"], mesh: PlaneTriangulation
) -> Iterator[Disk]:
    """Disks along a displacement: after area descent if the area decreases, then without."""
    faces = mesh.faces
    areas = np.array([face_areas(x + a * displacement, faces).sum() for a in AMPLITUDES])
    if areas.min() < face_areas(x, faces).sum():
        start = x + AMPLITUDES[areas.argmin()] * displacement
        try:
            descent = descend_area(start, faces, mesh.boundary_size, relative_change=FINE_CHANGE)
        except SingularMatrixError:  # triangles collapsed
            pass
        else:
            yield _disk(descent.vertices, mesh)
    # large amplitudes, because from small ones Newton's method returns to the old disk
    for amplitude in AMPLITUDES[:3]:
        yield _disk(x + amplitude * displacement, mesh)


def _is_lower(solution: PlateauSolution, other: PlateauSolution) -> bool:
    """Whether the area of a solution is less than that of another by more than the error."""
    return solution.area < other.area - _area_error(solution, other)


def _area_error(a: PlateauSolution, b: PlateauSolution) -> float:
    """Largest difference of the areas of two fits of one disk: the first variation is at most ∮ |δr| ds."""
    residuals = a.boundary_residual.rms + b.boundary_residual.rms
    return float(np.sqrt(EPS)) * max(a.area, b.area) + residuals * a.loop.perimeter


def _harmonic(mesh: PlaneTriangulation, boundary: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "n k"]:
    """Values at a plane mesh's vertices, harmonic inside."""
    return harmonic_extension(cotangent_laplacian(plane_coordinates(mesh.points), mesh.faces), boundary)


def _disk(vertices: Float[np.ndarray, "n 3"], mesh: PlaneTriangulation) -> Disk:
    area = float(face_areas(vertices, mesh.faces).sum())
    return Disk(vertices=vertices, faces=mesh.faces, areas=(area,), converged=False)
