"""A minimal surface as B-spline patches, with its measured deviations."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline

from spinor_geom.adapters.cad_objects import cad_object
from spinor_geom.adapters.open_cascade import Unit, require_cad_suffix, sewn_shell, write_shape
from spinor_geom.domain.quadrature import rule
from spinor_geom.errors import require_positive
from spinor_geom.nurbs.blocks import Blocks
from spinor_geom.nurbs.rims import Rim
from spinor_geom.nurbs.samples import Samples
from spinor_geom.nurbs.spline_space import SplineSpace
from spinor_geom.nurbs.strips import Fit, QuadMesh, fitted
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.threads import one_thread
from spinor_geom.shown import shortened


@dataclass(frozen=True, kw_only=True, eq=False)
class NurbsCurve:
    """A B-spline curve on [0, 1].

    Attributes:
        control_points: in mesh units.
        degree: of the polynomials.
        knots: from 0 to 1, each repeated as often as it counts.
    """

    control_points: Float[np.ndarray, "n 3"]
    degree: int
    knots: Float[np.ndarray, " k"]

    def __repr__(self) -> str:
        return f"NurbsCurve({len(self.control_points)} control points, degree {self.degree})"

    def point(self, u: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3"]:
        """Points of the curve."""
        return np.asarray(BSpline(self.knots, self.control_points, self.degree)(u))


@dataclass(frozen=True, kw_only=True, eq=False)
class NurbsPatch:
    """A B-spline surface on the unit square; all weights are 1.

    The normal of the minimal surface is that of the directions of u and v, in this order. Side 0 lies at v = 0, side 1
    at u = 1, side 2 at v = 1, side 3 at u = 0; a side is directed as the other parameter.

    Attributes:
        control_points: in mesh units, in rows of equal u.
        degrees: in u and in v.
        knots: of u and of v, from 0 to 1, each repeated as often as it counts.
    """

    control_points: Float[np.ndarray, "n m 3"]
    degrees: tuple[int, int]
    knots: tuple[Float[np.ndarray, " k"], Float[np.ndarray, " l"]]

    def __repr__(self) -> str:
        n, m, _ = self.control_points.shape
        return f"NurbsPatch({n} × {m} control points, degrees {self.degrees})"

    def grid(
        self, u: Float[np.ndarray, " a"], v: Float[np.ndarray, " b"], *, derivatives: tuple[int, int] = (0, 0)
    ) -> Float[np.ndarray, "a b 3"]:
        """Points, or partial derivatives of given orders, at all pairs of parameters."""
        by_u, by_v = (
            BSpline(knots, np.eye(len(knots) - degree - 1), degree)(at, nu=order)
            for knots, degree, at, order in zip(self.knots, self.degrees, (u, v), derivatives, strict=True)
        )
        return np.asarray(np.tensordot(by_u, by_v @ self.control_points, axes=1))

    def side(self, number: int) -> NurbsCurve:
        """One of the four sides as a curve."""
        points = self.control_points
        row = (points[:, 0], points[-1], points[:, -1], points[0])[number]
        axis = number % 2
        return NurbsCurve(control_points=row, degree=self.degrees[axis], knots=self.knots[axis])

    def normals_on(self, number: int, at: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Normals of the patch at points of a side, not of unit length."""
        end = np.array([0.0 if number in (0, 3) else 1.0])
        u, v = (at, end) if number % 2 == 0 else (end, at)
        along, across = (self.grid(u, v, derivatives=orders).reshape(-1, 3) for orders in ((1, 0), (0, 1)))
        return np.cross(along, across)

    @property
    def area(self) -> float:
        """Area by Gauss-Legendre quadrature, in squared mesh units."""
        (u, by_u), (v, by_v) = (_nodes(*each) for each in zip(self.knots, self.degrees, strict=True))
        along, across = (self.grid(u, v, derivatives=orders) for orders in ((1, 0), (0, 1)))
        return float(by_u @ np.linalg.norm(np.cross(along, across), axis=2) @ by_v)


