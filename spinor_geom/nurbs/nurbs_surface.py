"""A minimal surface as B-spline patches, with its measured deviations."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Float

from spinor_geom.adapters.cad_objects import cad_object
from spinor_geom.adapters.open_cascade import Unit, plane_shell, require_cad_suffix, sewn_shell, write_shape
from spinor_geom.deadline import is_out_of_time, seconds_left, time_limit
from spinor_geom.errors import DomainError, OptionError, OutOfTimeError, require_positive
from spinor_geom.mesh.boundary_loop import diagonals
from spinor_geom.mesh.rational_splines import NurbsCurve, NurbsPatch, homogeneous, on_side
from spinor_geom.nurbs.blocks import Blocks
from spinor_geom.nurbs.corner_patches import CornerPatches
from spinor_geom.nurbs.polynomial_disk import QUADS, PolynomialDisk
from spinor_geom.nurbs.rims import Rim
from spinor_geom.nurbs.samples import Samples
from spinor_geom.nurbs.spline_space import SplineSpace
from spinor_geom.nurbs.strips import NEARER_AT_RIMS, Fit, QuadMesh, Sampler, fitted, share_sides
from spinor_geom.nurbs.trims import area_inside, splines_along
from spinor_geom.plateau.curve_tensors import normals_of
from spinor_geom.plateau.route_result import FAILURES
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.threads import one_thread
from spinor_geom.shown import shortened
from spinor_geom.surface.array_surface import ArraySurface

_OF_TOLERANCE = 0.01  # accuracy of positions, relative to the tolerance
# Share of the allowed distance that a solve is continued to, and the relative difference of areas beyond which the
# surface found is another one over the same curves.
_BELOW, _SAME_AREA = 0.5, 1e-3
_FARTHEST = 0.5  # boundary residual, per mean edge, above which no case was met whose boundary runs along Γ
_FEW_CORNERS = 4  # of a frame that one patch may cover
_AROUND, _ROUNDING = 256, 1e-12  # points of a rim for its diagonal, and tolerance of exact patches
_ROUNDINGS = 16  # of a position, that interpolation adds up: 8 were measured


@dataclass(frozen=True, kw_only=True)
class Seam:
    """A side that two patches share, given by patch and side. `reversed` if its directions on them are opposite."""

    first: tuple[int, int]
    second: tuple[int, int]
    reversed: bool


@dataclass(frozen=True, kw_only=True)
class NurbsDeviations:
    """Largest measured deviations, in mesh units and degrees.

    Attributes:
        surface: distance of a patch from the minimal surface at equal parameters, measured between the nodes of
            interpolation. Near the rims it includes the boundary residual of the solution.
        rim: distance of a rim from the given curve at equal parameters, or at the nearest ones for exact patches.
        normals: angle between the normals of two patches along a seam.
        diagonal: of the bounding box of the largest loop.
    """

    surface: float
    rim: float
    normals: float
    diagonal: float


@dataclass(frozen=True, kw_only=True, eq=False)
class NurbsSurface:
    """A minimal surface as B-spline patches for CAD. Neighbouring patches have equal curves along their common side.

    Neighbouring patches have the same control points along the side that they share, bit for bit. Within a patch the
    surface is smooth. Across seams the normals agree up to `deviations.normals`. The rims are the given curves, up to
    `deviations.rim`, even where the minimal surface is farther from them.

    Attributes:
        patches: counter-clockwise about the normal of the surface.
        seams: the sides that two patches share.
        rims: for each loop of the solution, the sides on it, given by patch and side, in the direction of the surface's
            boundary, none where `trims` are given.
        trims: of a plane surface, whose one patch is a rectangle around it: the splines of each rim, else none.
        deviations: measured.
        tolerance: given to `to_nurbs`, relative to `deviations.diagonal`.
        converged: whether the patches and the displacement of the rims are within the tolerance. That of the solution
            does not matter.
        reason: the accuracy that was reached, in one sentence.
    """

    patches: tuple[NurbsPatch, ...]
    seams: tuple[Seam, ...]
    rims: tuple[tuple[tuple[int, int], ...], ...]
    trims: tuple[tuple[NurbsCurve, ...], ...] = ()
    deviations: NurbsDeviations
    tolerance: float
    converged: bool
    reason: str

    def __repr__(self) -> str:
        size = f"{len(self.patches)} patches, {self.size} control points, {len(self.boundary_curves)} rims"
        state = "converged" if self.converged else f"not converged: {self.reason}"
        return shortened(f"NurbsSurface({size}, area {self.area:.6g}, {state})")

    @classmethod
    def of_polynomials(cls, surface: ArraySurface) -> NurbsSurface:
        """The exact patches of a surface whose p and q are polynomials of degree up to 5 on a disk.

        Positions are polynomials of degree d in z. Five rational maps of degree 2 from a square to the disk, four in a
        ring and one inside, give rational patches of degree 2d. `PlateauSolution.to_nurbs` makes them too where p and q
        of the solution are polynomials. The rim is the surface's boundary itself. The tolerance is rounding error.

        Raises:
            OptionError: p and q are not given as power series on a disk, or their degree is above 5 (CAD systems
                support patches up to degree 25).
        """
        disk = PolynomialDisk.of(surface)
        if disk is None or not disk.is_representable:
            what = "not polynomials on a disk" if disk is None else f"polynomials of degree {(disk.degree - 1) // 2}"
            raise OptionError(
                f"p and q of this surface are {what}, and exact patches need polynomials of degree up to 5 on a disk; "
                "solve_plateau(curve).to_nurbs() approximates the surface over its boundary curve"
            )
        rim = surface.position(surface.domain.boundary.point(np.arange(_AROUND) / _AROUND))
        return _exact(disk, float(diagonals(rim)), 0.0, _ROUNDING)

    @property
    def size(self) -> int:
        """Number of control points of all patches."""
        return sum(patch.control_points.shape[0] * patch.control_points.shape[1] for patch in self.patches)

    @cached_property
    def area(self) -> float:
        """Area of the patches, or of the part of a plane inside `trims`, in squared mesh units."""
        if self.trims:
            return area_inside(self.trims, self._plane_normal)
        return sum(patch.area for patch in self.patches)

    @property
    def _plane_normal(self) -> Float[np.ndarray, "3"]:
        normal = self.patches[0].normals_on(0, np.zeros(1))[0]
        return np.asarray(normal / np.linalg.norm(normal))

    @property
    def boundary_curves(self) -> tuple[tuple[NurbsCurve, ...], ...]:
        """The curves of each rim, in order and in the direction of the surface's boundary."""
        if self.trims:
            return self.trims
        sides = (((self.patches[patch].side(side), side) for patch, side in rim) for rim in self.rims)
        return tuple(tuple(curve if side < 2 else curve.reversed() for curve, side in rim) for rim in sides)

    def shell(self, *, unit: Unit = "mm") -> Any:
        """The patches as a sewn shell of Open CASCADE, a `TopoDS_Shape` in millimetres. Raises as `sewn_shell`.

        A plane surface is one plane face, bounded by `trims`.

        Args:
            unit: of the curve's coordinates: "mm", "cm", "m" or "in".
        """
        if self.trims:
            return plane_shell(self.trims, self._plane_normal, unit=unit)
        return sewn_shell(self.patches, unit=unit)

    def to_build123d(self, *, unit: Unit = "mm") -> Any:
        """The patches as a `build123d.Shell`. Arguments and errors as for `shell`."""
        return cad_object(self.shell(unit=unit), "build123d")

    def to_cadquery(self, *, unit: Unit = "mm") -> Any:
        """The patches as a `cadquery.Shell`. Arguments and errors as for `shell`."""
        return cad_object(self.shell(unit=unit), "cadquery")

    def save(self, path: str | os.PathLike[str], *, unit: Unit = "mm", name: str = "minimal surface") -> None:
        """Writes the sewn shell to a STEP, IGES or BREP file, in millimetres, completely or not at all.

        Args:
            path: ends with .step, .stp, .igs, .iges or .brep.
            unit: of the curve's coordinates: "mm", "cm", "m" or "in".
            name: of the part in a STEP file.

        Raises:
            CadFileError: an unknown suffix, or the surface is too small for CAD.
            OptionError: an unknown unit.
            OSError: the file cannot be written.
            MissingPackageError: OCP is not installed.
        """
        require_cad_suffix(path)
        write_shape(self.shell(unit=unit), path, name=name)


