"""Layers of a filled loop for the report: its patch in space and in Ω, its Gauss map, and p and q on a raster."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Complex, Float
from scipy.spatial import cKDTree

from spinor_geom.arrays import to_numpy
from spinor_geom.discrete.minimal_surface import discrete_minimal_surface
from spinor_geom.domain.delaunay import flat_coordinates, plane_coordinates, rim_edges
from spinor_geom.errors import SpinorGeomError, UnplacedZerosError, ZeroOnContourError
from spinor_geom.fill.fill_result import LoopOutcome
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.measures import discrete_mean_curvature, distances_to_mesh
from spinor_geom.mesh.operators import vertex_normals
from spinor_geom.meshing.embed import Patch
from spinor_geom.render.camera import Camera
from spinor_geom.render.portrait import grid_lines
from spinor_geom.render.scene import PATCH, Dots, Faces, Layer, Lines, Scale, Scene
from spinor_geom.surface.array_surface import ArraySurface

MEAN = "mean curvature |H| of the mesh, 1/mesh unit"
DISTANCE = "distance to the discrete minimal surface, mesh units"
GAUSS = "Gauss curvature, 1/mesh unit²"
SWITCHES = WIREFRAME, GRID, NORMALS = "wireframe", "conformal grid", "normals"
_NORMAL_LENGTH = 0.8  # in mean edges of the loop
_BALL = 0.97  # radius of the sphere, so that chords between unit normals lie outside
_GRID_COLOUR, _NORMAL_COLOUR, _P_COLOUR, _Q_COLOUR = "#303c4f", "#2f7d4f", "#000000", "#ffffff"
_POLE_COLOUR, _SPHERE_COLOUR, _CIRCLE_COLOUR = "#9b3fc4", "#dfe2e6", "#aab0b8"


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopViews:
    """The patch of a loop that was filled with an exact surface, and the data of its views in the report."""

    outcome: LoopOutcome
    patch: Patch
    surface: ArraySurface
    fields: Mapping[str, Float[np.ndarray, " n"]]  # at the patch's vertices, NaN where unknown
    baseline_figures: dict[str, Any]  # of the discrete minimal surface, or the error instead
    normals: Float[np.ndarray, "n 3"]  # of the surface at the patch's vertices, on the side of the patch's faces

    @property
    def _faces(self) -> Faces:
        return patch_faces(self.patch, self.fields, self.outcome.index)

    def _grid(self, vertices: Float[np.ndarray, "n 3"], *, switch: str | None = None) -> Lines:
        """The image of a square grid in Ω, interpolated between the given positions of the patch's vertices."""
        points, edges = grid_lines(self.patch.points, self.patch.faces, vertices)
        return Lines(vertices=points, edges=edges, colour="#ffffff", halo=_GRID_COLOUR, width=1.6, switch=switch)

    def _boundary(self, vertices: Float[np.ndarray, "n 3"], width: float) -> Lines:
        return Lines(vertices=vertices, edges=rim_edges(self.patch.rims), width=width)

    def in_space(self) -> list[Layer]:
        """The patch in the mesh's space, with its grid and its normals."""
        vertices = self.patch.vertices
        tips = vertices + _NORMAL_LENGTH * self.outcome.loop.mean_edge_length * self.normals
        shown = np.flatnonzero(np.isfinite(tips).all(axis=1))
        ends, pairs = np.concatenate([vertices[shown], tips[shown]]), np.arange(2 * len(shown)).reshape(2, -1).T
        return [
            self._faces,
            self._grid(vertices, switch=GRID),
            Lines(vertices=ends, edges=pairs, colour=_NORMAL_COLOUR, switch=NORMALS),
        ]

    def plane_scene(self, scales: Mapping[str, Scale]) -> Scene:
        """The patch in Ω, its grid, the poles of the network, and the zeros of p and q."""
        plane = flat_coordinates(self.patch.points)
        p_zeros, q_zeros = _zeros(self.surface)
        dots = ((_poles(self.surface), _POLE_COLOUR, 5.0), (p_zeros, _P_COLOUR, 9.0), (q_zeros, _Q_COLOUR, 9.0))
        return Scene(
            title="Ω and its grid; poles of the network violet, zeros of p black, of q white",
            layers=[
                replace(self._faces, vertices=plane),
                self._grid(plane),
                self._boundary(plane, 2.5),
                *(Dots(vertices=flat_coordinates(z), colour=colour, width=size) for z, colour, size in dots if len(z)),
            ],
            camera=Camera.around(plane, np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])),
            scales=scales,
            unit="units of Ω",
            flat=True,
            shape="square",
            panel=True,
        )

    def sphere_scene(self, scales: Mapping[str, Scale]) -> Scene:
        """The image of the Gauss map on the unit sphere, seen along the mean normal."""
        known = np.nan_to_num(self.normals)
        faces = self.patch.faces[np.isfinite(self.normals).all(axis=1)[self.patch.faces].all(axis=1)]
        mean = np.nanmean(self.normals, axis=0)
        size = np.linalg.norm(mean)
        camera = Camera.facing(np.zeros((1, 3)), mean / size if size > 0 else np.array([0.0, 0.0, 1.0]))
        return Scene(
            title="The Gauss map: normals of the patch on the unit sphere",
            layers=[
                *_sphere(),
                replace(self._faces, vertices=1.005 * known, faces=faces),
                self._grid(1.008 * known),
                self._boundary(1.01 * known, 1.2),
            ],
            camera=replace(camera, radius=1.0),
            scales=scales,
            shape="square",
            panel=True,
        )

    def functions(self, pixels: int) -> dict[str, Complex[np.ndarray, "h w"]]:
        """p, q, f = −2q² and g = −p/q at the pixels of a raster over Ω, NaN outside. The longer side has `pixels`."""
        domain = self.surface.domain
        plane = plane_coordinates(self.patch.points)
        step = float(np.ptp(plane, axis=0).max()) / pixels
        x, y = (np.arange(own.min(), own.max(), step) + step / 2 for own in plane.T)
        z = x + 1j * y[:, None]
        inside = domain.contains(z)
        p, q = (np.full(z.shape, np.nan + 0j) for _ in range(2))
        p[inside], q[inside] = np.asarray(self.surface.spinors(z[inside])).T
        with np.errstate(divide="ignore", invalid="ignore"):
            return {"p": p, "q": q, "f": -2 * q * q, "g": -p / q}


