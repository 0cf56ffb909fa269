"""Methods that compute surfaces over loops, and tools that fill holes, by name, with suitable options."""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.bench.holes import Hole
from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface, discrete_minimal_surface
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.fill_options import ContinuityName
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.meshing.embed import Patch, mesh_patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau

OURS, SMOOTH = "spinor-fill", "spinor-fill-c1"
OUR_FILLERS = (OURS, SMOOTH)
# ours, and the others with the options that continue a mesh most smoothly
SMOOTHEST = (
    *OUR_FILLERS,
    *("meshlib-nicely", "meshlib-nicely-fine", "meshlib-nicely-natural", "cgal-fair", "cgal-fair-2"),
    *("meshlab-close-smoothed", "pymeshfix-refined"),
)
CLEAREST = ("cgal", "cgal-fair", "pymeshfix", "pymeshfix-refined")  # fillers with the fewest intersections
REPORTED = (*OUR_FILLERS, "meshlib-nicely", *CLEAREST)  # the fillers of the suite "reports"
_ANY_SIZE = 1e6  # largest radius of a hole, for tools that select holes by it
_CGAL_DENSITY = 2**0.5  # CGAL's default density factor, an argument before the continuity in its bindings

Surface: TypeAlias = PlateauSolution | DiscreteMinimalSurface
Mesh: TypeAlias = Patch | DiscreteMinimalSurface


Call = TypeVar("Call", bound=Callable[..., Any])


@dataclass(frozen=True)
class Tool(Generic[Call]):
    """A method or tool that is measured."""

    package: str
    options: str  # a description
    call: Call  # on a loop, a hole or the edges of a frame
    most_points: int = sys.maxsize  # of a loop, as more take minutes


def _solved(loop: BoundaryLoop) -> tuple[Surface, Mesh]:
    solution = solve_plateau(loop)
    return solution, mesh_patch(solution)


def _discrete(loop: BoundaryLoop, *, uniform: bool = True, **options: Any) -> tuple[Surface, Mesh]:
    length = loop.mean_edge_length if uniform else None
    surface = discrete_minimal_surface(loop, target_edge_length=length, **options)
    return surface, surface


