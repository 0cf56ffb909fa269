"""Solutions of Plateau's problem, with their evidence."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom import deadline
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import OptionError, SeveralRimsError, require_positive
from spinor_geom.files import MESH_SUFFIXES
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.loop_frame import LoopFrame
from spinor_geom.plateau.annulus import Annulus, Partition, RimDisks
from spinor_geom.plateau.evidence import Evidence
from spinor_geom.plateau.misfit import BoundaryResidual
from spinor_geom.plateau.rim_match import RimMatch
from spinor_geom.plateau.stability import Stability
from spinor_geom.plateau.steps import Iteration
from spinor_geom.shown import Shown, shortened
from spinor_geom.surface.array_surface import ArraySurface

if TYPE_CHECKING:
    from spinor_geom.meshing.embed import Patch
    from spinor_geom.meshing.solid import Solid
    from spinor_geom.nurbs.nurbs_surface import NurbsSurface
    from spinor_geom.surface.spinor_surface import SpinorSurface
    from spinor_geom.symmetry.continued_surface import ContinuedSurface

RouteName = Literal[
    "plane",
    "disk",
    "vertices",
    "annulus",
    "annular network",
    "circles",
    "network on circles",
    "flattened",
    "network",
    "trained",
    "mirrored",
]


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateauSolution(Shown):
    """A minimal disk over a loop, or a connected minimal surface between several loops.

    Attributes:
        rims: the loops with their boundaries of Ω, the outer boundary first.
        domain: Ω.
        boundary_residual: distance of the surface's boundary from Γ, of all rims together.
        area: ½∮ r·Im(φ dz), in squared mesh units, or `area_in_domain` where this is not positive because the surface
            is not resolved along ∂Ω.
        route: the route that found the surface.
            "plane": the region inside the plane loop is Ω, and p and q are constant.
            "disk", "flattened": Douglas's method on the unit disk, or on a smooth domain near a flattened discrete
            disk. p and q are a power series or Cauchy's formula.
            "vertices": the surface through the points of rough loops that is nearest to a discrete minimal disk, or to
            the surface over averages of several loops. Γ between the points is the surface's own boundary.
            "network", "annular network": Gauss-Newton for a Cauchy network on a flattened discrete disk or annulus.
            "annulus", "circles": Douglas's method for two loops, or for more, on a disk with round holes, where p and q
            are Laurent series.
            "network on circles": the same for loops of which some have corners or need many nodes, where p and q
            are a Cauchy network.
            "trained": a complex-valued network.
            "mirrored": the part on one side of planes of symmetry of a surface found by another route.
        history: the steps.
        solve_timings: wall time of each stage of the solve, in seconds.
        tolerance: the tolerance of the call: RMS residual in mean edges.
        converged: whether `boundary_residual.rms_per_edge` is within the tolerance, and `max_per_local_edge` within a
            hundred times as much.
        reason: why the solver stopped, in one sentence.
        evidence: the surface and its checks, computed on first use.
        annulus: properties of a surface over several rims, or None for disks.
        free_edges: with `mirror`, the intervals of parameters of `curve` on which the surface meets a plane.
        solved_to: solves the same problem with another tolerance, a network from here on. None for other surfaces of a
            batch or a search.
    """

    rims: tuple[RimMatch, ...]
    domain: PlaneDomain
    boundary_residual: BoundaryResidual
    area: float
    route: RouteName
    history: tuple[Iteration, ...]
    solve_timings: Mapping[str, float]
    tolerance: float
    converged: bool
    reason: str
    evidence: Evidence
    annulus: Annulus | None = None
    free_edges: tuple[tuple[float, float], ...] = ()
    solved_to: Callable[[float], PlateauSolution | NoConnectedSurface] | None = None

    def __repr__(self) -> str:
        rims = " + ".join(str(len(rim.loop)) for rim in self.rims)
        state = "converged" if self.converged else f"not converged: {self.reason}"
        residual = f"residual {self.boundary_residual.rms_per_edge:.1e} of an edge"
        return shortened(f"PlateauSolution({rims} points, area {self.area:.6g}, {residual}, {self.route!r}, {state})")

    @cached_property
    def surface(self) -> SpinorSurface:
        """The surface, in the loop's coordinates, as a module of torch."""
        from spinor_geom.surface.spinor_surface import SpinorSurface

        return SpinorSurface.of(self.array_surface)

    @property
    def array_surface(self) -> ArraySurface:
        """The surface, in the loop's coordinates, on arrays: it needs no torch."""
        return self.evidence.surface

    @property
    def stability(self) -> Stability:
        """Verdict of the second variation."""
        return self.evidence.stability

    @property
    def area_in_domain(self) -> float:
        """The area by quadrature in Ω: a check of `area` for smooth rims. Over rough ones its error is some percent."""
        return self.evidence.area_in_domain

    @property
    def self_intersections(self) -> int | None:
        """Number of pairs of intersecting triangles in the surface's mesh over Ω's triangulation.

        Every disk over a knotted loop intersects itself. None if the mesh is not finite.
        """
        return self.evidence.self_intersections

    @cached_property
    def area_gradient(self) -> tuple[Float[np.ndarray, "_ 3"], ...]:
        """Derivative of the area with respect to the points of each given loop, in mesh units, computed on first use.

        When the points move by δP, the area of the minimal surface changes by Σ gradient·δP, to first order. By the
        first variation it is ∮ ν·δΓ ds, ν the outer conormal and δΓ the displacement of the curve through the points.
        It is exact up to the boundary residual. Kind, degree and corners of the curve are those of this solution. Where
        `BoundaryCurve.from_loop` would choose others, the area jumps by about the error of interpolation.

        Raises:
            NotDifferentiableError: Γ is given by a formula, or free between the points (route "vertices").
        """
        from spinor_geom.gradients.area import area_gradient

        return area_gradient(self)

    @property
    def timings(self) -> dict[str, float]:
        """Wall time of each stage of the solve and of the checks computed so far, in seconds."""
        disks = {} if self.annulus is None else self.annulus.rim_disks.clock.seconds
        return {**self.solve_timings, **self.evidence.clock.seconds, **disks}

    @property
    def loop(self) -> BoundaryLoop:
        """The loop of a disk. Raises a SeveralRimsError for several rims."""
        return self._rim.loop

    @property
    def curve(self) -> BoundaryCurve:
        """Γ of a disk. Raises a SeveralRimsError for several rims."""
        return self._rim.curve

    @property
    def matching(self) -> Float[np.ndarray, "n 2"]:
        """`RimMatch.matching` of a disk. Raises a SeveralRimsError for several rims."""
        return self._rim.matching

    @property
    def diagonal(self) -> float:
        """The diagonal of the bounding box of the largest loop, in mesh units."""
        return max(rim.loop.diagonal for rim in self.rims)

    @property
    def _rim(self) -> RimMatch:
        if len(self.rims) > 1:
            raise SeveralRimsError(rims=len(self.rims))
        return self.rims[0]

    @property
    def is_area_minimum(self) -> bool:
        """Whether the surface is stable and, over several rims, meets Douglas's condition.

        The condition is that its area is below all `Annulus.partition_areas`. It counts as not met if a disk was not
        found, or if the time that the solve left is too short for the comparison.
        """
        if self.stability.verdict != "stable":
            return False
        if self.annulus is None:
            return True
        areas = self.annulus.partition_areas.values()
        return bool(areas) and self.area < min(areas)

    def placed_by(self, frame: LoopFrame, *loops: BoundaryLoop) -> PlateauSolution:
        """The solution over given loops, from that over the loops in the coordinates of a frame.

        If the frame is backward, Ω becomes its mirror image z̄.
        """
        domain = self.domain.mirrored if frame.is_backward else self.domain
        given = loops if self.annulus is None else [loops[number] for number in self.annulus.order]
        diagonal = max(loop.diagonal for loop in loops)
        return replace(
            self,
            rims=tuple(
                rim.placed_by(frame, loop, boundary)
                for rim, loop, boundary in zip(self.rims, given, domain.boundaries, strict=True)
            ),
            domain=domain,
            boundary_residual=self.boundary_residual.enlarged(frame.size, diagonal=diagonal),
            area=self.area * frame.size**2,
            evidence=self.evidence.placed_by(frame),
            annulus=None if self.annulus is None else self.annulus.placed_by(frame, loops),
            solved_to=None if self.solved_to is None else partial(_solved_in_frame, self.solved_to, frame, loops),
        )

    def loop_points_in_domain(self) -> Complex[np.ndarray, " m"]:
        """The points of ∂Ω that correspond to the loops' points, in loop order, rim after rim."""
        return np.concatenate([rim.points_in_domain() for rim in self.rims])

    def to_nurbs(self, *, tolerance: float = 1e-6, time_limit: float = math.inf) -> NurbsSurface:
        """The surface as B-spline patches for CAD, within a tolerance.

        Ω is divided into quadrilaterals: 5 for a disk over a smooth curve, up to 30 for a strongly folded and elongated
        one, and more for curves with many corners. Every two points of a ragged rim take three, or five on long rims.
        On each the surface is interpolated by splines, in the parameter of Γ along the rims. The outer sides are Γ
        itself: within the patches at the rims the surface is moved by its boundary residual. If this residual is above
        the tolerance, the problem is solved again with a smaller tolerance.

        Plane polygons have exact patches of degree 1. If p and q are polynomials of degree up to 5 on a disk, as for
        Enneper's surface, five rational patches are exact. See `NurbsSurface.of_polynomials`.

        The result of `fill_hole(continuity="C1")` is a mesh and cannot be converted. At a branch point a patch has no
        normal.

        Args:
            tolerance: largest distance of the patches from the surface, in diagonals of the largest loop. That of the
                outer sides from the curves is a tenth of it.
            time_limit: seconds after which no more control points are added.

        Returns:
            The patches, with `converged=False` and a reason if the tolerance needs too many control points or more
            time, or the boundary residual stays above the tolerance. Patches are not refined below this residual.

        Raises:
            OptionError: the tolerance or the time limit is not positive.
            DomainError: Ω is too narrow somewhere to be divided, or the surface is far from its curve.
        """
        from spinor_geom.nurbs.nurbs_surface import nurbs_surface

        require_positive("time_limit", time_limit, finite=False)
        with deadline.time_limit(time_limit):
            return nurbs_surface(self, tolerance)

    def solid(
        self,
        thickness: float,
        *,
        target_edge_length: float | Literal["auto"] = "auto",
        edge: Literal["straight", "rounded"] = "rounded",
    ) -> Solid:
        """The surface thickened by half of `thickness` to both sides, as a watertight mesh.

        The vertices of both sides are those of `mesh_patch`, moved along the exact normals of the surface.

        Args:
            thickness: distance of the two sides, in mesh units.
            target_edge_length: as for `mesh_patch`.
            edge: "rounded", a half circle around the rim, or "straight", the normals along the rim.

        Returns:
            The solid. `intersections` is not 0 if it is too thick for the surface or its rim.

        Raises:
            OptionError: the thickness or the edge length is not positive and finite, or `edge` is unknown.
            SurfaceError: a vertex is a branch point, where the surface has no normal.
            DomainError, TooManyPointsError: as for `mesh_patch`.
        """
        from spinor_geom.meshing.solid import thickened

        return thickened(self, thickness, target_edge_length, edge)

    def continued(self, copies: int | Literal["cell"] = "cell") -> ContinuedSurface:
        """The surface with its continuation across straight sides and planes of symmetry.

        By Schwarz's reflection principle a minimal surface continues across a straight side by a half turn about it,
        and across a side where it meets a plane at right angles by the reflection in the plane. Such sides are
        recognised: to 1e-7 of the diagonal and 1e-3 of a right angle.

        Args:
            copies: "cell": copies that make up a cell, which translations continue to the whole surface without a
                change of its sides, or the whole surface if it has no periods. A number n: the copies that are reached
                across at most n sides.

        Returns:
            The copies, with `area`, `mesh`, `to_nurbs` and `solid`. `lattice` is a basis of the translations.

        Raises:
            OptionError: no side has a symmetry, the angle at a corner between two such sides does not divide π, so that
                the continued surface is branched there, or there is no periodic cell.

        Source: Schwarz (1865); Dierkes, Hildebrandt & Sauvigny, "Minimal Surfaces" (2010), section 4.8.
        """
        from spinor_geom.symmetry.continued_surface import continued

        return continued(self, copies)

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        tolerance: float = 1e-6,
        time_limit: float = math.inf,
        unit: Literal["mm", "cm", "m", "in"] | None = None,
        target_edge_length: float | Literal["auto"] = "auto",
    ) -> NurbsSurface | Patch:
        """Writes the surface as a sewn shell of NURBS to a CAD file, or as triangles to a mesh file.

        Args:
            path: ends with .step, .stp, .igs, .iges or .brep, or with the suffix of a mesh format such as .stl.
            tolerance: of NURBS, as for `to_nurbs`.
            time_limit: of NURBS, as for `to_nurbs`. Writing the file comes after it.
            unit: of the curve's coordinates, "mm" by default. CAD files are in millimetres. Mesh files have no unit.
            target_edge_length: of triangles, as for `mesh_patch`.

        Returns:
            The patches or the mesh that was written.

        Raises:
            CadFileError, OptionError, DomainError, OSError, MissingPackageError: as `to_nurbs` and `NurbsSurface.save`,
                or an option of the other kind of file was given.
            MeshFileError, PrecisionError: as `MeshFile.write`.
        """
        from spinor_geom.adapters.open_cascade import require_cad_suffix

        if Path(path).suffix.lower() in MESH_SUFFIXES:
            from spinor_geom.meshing.embed import mesh_patch

            if unit is not None:
                raise OptionError(f"{os.fspath(path)}: mesh files have no unit; remove unit=, or write a CAD file")
            patch = mesh_patch(self, target_edge_length)
            patch.write(path)
            return patch
        require_cad_suffix(path)
        if target_edge_length != "auto":
            raise OptionError(f"{os.fspath(path)}: CAD files have no triangles; remove target_edge_length=")
        surface = self.to_nurbs(tolerance=tolerance, time_limit=time_limit)
        surface.save(path, unit=unit or "mm")
        return surface

    def to_dict(self) -> dict[str, Any]:
        """The values as types that JSON supports."""
        residual = self.boundary_residual
        return {
            "vertices": sum(len(rim.loop) for rim in self.rims),
            "area": self.area,
            "area_in_domain": self.area_in_domain,
            "self_intersections": self.self_intersections,
            "residual": {
                **asdict(residual),
                "rms_per_edge": residual.rms_per_edge,
                "max_per_edge": residual.max_per_edge,
                "rms_per_diagonal": residual.rms_per_diagonal,
                "max_per_diagonal": residual.max_per_diagonal,
            },
            "bulge_per_edge": max(rim.bulge for rim in self.rims) / residual.mean_edge,
            "route": self.route,
            "iterations": len(self.history),
            "tolerance": self.tolerance,
            "converged": self.converged,
            "reason": self.reason,
            "stability": asdict(self.stability),
            "annulus": None if self.annulus is None else self.annulus.to_dict(),
            "timings": self.timings,
        }


