"""An exact minimal surface and two meshes over the same boundary: its own patch, and a discrete or any other mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.adapters import is_mesh, to_mesh, to_rims
from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface, discrete_minimal_surface
from spinor_geom.errors import ForeignRimError, SurfaceError
from spinor_geom.fill.loop_choice import free_rim
from spinor_geom.measures import (
    HausdorffDistance,
    discrete_mean_curvature,
    distances_to_mesh,
    hausdorff_distance,
)
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.loops import find_boundary_loops
from spinor_geom.mesh.operators import face_areas
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch, mesh_patch, mesh_surface
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.solve import solve_plateau

MOST_CURVATURE_POINTS = 500  # second derivatives cost some milliseconds a point
# Vertices of the mesh that stands for the exact surface: per vertex of the patch, at least, at most. With 16 its
# triangles deviate from the surface by a sixteenth of what the patch's do.
_FINER, _FEWEST, _MOST = 16, 4_000, 40_000
_SAME_RIM = 0.1  # of the mean edge: how far from the loop a mesh over it may end; vertices between its points may bulge
_TOLERANCE = 1e-3  # of the surfaces that are solved here, as `fill_hole` has it


@dataclass(frozen=True, kw_only=True)
class CurvatureFigures:
    """|H| at some points, in 1/mesh units."""

    max: float
    rms: float  # by area where it is a mesh's
    tangential_rms: float  # of a mesh: what pulls vertices along the surface, see `discrete_mean_curvature`; else 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """An exact minimal surface, the mesh of it (the patch) and another mesh over the same rims (the baseline).

    Attributes:
        method: What made the baseline.
        patch_to_surface: Distances, forward from the patch to the exact surface; mesh units.
        baseline_to_surface: Distances, forward from the baseline to the exact surface.
        hausdorff: Distances, forward from the patch to the baseline.
        surface_error: The exact surface is measured by a fine mesh with all vertices on it; the largest distance of the
            surface from that mesh, at the triangles' centres. Distances to the surface are right to about this.
        patch_area: Of the patch's triangles; squared mesh units, like the two others. It stands beside the baseline's:
            the chords of the loop and of the triangles make both less than the surface's.
        baseline_area: Of the baseline's triangles.
        exact_area: Of the surface itself, whose boundary is a curve through the loop's points.
        patch_curvature: Discrete |H| (the normal part of the cotangent Laplacian over mixed Voronoi areas) at the
            patch's inner vertices.
        baseline_curvature: The same of the baseline.
        exact_curvature: |H| of the surface by automatic differentiation at the patch's inner vertices.
        exact_curvature_points: At how many of them: all, or a share of a large patch's, evenly spread.
        patch_vertices: Number of vertices.
        baseline_vertices: Number of vertices.
        solution_seconds: Wall time of the exact surface, all stages.
        baseline_seconds: Wall time of the baseline; None for a mesh that was given.
        patch: The exact surface's mesh.
        baseline: The other mesh.
        surface_mesh: The fine mesh that stands for the exact surface.
    """

    method: str
    patch_to_surface: HausdorffDistance
    baseline_to_surface: HausdorffDistance
    hausdorff: HausdorffDistance
    surface_error: float
    patch_area: float
    baseline_area: float
    exact_area: float
    patch_curvature: CurvatureFigures
    baseline_curvature: CurvatureFigures
    exact_curvature: CurvatureFigures
    exact_curvature_points: int
    patch_vertices: int
    baseline_vertices: int
    solution_seconds: float
    baseline_seconds: float | None
    patch: Patch = field(repr=False)
    baseline: TriangleMesh = field(repr=False)
    surface_mesh: Patch = field(repr=False)

    def __repr__(self) -> str:
        return (
            f"Comparison(to the exact surface, mean: its mesh {self.patch_to_surface.mean:.2e}, "
            f"{self.method} {self.baseline_to_surface.mean:.2e})"
        )

    def to_dict(self) -> dict[str, Any]:
        """All figures in JSON's types, the symmetric distances included, without the meshes."""
        figures: dict[str, Any] = {}
        for name, value in vars(self).items():
            if isinstance(value, HausdorffDistance):
                figures[name] = {**asdict(value), "max": value.max, "mean": value.mean}
            elif isinstance(value, CurvatureFigures):
                figures[name] = asdict(value)
            elif name not in ("patch", "baseline", "surface_mesh"):
                figures[name] = value
        return figures

    def rows(self) -> list[tuple[str, ...]]:
        """The figures as lines of a table: the name, then the exact surface, its mesh and the other mesh."""
        curvatures = self.exact_curvature, self.patch_curvature, self.baseline_curvature
        areas = self.exact_area, self.patch_area, self.baseline_area
        here, there = self.patch_to_surface, self.baseline_to_surface
        excess = (f"{area / self.exact_area - 1:+.2e}" for area in areas[1:])
        seconds = "" if self.baseline_seconds is None else f"{self.baseline_seconds:.2f}"
        return [
            ("", "surface", "its mesh", self.method),
            ("area", *(f"{area:.8g}" for area in areas)),
            ("area beside the surface's", "", *excess),
            ("to the surface, max", f"± {self.surface_error:.0e}", f"{here.max:.2e}", f"{there.max:.2e}"),
            ("to the surface, mean", "", f"{here.mean:.2e}", f"{there.mean:.2e}"),
            ("between the meshes, max", "", "", f"{self.hausdorff.max:.2e}"),
            ("between the meshes, mean", "", "", f"{self.hausdorff.mean:.2e}"),
            ("|H| max", *(f"{figures.max:.2e}" for figures in curvatures)),
            ("|H| rms", *(f"{figures.rms:.2e}" for figures in curvatures)),
            ("tangential rms", "", *(f"{figures.tangential_rms:.2e}" for figures in curvatures[1:])),
            ("vertices", "", str(self.patch_vertices), str(self.baseline_vertices)),
            ("seconds", f"{self.solution_seconds:.2f}", "", seconds),
        ]

    def __str__(self) -> str:
        """A table of one line a figure, with a column for each surface."""
        rows = self.rows()
        name, *others = (max(map(len, column)) for column in zip(*rows, strict=True))
        form = f"{{:<{name}}}" + "".join(f"  {{:>{width}}}" for width in others)
        return "\n".join(form.format(*row).rstrip() for row in rows)