def patch_faces(patch: Patch, fields: Mapping[str, Float[np.ndarray, " n"]], loop: int) -> Faces:
    """The patch of a loop in the mesh's space."""
    look = {"edges": WIREFRAME, "loop": str(loop), **PATCH}
    return Faces(vertices=patch.vertices, faces=patch.faces, fields=fields, **look)


def mean_curvature_field(patch: Patch) -> Float[np.ndarray, " n"]:
    """|H| at the vertices of a patch. Boundary vertices have the value of the nearest inner vertex in Ω, or NaN."""
    curvature, points = discrete_mean_curvature(patch.vertices, patch.faces), plane_coordinates(patch.points)
    known = np.isfinite(curvature.values)
    if not known.any():
        return np.full(len(points), np.nan)
    return np.asarray(curvature.values[known][cKDTree(points[curvature.vertices[known]]).query(points)[1]])


def loop_views(outcome: LoopOutcome) -> LoopViews:
    """Measures the patch of an exact surface, and computes the discrete minimal surface for comparison."""
    patch, solution = outcome.patch, outcome.solution
    assert patch is not None
    assert solution is not None
    surface, distance = solution.array_surface, np.full(len(patch.vertices), np.nan)
    curvature = discrete_mean_curvature(patch.vertices, patch.faces)
    figures: dict[str, Any] = {"|H| of the patch": {"max": curvature.max, "rms": curvature.rms}}
    try:
        baseline = discrete_minimal_surface([rim.loop for rim in solution.rims])
        distance = distances_to_mesh(patch.vertices, baseline.vertices, baseline.faces)
        curvature = discrete_mean_curvature(baseline.vertices, baseline.faces)
        figures["discrete minimal surface"] = {
            "area": baseline.area,
            "vertices": len(baseline.vertices),
            "|H| max": curvature.max,
            "|H| rms": curvature.rms,
            "largest distance of a vertex of the patch": float(distance.max()),
            "seconds": baseline.seconds,
        }
    except SpinorGeomError as error:
        figures["discrete minimal surface"] = {"none": str(error)}
    normals = np.asarray(surface.normal(patch.points))
    # the patch may be oriented against Ω. The normals shown are on the side of the patch's faces
    side = np.nansum(vertex_normals(patch.vertices, patch.faces) * normals)
    gauss = np.asarray(surface.gauss_curvature(patch.points))
    return LoopViews(
        outcome=outcome,
        patch=patch,
        surface=surface,
        fields={MEAN: mean_curvature_field(patch), DISTANCE: distance, GAUSS: gauss},
        baseline_figures=figures,
        normals=normals if side >= 0 else -normals,
    )


def _poles(surface: ArraySurface) -> Complex[np.ndarray, " k"]:
    """The poles of a Cauchy network or interpolant, empty for other models."""
    model = surface.model
    if isinstance(model, CauchyNetwork):
        return to_numpy(model.poles)
    if isinstance(model, CauchyInterpolant):
        return to_numpy(model.nodes)
    return np.zeros(0, dtype=np.complex128)


def _zeros(surface: ArraySurface) -> list[Complex[np.ndarray, " _"]]:
    """The zeros of p and of q in Ω, empty if p or q has zeros on ∂Ω, as on a plane, or zeros were not located."""
    try:
        return [np.array([zero.z for zero in zeros], dtype=np.complex128) for zeros in surface.spinor_zeros()]
    except (UnplacedZerosError, ZeroOnContourError):
        return [np.zeros(0, dtype=np.complex128)] * 2


def _sphere() -> list[Layer]:
    """A sphere with circles of latitude and longitude every 30°."""
    ball = trimesh.creation.uv_sphere(radius=_BALL, count=(24, 48))
    t, tilt = np.linspace(0, 2 * np.pi, 49), np.radians(np.arange(30, 181, 30))[:, None]
    level = np.stack([np.sin(tilt) * np.cos(t), np.sin(tilt) * np.sin(t), np.cos(tilt) + 0 * t], axis=-1)
    upright = np.stack([np.cos(tilt) * np.cos(t), np.sin(tilt) * np.cos(t), np.sin(t) + 0 * tilt], axis=-1)
    circles = 1.005 * _BALL * np.concatenate([level, upright])
    number = np.arange(circles.size // 3).reshape(-1, len(t))
    edges = np.stack([number[:, :-1], number[:, 1:]], axis=-1).reshape(-1, 2)
    return [
        Faces(vertices=np.array(ball.vertices), faces=np.array(ball.faces), colour=_SPHERE_COLOUR),
        Lines(vertices=circles.reshape(-1, 3), edges=edges, colour=_CIRCLE_COLOUR, width=1),
    ]