def _nodes(knots: Float[np.ndarray, " k"], degree: int) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Nodes and weights of integrals over all pieces."""
    gauss, ends = rule("gauss", degree + 3), np.unique(knots)
    width = np.diff(ends)[:, None]
    return (ends[:-1, None] + width * gauss.nodes).ravel(), (width * gauss.weights).ravel()


@dataclass(frozen=True, kw_only=True)
class Seam:
    """A side that two patches share, given by patch and side; `reversed` if they have opposite directions."""

    first: tuple[int, int]
    second: tuple[int, int]
    reversed: bool


@dataclass(frozen=True, kw_only=True)
class NurbsDeviations:
    """Largest measured deviations, in mesh units and degrees.

    Attributes:
        surface: distance of a patch from the minimal surface at equal parameters, between the nodes of interpolation;
            near the rims it includes the boundary residual of the solution.
        rim: distance of a rim from the given curve at equal parameters.
        normals: angle between the normals of two patches along a seam.
        diagonal: of the bounding box of the largest loop.
    """

    surface: float
    rim: float
    normals: float
    diagonal: float


@dataclass(frozen=True, kw_only=True, eq=False)
class NurbsSurface:
    """A minimal surface as B-spline patches that meet in equal curves, for CAD.

    Neighbouring patches have the same control points along the side that they share, bit for bit. Within a patch the
    surface is smooth; across seams the normals agree up to `deviations.normals`. The rims are the given curves, up to
    `deviations.rim`, also where the minimal surface misses them by its boundary residual.

    Attributes:
        patches: counter-clockwise about the normal of the surface.
        seams: the sides that two patches share.
        rims: for each loop of the solution, the sides on it, given by patch and side, in the direction of the surface's
            boundary.
        deviations: measured.
        tolerance: of the call.
        converged: whether the patches are within the tolerance and the solution has converged.
        reason: one sentence: what was reached.
    """

    patches: tuple[NurbsPatch, ...]
    seams: tuple[Seam, ...]
    rims: tuple[tuple[tuple[int, int], ...], ...]
    deviations: NurbsDeviations
    tolerance: float
    converged: bool
    reason: str

    def __repr__(self) -> str:
        size = f"{len(self.patches)} patches, {self.size} control points, {len(self.rims)} rims"
        state = "converged" if self.converged else f"not converged: {self.reason}"
        return shortened(f"NurbsSurface({size}, area {self.area:.6g}, {state})")

    @property
    def size(self) -> int:
        """Number of control points of all patches."""
        return sum(patch.control_points.shape[0] * patch.control_points.shape[1] for patch in self.patches)

    @cached_property
    def area(self) -> float:
        """Area of the patches, in squared mesh units."""
        return sum(patch.area for patch in self.patches)

    @property
    def boundary_curves(self) -> tuple[tuple[NurbsCurve, ...], ...]:
        """The curves of each rim, in order."""
        return tuple(tuple(self.patches[patch].side(side) for patch, side in rim) for rim in self.rims)

    def shell(self, *, unit: Unit = "mm") -> Any:
        """The patches as a sewn shell of Open CASCADE, a `TopoDS_Shape` in millimetres; raises as `sewn_shell`.

        Args:
            unit: of the curve's coordinates: "mm", "cm", "m" or "in".
        """
        return sewn_shell(self.patches, unit=unit)

    def to_build123d(self, *, unit: Unit = "mm") -> Any:
        """The patches as a `build123d.Shell`; arguments and errors as for `shell`."""
        return cad_object(self.shell(unit=unit), "build123d")

    def to_cadquery(self, *, unit: Unit = "mm") -> Any:
        """The patches as a `cadquery.Shell`; arguments and errors as for `shell`."""
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
    diagonal = max(rim.loop.diagonal for rim in solution.rims)
    with one_thread():
        rims = Rim.all_of(solution)
        blocks = Blocks.of(solution.domain, rims)
        samples = Samples(surface=solution.array_surface, rims=rims, blocks=blocks)
        mesh = QuadMesh(quads=blocks.quads, ring=len(blocks.parts))
        fit = fitted(mesh, samples.on, tolerance * diagonal)
        patches = tuple(
            NurbsPatch(control_points=net, degrees=(u.degree, v.degree), knots=(u.knots, v.knots))
            for net, (u, v) in zip(fit.nets, fit.spaces, strict=True)
        )
        seams = _seams(mesh)
        surface, rim, moved = _distances(patches, fit, samples)
        normals = _largest_angle(patches, fit.spaces, seams)
    deviations = NurbsDeviations(surface=surface, rim=rim, normals=normals, diagonal=diagonal)
    reached = f"{fit.error / diagonal:.1e} of the diagonal with {fit.points} control points"
    within = fit.error <= tolerance * diagonal
    reason = f"interpolation error {reached}"
    if not solution.converged:
        reason = f"{reason}, but the minimal surface misses its curve: {solution.reason}"
    elif moved > tolerance * diagonal:
        reason = (
            f"{reason}, but the rims are moved by the boundary residual of the solution, {moved / diagonal:.1e} of the "
            f"diagonal, above the tolerance {tolerance:.1e}: solve with a smaller tolerance"
        )
    elif not within:
        reason = f"{reason}, above the tolerance {tolerance:.1e}: more control points are not tried"
    ends = np.cumsum(blocks.sizes).tolist()
    return NurbsSurface(
        patches=patches,
        seams=seams,
        rims=tuple(
            tuple((patch, 0) for patch in range(end - size, end)) for size, end in zip(blocks.sizes, ends, strict=True)
        ),
        deviations=deviations,
        tolerance=tolerance,
        converged=within and solution.converged and moved <= tolerance * diagonal,
        reason=reason,
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


def _distances(patches: Sequence[NurbsPatch], fit: Fit, samples: Samples) -> tuple[float, float, float]:
    """Largest distances of patches from the surface, of rims from Γ, and of the surface's rims from Γ.

    They are measured at equal parameters, between the nodes.
    """
    rims = len(samples.blocks.parts)
    grids = []
    for quad, (u, v) in enumerate(fit.spaces):
        across = np.append(0.0, v.between) if quad < rims else v.between
        grids.append((quad, u.between, across, v.breaks))
    surface, rim, residual = [], [], []
    for patch, (quad, at_u, at_v, _), (exact, moved) in zip(patches, grids, samples.on(grids), strict=True):
        own = patch.grid(at_u, at_v)
        surface.append(np.linalg.norm(own - exact, axis=2).max())
        if quad < rims:
            rim.append(np.linalg.norm(own - moved, axis=2)[:, 0].max())
            residual.append(np.linalg.norm(exact - moved, axis=2)[:, 0].max())
    return float(max(surface)), float(max(rim)), float(max(residual))


def _largest_angle(
    patches: Sequence[NurbsPatch], spaces: Sequence[tuple[SplineSpace, SplineSpace]], seams: Sequence[Seam]
) -> float:
    """The largest angle between normals on both sides of a seam, in degrees; 0 without seams."""
    largest = 0.0
    for seam in seams:
        (patch, side), (other, its_side) = seam.first, seam.second
        at = spaces[patch][side % 2].between
        one = patches[patch].normals_on(side, at)
        two = patches[other].normals_on(its_side, 1 - at if seam.reversed else at)
        sine, cosine = np.linalg.norm(np.cross(one, two), axis=1), (one * two).sum(axis=1)
        largest = max(largest, float(np.degrees(np.arctan2(sine, cosine)).max()))
    return largest