def nurbs_surface(solution: PlateauSolution, tolerance: float) -> NurbsSurface:
    """See `PlateauSolution.to_nurbs`."""
    require_positive("tolerance", tolerance)
    diagonal = solution.diagonal
    if solution.route == "plane":
        return _plane(solution, tolerance, diagonal)
    far = max(float(np.abs(rim.loop.points).max()) for rim in solution.rims)
    rounding = _ROUNDINGS * float(np.finfo(np.float64).eps) * far
    may_continue = solution.solved_to is not None
    if rounding < tolerance * diagonal:
        solution = _within(solution, tolerance * diagonal)
    disk, missed = PolynomialDisk.of(solution.array_surface), solution.boundary_residual.max
    with one_thread():
        if disk is not None and disk.is_representable and missed <= tolerance * diagonal / NEARER_AT_RIMS:
            return _exact(disk, diagonal, missed, tolerance)
        rims = Rim.all_of(solution)
        mesh, fit, sample = _fitted(solution, rims, tolerance, rounding)
        patches = tuple(
            NurbsPatch(control_points=net, weights=np.ones(net.shape[:2]), knots=(u.knots, v.knots))
            for net, (u, v) in zip(fit.nets, fit.spaces, strict=True)
        )
        seams = _seams(mesh)
        surface, rim, moved = _distances(patches, mesh, fit, sample)
        normals = largest_angle(patches, seams, [(u.between, v.between) for u, v in fit.spaces])
    deviations = NurbsDeviations(surface=surface, rim=rim, normals=normals, diagonal=diagonal)
    reached = f"{fit.error / diagonal:.1e} of the diagonal with {fit.points} control points"
    within = fit.error <= tolerance * diagonal
    reason = f"interpolation error {reached}"
    is_met = moved <= tolerance * diagonal
    if not within and NEARER_AT_RIMS * rounding > tolerance * diagonal / 2:
        reason = (
            f"{reason}, above the tolerance {tolerance:.1e}: coordinates of {far:.2g} are rounded; "
            "move the curve to the origin"
        )
    elif not is_met:
        reason = (
            f"{reason}, but the rims are moved by the boundary residual of the solution, {moved / diagonal:.1e} of the "
            f"diagonal, above the tolerance {tolerance:.1e}: "
            + ("no solve in the given time was near enough" if may_continue else "solve with a smaller tolerance")
        )
    elif not within:
        reason = f"{reason}, above the tolerance {tolerance:.1e}: more control points were not tried"
    return NurbsSurface(
        patches=patches,
        seams=seams,
        rims=mesh.rims,
        deviations=deviations,
        tolerance=tolerance,
        converged=within and is_met,
        reason=reason,
    )


