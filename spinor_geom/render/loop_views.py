"""One loop's patch as it is shown: in space, in Ω, on the sphere of normals, and its functions on a grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.comparison import MOST_CURVATURE_POINTS
from spinor_geom.discrete.minimal_surface import discrete_minimal_surface
from spinor_geom.domain.delaunay import plane_coordinates, rim_successors
from spinor_geom.errors import SpinorGeomError, ZeroOnContourError
from spinor_geom.fill.result import FillResult, LoopOutcome
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.measures.hausdorff import distances_to_mesh
from spinor_geom.measures.mean_curvature import discrete_mean_curvature
from spinor_geom.meshing.embed import Patch
from spinor_geom.render.colours import INSIDE_COLOUR, MESH_COLOUR, PATCH_COLOUR, RIM_COLOUR
from spinor_geom.render.layers import ALWAYS, Camera, Dots, Faces, Layer, Lines
from spinor_geom.surface.spinor_surface import SpinorSurface

MEAN, DISTANCE, GAUSS = "mean curvature", "distance to the discrete minimal surface", "Gauss curvature"
EXACT = "mean curvature of the surface"
GRID, NORMALS = "conformal grid", "normals"
# triangles of a mesh that are shown; of a larger one those nearest to its loops
MOST_FACES = 120_000
_GRID_LINES = 14  # across the longer side of Ω
_NORMAL_LENGTH = 0.8  # in edges of the loop
_MARGIN = 1.1
_GRID_COLOUR, _NORMAL_COLOUR, _P_COLOUR, _Q_COLOUR = "#303c4f", "#2f7d4f", "#000000", "#ffffff"
_POLE_COLOUR, _SPHERE_COLOUR, _CIRCLE_COLOUR = "#9b3fc4", "#dfe2e6", "#aab0b8"


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopViews:
    """What is shown of a filled loop.

    Attributes:
        outcome: the loop's.
        patch: its mesh.
        surface: its surface.
        fields: values at the patch's vertices by name, NaN where there are none.
        baseline_figures: of the discrete minimal surface beside it; a reason where there is none.
        normals: of the surface at the patch's vertices, on the side of the patch's faces.
    """

    outcome: LoopOutcome
    patch: Patch
    surface: SpinorSurface
    fields: Mapping[str, Float[np.ndarray, " n"]]
    baseline_figures: Mapping[str, Any]
    normals: Float[np.ndarray, "n 3"]

    @cached_property
    def _plane(self) -> Float[np.ndarray, "n 3"]:
        """The patch's vertices in Ω, as points of space."""
        z = self.patch.points
        return np.stack([z.real, z.imag, np.zeros(len(z))], axis=1)

    @cached_property
    def _grid(self) -> LevelLines:
        z = self.patch.points
        step = max(np.ptp(z.real), np.ptp(z.imag)) / _GRID_LINES
        return LevelLines.of(z.real, self.patch.faces, step).followed_by(LevelLines.of(z.imag, self.patch.faces, step))

    @property
    def _rim(self) -> Int[np.ndarray, "m 2"]:
        return np.stack([np.arange(self.patch.boundary_size), rim_successors(self.patch.rims)], axis=1)

    def in_space(self, *, edges: str) -> list[Layer]:
        """The patch in the mesh's space; its edges are shown by a switch of that name."""
        vertices = self.patch.vertices
        tips = vertices + _NORMAL_LENGTH * self.outcome.loop.mean_edge_length * self.normals
        shown = np.flatnonzero(np.isfinite(tips).all(axis=1))
        hairs = np.concatenate([vertices[shown], tips[shown]])
        pairs = np.arange(2 * len(shown)).reshape(2, -1).T
        return [
            patch_faces(self.patch, edges=edges, fields=self.fields),
            self._grid.lines(vertices),
            Lines(vertices=hairs, edges=pairs, colour=_NORMAL_COLOUR, switch=NORMALS),
        ]

    def in_plane(self, *, edges: str) -> list[Layer]:
        """The patch in Ω, its grid, the poles of the network, and the zeros of p and q."""
        loop = str(self.outcome.index)
        p_zeros, q_zeros = _zeros(self.surface)
        dots = ((_poles(self.surface), _POLE_COLOUR, 5.0), (p_zeros, _P_COLOUR, 9.0), (q_zeros, _Q_COLOUR, 9.0))
        patch = Faces(
            vertices=self._plane,
            faces=self.patch.faces,
            colour=PATCH_COLOUR,
            fields=self.fields,
            edges=edges,
            loop=loop,
        )
        return [
            patch,
            self._grid.lines(self._plane, loop=loop, switch=None),
            Lines(vertices=self._plane, edges=self._rim, colour=RIM_COLOUR, width=2.5, loop=loop),
            *(
                Dots(vertices=np.stack([z.real, z.imag, np.zeros(len(z))], axis=1), colour=colour, size=size, loop=loop)
                for z, colour, size in dots
                if len(z)
            ),
        ]

    @property
    def plane_camera(self) -> Camera:
        """Looks at Ω from above."""
        low, high = self._plane.min(axis=0), self._plane.max(axis=0)
        return Camera(
            focus=(low + high) / 2,
            direction=np.array([0.0, 0.0, 1.0]),
            up=np.array([0.0, 1.0, 0.0]),
            radius=_MARGIN * float((high - low).max()) / 2,
        )

    def on_sphere(self, *, edges: str) -> list[Layer]:
        """The unit normals of the patch on the unit sphere, with its circles of latitude and longitude."""
        loop = str(self.outcome.index)
        known = np.nan_to_num(self.normals)
        whole = np.isfinite(self.normals).all(axis=1)[self.patch.faces].all(axis=1)
        image = Faces(
            vertices=1.005 * known,
            faces=self.patch.faces[whole],
            colour=PATCH_COLOUR,
            fields=self.fields,
            edges=edges,
            loop=loop,
        )
        return [
            *_sphere(loop),
            image,
            self._grid.lines(1.008 * known, loop=loop, switch=None),
            Lines(vertices=1.01 * known, edges=self._rim, colour=RIM_COLOUR, width=1.2, loop=loop),
        ]

    @property
    def sphere_camera(self) -> Camera:
        """Looks at the middle of the Gauss map's image."""
        mean = np.nanmean(self.normals, axis=0)
        size = np.linalg.norm(mean)
        direction = mean / size if size > 0 else np.array([0.0, 0.0, 1.0])
        side = np.cross(np.eye(3)[int(np.argmin(np.abs(direction)))], direction)
        up = np.cross(direction, side / np.linalg.norm(side))
        return Camera(focus=np.zeros(3), direction=direction, up=up, radius=_MARGIN)

    def functions(self, pixels: int) -> dict[str, Complex[np.ndarray, "h w"]]:
        """p, q, f = −2q² and g = −p/q at the middles of square cells over Ω; NaN outside.

        Args:
            pixels: cells along the longer side.
        """
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


