"""What is measured: loops whose minimal surface is known, and meshes with holes, known ones, odd ones, mesh files."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cache, cached_property, lru_cache, partial
from pathlib import Path
from typing import Literal, cast

import numpy as np
import trimesh
from jaxtyping import Float, Int
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline
from scipy.spatial.distance import pdist

from spinor_geom import gallery
from spinor_geom.adapters import read_mesh
from spinor_geom.adapters.mesh_files import FORMATS
from spinor_geom.discrete.minimal_surface import discrete_minimal_surface
from spinor_geom.errors import OptionError, SpinorGeomError
from spinor_geom.gallery.chart import Chart
from spinor_geom.gallery.curves import trigonometric
from spinor_geom.gallery.known import KnownCurve, KnownPatch, KnownSurface, surface_chart
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.interpolation import by_arcs
from spinor_geom.mesh.operators import vertex_normals
from spinor_geom.mesh.topology import boundary_edges
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.plateau.solve import solve_plateau

Kind = Literal["smooth", "corners", "plane"]
Sampling = Literal["formula", "even", "uneven"]
_DIAMETER_POINTS = 512
_SEED = 0  # of uneven edges
_ROUNDING = 1e-12  # nothing comes nearer that matters
_COLLAR = math.sqrt(0.75)  # width of a collar per edge of the rim: the height of an equilateral triangle
_GRID = 12  # of the squares of odd rims, on a side


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A known minimal disk and its boundary; smooth ones are sampled as a formula runs, evenly, or at random steps."""

    kind: Kind
    known: KnownCurve | KnownSurface | KnownPatch
    sampling: Sampling = "formula"

    @property
    def area(self) -> float:
        """The exact area."""
        return self.known.disks[0].area if isinstance(self.known, KnownCurve) else self.known.area

    def loop(self, n: int) -> BoundaryLoop:
        """A loop of n points."""
        known = self.known
        if self.sampling == "formula" or isinstance(known, KnownPatch):
            return known.sample(n) if isinstance(known, KnownCurve) else known.rim(n)
        if self.sampling == "even":
            return gallery.evenly_sampled(known, n)
        return gallery.unevenly_sampled(known, n, seed=_SEED)

    @cached_property
    def chart(self) -> Chart:
        """The exact surface; where only the area is known a solution of the curve's formula by power series instead."""
        if self.known.chart is not None:
            return self.known.chart
        surface = solve_plateau(self.known, model="series").surface
        return surface_chart(surface, lambda z: np.asarray(surface.position(z)))

    @cached_property
    def diameter(self) -> float:
        """Largest distance of two points of the loop."""
        return float(pdist(self.loop(_DIAMETER_POINTS).points).max())


_STAR = np.exp(2j * np.pi * np.arange(10) / 10) * np.where(np.arange(10) % 2, 0.45, 1.0)