def _plane(solution: PlateauSolution, tolerance: float, diagonal: float) -> NurbsSurface:
    """A rectangle around a plane surface, and splines along its rims."""
    allowed = tolerance * diagonal / (2 * NEARER_AT_RIMS)
    trims, errors = zip(*(splines_along(rim.curve, allowed) for rim in solution.rims), strict=True)
    points = np.concatenate([curve.control_points for rim in trims for curve in rim])
    (normal,) = solution.array_surface.normal(np.array([solution.array_surface.root]))
    axes = np.array(normals_of(normal))
    along = (points - points[0]) @ axes.T
    (x, y), (far_x, far_y) = along.min(axis=0), along.max(axis=0)
    corners = points[0] + np.array([[[x, y], [x, far_y]], [[far_x, y], [far_x, far_y]]]) @ axes
    knots = SplineSpace.on(1, (0.0, 1.0)).knots
    patch = NurbsPatch(control_points=corners, weights=np.ones((2, 2)), knots=(knots, knots))
    error = float(max(errors))
    deviations = NurbsDeviations(surface=solution.boundary_residual.max, rim=error, normals=0.0, diagonal=diagonal)
    return NurbsSurface(
        patches=(patch,),
        seams=(),
        rims=(),
        trims=trims,
        deviations=deviations,
        tolerance=tolerance,
        converged=solution.converged and bool(error <= tolerance * diagonal),
        reason=f"plane, with rims within {error / diagonal:.1e} of the diagonal; tolerance {tolerance:.1e}",
    )