def patch_faces(patch: Patch, *, edges: str, fields: Mapping[str, Float[np.ndarray, " n"]] | None = None) -> Faces:
    """A patch in the mesh's space; its edges are shown by a switch of that name."""
    return Faces(vertices=patch.vertices, faces=patch.faces, colour=PATCH_COLOUR, fields=fields or {}, edges=edges)


def loop_views(outcome: LoopOutcome, *, exact: bool = False) -> LoopViews:
    """What is shown of a loop that is filled with an exact minimal surface.

    Args:
        outcome: of that loop.
        exact: whether to measure |H| of the surface itself too, by automatic differentiation: it takes seconds.
    """
    patch, solution = outcome.patch, outcome.solution
    assert patch is not None
    assert solution is not None
    surface, none = solution.surface, np.full(len(patch.vertices), np.nan)
    mean = none.copy()
    curvature = discrete_mean_curvature(patch.vertices, patch.faces)
    mean[curvature.vertices] = curvature.values
    figures: dict[str, Any] = {"|H| of the patch": {"max": curvature.max, "rms": curvature.rms}}
    distance = none
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
    corners = patch.vertices[patch.faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # the patch may lie the other way round than Ω: its normals are to point out of the mesh
    side = np.nansum(facing * normals[patch.faces[:, 0]])
    return LoopViews(
        outcome=outcome,
        patch=patch,
        surface=surface,
        fields={
            MEAN: _continued(mean, patch.faces),
            DISTANCE: distance,
            GAUSS: np.asarray(surface.gauss_curvature(patch.points)),
            **({EXACT: _measured(surface, patch)} if exact else {}),
        },
        baseline_figures=figures,
        normals=normals if side >= 0 else -normals,
    )


def surroundings(result: FillResult, *, edges: str) -> tuple[list[Layer], int]:
    """The open mesh and its rims, and how many triangles, far from all loops, are left out of a very large one."""
    mesh, loops = result.original, [outcome.loop for outcome in result.loops]
    faces, left_out = mesh.faces, max(len(mesh.faces) - MOST_FACES, 0)
    if left_out and loops:
        tree = cKDTree(np.concatenate([loop.points for loop in loops]))
        distance = tree.query(mesh.vertices[mesh.faces].mean(axis=1))[0]
        faces = faces[np.sort(np.argpartition(distance, MOST_FACES)[:MOST_FACES])]
    elif left_out:
        faces = faces[:MOST_FACES]
    used, renumbered = np.unique(faces, return_inverse=True)
    layers: list[Layer] = [
        Faces(
            vertices=mesh.vertices[used],
            faces=renumbered.reshape(-1, 3),
            colour=MESH_COLOUR,
            inside=INSIDE_COLOUR,
            edges=edges,
        )
    ]
    if loops:
        starts = np.cumsum([0, *(len(loop) for loop in loops)]).tolist()
        rims = [
            start + np.stack([np.arange(len(loop)), np.roll(np.arange(len(loop)), -1)], axis=1)
            for loop, start in zip(loops, starts, strict=False)
        ]
        points = np.concatenate([loop.points for loop in loops])
        layers.append(Lines(vertices=points, edges=np.concatenate(rims), colour=RIM_COLOUR, width=2.5))
    return layers, left_out


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelLines:
    """Where a function that is linear on each triangle takes some values: straight pieces, one in a triangle.

    Attributes:
        edges: (k, 2, 2) the edge of the mesh on which each end of a piece lies.
        shares: (k, 2) where on that edge, from its first vertex, 0 to 1.
    """

    edges: Int[np.ndarray, "k 2 2"]
    shares: Float[np.ndarray, "k 2"]

    @classmethod
    def of(cls, values: Float[np.ndarray, " n"], faces: Int[np.ndarray, "f 3"], step: float) -> LevelLines:
        """The lines at multiples of a step, counted from the middle of the values."""
        level = (values - (values.min() + values.max()) / 2) / step
        edges, shares = [], []
        for height in np.arange(np.ceil(level.min()), np.floor(level.max()) + 1):
            above: Bool[np.ndarray, "f 3"] = level[faces] > height
            cut = faces[above.any(axis=1) & ~above.all(axis=1)]
            sides = np.stack([cut, np.roll(cut, -1, axis=1)], axis=2)
            crossed = sides[(level[sides] > height).sum(axis=2) == 1].reshape(-1, 2, 2)
            low, high = level[crossed[..., 0]], level[crossed[..., 1]]
            edges.append(crossed)
            shares.append((height - low) / (high - low))
        none = np.zeros((0, 2, 2), dtype=np.int64)
        return cls(
            edges=np.concatenate([none, *edges]), shares=np.concatenate([none[:, 0].astype(np.float64), *shares])
        )

    def followed_by(self, other: LevelLines) -> LevelLines:
        """These lines and others of the same mesh."""
        return LevelLines(
            edges=np.concatenate([self.edges, other.edges]), shares=np.concatenate([self.shares, other.shares])
        )

    def lines(self, vertices: Float[np.ndarray, "n 3"], *, loop: str = ALWAYS, switch: str | None = GRID) -> Lines:
        """The lines on the mesh with its vertices at some place."""
        start, end = vertices[self.edges[..., 0]], vertices[self.edges[..., 1]]
        points = (start + self.shares[..., None] * (end - start)).reshape(-1, 3)
        pairs = np.arange(len(points)).reshape(-1, 2)
        look: dict[str, Any] = {"colour": "#ffffff", "halo": _GRID_COLOUR, "width": 1.6}
        return Lines(vertices=points, edges=pairs, switch=switch, loop=loop, **look)


def _measured(surface: SpinorSurface, patch: Patch) -> Float[np.ndarray, " n"]:
    """|H| of the surface at inner vertices of the patch, all or some evenly spread; elsewhere that of the nearest."""
    inner = np.arange(patch.boundary_size, len(patch.points))
    if not len(inner):
        return np.full(len(patch.points), np.nan)
    some = inner[np.unique(np.linspace(0, len(inner) - 1, MOST_CURVATURE_POINTS).astype(int))]
    values = np.abs(np.asarray(surface.mean_curvature(patch.points[some])))
    _, nearest = cKDTree(plane_coordinates(patch.points[some])).query(plane_coordinates(patch.points))
    return np.asarray(values[nearest])


def _continued(values: Float[np.ndarray, " n"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " n"]:
    """Values at the rim too: the mean of those of the neighbours that have some."""
    known = np.isfinite(values)
    sides = np.concatenate([faces, faces[:, ::-1]])
    pairs = np.concatenate([np.stack([sides, np.roll(sides, -1, axis=1)], axis=2).reshape(-1, 2)])
    pairs = np.unique(pairs[known[pairs[:, 1]] & ~known[pairs[:, 0]]], axis=0)
    count = np.bincount(pairs[:, 0], minlength=len(values))
    total = np.bincount(pairs[:, 0], weights=values[pairs[:, 1]], minlength=len(values))
    return np.where(known | (count == 0), values, total / np.maximum(count, 1))


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
    except ZeroOnContourError:
        return [np.zeros(0, dtype=np.complex128)] * 2


def _sphere(loop: str) -> list[Layer]:
    """The unit sphere with its circles of latitude and longitude, every 30°."""
    across, around = 24, 48
    t, s = np.meshgrid(np.linspace(0, np.pi, across + 1), np.linspace(0, 2 * np.pi, around + 1), indexing="ij")
    points = np.stack([np.sin(t) * np.cos(s), np.sin(t) * np.sin(s), np.cos(t)], axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(t.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)])
    level, upright = number[4:-4:4], number[:, :-1:4]
    circles = np.concatenate(
        [
            np.stack([level[:, :-1], level[:, 1:]], axis=-1).reshape(-1, 2),
            np.stack([upright[:-1], upright[1:]], axis=-1).reshape(-1, 2),
        ]
    )
    return [
        Faces(vertices=0.995 * points, faces=faces, colour=_SPHERE_COLOUR, loop=loop),
        Lines(vertices=points, edges=circles, colour=_CIRCLE_COLOUR, width=1, loop=loop),
    ]
