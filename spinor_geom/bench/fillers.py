"""All methods by name, each by its own package and options that serve it: loops are spanned, holes are filled."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.bench.cases import Hole
from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface, discrete_minimal_surface
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.fill_options import Continuity
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.meshing.embed import Patch, mesh_patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau

OURS, SMOOTH = "spinor-fill", "spinor-fill-c1"
OUR_FILLERS = (OURS, SMOOTH)
# those that are asked to continue the mesh smoothly, each in the ways that do it best, beside ours
SMOOTHEST = (
    *OUR_FILLERS,
    *("meshlib-nicely", "meshlib-nicely-fine", "meshlib-nicely-natural", "cgal-fair", "cgal-fair-2"),
    *("meshlab-close-smoothed", "pymeshfix-refined"),
)
# those whose patches ours are to cross no more than, and what fills them
CLEAREST = ("cgal", "cgal-fair", "pymeshfix", "pymeshfix-refined")
REPORTED = (*OUR_FILLERS, "meshlib-nicely", *CLEAREST)
_EVERY_SIZE = 1e6  # radius of holes for tools that cannot tell ours from the others by it
_CGAL_DENSITY = 2**0.5  # CGAL's own default, which its bindings ask for before the continuity


Answer: TypeAlias = PlateauSolution | DiscreteMinimalSurface
Mesh: TypeAlias = Patch | DiscreteMinimalSurface


@dataclass(frozen=True)
class LoopMethod:
    """A way to span a loop; `span` is the whole of it, mesh included. More than `most_points` take minutes."""

    options: str
    most_points: int
    span: Callable[[BoundaryLoop], tuple[Answer, Mesh]]


def _solved(loop: BoundaryLoop) -> tuple[Answer, Mesh]:
    return (solution := solve_plateau(loop)), mesh_patch(solution)


def _discrete(loop: BoundaryLoop, **options: Any) -> tuple[Answer, Mesh]:
    return (found := discrete_minimal_surface(loop, **options)), found


def _uniform(loop: BoundaryLoop, **options: Any) -> tuple[Answer, Mesh]:
    return _discrete(loop, target_edge_length=loop.mean_edge_length, **options)


LOOP_METHODS: Mapping[str, LoopMethod] = {
    "spinor": LoopMethod("solve_plateau with its defaults, then mesh_patch with the loop's mean edge", 5000, _solved),
    "libigl": LoopMethod(
        "discrete_minimal_surface with its defaults: edges as the loop's at the rim, longer inside", 1024, _discrete
    ),
    "libigl-uniform": LoopMethod("the same with the loop's mean edge everywhere", 512, _uniform),
    "pymeshlab": LoopMethod(
        "discrete_minimal_surface(method='pymeshlab') with the loop's mean edge",
        128,
        partial(_uniform, method="pymeshlab"),
    ),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Filled:
    """What a filler left: the whole mesh."""

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    told: str = ""  # what the call returned, in words
    succeeded: bool | None = None  # by the tool itself; where it says nothing users take that for a yes
    area: float | None = None  # of the surface that the patches are meshes of, where there is one
    in_order: bool = False  # whether the mesh's vertices are known to come first as before, wherever they are now
    figures: Mapping[str, Any] = field(default_factory=dict)  # what only ours tells besides


# the call that fills, which alone is timed, and what makes of its answer the mesh that it left
Prepared: TypeAlias = tuple[Callable[[], Any], Callable[[Any], Filled]]


@dataclass(frozen=True)
class Filler:
    """A way to fill holes: its package, options that are not the defaults, and what hands a mesh over."""

    package: str
    options: str
    prepare: Callable[[Hole], Prepared]


def _left(vertices: Any, faces: Any, **said: Any) -> Filled:
    """Copies of a tool's arrays, which may be of other kinds and go with it."""
    return Filled(vertices=np.array(vertices, dtype=np.float64), faces=np.array(faces, dtype=np.int64), **said)


def _spinor(hole: Hole, *, continuity: Continuity) -> Prepared:
    # of a mesh all of whose loops are asked for, borders of sheets are left open as for any user
    some = {} if len(hole.places) == len(hole.loops) else {"loop": hole.places}
    options: dict[str, Any] = {"bridge": hole.places} if hole.facing else some
    options |= {"islands": "join", "continuity": continuity, "return_report": True}

    def finish(answer: Any) -> Filled:
        mesh, report = answer
        asked = [outcome for outcome in report.loops if outcome.requested]
        filled = [outcome for outcome in asked if outcome.filled]
        said = [outcome.reason for outcome in asked if outcome.reason]
        said += [note for outcome in asked for note in outcome.notes]
        exact = [outcome.solution for outcome in filled if outcome.solution is not None]
        residuals = [solution.boundary_residual.rms_per_edge for solution in exact]
        return _left(
            *mesh,
            told="; ".join([f"{len(filled)} of {len(asked)} filled", *dict.fromkeys(said)]),
            succeeded=all(outcome.converged for outcome in asked) and report.intersection_free,
            # a surface between two rims counts once, at the rim that its faces are counted at
            area=sum(o.area for o in asked if o.area is not None and o.faces_added),
            figures={
                **{kind: sum(o.kind == kind for o in filled) for kind in ("minimal", "discrete", "smooth")},
                "requested": len(asked),
                "unexplained": sum(not outcome.filled and not outcome.reason for outcome in asked),
                "within_1e-2": sum(residual <= 1e-2 for residual in residuals),
                "residual_per_edge": max(residuals, default=None),
            },
        )

    return lambda: fill_hole((hole.vertices, hole.faces), **options), finish


