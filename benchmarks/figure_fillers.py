"""One hole filled by this project and by other hole fillers that are installed: how fast, how exactly, what is kept."""

from __future__ import annotations

import importlib.util
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from figure_tables import Figure, Table, figure_table, note
from jaxtyping import Float, Int

from spinor_geom import boundary_loops, fill_hole, gallery

RUNS = 5
NEARER = 1e4  # times the exact patch's area is nearer than the other's
SPEED = {64: 4.0, 256: 1.0, 1000: 0.333}  # largest share of the reference's time, by vertices of the rim
# With these target edges our patch has about as many triangles as the reference's, as far as the rim's edges let it.
TARGET_EDGE = {64: 0.065, 256: 0.1, 1000: 0.1}
QUADRILATERAL_VERTICES, QUADRILATERAL_EDGE = 64, 0.027
COLLAR = np.sqrt(0.75)  # its width per edge of the rim, the height of an equilateral triangle
OURS, REFERENCE = "spinor-geom", "MeshLib, nicely"


@dataclass(frozen=True, kw_only=True, eq=False)
class Hole:
    """A collar one triangle wide around a rim whose minimal surface is known.

    Attributes:
        name: What it is.
        vertices: The rim's points first, in order.
        faces: The collar's.
        rim: Number of points of the rim; the collar's outer boundary has one more.
        area: Of the minimal surface.
        target_edge: Of our patch.
    """

    name: str
    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    rim: int
    area: float
    target_edge: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Filled:
    """A collar with its hole filled.

    Attributes:
        vertices: Of collar and patch.
        faces: Of collar and patch.
        seconds: Median of the fills.
        exact_area: Of the surface that the patch was made from, where there is one.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    seconds: float
    exact_area: float | None = None


@dataclass(frozen=True, kw_only=True)
class Tool:
    """A hole filler.

    Attributes:
        name: For the tables.
        package: The package it is in, imported only where it is installed.
        fill: Fills a hole, several times.
    """

    name: str
    package: str
    fill: Callable[[Hole], Filled]


def fillers(only: str) -> list[Table]:
    """Fills holes with `only` in their names by every tool that is installed."""
    figures: list[Figure] = []
    rows: list[tuple[str, ...]] = []
    for hole in holes():
        if only not in hole.name:
            continue
        results: dict[str, Filled] = {}
        for tool in TOOLS:
            if importlib.util.find_spec(tool.package) is None:
                continue
            note(f"{hole.name}: {tool.name}")
            results[tool.name] = tool.fill(hole)
        rows += [row(hole, tool, filled) for tool, filled in results.items()]
        if REFERENCE in results:
            figures += case_figures(hole, results[OURS], results[REFERENCE])
    columns = ("rim", "tool", "seconds", "triangles", "area excess", "closed", "rim kept bit-equal")
    return [
        figure_table(f"Whole fills beside {REFERENCE}", figures),
        Table(title=f"Fills by every tool, medians of {RUNS}", columns=columns, rows=tuple(rows)),
    ]


def holes() -> list[Hole]:
    """Enneper's rim at several resolutions, and a quadrilateral with corners."""
    enneper = gallery.enneper(0.8)
    found = []
    for n, edge in TARGET_EDGE.items():
        z = 0.8 * np.exp(2j * np.pi * np.arange(n) / n)
        width = 1 + COLLAR * 2 * np.pi / n
        outer = 0.8 * width * np.exp(2j * np.pi * outer_parameters(n))
        found.append(
            collar(f"{enneper.name}, {n} vertices", enneper.position(z), enneper.position(outer), enneper.area, edge)
        )
    skew = gallery.schwarz_d_quadrilateral()
    n = QUADRILATERAL_VERTICES
    points = skew.point(np.arange(n) / n)
    # scaled about its centre, which is 0
    wider = skew.point(outer_parameters(n)) * (1 + COLLAR * 4 / n / np.linalg.norm(points, axis=1).min())
    found.append(collar(f"{skew.name}, {n} vertices", points, wider, skew.disks[0].area, QUADRILATERAL_EDGE))
    return found


def outer_parameters(n: int) -> Float[np.ndarray, " n+1"]:
    """Parameters of the collar's outer points: those of the rim and one between the first two."""
    return np.insert(np.arange(n) / n, 1, 0.5 / n)


def collar(
    name: str, rim: Float[np.ndarray, "n 3"], outer: Float[np.ndarray, "n+1 3"], area: float, target_edge: float
) -> Hole:
    """Triangles between a rim and an outer curve; that one has a point more, so that tools can tell the two holes."""
    n = len(rim)
    i = np.arange(n)
    after = (i + 1) % n
    # outer points across from the rim's; the extra one is n + 1
    across = np.append(n, n + 2 + np.arange(n - 1))
    first = np.stack([i, across, across[after]], axis=1)
    second = np.stack([i, across[after], after], axis=1)
    split = np.array([[0, n, n + 1], [0, n + 1, n + 2]])
    return Hole(
        name=name,
        vertices=np.concatenate([rim, outer]),
        faces=np.concatenate([first[1:], second, split]),
        rim=n,
        area=area,
        target_edge=target_edge,
    )


def case_figures(hole: Hole, ours: Filled, reference: Filled) -> list[Figure]:
    """What is promised beside the reference."""
    figures = []
    if hole.rim in SPEED and hole.name.startswith("Enneper"):
        share = ours.seconds / reference.seconds
        figures.append(Figure.at_most(hole.name, f"seconds per those of {REFERENCE}", share, SPEED[hole.rim]))
    assert ours.exact_area is not None
    theirs, exact = abs(patch_area(hole, reference) - hole.area), abs(ours.exact_area - hole.area)
    name = f"error of its area per that of the exact patch (off by {exact / hole.area:.1e})"
    times = theirs / max(exact, np.spacing(hole.area))
    return [
        *figures,
        Figure(case=hole.name, name=name, measured=f"{times:.1e}", target=f"≥ {NEARER:g}", met=bool(times >= NEARER)),
    ]


