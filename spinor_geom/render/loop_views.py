"""One loop's patch as it is shown: in space, in Ω, on the sphere of normals, and its functions on a grid."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Complex, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.comparison import MOST_CURVATURE_POINTS
from spinor_geom.discrete.minimal_surface import discrete_minimal_surface
from spinor_geom.domain.delaunay import flat_coordinates, plane_coordinates, rim_successors
from spinor_geom.errors import SpinorGeomError, UnplacedZerosError, ZeroOnContourError
from spinor_geom.fill.fill_result import FillResult, LoopOutcome
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.measures import discrete_mean_curvature, distances_to_mesh
from spinor_geom.mesh.operators import vertex_normals
from spinor_geom.meshing.embed import Patch
from spinor_geom.render.layers import ALWAYS, MESH, PATCH, Camera, Dots, Faces, Layer, Lines
from spinor_geom.render.portrait import facing, grid_lines, whole_mesh
from spinor_geom.surface.spinor_surface import SpinorSurface

MEAN, DISTANCE, GAUSS = "mean curvature", "distance to the discrete minimal surface", "Gauss curvature"
EXACT = "mean curvature of the surface"
COLOURS = {
    MEAN: ("mean curvature |H| of the mesh", "/ mesh unit"),
    EXACT: ("mean curvature |H| of the surface, measured", "/ mesh unit"),
    DISTANCE: (DISTANCE, "mesh units"),
    GAUSS: (GAUSS, "/ mesh unit²"),
}
"""Labels and units of the fields."""
SWITCHES = WIREFRAME, GRID, NORMALS = "wireframe", "conformal grid", "normals"
MOST_FACES = 120_000  # triangles of a mesh that are shown; of a larger one those nearest to its loops
_NORMAL_LENGTH = 0.8  # in edges of the loop
_BALL = 0.97  # its radius: below the triangles between unit normals
_GRID_COLOUR, _NORMAL_COLOUR, _P_COLOUR, _Q_COLOUR = "#303c4f", "#2f7d4f", "#000000", "#ffffff"
_POLE_COLOUR, _SPHERE_COLOUR, _CIRCLE_COLOUR = "#9b3fc4", "#dfe2e6", "#aab0b8"


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopViews:
    """What is shown of a filled loop."""

    outcome: LoopOutcome
    patch: Patch
    surface: SpinorSurface
    fields: Mapping[str, Float[np.ndarray, " n"]]  # at the patch's vertices by name, NaN where there are none
    baseline_figures: Mapping[str, Any]  # of the discrete minimal surface beside it, or why there is none
    normals: Float[np.ndarray, "n 3"]  # of the surface at the patch's vertices, on the side of the patch's faces

    @cached_property
    def _plane(self) -> Float[np.ndarray, "n 3"]:
        """The patch's vertices in Ω, as points of space."""
        return flat_coordinates(self.patch.points)

    def _grid(self, vertices: Float[np.ndarray, "n 3"], *, switch: str | None = None, loop: str = ALWAYS) -> Lines:
        """The image of a square grid in Ω on the patch with its vertices at some place."""
        points, edges = grid_lines(self.patch.points, self.patch.faces, vertices)
        return Lines(
            vertices=points, edges=edges, colour="#ffffff", halo=_GRID_COLOUR, width=1.6, switch=switch, loop=loop
        )

    @property
    def _rim(self) -> Int[np.ndarray, "m 2"]:
        return np.stack([np.arange(self.patch.boundary_size), rim_successors(self.patch.rims)], axis=1)

    def _patch(self, vertices: Float[np.ndarray, "n 3"]) -> Faces:
        return replace(patch_faces(self.patch), vertices=vertices, fields=self.fields)

    def in_space(self) -> list[Layer]:
        """The patch in the mesh's space."""
        vertices = self.patch.vertices
        tips = vertices + _NORMAL_LENGTH * self.outcome.loop.mean_edge_length * self.normals
        shown = np.flatnonzero(np.isfinite(tips).all(axis=1))
        hairs = np.concatenate([vertices[shown], tips[shown]])
        pairs = np.arange(2 * len(shown)).reshape(2, -1).T
        return [
            self._patch(vertices),
            self._grid(vertices, switch=GRID),
            Lines(vertices=hairs, edges=pairs, colour=_NORMAL_COLOUR, switch=NORMALS),
        ]

    def in_plane(self) -> list[Layer]:
        """The patch in Ω, its grid, the poles of the network, and the zeros of p and q."""
        loop = str(self.outcome.index)
        p_zeros, q_zeros = _zeros(self.surface)
        dots = ((_poles(self.surface), _POLE_COLOUR, 5.0), (p_zeros, _P_COLOUR, 9.0), (q_zeros, _Q_COLOUR, 9.0))
        return [
            replace(self._patch(self._plane), loop=loop),
            self._grid(self._plane, loop=loop),
            Lines(vertices=self._plane, edges=self._rim, width=2.5, loop=loop),
            *(Dots(vertices=flat_coordinates(z), colour=c, width=size, loop=loop) for z, c, size in dots if len(z)),
        ]

    @property
    def plane_camera(self) -> Camera:
        """Looks at Ω from above."""
        return whole_mesh(self._plane, np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]))

    def on_sphere(self) -> list[Layer]:
        """The unit normals of the patch on the unit sphere, with its circles of latitude and longitude."""
        loop = str(self.outcome.index)
        known = np.nan_to_num(self.normals)
        whole = np.isfinite(self.normals).all(axis=1)[self.patch.faces].all(axis=1)
        image = replace(self._patch(1.005 * known), faces=self.patch.faces[whole], loop=loop)
        return [
            *_sphere(loop),
            image,
            self._grid(1.008 * known, loop=loop),
            Lines(vertices=1.01 * known, edges=self._rim, width=1.2, loop=loop),
        ]

    @property
    def sphere_camera(self) -> Camera:
        """Looks at the middle of the Gauss map's image."""
        mean = np.nanmean(self.normals, axis=0)
        size = np.linalg.norm(mean)
        direction, up = facing(mean / size if size > 0 else np.array([0.0, 0.0, 1.0]))
        return Camera(focus=np.zeros(3), direction=direction, up=up, radius=1.0)

    def functions(self, pixels: int) -> dict[str, Complex[np.ndarray, "h w"]]:
        """p, q, f = −2q² and g = −p/q at the middles of square cells over Ω, so many along its longer side, or NaN."""
        domain = self.surface.domain
        low, high = self._plane.min(axis=0), self._plane.max(axis=0)
        step = float((high - low).max()) / pixels
        x, y = (np.arange(a, b, step) + step / 2 for a, b in zip(low[:2], high[:2], strict=True))
        z = x + 1j * y[:, None]
        inside = domain.contains(z)
        p, q = (np.full(z.shape, np.nan + 0j) for _ in range(2))
        p[inside], q[inside] = np.asarray(self.surface.spinors(z[inside])).T
        with np.errstate(divide="ignore", invalid="ignore"):
            return {"p": p, "q": q, "f": -2 * q * q, "g": -p / q}