def compare(
    surface: Any,
    baseline: Any = None,
    *,
    loop: int | None = None,
    target_edge_length: float | Literal["auto"] = "auto",
    patch: Patch | None = None,
) -> Comparison:
    """Measures two meshes against an exact minimal surface and against each other.

    One mesh is `mesh_patch` of the surface. The other is a discrete minimal surface, or a mesh of yours over the same
    rim.

    Args:
        surface: A `PlateauSolution`, or what to solve first: a loop, a curve, (n, 3) points, a mesh of any known type
            or the path of a mesh file; a sequence of loops for a surface between several rims. A rim of a mesh is
            solved as `fill_hole` does.
        baseline: A `DiscreteMinimalSurface`, or a mesh of any known type whose boundary is the same rim, without the
            mesh around it. None makes a `discrete_minimal_surface` of the same loop, with the patch's edge length;
            between two loops its edges grow inwards, and between more it is `Patch.relaxed`.
        loop: Which loop of a mesh, as `boundary_loops` numbers them; needed where a mesh has several.
        target_edge_length: Of the patch, as in `mesh_patch`, and of the baseline made here.
        patch: The solution's mesh of that edge length, if there is one already.

    Raises:
        OptionError: The edge length is not a positive number, or `loop` is missing or of no use.
        LoopIndexError: The mesh has no such loop.
        UnknownMeshTypeError: `surface` or `baseline` is of no known type.
        ForeignRimError: The baseline's boundary is not the surface's rim.
        DomainError: The solution cannot be meshed, or its two loops have no discrete annulus.
        SurfaceError: No connected minimal surface spans the loops.
    """
    solution = surface if isinstance(surface, PlateauSolution) else _solved(surface, loop)
    mesh = mesh_patch(solution, target_edge_length) if patch is None else patch
    loops = [rim.loop for rim in solution.rims]
    name, seconds, other = _baseline(baseline, loops, mesh, target_edge_length)
    exact = exact_curvature(solution, mesh.points[mesh.boundary_size :])
    fine = mesh_surface(solution.surface, vertices=int(np.clip(_FINER * len(mesh.vertices), _FEWEST, _MOST)))
    return Comparison(
        method=name,
        patch_to_surface=hausdorff_distance(mesh.vertices, mesh.faces, fine.vertices, fine.faces),
        baseline_to_surface=hausdorff_distance(other.vertices, other.faces, fine.vertices, fine.faces),
        hausdorff=hausdorff_distance(mesh.vertices, mesh.faces, other.vertices, other.faces),
        surface_error=_error(solution, fine),
        patch_area=mesh.area,
        baseline_area=float(face_areas(other.vertices, other.faces).sum()),
        exact_area=solution.area,
        patch_curvature=_discrete_curvature(mesh.vertices, mesh.faces),
        baseline_curvature=_discrete_curvature(other.vertices, other.faces),
        exact_curvature=CurvatureFigures(
            max=float(exact.max(initial=0.0)),
            rms=float(np.linalg.norm(exact)) / max(len(exact), 1) ** 0.5,
            tangential_rms=0.0,
        ),
        exact_curvature_points=len(exact),
        patch_vertices=len(mesh.vertices),
        baseline_vertices=len(other.vertices),
        solution_seconds=sum(solution.solve_timings.values()),
        baseline_seconds=seconds,
        patch=mesh,
        baseline=other,
        surface_mesh=fine,
    )