def row(hole: Hole, tool: str, filled: Filled) -> tuple[str, ...]:
    """One tool's line of the table."""
    excess = patch_area(hole, filled) / hole.area - 1
    left_open = open_edges(filled.faces) - (hole.rim + 1)
    # rows as bytes, so that only bit-equal points are equal
    points = {point.tobytes() for point in np.ascontiguousarray(filled.vertices, dtype=np.float64)}
    kept = all(point.tobytes() in points for point in hole.vertices[: hole.rim])
    return (
        hole.name,
        tool,
        f"{filled.seconds:.4f}",
        str(len(filled.faces) - len(hole.faces)),
        f"{excess:+.1e}" + ("" if filled.exact_area is None else f", exact {filled.exact_area / hole.area - 1:+.1e}"),
        "yes" if left_open == 0 else f"no, {left_open:+d} open edges",
        "yes" if kept else "no",
    )


def patch_area(hole: Hole, filled: Filled) -> float:
    """Area of all faces less that of the collar."""
    return face_area(filled.vertices, filled.faces) - face_area(hole.vertices, hole.faces)


def face_area(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> float:
    """Total area of faces."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def open_edges(faces: Int[np.ndarray, "f 3"]) -> int:
    """Number of edges that have one face."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return int((np.unique(edges, axis=0, return_counts=True)[1] == 1).sum())


def ours(hole: Hole) -> Filled:
    """The whole of `fill_hole`: finding the loops, solving, meshing, stitching."""
    mesh = (hole.vertices, hole.faces)
    loops = boundary_loops(mesh)
    place = next(k for k, loop in enumerate(loops) if loop.vertex_ids.max() < hole.rim)
    seconds, _, (filled, report) = timed(
        lambda: mesh,
        lambda mesh: fill_hole(mesh, place, target_edge_length=hole.target_edge, return_report=True),
    )
    solution = report.loops[place].solution
    return Filled(
        vertices=filled[0], faces=filled[1], seconds=seconds, exact_area=None if solution is None else solution.area
    )


def meshlib_nicely(hole: Hole) -> Filled:
    """MeshLib's minimum-weight triangulation, subdivided and smoothed, with its defaults."""
    from meshlib import mrmeshnumpy, mrmeshpy

    settings = mrmeshpy.FillHoleNicelySettings()
    seconds, mesh, _ = timed(
        lambda: mrmeshnumpy.meshFromFacesVerts(hole.faces.astype(np.int32), hole.vertices),
        lambda mesh: mrmeshpy.fillHoleNicely(mesh, rim_edge(hole, mesh), settings),
    )
    faces = mrmeshnumpy.getNumpyFaces(mesh.topology).astype(np.int64)
    return Filled(vertices=mrmeshnumpy.getNumpyVerts(mesh), faces=faces, seconds=seconds)


def rim_edge(hole: Hole, mesh: Any) -> Any:
    """An edge of the hole in MeshLib's mesh, not of the collar's outer boundary."""
    topology = mesh.topology
    return next(edge for edge in topology.findHoleRepresentiveEdges() if topology.org(edge).get() < hole.rim)


def pymeshlab_close(hole: Hole) -> Filled:
    """PyMeshLab's filter that closes holes, without refinement."""
    import pymeshlab

    def prepared() -> Any:
        meshes = pymeshlab.MeshSet(verbose=False)
        meshes.add_mesh(pymeshlab.Mesh(hole.vertices, hole.faces.astype(np.int32)))
        return meshes

    # it fills what has fewer edges than the limit
    seconds, meshes, _ = timed(prepared, lambda meshes: meshes.meshing_close_holes(maxholesize=hole.rim + 1))
    mesh = meshes.current_mesh()
    return Filled(vertices=mesh.vertex_matrix(), faces=mesh.face_matrix().astype(np.int64), seconds=seconds)


def pymeshfix_small(hole: Hole) -> Filled:
    """PyMeshFix's filling of small boundaries, without refinement."""
    import pymeshfix

    def prepared() -> Any:
        mesh = pymeshfix.PyTMesh()
        mesh.set_quiet(True)
        mesh.load_array(hole.vertices, hole.faces.astype(np.int32))
        return mesh

    seconds, mesh, _ = timed(prepared, lambda mesh: mesh.fill_small_boundaries(hole.rim, False))
    vertices, faces = mesh.return_arrays()
    return Filled(vertices=vertices, faces=faces.astype(np.int64), seconds=seconds)


def timed(prepare: Callable[[], Any], fill: Callable[[Any], Any]) -> tuple[float, Any, Any]:
    """Median seconds of fills after one that is not counted, and the last one's mesh and result."""
    seconds = []
    for _ in range(RUNS + 1):
        mesh = prepare()
        start = time.perf_counter()
        result = fill(mesh)
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds[1:]), mesh, result


TOOLS: tuple[Tool, ...] = (
    Tool(name=OURS, package="spinor_geom", fill=ours),
    Tool(name=REFERENCE, package="meshlib", fill=meshlib_nicely),
    Tool(name="PyMeshLab", package="pymeshlab", fill=pymeshlab_close),
    Tool(name="PyMeshFix", package="pymeshfix", fill=pymeshfix_small),
)