_SOLVED = "solve_plateau with its defaults, then mesh_patch with the loop's mean edge"
_GRADED = "discrete_minimal_surface with its defaults: edges as the loop's at the rim, longer inside"
_MESHLAB = "discrete_minimal_surface(method='pymeshlab') with the loop's mean edge"
LOOP_METHODS: Mapping[str, Tool[Callable[[BoundaryLoop], tuple[Surface, Mesh]]]] = {
    "spinor": Tool("spinor_geom", _SOLVED, _solved, 5000),
    "libigl": Tool("spinor_geom", _GRADED, partial(_discrete, uniform=False), 1024),
    "libigl-uniform": Tool("spinor_geom", "the same with the loop's mean edge everywhere", _discrete, 512),
    "pymeshlab": Tool("spinor_geom", _MESHLAB, partial(_discrete, method="pymeshlab"), 128),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Filled:
    """The mesh that a filler returns."""

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    message: str = ""  # the call's result as text
    succeeded: bool | None = None  # as the tool reports, or None if it reports nothing
    area: float | None = None  # of the surface that the patches approximate, if there is one
    in_order: bool = False  # whether the input's vertices come first, in their order, perhaps moved
    figures: Mapping[str, Any] = field(default_factory=dict)  # further figures of our fillers


# the call that fills, which is timed, and the conversion of its result, which is not
Prepared: TypeAlias = tuple[Callable[[], Any], Callable[[Any], Filled]]


Filler: TypeAlias = Tool[Callable[[Hole], Prepared]]


def _filled(vertices: Any, faces: Any, **more: Any) -> Filled:
    """Copies a tool's arrays, which may be views of memory that it frees."""
    return Filled(vertices=np.array(vertices, dtype=np.float64), faces=np.array(faces, dtype=np.int64), **more)


def _spinor(hole: Hole, *, continuity: ContinuityName) -> Prepared:
    # if all loops are rims, none is selected, and `fill_hole` leaves borders of sheets open
    some = {} if len(hole.rim_indices) == len(hole.loops) else {"loop": hole.rim_indices}
    options: dict[str, Any] = {"bridge": hole.rim_indices} if hole.facing else some
    options |= {"islands": "join", "continuity": continuity}

    def convert(result: Any) -> Filled:
        mesh, report = result
        requested = [outcome for outcome in report.loops if outcome.requested]
        filled = [outcome for outcome in requested if outcome.filled]
        reasons = [outcome.reason for outcome in requested if outcome.reason]
        reasons += [note for outcome in requested for note in outcome.notes]
        solutions = [outcome.solution for outcome in filled if outcome.solution is not None]
        residuals = [solution.boundary_residual.rms_per_edge for solution in solutions]
        return _filled(
            *mesh,
            message="; ".join([f"{len(filled)} of {len(requested)} filled", *dict.fromkeys(reasons)]),
            succeeded=all(outcome.converged for outcome in requested) and report.intersection_free,
            area=sum(outcome.area for outcome in filled if outcome.area is not None),
            figures={
                **{kind: sum(o.kind == kind for o in filled) for kind in ("minimal", "discrete", "smooth")},
                "residual_per_edge": max(residuals, default=None),
            },
        )

    return lambda: fill_hole((hole.vertices, hole.faces), **options, return_report=True), convert


def _meshlab(hole: Hole, *, refine: bool, smooth: bool = False) -> Prepared:
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(hole.vertices, hole.faces.astype(np.int32)))
    # it fills holes with fewer edges than the limit
    limit, length = hole.edge_limit + 1, pymeshlab.PureValue(hole.mean_edge)

    def fill() -> Any:
        closed = meshes.meshing_close_holes(maxholesize=limit, refinehole=refine, refineholeedgelen=length)
        if smooth:  # the new faces are selected now
            meshes.apply_coord_laplacian_smoothing(selected=True)
        return closed or {}

    def convert(result: Any) -> Filled:
        mesh, closed = meshes.current_mesh(), result.get("closed_holes")
        message = ", ".join(f"{key} {value}" for key, value in result.items())
        succeeded = None if closed is None else bool(closed)
        return _filled(mesh.vertex_matrix(), mesh.face_matrix(), message=message, succeeded=succeeded)

    return fill, convert


def _meshlib(hole: Hole, *, metric: str = "", fine: bool = False, natural: bool = False) -> Prepared:
    from meshlib import mrmeshnumpy, mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(hole.faces.astype(np.int32), hole.vertices)
    rim = set(hole.rim.tolist())

    def edges() -> list[Any]:
        """An edge of every open rim."""
        return [edge for edge in mesh.topology.findHoleRepresentiveEdges() if mesh.topology.org(edge).get() in rim]

    rims = edges()

    def fill() -> None:
        if metric:
            for edge in rims:
                parameters = mrmeshpy.FillHoleParams()
                parameters.metric = getattr(mrmeshpy, metric)(mesh)
                mrmeshpy.fillHole(mesh, edge, parameters)
            return
        settings = mrmeshpy.StitchHolesNicelySettings() if hole.facing else mrmeshpy.FillHoleNicelySettings()
        if fine:
            settings.subdivideSettings.maxEdgeLen = hole.mean_edge
            settings.subdivideSettings.maxEdgeSplits = 1_000_000
        settings.smoothSettings.naturalSmooth = natural
        if hole.facing:
            mrmeshpy.stitchHolesNicely(mesh, *rims, settings)
            return
        for edge in rims:
            mrmeshpy.fillHoleNicely(mesh, edge, settings)

    def convert(_: Any) -> Filled:
        left = len(edges())
        vertices, faces = mrmeshnumpy.getNumpyVerts(mesh), mrmeshnumpy.getNumpyFaces(mesh.topology)
        return _filled(vertices, faces, message=f"{left} holes left" if left else "", in_order=True)

    return fill, convert


