"""Hole fillers of other projects, each through its own Python package and with options that serve it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.bench.holes import Hole

# radius of holes for tools that cannot tell ours from the others by it
_EVERY_SIZE = 1e6
# CGAL's own default, which its bindings ask for before the continuity
_CGAL_DENSITY = 2**0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Filled:
    """What a filler left.

    Attributes:
        vertices: of the whole mesh.
        faces: of the whole mesh.
        told: what the call returned, in words; empty where it returns nothing.
        succeeded: whether the tool says that it filled; None where it says nothing, which users take for a yes.
        area: of the surface that the patches are meshes of, where there is one.
        in_order: whether the mesh's vertices are known to come first as before, wherever they are now.
        figures: what only ours tells besides.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    told: str = ""
    succeeded: bool | None = None
    area: float | None = None
    in_order: bool = False
    figures: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Peer:
    """A hole filler.

    Attributes:
        name: on the command line and in tables.
        package: the module it is imported from.
        distribution: the package that holds it, whose version is told.
        options: which are not the defaults, for the documents.
        prepare: hands the mesh over; not timed.
        fill: the call that fills; timed.
        finish: takes the mesh back; not timed.
    """

    name: str
    package: str
    distribution: str
    options: str
    prepare: Callable[[Hole], Any]
    fill: Callable[[Any], Any]
    finish: Callable[[Any, Any], Filled]


# --- MeshLab ----------------------------------------------------------------------------------------------------------


def _meshlab_prepare(hole: Hole) -> Any:
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(hole.vertices, hole.faces.astype(np.int32)))
    # it fills what has fewer edges than the limit
    return meshes, hole.edge_limit + 1, pymeshlab.PureValue(hole.mean_edge)


def _meshlab_fill(state: Any, *, refine: bool, smooth: bool = False) -> Any:
    meshes, limit, length = state
    closed = meshes.meshing_close_holes(maxholesize=limit, refinehole=refine, refineholeedgelen=length)
    if smooth:  # the new faces, which are selected now
        meshes.apply_coord_laplacian_smoothing(selected=True)
    return closed


def _meshlab_finish(state: Any, answer: Any) -> Filled:
    mesh = state[0].current_mesh()
    closed = (answer or {}).get("closed_holes")
    return Filled(
        vertices=mesh.vertex_matrix(),
        faces=mesh.face_matrix().astype(np.int64),
        told=", ".join(f"{key} {value}" for key, value in (answer or {}).items()),
        succeeded=None if closed is None else bool(closed),
    )


# --- MeshLib ----------------------------------------------------------------------------------------------------------


def _meshlib_prepare(hole: Hole) -> Any:
    from meshlib import mrmeshnumpy

    mesh = mrmeshnumpy.meshFromFacesVerts(hole.faces.astype(np.int32), hole.vertices)
    return mesh, _meshlib_edges(mesh, hole), hole


def _meshlib_edges(mesh: Any, hole: Hole) -> list[Any]:
    """An edge of every rim."""
    rim = set(hole.rim.tolist())
    topology = mesh.topology
    return [edge for edge in topology.findHoleRepresentiveEdges() if topology.org(edge).get() in rim]


def _meshlib_plain(state: Any, *, metric: str) -> None:
    from meshlib import mrmeshpy

    mesh, edges, _ = state
    for edge in edges:
        parameters = mrmeshpy.FillHoleParams()
        parameters.metric = getattr(mrmeshpy, metric)(mesh)
        mrmeshpy.fillHole(mesh, edge, parameters)


def _meshlib_nicely(state: Any, *, fine: bool = False, natural: bool = False) -> None:
    from meshlib import mrmeshpy

    mesh, edges, hole = state
    settings = mrmeshpy.StitchHolesNicelySettings() if hole.facing else mrmeshpy.FillHoleNicelySettings()
    if fine:
        settings.subdivideSettings.maxEdgeLen = hole.mean_edge
        settings.subdivideSettings.maxEdgeSplits = 1_000_000
    settings.smoothSettings.naturalSmooth = natural
    if hole.facing:
        mrmeshpy.stitchHolesNicely(mesh, *edges, settings)
        return
    for edge in edges:
        mrmeshpy.fillHoleNicely(mesh, edge, settings)


def _meshlib_finish(state: Any, answer: Any) -> Filled:
    from meshlib import mrmeshnumpy

    mesh, _, hole = state
    left = len(_meshlib_edges(mesh, hole))
    return Filled(
        vertices=mrmeshnumpy.getNumpyVerts(mesh),
        faces=mrmeshnumpy.getNumpyFaces(mesh.topology).astype(np.int64),
        told=f"{left} holes left" if left else "",
        succeeded=None,
        in_order=True,
    )