def _meshlab(hole: Hole, *, refine: bool, smooth: bool = False) -> Prepared:
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(hole.vertices, hole.faces.astype(np.int32)))
    # it fills what has fewer edges than the limit
    limit, length = hole.edge_limit + 1, pymeshlab.PureValue(hole.mean_edge)

    def fill() -> Any:
        closed = meshes.meshing_close_holes(maxholesize=limit, refinehole=refine, refineholeedgelen=length)
        if smooth:  # the new faces, which are selected now
            meshes.apply_coord_laplacian_smoothing(selected=True)
        return closed or {}

    def finish(answer: Any) -> Filled:
        mesh, closed = meshes.current_mesh(), answer.get("closed_holes")
        told = ", ".join(f"{key} {value}" for key, value in answer.items())
        succeeded = None if closed is None else bool(closed)
        return _left(mesh.vertex_matrix(), mesh.face_matrix(), told=told, succeeded=succeeded)

    return fill, finish


def _meshlib(hole: Hole, *, metric: str = "", fine: bool = False, natural: bool = False) -> Prepared:
    from meshlib import mrmeshnumpy, mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(hole.faces.astype(np.int32), hole.vertices)
    rim = set(hole.rim.tolist())

    def edges() -> list[Any]:
        """An edge of every rim that is open."""
        return [edge for edge in mesh.topology.findHoleRepresentiveEdges() if mesh.topology.org(edge).get() in rim]

    asked = edges()

    def fill() -> None:
        if metric:
            for edge in asked:
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
            mrmeshpy.stitchHolesNicely(mesh, *asked, settings)
            return
        for edge in asked:
            mrmeshpy.fillHoleNicely(mesh, edge, settings)

    def finish(_: Any) -> Filled:
        left = len(edges())
        vertices, faces = mrmeshnumpy.getNumpyVerts(mesh), mrmeshnumpy.getNumpyFaces(mesh.topology)
        return _left(vertices, faces, told=f"{left} holes left" if left else "", in_order=True)

    return fill, finish


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
        raise ValueError("CGAL's Polyhedron_3 does not take this mesh")

    def points() -> list[tuple[float, float, float]]:
        """Numbers the vertices."""
        found = []
        for k, vertex in enumerate(polyhedron.vertices()):
            vertex.set_id(k)
            point = vertex.point()
            found.append((point.x(), point.y(), point.z()))
        return found

    points()
    borders = {(h.opposite().vertex().id(), h.vertex().id()): h for h in polyhedron.halfedges() if h.is_border()}
    firsts = (hole.loops[place].vertex_ids[:2].tolist() for place in hole.places)
    rims = [borders[a, b] if (a, b) in borders else borders[b, a] for a, b in firsts]
    call = getattr(CGAL_Polygon_mesh_processing, function)

    def fill() -> list[Any]:
        return [call(polyhedron, halfedge, *([] for _ in range(outputs)), *more) for halfedge in rims]

    def finish(answer: Any) -> Filled:
        vertices, faces = points(), []
        for facet in polyhedron.facets():
            first = facet.halfedge()
            faces.append((first.vertex().id(), first.next().vertex().id(), first.next().next().vertex().id()))
        said = [value for value in answer if isinstance(value, bool)]
        told = ", ".join(str(value) for value in answer if value is not None)
        return _left(vertices, faces, told=told, succeeded=all(said) if said else None)

    return fill, finish


def _vtk(hole: Hole) -> Prepared:
    import pyvista

    mesh = pyvista.PolyData.from_regular_faces(hole.vertices, hole.faces)

    def finish(answer: Any) -> Filled:
        triangles = answer.triangulate()
        return _left(triangles.points, triangles.regular_faces)

    return lambda: mesh.fill_holes(_EVERY_SIZE), finish


