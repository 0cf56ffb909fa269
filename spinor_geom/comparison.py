"""The exact minimal surface beside the discrete one over the same loop, in numbers."""

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface, discrete_minimal_surface
from spinor_geom.measures import HausdorffDistance, discrete_mean_curvature, hausdorff_distance
from spinor_geom.meshing.embed import Patch, mesh_patch
from spinor_geom.plateau.solution import PlateauSolution

MOST_CURVATURE_POINTS = 500  # second derivatives cost some milliseconds a point


@dataclass(frozen=True, kw_only=True)
class CurvatureFigures:
    """|H| at some points, in 1/mesh units."""

    max: float
    rms: float  # by area where it is a mesh's
    tangential_rms: float  # of a mesh: what pulls vertices along the surface, see `discrete_mean_curvature`; else 0


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Mesh of an exact minimal surface (the patch) against a discrete minimal surface (the baseline) over one loop.

    Attributes:
        method: What made the baseline.
        hausdorff: Distances, forward from the patch to the baseline; mesh units.
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
        baseline_seconds: Wall time of the baseline.
    """

    method: str
    hausdorff: HausdorffDistance
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
    baseline_seconds: float

    def to_dict(self) -> dict[str, Any]:
        """All figures in JSON's types, the symmetric distances included."""
        figures = asdict(self)
        figures["hausdorff"] |= {"max": self.hausdorff.max, "mean": self.hausdorff.mean}
        return figures

    def __str__(self) -> str:
        """A table of one line a figure, with a column for each surface."""
        forward, backward = self.hausdorff.forward, self.hausdorff.backward
        curvatures = self.exact_curvature, self.patch_curvature, self.baseline_curvature
        rows = [
            ("", "surface", "its mesh", f"{self.method} mesh"),
            ("area", *(f"{area:.8g}" for area in (self.exact_area, self.patch_area, self.baseline_area))),
            ("mesh area excess", "", "", f"{self.baseline_area / self.patch_area - 1:+.2e}"),
            ("|H| max", *(f"{figures.max:.2e}" for figures in curvatures)),
            ("|H| rms", *(f"{figures.rms:.2e}" for figures in curvatures)),
            ("tangential rms", "", *(f"{figures.tangential_rms:.2e}" for figures in curvatures[1:])),
            ("vertices", "", str(self.patch_vertices), str(self.baseline_vertices)),
            ("seconds", f"{self.solution_seconds:.2f}", "", f"{self.baseline_seconds:.2f}"),
            ("distance max", "", f"{forward.max:.2e}", f"{backward.max:.2e}"),
            ("distance mean", "", f"{forward.mean:.2e}", f"{backward.mean:.2e}"),
        ]
        name, *others = (max(map(len, column)) for column in zip(*rows, strict=True))
        form = f"{{:<{name}}}" + "".join(f"  {{:>{width}}}" for width in others)
        return "\n".join(form.format(*row).rstrip() for row in rows)


def compare(
    solution: PlateauSolution,
    baseline: DiscreteMinimalSurface | None = None,
    *,
    target_edge_length: float | Literal["auto"] = "auto",
    patch: Patch | None = None,
) -> Comparison:
    """Compares a solved minimal surface with a discrete one over the same loop or loops.

    Args:
        solution: The exact surface.
        baseline: The discrete surface; if none is given, `discrete_minimal_surface` of the same loop, with the patch's
            edge length; between two loops its edges grow inwards, and between more it is `Patch.relaxed`.
        target_edge_length: Of the patch, as in `mesh_patch`, and of the baseline made here.
        patch: The solution's mesh of that edge length, if there is one already.

    Raises:
        OptionError: The edge length is not a positive number.
        DomainError: The solution cannot be meshed, or its two loops have no discrete annulus.
    """
    mesh = mesh_patch(solution, target_edge_length) if patch is None else patch
    discrete, loops = baseline, [rim.loop for rim in solution.rims]
    if discrete is None and len(loops) == 1:
        length = loops[0].mean_edge_length if target_edge_length == "auto" else target_edge_length
        discrete = discrete_minimal_surface(loops, target_edge_length=length)
    elif discrete is None:
        discrete = discrete_minimal_surface(loops) if len(loops) == 2 else mesh.relaxed()
    exact = exact_curvature(solution, mesh.points[mesh.boundary_size :])
    return Comparison(
        method=discrete.method,
        hausdorff=hausdorff_distance(mesh.vertices, mesh.faces, discrete.vertices, discrete.faces),
        patch_area=mesh.area,
        baseline_area=discrete.area,
        exact_area=solution.area,
        patch_curvature=_discrete_curvature(mesh),
        baseline_curvature=_discrete_curvature(discrete),
        exact_curvature=CurvatureFigures(
            max=float(exact.max(initial=0.0)),
            rms=float(np.linalg.norm(exact)) / max(len(exact), 1) ** 0.5,
            tangential_rms=0.0,
        ),
        exact_curvature_points=len(exact),
        patch_vertices=len(mesh.vertices),
        baseline_vertices=len(discrete.vertices),
        solution_seconds=sum(solution.solve_timings.values()),
        baseline_seconds=discrete.seconds,
    )


def _discrete_curvature(mesh: Patch | DiscreteMinimalSurface) -> CurvatureFigures:
    curvature = discrete_mean_curvature(mesh.vertices, mesh.faces)
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
