"""Comparison of an exact minimal surface, its mesh, and a discrete minimal surface or another mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.adapters import is_mesh, to_mesh, to_rims
from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface, discrete_minimal_surface
from spinor_geom.domain.delaunay import rim_edges
from spinor_geom.errors import ForeignRimError, SurfaceError
from spinor_geom.fill.loop_choice import free_rim
from spinor_geom.measures import HausdorffDistance, discrete_mean_curvature, distances_to_mesh, hausdorff_distance
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.operators import face_areas
from spinor_geom.mesh.topology import HalfEdges, linked
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import Patch, mesh_over_points, mesh_surface
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.solve import solve_plateau

MOST_CURVATURE_POINTS = 500  # second derivatives take some milliseconds per point
# Number of vertices of the fine mesh of the exact surface: per vertex of the patch, and its limits. With 16 its
# deviation from the surface is a sixteenth of the patch's.
_FINER, _FEWEST, _MOST = 16, 4_000, 40_000
_SAME_RIM = 0.1  # largest distance of a baseline's boundary from the loops, in mean edges
_SAME_VERTEX = 1e-3  # largest distance of a vertex of a filled mesh from a point of its rim, in edges there
_TOLERANCE = 1e-3  # of the surfaces solved here, as in `fill_hole`


@dataclass(frozen=True, kw_only=True)
class CurvatureFigures:
    """|H| at some points, in 1/mesh units."""

    max: float
    rms: float  # weighted by area for a mesh
    tangential_rms: float = 0.0  # of a mesh, see `DiscreteMeanCurvature.tangential`


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """An exact minimal surface, a mesh of it (the patch) and another mesh over the same loops (the baseline).

    Lengths are in mesh units. Distances to the exact surface are measured to `surface_mesh`, a fine mesh with all
    vertices on it, and have an error of about `surface_error`. Both meshes have less area than the exact surface,
    because their boundaries are chords of the loops: compare their areas with each other.
    """

    method: str  # the method that made the baseline
    patch_to_surface: HausdorffDistance  # forward: from the patch to the exact surface
    baseline_to_surface: HausdorffDistance  # forward: from the baseline to the exact surface
    hausdorff: HausdorffDistance  # forward: from the patch to the baseline
    surface_error: float  # largest distance of the surface from `surface_mesh`, at the centres of its triangles
    patch_area: float
    baseline_area: float
    exact_area: float
    patch_curvature: CurvatureFigures  # discrete |H| at the inner vertices
    baseline_curvature: CurvatureFigures  # the same of the baseline
    exact_curvature: CurvatureFigures  # |H| of the surface at inner vertices of the patch
    patch_vertices: int
    baseline_vertices: int
    solution_seconds: float  # wall time of the exact surface, all stages
    baseline_seconds: float | None  # wall time of the baseline, or None for a given mesh
    patch: Patch = field(repr=False)
    baseline: TriangleMesh = field(repr=False)
    surface_mesh: Patch = field(repr=False)

    def __repr__(self) -> str:
        return (
            f"Comparison(to the exact surface, mean: its mesh {self.patch_to_surface.mean:.2e}, "
            f"{self.method} {self.baseline_to_surface.mean:.2e})"
        )

    def to_dict(self) -> dict[str, Any]:
        """All figures in JSON's types, without the meshes."""
        figures = {name: value for name, value in vars(self).items() if not isinstance(value, (Patch, TriangleMesh))}
        for name, value in figures.items():
            if isinstance(value, HausdorffDistance):
                figures[name] = {**asdict(value), "max": value.max, "mean": value.mean}
            elif isinstance(value, CurvatureFigures):
                figures[name] = asdict(value)
        return figures

    def rows(self) -> list[tuple[str, ...]]:
        """The figures as rows of a table, its head first: name, exact surface, patch, baseline."""
        curvatures = self.exact_curvature, self.patch_curvature, self.baseline_curvature
        areas = self.exact_area, self.patch_area, self.baseline_area
        here, there = self.patch_to_surface, self.baseline_to_surface
        excess = (f"{area / self.exact_area - 1:+.2e}" for area in areas[1:])
        seconds = "" if self.baseline_seconds is None else f"{self.baseline_seconds:.2f}"
        return [
            ("", "surface", "its mesh", self.method),
            ("area", *(f"{area:.8g}" for area in areas)),
            ("relative area excess", "", *excess),
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
        """The table of `rows`."""
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
    """Measures the distances, areas and curvatures of an exact minimal surface, its mesh and a second mesh.

    Args:
        surface: a `PlateauSolution`. For a loop, a curve, (n, 3) points, a mesh of any supported type or the path of a
            mesh file, or a sequence of loops, Plateau's problem is solved first. A loop of a mesh is solved as by
            `fill_hole`.
        baseline: a `DiscreteMinimalSurface`, a `Patch`, or a mesh of any supported type whose boundary is the same
            loop. Of a filled mesh with the loop's points as vertices, the patch over the loop is used. None computes
            the `discrete_minimal_surface` of the same loop, with the patch's edge length. Between two loops its edges
            grow inwards, and between more it is `Patch.relaxed`.
        loop: index of a mesh's loop, as in `boundary_loops`, required if a mesh has several.
        target_edge_length: of the patch, as in `mesh_patch` but over the loops' points alone, and of the baseline made
            here.
        patch: the solution's mesh of that edge length, if it exists already.

    Raises:
        OptionError: the edge length is not a positive number, or `loop` is missing or does not apply.
        LoopIndexError: the mesh has no such loop.
        UnknownMeshTypeError: the type of `surface` or `baseline` is not supported.
        ForeignRimError: the baseline's boundary is not that of the surface.
        DomainError: the solution cannot be meshed, or its two loops have no discrete annulus.
        SurfaceError: no connected minimal surface spans the loops.
    """
    solution = surface if isinstance(surface, PlateauSolution) else _solved(surface, loop)
    mesh = mesh_over_points(solution, target_edge_length) if patch is None else patch
    loops = [rim.loop for rim in solution.rims]
    name, seconds, other = _baseline(baseline, loops, mesh, target_edge_length)
    exact = exact_curvature(solution, mesh.points[mesh.boundary_size :])
    fine = mesh_surface(solution.array_surface, vertices=int(np.clip(_FINER * len(mesh.vertices), _FEWEST, _MOST)))
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
            max=float(exact.max(initial=0.0)), rms=float(np.linalg.norm(exact)) / max(len(exact), 1) ** 0.5
        ),
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
    """The baseline: its name, the seconds that it took if known, and the mesh."""
    if given is not None and not isinstance(given, DiscreteMinimalSurface):
        mesh = (
            TriangleMesh(given.vertices, given.faces) if isinstance(given, Patch) else _patch_of(to_mesh(given), loops)
        )
        _require_same_rims(mesh, loops)
        return "given mesh", None, mesh
    if given is None and len(loops) == 1:
        length = loops[0].mean_edge_length if target == "auto" else target
        given = discrete_minimal_surface(loops, target_edge_length=length)
    elif given is None:
        given = discrete_minimal_surface(loops) if len(loops) == 2 else patch.relaxed()
    mesh = TriangleMesh(given.vertices, given.faces)
    _require_same_rims(mesh, loops)
    return f"{given.method} mesh", given.seconds, mesh