KNOWN: Mapping[str, tuple[Kind, Callable[[], KnownCurve | KnownSurface | KnownPatch]]] = {
    "enneper-0.5": ("smooth", lambda: gallery.enneper(0.5)),
    "enneper-0.8": ("smooth", lambda: gallery.enneper(0.8)),
    "enneper-0.95": ("smooth", lambda: gallery.enneper(0.95)),
    "henneberg": ("smooth", gallery.henneberg),
    "random-0": ("smooth", lambda: gallery.random_polynomial(0)),
    "random-1": ("smooth", lambda: gallery.random_polynomial(1)),
    "random-2": ("smooth", lambda: gallery.random_polynomial(2, degree=6)),
    "twisted-circle": ("smooth", gallery.twisted_circle),
    "tennis-seam": ("smooth", lambda: gallery.tennis_seam(0.8)),
    "plane-ellipse": ("plane", lambda: gallery.ellipse(2.0)),
    "plane-square": ("plane", lambda: gallery.plane_polygon([(0, 0), (1, 0), (1, 1), (0, 1)], name="plane square")),
    "plane-l": ("plane", gallery.l_shape),
    "plane-star": (
        "plane",
        lambda: gallery.plane_polygon([(z.real, z.imag) for z in _STAR.tolist()], name="plane star"),
    ),
    "catenoid": ("corners", lambda: gallery.catenoid(0.5, turn=math.pi)),
    "helicoid": ("corners", lambda: gallery.helicoid(turn=math.pi)),
    "associate-45": ("corners", lambda: gallery.associate(math.pi / 4)),
    "scherk": ("corners", lambda: gallery.scherk(2.0)),
    "schwarz-d-quad": ("corners", gallery.schwarz_d_quadrilateral),
    "schwarz-d-hexagon": ("corners", gallery.schwarz_d_hexagon),
    "schwarz-p-quad": ("corners", gallery.schwarz_p_quadrilateral),
    "schwarz-p-hexagon": ("corners", gallery.schwarz_p_hexagon),
    "schwarz-prism": ("corners", lambda: gallery.schwarz_prism(0.7)),
    "schwarz-prism-tall": ("corners", lambda: gallery.schwarz_prism(1.5)),
    "schwarz-h": ("corners", lambda: gallery.schwarz_h(0.3)),
}
"""The cases with a known answer; "random-SEED" makes more, of degree 4."""

SAMPLED = tuple(
    f"{name}@{sampling}" for name, (kind, _) in KNOWN.items() if kind == "smooth" for sampling in ("even", "uneven")
)
"""The smooth ones with points that a formula's parameter does not favour."""


def known_kind(name: str) -> Kind:
    """Whether a known case is smooth, has corners or is plane."""
    return KNOWN[base][0] if (base := name.partition("@")[0]) in KNOWN else "smooth"


@lru_cache(maxsize=4)
def known_case(name: str) -> Case:
    """The case of a name, or an OptionError; "NAME@even" and "NAME@uneven" are smooth ones in that sampling."""
    base, at, sampling = name.partition("@")
    head, _, seed = base.partition("-")
    if base in KNOWN:
        kind, make = KNOWN[base]
    elif head == "random" and seed.isdigit():
        kind, make = "smooth", partial(gallery.random_polynomial, int(seed))
    else:
        raise OptionError(f"there is no case {name!r}; choose from: {', '.join(KNOWN)}, random-SEED")
    if at and (sampling not in ("even", "uneven") or kind != "smooth"):
        raise OptionError(f"there is no case {name!r}; smooth cases have the samplings @even and @uneven")
    return Case(kind=kind, known=make(), sampling=cast(Sampling, sampling or "formula"))


def points_limit(case: Case, n: int) -> float | None:
    """Least relative error of the area of minimal surfaces over usual interpolants of a smooth case's points, if any.

    The interpolants know nothing but the points: the trigonometric polynomial where the points are equal steps of a
    parameter, and the periodic splines of degree 5 and 7 by arc length. Each is solved as a curve in formulas.
    """
    points = case.loop(n).points
    errors: list[float] = []
    for curve in _interpolants(points, equal_steps=case.sampling != "uneven"):
        with suppress(SpinorGeomError):  # it winds too much between the points
            errors.append(abs(solve_plateau(curve, model="series").area / case.area - 1))
        if errors and errors[-1] < _ROUNDING:
            break
    return min(errors, default=None)


def _interpolants(points: Float[np.ndarray, "n 3"], *, equal_steps: bool) -> Iterator[ClosedCurve]:
    if equal_steps:
        yield trigonometric(points)
    around = np.vstack([points, points[:1]])
    for degree in (7, 5):
        spline = make_interp_spline(by_arcs(points), around, k=degree, bc_type="periodic")
        spline.extrapolate = "periodic"
        yield ClosedCurve(point=spline, derivative=spline.derivative(), second_derivative=spline.derivative(2))