# --- CGAL -------------------------------------------------------------------------------------------------------------


def _cgal_prepare(hole: Hole) -> Any:
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
    for k, vertex in enumerate(polyhedron.vertices()):
        vertex.set_id(k)
    return polyhedron, _cgal_rims(polyhedron, set(hole.rim.tolist()))


def _cgal_rims(polyhedron: Any, rim: set[int]) -> list[Any]:
    """A halfedge of every rim."""
    polyhedron.normalize_border()
    seen: set[tuple[int, int]] = set()
    found = []
    for halfedge in polyhedron.halfedges():
        if not halfedge.is_border():
            continue
        ends = halfedge.opposite().vertex().id(), halfedge.vertex().id()
        if ends in seen:
            continue
        around, walk = [], halfedge
        while True:
            pair = walk.opposite().vertex().id(), walk.vertex().id()
            if pair in seen:
                break
            seen.add(pair)
            around.append(pair[0])
            walk = walk.next()
        if set(around) <= rim:
            found.append(halfedge)
    return found


def _cgal_fill(state: Any, *, function: str, outputs: int = 2, options: tuple[float, ...] = ()) -> list[Any]:
    from CGAL import CGAL_Polygon_mesh_processing

    call = getattr(CGAL_Polygon_mesh_processing, function)
    return [call(state[0], halfedge, *([] for _ in range(outputs)), *options) for halfedge in state[1]]


def _cgal_finish(state: Any, answer: Any) -> Filled:
    polyhedron = state[0]
    points = []
    for k, vertex in enumerate(polyhedron.vertices()):
        vertex.set_id(k)
        point = vertex.point()
        points.append((point.x(), point.y(), point.z()))
    faces = []
    for facet in polyhedron.facets():
        first = facet.halfedge()
        faces.append((first.vertex().id(), first.next().vertex().id(), first.next().next().vertex().id()))
    said = [value for value in answer if isinstance(value, bool)]
    return Filled(
        vertices=np.array(points),
        faces=np.array(faces, dtype=np.int64),
        told=", ".join(str(value) for value in answer if value is not None),
        succeeded=all(said) if said else None,
    )


# --- VTK, Open3D ------------------------------------------------------------------------------------------------------


def _vtk_prepare(hole: Hole) -> Any:
    import pyvista

    return pyvista.PolyData.from_regular_faces(hole.vertices, hole.faces)


def _vtk_finish(state: Any, answer: Any) -> Filled:
    triangles = answer.triangulate()
    return Filled(
        vertices=np.asarray(triangles.points, dtype=np.float64), faces=triangles.regular_faces.astype(np.int64)
    )


def _open3d_prepare(hole: Hole) -> Any:
    import open3d

    tensor: Any = open3d.core.Tensor  # its stubs do not know that arrays may come without a dtype
    return open3d.t.geometry.TriangleMesh(tensor(hole.vertices), tensor(hole.faces))


def _open3d_finish(state: Any, answer: Any) -> Filled:
    return Filled(
        vertices=answer.vertex.positions.numpy().astype(np.float64),
        faces=answer.triangle.indices.numpy().astype(np.int64),
    )


# --- PyMeshFix, trimesh -----------------------------------------------------------------------------------------------


def _meshfix_prepare(hole: Hole) -> Any:
    import pymeshfix

    mesh = pymeshfix.PyTMesh()
    mesh.set_quiet(True)
    mesh.load_array(hole.vertices, hole.faces.astype(np.int32))
    return mesh, hole.edge_limit


def _meshfix_finish(state: Any, answer: Any) -> Filled:
    vertices, faces = state[0].return_arrays()
    return Filled(
        vertices=np.asarray(vertices, dtype=np.float64),
        faces=np.asarray(faces, dtype=np.int64),
        told="" if answer is None else f"{answer} filled",
        succeeded=None if answer is None else bool(answer),
    )


def _trimesh_prepare(hole: Hole) -> Any:
    import trimesh

    return trimesh.Trimesh(hole.vertices, hole.faces, process=False)


def _trimesh_stitch(mesh: Any) -> Any:
    import trimesh

    stitch: Any = trimesh.repair.stitch
    return stitch(mesh)


def _trimesh_finish(mesh: Any, answer: Any) -> Filled:
    return Filled(
        vertices=np.asarray(mesh.vertices, dtype=np.float64),
        faces=np.asarray(mesh.faces, dtype=np.int64),
        told=f"returned {answer}",
        succeeded=bool(answer),
    )