def patch_faces(patch: Patch, *, measured: bool = False) -> Faces:
    """A patch in the mesh's space; with its discrete mean curvature as a field where it is to be measured."""
    fields: dict[str, Float[np.ndarray, " n"]] = {}
    if measured:
        curvature = discrete_mean_curvature(patch.vertices, patch.faces)
        fields[MEAN] = _nearest_known(curvature.values, patch, curvature.vertices)
    return Faces(vertices=patch.vertices, faces=patch.faces, edges=WIREFRAME, fields=fields, **PATCH)


def loop_views(outcome: LoopOutcome, *, exact: bool = False) -> LoopViews:
    """What is shown of a loop with an exact surface, its |H| by automatic differentiation too: that takes seconds."""
    patch, solution = outcome.patch, outcome.solution
    assert patch is not None
    assert solution is not None
    surface, distance = solution.surface, np.full(len(patch.vertices), np.nan)
    curvature = discrete_mean_curvature(patch.vertices, patch.faces)
    figures: dict[str, Any] = {"|H| of the patch": {"max": curvature.max, "rms": curvature.rms}}
    try:
        baseline = discrete_minimal_surface([rim.loop for rim in solution.rims])
        distance = distances_to_mesh(patch.vertices, baseline.vertices, baseline.faces)
        baseline_curvature = discrete_mean_curvature(baseline.vertices, baseline.faces)
        figures["discrete minimal surface"] = {
            "area": baseline.area,
            "vertices": len(baseline.vertices),
            "|H| max": baseline_curvature.max,
            "|H| rms": baseline_curvature.rms,
            "largest distance of a vertex of the patch": float(distance.max()),
            "seconds": baseline.seconds,
        }
    except SpinorGeomError as error:
        figures["discrete minimal surface"] = {"none": str(error)}
    normals = np.asarray(surface.normal(patch.points))
    # the patch may lie the other way round than Ω: its normals are to point out of the mesh
    side = np.nansum(vertex_normals(patch.vertices, patch.faces) * normals)
    return LoopViews(
        outcome=outcome,
        patch=patch,
        surface=surface,
        fields={
            MEAN: _nearest_known(curvature.values, patch, curvature.vertices),
            DISTANCE: distance,
            GAUSS: np.asarray(surface.gauss_curvature(patch.points)),
            **({EXACT: _measured(surface, patch)} if exact else {}),
        },
        baseline_figures=figures,
        normals=normals if side >= 0 else -normals,
    )