def _patch_of(mesh: TriangleMesh, loops: Sequence[BoundaryLoop]) -> TriangleMesh:
    """The part of a filled mesh that closed chains of its edges at the points of the loops bound.

    The mesh itself if the loops are its boundary or not among its edges.
    """
    (points, edges), faces = _polylines(loops), np.asarray(mesh.faces)
    used = np.unique(faces)
    distance, nearest = cKDTree(mesh.vertices[used]).query(points)
    rim, half_edges = used[nearest][edges], HalfEdges.of(faces)
    count = len(mesh.vertices)
    own, rims = half_edges.origin * count + half_edges.target, rim[:, 0] * count + rim[:, 1]
    is_rim = np.isin(own, rims)
    is_inner = is_rim[is_rim] & (half_edges.twin[is_rim] >= 0)
    lengths = np.linalg.norm(np.diff(points[edges], axis=1)[:, 0], axis=1)
    if not (distance <= _SAME_VERTEX * lengths).all() or is_inner.sum() < len(rims):
        return mesh
    pairs = half_edges.pairs[~(is_rim[half_edges.pairs].any(axis=1))]
    part = linked(pairs // 3, len(faces))
    kept = faces[np.isin(part, part[np.flatnonzero(is_rim) // 3])]
    numbers, corners = np.unique(kept, return_inverse=True)
    return TriangleMesh(mesh.vertices[numbers], corners.reshape(-1, 3))


def _require_same_rims(mesh: TriangleMesh, loops: Sequence[BoundaryLoop]) -> None:
    """Raises a ForeignRimError unless a mesh's boundary and the loops are within a tenth of a mean edge of each other.

    The mesh may have more vertices on its boundary than the loops have points.
    """
    others = find_boundary_loops(mesh)
    if len(others) != len(loops):
        raise ForeignRimError(boundary=f"{len(others)} boundary loops, the surface has {len(loops)}")
    own, other = _polylines(loops), _polylines(others)
    edge = sum(loop.perimeter for loop in loops) / len(own[0])
    away = max(distances_to_mesh(other[0], *own).max(), distances_to_mesh(own[0], *other).max())
    if not away <= _SAME_RIM * edge:
        raise ForeignRimError(boundary=f"a boundary up to {away:.3g} ({away / edge:.2g} mean edges) away from it")


def _polylines(loops: Sequence[BoundaryLoop]) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n 2"]]:
    """The points and edges of all loops."""
    return np.concatenate([loop.points for loop in loops]), rim_edges(tuple(map(len, loops)))


def _error(solution: PlateauSolution, fine: Patch) -> float:
    """The largest distance of the surface, at the triangles' centres, from a mesh with all vertices on it."""
    centres = solution.array_surface.positions_inside(fine.points[fine.faces].mean(axis=1))[0]
    return float(distances_to_mesh(centres, fine.vertices, fine.faces).max())


def _discrete_curvature(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> CurvatureFigures:
    curvature = discrete_mean_curvature(vertices, faces)
    return CurvatureFigures(max=curvature.max, rms=curvature.rms, tangential_rms=curvature.tangential_rms)


def exact_curvature(
    solution: PlateauSolution, points: Complex[np.ndarray, " n"], most: int = MOST_CURVATURE_POINTS
) -> Float[np.ndarray, " k"]:
    """|H| at points of Ω as of `ArraySurface.mean_curvature`, in 1/mesh units. Branch points are left out.

    At most `most` of the points are used, evenly spread.
    """
    if len(points) > most:
        points = points[np.linspace(0, len(points) - 1, most).astype(int)]
    values = np.abs(np.asarray(solution.array_surface.mean_curvature(points)))
    return np.asarray(values[np.isfinite(values)])