def _trimesh_stitched(mesh: Any, answer: Any) -> Filled:
    faces = np.asarray(answer, dtype=np.int64).reshape(-1, 3)
    return Filled(
        vertices=np.asarray(mesh.vertices, dtype=np.float64),
        faces=np.concatenate([np.asarray(mesh.faces, dtype=np.int64), faces]),
        told=f"{len(faces)} faces",
    )


# of one tool by name: options that are not its defaults, and the call that fills
Ways: TypeAlias = Mapping[str, tuple[str, Callable[[Any], Any]]]


def ways_of(
    package: str,
    distribution: str,
    prepare: Callable[[Hole], Any],
    finish: Callable[[Any, Any], Filled],
    ways: Ways,
) -> tuple[Peer, ...]:
    """The ways of one tool as fillers."""
    shared: dict[str, Any] = {"package": package, "distribution": distribution, "prepare": prepare, "finish": finish}
    return tuple(Peer(name=name, options=options, fill=fill, **shared) for name, (options, fill) in ways.items())


_MESHLAB: Ways = {
    "meshlab-close": ("maxholesize above the rim's edges", partial(_meshlab_fill, refine=False)),
    "meshlab-close-refined": ("and refinehole=True with the rim's mean edge", partial(_meshlab_fill, refine=True)),
    "meshlab-close-smoothed": (
        "and apply_coord_laplacian_smoothing of the new faces with its defaults",
        partial(_meshlab_fill, refine=True, smooth=True),
    ),
}
_MESHLIB: Ways = {
    "meshlib-universal": ("fillHole, universal metric", partial(_meshlib_plain, metric="getUniversalMetric")),
    "meshlib-min-area": ("fillHole, minimum-area metric", partial(_meshlib_plain, metric="getMinAreaMetric")),
    "meshlib-nicely": ("fillHoleNicely with its defaults, stitchHolesNicely between facing rims", _meshlib_nicely),
    "meshlib-nicely-fine": (
        "the same, maxEdgeLen the rim's mean edge, maxEdgeSplits 1,000,000",
        partial(_meshlib_nicely, fine=True),
    ),
    "meshlib-nicely-natural": (
        "fillHoleNicely with naturalSmooth, which moves three layers of vertices around the rim too",
        partial(_meshlib_nicely, natural=True),
    ),
}
_FAIR = "triangulate_refine_and_fair_hole"
_CGAL: Ways = {
    "cgal": ("triangulate_hole", partial(_cgal_fill, function="triangulate_hole", outputs=1)),
    "cgal-refine": (
        "triangulate_and_refine_hole",
        partial(_cgal_fill, function="triangulate_and_refine_hole"),
    ),
    "cgal-fair": (f"{_FAIR}, which fairs with continuity 1", partial(_cgal_fill, function=_FAIR)),
    "cgal-fair-2": ("with fairing continuity 2", partial(_cgal_fill, function=_FAIR, options=(_CGAL_DENSITY, 2))),
}
_VTK = "vtkFillHolesFilter through pyvista, any size: it closes the outer boundaries too"
_MESHFIX: Ways = {
    "pymeshfix": (
        "fill_small_boundaries up to the rim's edges, refine=False",
        lambda state: state[0].fill_small_boundaries(state[1], False),
    ),
    "pymeshfix-refined": ("the same, refine=True", lambda state: state[0].fill_small_boundaries(state[1], True)),
}
_STITCH = "repair.stitch, which closes every boundary, the outer ones too"

PEERS = (
    *ways_of("pymeshlab", "pymeshlab", _meshlab_prepare, _meshlab_finish, _MESHLAB),
    *ways_of("meshlib", "meshlib", _meshlib_prepare, _meshlib_finish, _MESHLIB),
    *ways_of("CGAL", "cgal", _cgal_prepare, _cgal_finish, _CGAL),
    *ways_of("pyvista", "vtk", _vtk_prepare, _vtk_finish, {"vtk": (_VTK, lambda mesh: mesh.fill_holes(_EVERY_SIZE))}),
    *ways_of(
        *("open3d", "open3d-cpu", _open3d_prepare, _open3d_finish),
        {"open3d": ("t.geometry fill_holes, any size", lambda mesh: mesh.fill_holes(hole_size=_EVERY_SIZE))},
    ),
    *ways_of("pymeshfix", "pymeshfix", _meshfix_prepare, _meshfix_finish, _MESHFIX),
    *ways_of(
        *("trimesh", "trimesh", _trimesh_prepare, _trimesh_finish),
        {"trimesh": ("fill_holes", lambda mesh: mesh.fill_holes())},
    ),
    *ways_of("trimesh", "trimesh", _trimesh_prepare, _trimesh_stitched, {"trimesh-stitch": (_STITCH, _trimesh_stitch)}),
)
"""All of them."""