def _solved_in_frame(
    solve: Callable[[float], PlateauSolution | NoConnectedSurface],
    frame: LoopFrame,
    loops: tuple[BoundaryLoop, ...],
    tolerance: float,
) -> PlateauSolution | NoConnectedSurface:
    """The surface over given loops, from a solve in the coordinates of a frame."""
    found = solve(tolerance)
    return found if isinstance(found, NoConnectedSurface) else found.placed_by(frame, *loops)


@dataclass(frozen=True, kw_only=True, eq=False)
class NoConnectedSurface:
    """The result that no connected minimal surface spans several rims.

    Attributes:
        loops: the loops of all rims.
        rim_disks: the minimal surfaces over some of them.
        reason: why there is none, in one sentence.
        history: the steps.
        solve_timings: wall time of each stage of the search, in seconds.
    """

    loops: tuple[BoundaryLoop, ...]
    rim_disks: RimDisks
    reason: str
    history: tuple[Iteration, ...]
    solve_timings: Mapping[str, float]

    def __repr__(self) -> str:
        rims = " + ".join(str(len(loop)) for loop in self.loops)
        return shortened(f"NoConnectedSurface({rims} points: {self.reason})")

    @property
    def disks(self) -> tuple[PlateauSolution, ...] | None:
        """The minimal disks over the loops, or None if one was not found. Solved on first use."""
        return self.rim_disks.all

    @property
    def timings(self) -> dict[str, float]:
        """Wall time of each stage of the search, and of the disks if they were solved, in seconds."""
        return {**self.solve_timings, **self.rim_disks.clock.seconds}

    @property
    def partition_areas(self) -> dict[Partition, float]:
        """`RimDisks.partitions`."""
        return self.rim_disks.partitions

    @property
    def area(self) -> float | None:
        """Total area of the disks: for two rims the least area that they bound."""
        return None if self.disks is None else sum(disk.area for disk in self.disks)

    def to_dict(self) -> dict[str, Any]:
        """The values as types that JSON supports."""
        return {
            "vertices": sum(map(len, self.loops)),
            "disk_area": self.area,
            "reason": self.reason,
            "iterations": len(self.history),
            "timings": self.timings,
        }