@dataclass(frozen=True, kw_only=True, eq=False)
class Hole:
    """A mesh with one or more rims to be closed; its other boundaries, which are longer, are to be left open."""

    name: str
    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    rim: Int[np.ndarray, " r"]  # ids of the rims' vertices
    expected: str = ""  # what a tool should do, where it is not to close the rims
    facing: bool = False  # whether its two rims face each other: a tool that can join rims is to join them
    area: float | None = None  # of the minimal surface over the rims, where it is known

    @cached_property
    def edges(self) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "o 2"]]:
        """The boundary edges to be closed, and those to be left open."""
        edges = boundary_edges(self.faces)
        ours = np.isin(edges, self.rim).all(axis=1)
        return edges[ours], edges[~ours]

    @cached_property
    def loops(self) -> list[BoundaryLoop]:
        """All boundary loops, longest first."""
        return find_boundary_loops(TriangleMesh(self.vertices, self.faces))

    @cached_property
    def places(self) -> list[int]:
        """Which of the loops are rims to be closed."""
        return [place for place, loop in enumerate(self.loops) if np.isin(loop.vertex_ids, self.rim).all()]

    @cached_property
    def edge_limit(self) -> int:
        """The edges of all rims together, which some tools walk around as one; less where other boundaries have as few.

        Those shorter than a rim cannot be told from it, and are closed with it.
        """
        inner = [len(self.loops[place]) for place in self.places]
        outer = [len(loop) for place, loop in enumerate(self.loops) if place not in self.places]
        return min([sum(inner), *(count - 1 for count in outer if count > max(inner))])

    @cached_property
    def mean_edge(self) -> float:
        """Mean length of the edges to be closed."""
        start, end = self.vertices[self.edges[0]].swapaxes(0, 1)
        return float(np.linalg.norm(end - start, axis=1).mean())


def hole_over(name: str, loop: BoundaryLoop, area: float | None = None) -> Hole:
    """A collar one triangle wide around a loop that goes on as the discrete minimal surface over it ends."""
    disk = discrete_minimal_surface(loop)
    tangent = np.roll(loop.points, -1, axis=0) - np.roll(loop.points, 1, axis=0)
    outward = np.cross(tangent, vertex_normals(disk.vertices, disk.faces)[: len(loop)])
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    outer = loop.points + _COLLAR * loop.mean_edge_length * outward
    return replace(collar(name, loop.points, outer), area=area)


def collar(name: str, rim: Float[np.ndarray, "n 3"], outer: Float[np.ndarray, "n 3"], *, expected: str = "") -> Hole:
    """Triangles between a rim and an outer curve, which gets one point more, so that tools can tell them."""
    n = len(rim)
    outer = np.insert(outer, 1, (outer[0] + outer[1]) / 2, axis=0)
    i = np.arange(n)
    after = (i + 1) % n
    across = np.append(n, n + 2 + np.arange(n - 1))
    first = np.stack([i, across, across[after]], axis=1)
    second = np.stack([i, across[after], after], axis=1)
    split = np.array([[0, n, n + 1], [0, n + 1, n + 2]])
    faces = np.concatenate([first[1:], second, split])
    return Hole(name=name, vertices=np.concatenate([rim, outer]), faces=faces, rim=i, expected=expected)


@cache
def odd_holes() -> Mapping[str, Hole]:
    """Rims that are no ordinary holes, and those of other projects' tests, rebuilt from what they say."""
    return {hole.name: hole for hole in _odd()}