def _within(solution: PlateauSolution, allowed: float) -> PlateauSolution:
    """The solution, solved again if its boundary is farther from the curves than allowed, in mesh units.

    The nearest one is kept, unless it is another surface over the same curves. The largest distance may grow first
    where the residual decreases. A solve that missed its own tolerance is not followed by another one.
    """
    solve, residual, missed = solution.solved_to, solution.boundary_residual.rms_per_edge, _missed(solution)
    while solve is not None and missed > allowed and not is_out_of_time():
        tolerance = residual * _BELOW * allowed / missed
        try:
            with time_limit(seconds_left() / 2):  # the rest is for the patches
                again = solve(tolerance)
        except (*FAILURES, OutOfTimeError):
            break
        if isinstance(again, NoConnectedSurface) or abs(again.area - solution.area) > _SAME_AREA * solution.area:
            break
        before, residual, distance = residual, again.boundary_residual.rms_per_edge, _missed(again)
        is_nearer = distance < missed
        if is_nearer:
            solution, missed = again, distance
        if not again.converged or not (is_nearer or residual < before):
            break
    return solution


def _missed(solution: PlateauSolution) -> float:
    """The largest distance of the surface from its curves and, at their corners, of corners from corners."""
    return max(solution.boundary_residual.max, *(rim.largest_at_corners for rim in Rim.all_of(solution)))


def _fitted(
    solution: PlateauSolution, rims: tuple[Rim, ...], tolerance: float, rounding: float
) -> tuple[QuadMesh, Fit, Sampler]:
    """One patch over a curve with up to 4 corners, or a few where it would be folded. Otherwise rings along the rims.

    Patches between corners that are not near enough are kept at the time limit, and where rings are not nearer or
    cannot be made. Where rings cannot be made over more corners, patches between these are.
    """
    failed: DomainError | None = None
    if len(rims[0].corners) > _FEW_CORNERS:
        try:
            return _patches(solution, rims, tolerance, rounding)
        except DomainError as error:
            failed = error
    few = CornerPatches.of(solution.domain, rims)
    if few is None:
        if failed is not None:
            raise failed
        return _patches(solution, rims, tolerance, rounding)
    allowed = tolerance * solution.diagonal
    begin = perf_counter()
    fit = fitted(few.mesh, few.on, allowed, rounding)
    spent = perf_counter() - begin
    for quad, side in np.argwhere(few.collapsed).tolist():
        row = fit.nets[quad][on_side(side)]
        row[:] = row[0]
    if failed is None and fit.error > allowed and seconds_left() > 2 * spent:  # several patches take longer than one
        with suppress(DomainError):  # a part of Ω is too narrow, as at a sharp angle
            several = _patches(solution, rims, tolerance, rounding)
            if several[1].error < fit.error:
                return several
    return few.mesh, fit, few.on


def _patches(
    solution: PlateauSolution, rims: tuple[Rim, ...], tolerance: float, rounding: float
) -> tuple[QuadMesh, Fit, Sampler]:
    """Rings of patches along the rims, and patches inside the rings."""
    missed = solution.boundary_residual.rms_per_edge
    if missed > _FARTHEST:
        raise DomainError(
            f"the boundary of the surface is {missed:.2g} mean edges from its curve (root mean square), too far to be "
            "moved onto it by patches: smooth the curve, or give more of its points, and solve again"
        )
    blocks = Blocks.of(solution.domain, rims)
    samples = Samples(surface=solution.array_surface, rims=rims, blocks=blocks, accuracy=_OF_TOLERANCE * tolerance)
    mesh = QuadMesh(quads=blocks.quads, rims=_rims(blocks.sizes))
    return mesh, fitted(mesh, samples.on, tolerance * solution.diagonal, rounding), samples.on