def _solved(what: Any, loop: int | None) -> PlateauSolution:
    first, *others = to_rims(what, loop)
    if is_mesh(what) and isinstance(first, BoundaryLoop):
        return solve_plateau(free_rim(first, tolerance=_TOLERANCE), tolerance=_TOLERANCE, between="free")
    found = solve_plateau((first, *others)) if others else solve_plateau(first)
    if isinstance(found, NoConnectedSurface):
        raise SurfaceError(found.reason)
    return found


def _baseline(
    given: Any, loops: Sequence[BoundaryLoop], patch: Patch, target: float | Literal["auto"]
) -> tuple[str, float | None, TriangleMesh]:
    """The name of the other mesh, the seconds that it took where they are known, and the mesh itself."""
    if given is not None and not isinstance(given, DiscreteMinimalSurface):
        mesh = to_mesh(given)
        require_same_rims(mesh, loops)
        return "given mesh", None, mesh
    if given is None and len(loops) == 1:
        length = loops[0].mean_edge_length if target == "auto" else target
        given = discrete_minimal_surface(loops, target_edge_length=length)
    elif given is None:
        given = discrete_minimal_surface(loops) if len(loops) == 2 else patch.relaxed()
    mesh = TriangleMesh(given.vertices, given.faces)
    require_same_rims(mesh, loops)
    return f"{given.method} mesh", given.seconds, mesh


def require_same_rims(mesh: TriangleMesh, loops: Sequence[BoundaryLoop]) -> None:
    """Raises a ForeignRimError where the boundary of a mesh is not that of a surface over some loops.

    Every vertex of the boundary lies within a tenth of a mean edge of the loops, and every point of a loop as near to
    the boundary. The mesh may have more vertices on its boundary than the loops have points.
    """
    theirs = find_boundary_loops(mesh)
    if len(theirs) != len(loops):
        raise ForeignRimError(boundary=f"{len(theirs)} boundary loops, the surface has {len(loops)}")
    here, there = _polylines(loops), _polylines(theirs)
    edge = sum(loop.perimeter for loop in loops) / len(here[0])
    away = max(distances_to_mesh(there[0], *here).max(), distances_to_mesh(here[0], *there).max())
    if not away <= _SAME_RIM * edge:
        raise ForeignRimError(boundary=f"a boundary up to {away:.3g} ({away / edge:.2g} mean edges) away from it")


def _polylines(loops: Sequence[BoundaryLoop]) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n 2"]]:
    """Some loops' points and edges, numbered through."""
    starts = np.cumsum([0, *map(len, loops)])
    rings = [np.arange(start, stop) for start, stop in pairwise(starts)]
    return np.concatenate([loop.points for loop in loops]), np.concatenate(
        [np.stack([ring, np.roll(ring, -1)], axis=1) for ring in rings]
    )


def _error(solution: PlateauSolution, fine: Patch) -> float:
    """How far the surface is from a mesh with all vertices on it, at most, at the centres of its triangles."""
    centres = solution.surface.positions_inside(fine.points[fine.faces].mean(axis=1))
    return float(distances_to_mesh(centres, fine.vertices, fine.faces).max())


def _discrete_curvature(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> CurvatureFigures:
    curvature = discrete_mean_curvature(vertices, faces)
    return CurvatureFigures(max=curvature.max, rms=curvature.rms, tangential_rms=curvature.tangential_rms)


def exact_curvature(
    solution: PlateauSolution, points: Complex[np.ndarray, " n"], most: int = MOST_CURVATURE_POINTS
) -> Float[np.ndarray, " k"]:
    """|H| at points of Ω by automatic differentiation of the position, in 1/mesh units; a branch point has none.

    Of more than `most` points so many are taken, evenly spread.
    """
    if len(points) > most:
        points = points[np.linspace(0, len(points) - 1, most).astype(int)]
    values = np.abs(np.asarray(solution.surface.mean_curvature(points)))
    return np.asarray(values[np.isfinite(values)])