def _odd() -> Iterator[Hole]:
    t = 2 * np.pi * (np.arange(64) + 0.5) / 64
    # it crosses itself in the middle of two edges
    eight = np.stack([np.sin(t), np.sin(2 * t) / 2, 0 * t], axis=1)
    yield _upright("figure-eight", eight, "bounds no embedded disk")
    t = 2 * np.pi * np.arange(48) / 48
    r = 2 + np.cos(3 * t)
    trefoil = np.stack([r * np.cos(2 * t), r * np.sin(2 * t), np.sin(3 * t)], axis=1)
    yield _upright("knot", trefoil, "every disk over it crosses itself")
    cells = [(x, y) for x, y in _square(3, 9) if not (x in (5, 6) and y in (5, 6))]
    yield _pierced("island", cells, "one patch with a hole for the island")
    # cut open along a line: a rim of zero width
    vertices, faces = _plane()
    line = [_GRID // 2 * (_GRID + 1) + x for x in range(3, 10)]
    copies = np.arange(len(vertices))
    copies[line[1:-1]] = len(vertices) + np.arange(len(line) - 2)
    above = vertices[faces].mean(axis=1)[:, 1] > _GRID // 2
    faces[above] = copies[faces[above]]
    points, rim = np.concatenate([vertices, vertices[line[1:-1]]]), np.array([*line, *copies[line[1:-1]]])
    yield Hole(name="slit", vertices=points, faces=faces, rim=rim, expected="merge its sides: there is nothing to fill")
    for height in (0.5, 0.6, 0.7):
        yield facing_rims(height)
    # holes that the test suites of PMP, MeshLib, trimesh and CGAL fill
    t, i = 2 * np.pi * np.arange(8) / 8, np.arange(8)
    cone = np.concatenate([np.stack([np.cos(t), np.sin(t), 0 * t], axis=1), [[0, 0, 1.5]]])
    # PMP: a cone of radius 1 and height 1.5 without its base
    yield all_rims("open-cone", cone, np.stack([i, (i + 1) % 8, np.full(8, 8)], axis=1), "one flat patch")
    # MeshLib: a coarse torus less one triangle
    ring = trimesh.creation.torus(2.0, 1.0, major_sections=10, minor_sections=10)
    yield all_rims("torus-window", ring.vertices, ring.faces[1:], "one triangle")
    # MeshLib: a prism less three triangles: rims of three and four edges with two common vertices
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]]
    ends, sides = [[0, 2, 1], [3, 4, 5]], [[0, 1, 3], [2, 5, 4], [2, 3, 5]]
    yield all_rims("prism", corners, ends + sides, "two patches of one and two triangles")
    # MeshLib: two triangles at distance 1, to be joined by a prism's sides
    yield replace(all_rims("facing-triangles", corners, ends, "the three sides of a prism, or refused"), facing=True)
    # trimesh: a cube less its first and last triangle
    box = trimesh.creation.box()
    yield all_rims("holey-cube", box.vertices, box.faces[1:-1], "one triangle in each of two sides")
    # CGAL: a closed mesh less two neighbouring triangles
    ball = trimesh.creation.icosphere(2)
    beside = (np.isin(ball.faces, ball.faces[0]).sum(axis=1) == 2).nonzero()[0][0]
    yield all_rims("quad-hole", ball.vertices, np.delete(ball.faces, [0, beside], axis=0), "two triangles")
    # a plane hole that winds to and fro, as those of CGAL's and trimesh's plane tests
    rows = [(x, y) for y in (4, 8, 12) for x in range(6, 18)]
    turns = [(x, y) for x, low in ((17, 5), (6, 9)) for y in range(low, low + 3)]
    yield _pierced("squiggle", rows + turns, "one flat patch", 2 * _GRID)
    # CGAL: a non-manifold rim: a triangle stands on an edge of the mesh that ends in the rim
    hole = _pierced("fin", _square(3, 9), "closed, or refused with the edge's name")
    inner = hole.faces[np.isin(hole.faces, hole.rim).sum(axis=1) == 1][0]
    on = inner[np.isin(inner, hole.rim)][0], inner[~np.isin(inner, hole.rim)][0]
    top = hole.vertices[list(on)].mean(axis=0) + np.array([0, 0, 1])
    fin = [[*on, len(hole.vertices)]]
    yield replace(hole, vertices=np.vstack([hole.vertices, top]), faces=np.concatenate([hole.faces, fin]))
    # CGAL: two square holes that touch in a vertex
    yield _pierced("bow-tie", _square(3, 6) + _square(6, 9), "two patches that share a vertex")