def _cgal(hole: Hole, *, function: str, outputs: int = 2, more: tuple[float, ...] = ()) -> Prepared:
    from CGAL import CGAL_Polygon_mesh_processing
    from CGAL.CGAL_Kernel import Point_3
    from CGAL.CGAL_Polyhedron_3 import Polyhedron_3, Polyhedron_modifier

    modifier = Polyhedron_modifier()
    modifier.begin_surface(len(hole.vertices), len(hole.faces))
    for x, y, z in hole.vertices.tolist():
        modifier.add_vertex(Point_3(x, y, z))
    for face in hole.faces.tolist():
        modifier.begin_facet()
        for vertex in face:
            modifier.add_vertex_to_facet(vertex)
        modifier.end_facet()
    modifier.end_surface()
    polyhedron = Polyhedron_3()
    polyhedron.delegate(modifier)
    if polyhedron.size_of_vertices() != len(hole.vertices):
        raise ValueError("CGAL's Polyhedron_3 does not accept this mesh")

    def points() -> list[tuple[float, float, float]]:
        """Numbers the vertices and returns their positions."""
        found = []
        for k, vertex in enumerate(polyhedron.vertices()):
            vertex.set_id(k)
            point = vertex.point()
            found.append((point.x(), point.y(), point.z()))
        return found

    points()
    borders = {(h.opposite().vertex().id(), h.vertex().id()): h for h in polyhedron.halfedges() if h.is_border()}
    firsts = (hole.loops[k].vertex_ids[:2].tolist() for k in hole.rim_indices)
    rims = [borders[a, b] if (a, b) in borders else borders[b, a] for a, b in firsts]
    call = getattr(CGAL_Polygon_mesh_processing, function)

    def fill() -> list[Any]:
        return [call(polyhedron, halfedge, *([] for _ in range(outputs)), *more) for halfedge in rims]

    def convert(result: Any) -> Filled:
        vertices, first = points(), [facet.halfedge() for facet in polyhedron.facets()]
        faces = [(h.vertex().id(), h.next().vertex().id(), h.next().next().vertex().id()) for h in first]
        verdicts = [value for value in result if isinstance(value, bool)]
        message = ", ".join(str(value) for value in result if value is not None)
        return _filled(vertices, faces, message=message, succeeded=all(verdicts) if verdicts else None)

    return fill, convert


def _vtk(hole: Hole) -> Prepared:
    import pyvista

    mesh = pyvista.PolyData.from_regular_faces(hole.vertices, hole.faces)

    def convert(result: Any) -> Filled:
        triangles = result.triangulate()
        return _filled(triangles.points, triangles.regular_faces)

    return lambda: mesh.fill_holes(_ANY_SIZE), convert


def _open3d(hole: Hole) -> Prepared:
    import open3d

    tensor: Any = open3d.core.Tensor  # its stubs require a dtype
    mesh = open3d.t.geometry.TriangleMesh(tensor(hole.vertices), tensor(hole.faces))
    return (
        lambda: mesh.fill_holes(hole_size=_ANY_SIZE),
        lambda result: _filled(result.vertex.positions.numpy(), result.triangle.indices.numpy()),
    )


def _meshfix(hole: Hole, *, refine: bool) -> Prepared:
    import pymeshfix

    mesh = pymeshfix.PyTMesh()
    mesh.set_quiet(True)
    mesh.load_array(hole.vertices, hole.faces.astype(np.int32))
    limit = hole.edge_limit

    def convert(result: Any) -> Filled:
        if result is None:
            return _filled(*mesh.return_arrays())
        return _filled(*mesh.return_arrays(), message=f"{result} filled", succeeded=bool(result))

    return lambda: mesh.fill_small_boundaries(limit, refine), convert