def _rims(sizes: Sequence[int]) -> tuple[tuple[tuple[int, int], ...], ...]:
    """Side 0 of the patches along each boundary. These patches come first."""
    ends = np.cumsum(sizes).tolist()
    return tuple(tuple((patch, 0) for patch in range(end - size, end)) for size, end in zip(sizes, ends, strict=True))


def _exact(disk: PolynomialDisk, diagonal: float, missed: float, tolerance: float) -> NurbsSurface:
    """The exact patches of a disk whose boundary is at most `missed` from the given curve."""
    mesh = QuadMesh(quads=QUADS, rims=_rims((4,)))
    patches, error = disk.patches()
    nets = [homogeneous(patch.control_points, patch.weights) for patch in patches]
    share_sides(mesh, nets)
    patches = [
        replace(patch, control_points=net[..., :3] / net[..., 3:], weights=net[..., 3])
        for patch, net in zip(patches, nets, strict=True)
    ]
    seams, at = _seams(mesh), np.linspace(0, 1, 2 * disk.degree + 1)
    normals = largest_angle(patches, seams, [(at, at)] * len(patches))
    return NurbsSurface(
        patches=tuple(patches),
        seams=seams,
        rims=mesh.rims,
        deviations=NurbsDeviations(surface=error, rim=missed + error, normals=normals, diagonal=diagonal),
        tolerance=tolerance,
        converged=True,
        reason=f"exact: p and q are polynomials, positions have degree {disk.degree} in z",
    )


def _seams(mesh: QuadMesh) -> tuple[Seam, ...]:
    """The shared sides of a mesh."""
    first: dict[int, tuple[int, int]] = {}
    found = []
    for quad, row in enumerate(mesh.edges.tolist()):
        for side, edge in enumerate(row):
            other = first.setdefault(edge, (quad, side))
            if other != (quad, side):
                found.append(
                    Seam(first=other, second=(quad, side), reversed=bool(mesh.ahead[other] != mesh.ahead[quad, side]))
                )
    return tuple(found)


def _distances(patches: Sequence[NurbsPatch], mesh: QuadMesh, fit: Fit, sample: Sampler) -> tuple[float, float, float]:
    """Largest distances of patches from the surface, of rims from Γ, and of the surface's rims from Γ.

    They are measured at equal parameters, halfway between the nodes, and on the sides.
    """
    grids = [
        (quad, np.concatenate([[0], u.between, [1]]), np.concatenate([[0], v.between, [1]]), v.breaks)
        for quad, (u, v) in enumerate(fit.spaces)
    ]
    values = sample(grids)
    own = [patch.grid(u, v) for patch, (_, u, v, _) in zip(patches, grids, strict=True)]
    surface = max(np.linalg.norm(found - exact, axis=2).max() for found, (exact, _) in zip(own, values, strict=True))
    rim, residual = [], []
    for quad, side in (side for sides in mesh.rims for side in sides):
        exact, moved = (each[on_side(side)] for each in values[quad])
        rim.append(np.linalg.norm(own[quad][on_side(side)] - moved, axis=1).max())
        residual.append(np.linalg.norm(exact - moved, axis=1).max())
    return float(surface), float(max(rim)), float(max(residual))


def largest_angle(
    patches: Sequence[NurbsPatch],
    seams: Sequence[Seam],
    parameters: Sequence[tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]],
) -> float:
    """The largest angle between normals on both sides of a seam, in degrees, or 0 without seams.

    For each patch `parameters` are those of the points on its sides, along u and along v.
    """
    largest = 0.0
    for seam in seams:
        (patch, side), (other, its_side) = seam.first, seam.second
        at = parameters[patch][side % 2]
        one = patches[patch].normals_on(side, at)
        two = patches[other].normals_on(its_side, 1 - at if seam.reversed else at)
        sine, cosine = np.linalg.norm(np.cross(one, two), axis=1), (one * two).sum(axis=1)
        largest = max(largest, float(np.degrees(np.arctan2(sine, cosine)).max()))
    return largest