def surroundings(result: FillResult) -> tuple[list[Layer], int]:
    """The open mesh and its rims, and how many triangles, far from all loops, are left out of a very large one."""
    mesh, loops = result.original, [outcome.loop for outcome in result.loops]
    faces, left_out = mesh.faces, max(len(mesh.faces) - MOST_FACES, 0)
    if left_out:
        near = np.concatenate([loop.points for loop in loops]) if loops else mesh.vertices[:1]
        distance = cKDTree(near).query(mesh.vertices[faces].mean(axis=1))[0]
        faces = faces[np.sort(np.argpartition(distance, MOST_FACES)[:MOST_FACES])]
    used, renumbered = np.unique(faces, return_inverse=True)
    shown = Faces(vertices=mesh.vertices[used], faces=renumbered.reshape(-1, 3), edges=WIREFRAME, **MESH)
    layers: list[Layer] = [shown]
    if loops:
        points = np.concatenate([loop.points for loop in loops])
        edges = np.stack([np.arange(len(points)), rim_successors(tuple(len(loop) for loop in loops))], axis=1)
        layers.append(Lines(vertices=points, edges=edges, width=2.5))
    return layers, left_out


def _measured(surface: SpinorSurface, patch: Patch) -> Float[np.ndarray, " n"]:
    """|H| of the surface at inner vertices of the patch, all or some evenly spread; elsewhere that of the nearest."""
    inner = np.arange(patch.boundary_size, len(patch.points))
    some = inner[np.unique(np.linspace(0, len(inner) - 1, MOST_CURVATURE_POINTS).astype(int))] if len(inner) else inner
    return _nearest_known(np.abs(np.asarray(surface.mean_curvature(patch.points[some]))), patch, some)


def _nearest_known(
    values: Float[np.ndarray, " k"], patch: Patch, vertices: Int[np.ndarray, " k"]
) -> Float[np.ndarray, " n"]:
    """For each vertex of a patch the value at the nearest one in Ω of those that have one; NaN where none has."""
    known, points = vertices[np.isfinite(values)], plane_coordinates(patch.points)
    if not len(known):
        return np.full(len(points), np.nan)
    return np.asarray(values[np.isfinite(values)][cKDTree(points[known]).query(points)[1]])


def _poles(surface: SpinorSurface) -> Complex[np.ndarray, " k"]:
    """The poles of the units that p and q are made of; power series and exponential networks have none."""
    model = surface.model
    if isinstance(model, CauchyNetwork):
        return np.asarray(model.poles.detach().cpu().resolve_conj().numpy())
    if isinstance(model, CauchyInterpolant):
        return np.asarray(model.nodes.detach().cpu().resolve_conj().numpy())
    return np.zeros(0, dtype=np.complex128)


def _zeros(surface: SpinorSurface) -> list[Complex[np.ndarray, " k"]]:
    """The zeros of p and those of q in Ω; none where p or q vanishes on its boundary, as on a plane."""
    try:
        return [np.array([zero.z for zero in zeros], dtype=np.complex128) for zeros in surface.spinor_zeros()]
    except (UnplacedZerosError, ZeroOnContourError):
        return [np.zeros(0, dtype=np.complex128)] * 2


def _sphere(loop: str) -> list[Layer]:
    """The unit sphere with its circles of latitude and longitude, every 30°."""
    ball = trimesh.creation.uv_sphere(radius=_BALL, count=(24, 48))
    t, tilt = np.linspace(0, 2 * np.pi, 49), np.radians(np.arange(30, 181, 30))[:, None]
    level = np.stack([np.sin(tilt) * np.cos(t), np.sin(tilt) * np.sin(t), np.cos(tilt) + 0 * t], axis=-1)
    upright = np.stack([np.cos(tilt) * np.cos(t), np.sin(tilt) * np.cos(t), np.sin(t) + 0 * tilt], axis=-1)
    circles = 1.005 * _BALL * np.concatenate([level, upright])
    number = np.arange(circles.size // 3).reshape(-1, len(t))
    edges = np.stack([number[:, :-1], number[:, 1:]], axis=-1).reshape(-1, 2)
    return [
        Faces(vertices=np.array(ball.vertices), faces=np.array(ball.faces), colour=_SPHERE_COLOUR, loop=loop),
        Lines(vertices=circles.reshape(-1, 3), edges=edges, colour=_CIRCLE_COLOUR, width=1, loop=loop),
    ]