def _trimesh(hole: Hole, *, stitch: bool) -> Prepared:
    import trimesh

    mesh = trimesh.Trimesh(hole.vertices, hole.faces, process=False)
    repair: Any = trimesh.repair

    def convert(result: Any) -> Filled:
        if not stitch:
            return _filled(mesh.vertices, mesh.faces, message=f"returned {result}", succeeded=bool(result))
        faces = np.asarray(result, dtype=np.int64).reshape(-1, 3)
        return _filled(mesh.vertices, np.concatenate([mesh.faces, faces]), message=f"{len(faces)} faces")

    return (lambda: repair.stitch(mesh)) if stitch else mesh.fill_holes, convert


def _tool(package: str, options: str, prepare: Callable[..., Prepared], **settings: Any) -> Filler:
    return Tool(package, options, partial(prepare, **settings))


_WHOLE = "fill_hole, islands joined, facing rims bridged; the time includes finding loops, meshing and stitching"
_SMOOTHED = "and apply_coord_laplacian_smoothing of the new faces with its defaults"
_NICELY = "fillHoleNicely with its defaults, stitchHolesNicely between facing rims"
_FINE = "the same, maxEdgeLen the rim's mean edge, maxEdgeSplits 1,000,000"
_NATURAL = "fillHoleNicely with naturalSmooth, which moves three layers of vertices around the rim too"
_REFINE, _FAIR = "triangulate_and_refine_hole", "triangulate_refine_and_fair_hole"
_SMALL = "fill_small_boundaries up to the rim's edges, refine=False"
_STITCH = "repair.stitch, which closes every boundary, the outer ones too"

FILLERS: Mapping[str, Filler] = {
    OURS: _tool("spinor_geom", _WHOLE, _spinor, continuity="C0"),
    SMOOTH: _tool("spinor_geom", 'the same with continuity="C1"', _spinor, continuity="C1"),
    "meshlab-close": _tool("pymeshlab", "maxholesize above the rim's edges", _meshlab, refine=False),
    "meshlab-close-refined": _tool("pymeshlab", "and refinehole=True with the rim's mean edge", _meshlab, refine=True),
    "meshlab-close-smoothed": _tool("pymeshlab", _SMOOTHED, _meshlab, refine=True, smooth=True),
    "meshlib-universal": _tool("meshlib", "fillHole, universal metric", _meshlib, metric="getUniversalMetric"),
    "meshlib-min-area": _tool("meshlib", "fillHole, minimum-area metric", _meshlib, metric="getMinAreaMetric"),
    "meshlib-nicely": _tool("meshlib", _NICELY, _meshlib),
    "meshlib-nicely-fine": _tool("meshlib", _FINE, _meshlib, fine=True),
    "meshlib-nicely-natural": _tool("meshlib", _NATURAL, _meshlib, natural=True),
    "cgal": _tool("CGAL", "triangulate_hole", _cgal, function="triangulate_hole", outputs=1),
    "cgal-refine": _tool("CGAL", _REFINE, _cgal, function=_REFINE),
    "cgal-fair": _tool("CGAL", f"{_FAIR}, which fairs with continuity 1", _cgal, function=_FAIR),
    "cgal-fair-2": _tool("CGAL", "with fairing continuity 2", _cgal, function=_FAIR, more=(_CGAL_DENSITY, 2)),
    "vtk": _tool("pyvista", "vtkFillHolesFilter through pyvista, any size: it closes the outer boundaries too", _vtk),
    "open3d": _tool("open3d", "t.geometry fill_holes, any size", _open3d),
    "pymeshfix": _tool("pymeshfix", _SMALL, _meshfix, refine=False),
    "pymeshfix-refined": _tool("pymeshfix", "the same, refine=True", _meshfix, refine=True),
    "trimesh": _tool("trimesh", "fill_holes", _trimesh, stitch=False),
    "trimesh-stitch": _tool("trimesh", _STITCH, _trimesh, stitch=True),
}