def _open3d(hole: Hole) -> Prepared:
    import open3d

    tensor: Any = open3d.core.Tensor  # its stubs do not know that arrays may come without a dtype
    mesh = open3d.t.geometry.TriangleMesh(tensor(hole.vertices), tensor(hole.faces))
    return (
        lambda: mesh.fill_holes(hole_size=_EVERY_SIZE),
        lambda answer: _left(answer.vertex.positions.numpy(), answer.triangle.indices.numpy()),
    )


def _meshfix(hole: Hole, *, refine: bool) -> Prepared:
    import pymeshfix

    mesh = pymeshfix.PyTMesh()
    mesh.set_quiet(True)
    mesh.load_array(hole.vertices, hole.faces.astype(np.int32))
    limit = hole.edge_limit

    def finish(answer: Any) -> Filled:
        if answer is None:
            return _left(*mesh.return_arrays())
        return _left(*mesh.return_arrays(), told=f"{answer} filled", succeeded=bool(answer))

    return lambda: mesh.fill_small_boundaries(limit, refine), finish


def _trimesh(hole: Hole, *, stitch: bool) -> Prepared:
    import trimesh

    mesh = trimesh.Trimesh(hole.vertices, hole.faces, process=False)
    repair: Any = trimesh.repair

    def finish(answer: Any) -> Filled:
        if not stitch:
            return _left(mesh.vertices, mesh.faces, told=f"returned {answer}", succeeded=bool(answer))
        faces = np.asarray(answer, dtype=np.int64).reshape(-1, 3)
        return _left(mesh.vertices, np.concatenate([mesh.faces, faces]), told=f"{len(faces)} faces")

    return (lambda: repair.stitch(mesh)) if stitch else mesh.fill_holes, finish


def _tool(package: str, options: str, prepare: Callable[..., Prepared], **settings: Any) -> Filler:
    return Filler(package, options, partial(prepare, **settings))


_FAIR = "triangulate_refine_and_fair_hole"
_REFINE = "triangulate_and_refine_hole"
_FINE = "the same, maxEdgeLen the rim's mean edge, maxEdgeSplits 1,000,000"
_NATURAL = "fillHoleNicely with naturalSmooth, which moves three layers of vertices around the rim too"
_WHOLE = "fill_hole, islands joined, facing rims bridged; timed with finding loops, solving, meshing, stitching"
_SMOOTHED = "and apply_coord_laplacian_smoothing of the new faces with its defaults"

FILLERS: Mapping[str, Filler] = {
    OURS: _tool("spinor_geom", _WHOLE, _spinor, continuity="C0"),
    SMOOTH: _tool("spinor_geom", 'the same with continuity="C1"', _spinor, continuity="C1"),
    "meshlab-close": _tool("pymeshlab", "maxholesize above the rim's edges", _meshlab, refine=False),
    "meshlab-close-refined": _tool("pymeshlab", "and refinehole=True with the rim's mean edge", _meshlab, refine=True),
    "meshlab-close-smoothed": _tool("pymeshlab", _SMOOTHED, _meshlab, refine=True, smooth=True),
    "meshlib-universal": _tool("meshlib", "fillHole, universal metric", _meshlib, metric="getUniversalMetric"),
    "meshlib-min-area": _tool("meshlib", "fillHole, minimum-area metric", _meshlib, metric="getMinAreaMetric"),
    "meshlib-nicely": _tool(
        "meshlib", "fillHoleNicely with its defaults, stitchHolesNicely between facing rims", _meshlib
    ),
    "meshlib-nicely-fine": _tool("meshlib", _FINE, _meshlib, fine=True),
    "meshlib-nicely-natural": _tool("meshlib", _NATURAL, _meshlib, natural=True),
    "cgal": _tool("CGAL", "triangulate_hole", _cgal, function="triangulate_hole", outputs=1),
    "cgal-refine": _tool("CGAL", _REFINE, _cgal, function=_REFINE),
    "cgal-fair": _tool("CGAL", f"{_FAIR}, which fairs with continuity 1", _cgal, function=_FAIR),
    "cgal-fair-2": _tool("CGAL", "with fairing continuity 2", _cgal, function=_FAIR, more=(_CGAL_DENSITY, 2)),
    "vtk": _tool("pyvista", "vtkFillHolesFilter through pyvista, any size: it closes the outer boundaries too", _vtk),
    "open3d": _tool("open3d", "t.geometry fill_holes, any size", _open3d),
    "pymeshfix": _tool(
        "pymeshfix", "fill_small_boundaries up to the rim's edges, refine=False", _meshfix, refine=False
    ),
    "pymeshfix-refined": _tool("pymeshfix", "the same, refine=True", _meshfix, refine=True),
    "trimesh": _tool("trimesh", "fill_holes", _trimesh, stitch=False),
    "trimesh-stitch": _tool(
        "trimesh", "repair.stitch, which closes every boundary, the outer ones too", _trimesh, stitch=True
    ),
}
"""Ours first."""