def _upright(name: str, points: Float[np.ndarray, "n 3"], expected: str) -> Hole:
    return collar(name, points, points * [1.15, 1.15, 1.0] - [0, 0, 0.25], expected=expected)


def facing_rims(height: float, n: int = 48) -> Hole:
    """Two unit circles at z = ±h with collars that lead away from each other."""
    t = 2 * np.pi * np.arange(n) / n
    circle = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    lift = np.array([0, 0, height])
    upper = collar("", circle + lift, 1.1 * circle + np.array([0, 0, 0.1]) + lift)
    lower = upper.vertices * [1, 1, -1]
    expected = "no minimal annulus between them: two disks"
    if joined := height < 0.66274:
        expected = "a catenoid between them is a local minimum, two disks have less area"
    if height < 0.5277:
        expected = "the catenoid between them has less area than two disks"
    return Hole(
        name=f"facing-{height:g}",
        vertices=np.concatenate([upper.vertices, lower]),
        faces=np.concatenate([upper.faces, upper.faces[:, ::-1] + len(lower)]),
        rim=np.concatenate([upper.rim, upper.rim + len(lower)]),
        expected=expected,
        facing=True,
        area=gallery.catenoid(height).area if joined else None,
    )


def _square(low: int, high: int) -> list[tuple[int, int]]:
    return [(x, y) for x in range(low, high) for y in range(low, high)]


def _pierced(name: str, cells: list[tuple[int, int]], expected: str, side: int = _GRID) -> Hole:
    vertices, faces = _plane(side)
    gone = np.zeros((side, side, 2), dtype=bool)
    gone[tuple(np.array(cells).T[::-1])] = True
    used, rest = np.unique(faces[~gone.ravel()], return_inverse=True)
    hole = all_rims(name, vertices[used], rest.reshape(-1, 3), expected)
    inside = ((hole.vertices[hole.rim, :2] > 0.5) & (hole.vertices[hole.rim, :2] < side - 0.5)).all(axis=1)
    return replace(hole, rim=hole.rim[inside])


def _plane(side: int = _GRID) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"]]:
    (x, y), faces = lattice(side, side)
    return np.stack([x, y, 0 * x], axis=1), faces


def lattice(
    nx: int, ny: int, *, wrap_x: bool = False, wrap_y: bool = False
) -> tuple[Float[np.ndarray, "2 n"], Int[np.ndarray, "f 3"]]:
    """Points of the plane at 0, 1, … and two triangles a cell, round where it wraps."""
    width, depth = nx + (not wrap_x), ny + (not wrap_y)
    places = np.stack(np.meshgrid(np.arange(width), np.arange(depth))).reshape(2, -1).astype(np.float64)
    i, j = (part.ravel() for part in np.meshgrid(np.arange(nx), np.arange(ny)))
    right, up = (i + 1) % width, (j + 1) % depth
    a, b, c, d = i + width * j, right + width * j, right + width * up, i + width * up
    return places, np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)


def all_rims(name: str, vertices: ArrayLike, faces: ArrayLike, expected: str = "") -> Hole:
    """A mesh all of whose boundaries are to be closed."""
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    rim = np.unique(boundary_edges(triangles))
    return Hole(name=name, vertices=points, faces=triangles, rim=rim, expected=expected)


def mesh_files(folder: Path, names: Sequence[str] = ()) -> list[Path]:
    """The mesh files of a folder that have faces and holes, or those of them whose names match one that is given."""
    found = []
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in FORMATS and (not names or any(fnmatchcase(path.name, name) for name in names)):
            mesh = read_mesh(path).mesh
            if len(mesh.faces) and len(boundary_edges(mesh.faces)):
                found.append(path)
    return found
