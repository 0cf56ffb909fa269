"""Mesh objects of every supported type with data at vertices and faces, and all that they hold, as arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import meshio
import numpy as np
import pyvista
import trimesh
from trimesh.visual import ColorVisuals, TextureVisuals

from spinor_geom.adapters import to_mesh
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from tests.adapters.shapes import is_closed
from tests.bench.test_holes import require_peer

Arrays = dict[str, np.ndarray]


class Shell(NamedTuple):
    positions: np.ndarray
    triangles: np.ndarray


class Kind(NamedTuple):
    """A type: `made` of vertices and faces. `held` are its rows for vertices, its rows for faces, and all else."""

    made: Callable[[np.ndarray, np.ndarray], Any]
    held: Callable[[Any], tuple[Arrays, Arrays, dict[str, Any]]]
    closed: Callable[[Any], bool] = lambda mesh: is_closed(to_mesh(mesh))  # in the library's own eyes


def labels(vertices):
    return (3 * np.arange(len(vertices)) % 251).astype(np.int16)


def flow(vertices):
    return np.random.default_rng(len(vertices)).normal(size=(len(vertices), 2, 2))


def colors(rows):
    return np.random.default_rng(len(rows)).integers(0, 256, (len(rows), 4), dtype=np.uint8)


def words(vertices):
    return np.array([f"v{k}" for k in range(len(vertices))])


def pair(container, real, integer):
    def held(mesh):
        vertices, faces = map(np.asarray, mesh)
        return {"vertices": vertices}, {"faces": faces}, {}

    return Kind(lambda v, f: container([v.astype(real), f.astype(integer)]), held)


def tensors(real, integer):
    def made(vertices, faces):
        import torch

        return torch.from_numpy(vertices.astype(real)), torch.from_numpy(np.asarray(faces).astype(integer))

    return Kind(made, lambda mesh: ({"vertices": mesh[0].numpy()}, {"faces": mesh[1].numpy()}, {}))


def as_triangle_mesh(vertices, faces):
    attributes = {"label": labels(vertices), "color": colors(vertices)}
    return TriangleMesh(vertices, faces, vertex_attributes=attributes, labels=("label",))


def trimesh_kind(visual):
    def made(vertices, faces):
        return trimesh.Trimesh(
            vertices,
            faces,
            process=False,
            visual=visual(vertices, faces),
            vertex_attributes={"label": labels(vertices), "flow": flow(vertices)},
            face_attributes={"part": np.arange(len(faces))},
            metadata={"name": ["a"]},
        )

    def held(mesh):
        at_vertices = {"vertices": np.asarray(mesh.vertices), **mesh.vertex_attributes}
        at_faces = {"faces": np.asarray(mesh.faces), **mesh.face_attributes}
        if mesh.visual.kind == "vertex":
            at_vertices["color"] = mesh.visual.vertex_colors
        elif mesh.visual.kind == "face":
            at_faces["color"] = mesh.visual.face_colors
        elif mesh.visual.kind == "texture":
            at_vertices["uv"] = mesh.visual.uv
        return at_vertices, at_faces, {"metadata": mesh.metadata, "visual": mesh.visual.kind}

    return Kind(made, held, lambda mesh: mesh.is_watertight and mesh.is_winding_consistent)


def as_poly_data(vertices, faces):
    mesh = pyvista.PolyData.from_regular_faces(vertices.astype(np.float32), faces)
    mesh.point_data["label"] = labels(vertices)
    mesh.point_data["flow"] = flow(vertices)[:, 0]
    mesh.point_data["RGB"] = colors(vertices)[:, :3]
    mesh.point_data["word"] = words(vertices)
    mesh.point_data.active_normals = np.tile(np.float32([0.6, 0, 0.8]), (len(vertices), 1))
    mesh.point_data.active_scalars_name = "label"
    mesh.cell_data["part"] = np.arange(len(faces))
    mesh.field_data["unit"] = ["mm"]
    return mesh


def vtk_held(mesh):
    faces = mesh.faces if isinstance(mesh, pyvista.PolyData) else mesh.cells
    data = mesh.point_data
    active = (data.active_normals_name, data.active_scalars_name)
    other = {"unit": list(mesh.field_data["unit"]), "active": active}
    at_vertices = {"vertices": np.array(mesh.points), **{name: np.array(values) for name, values in data.items()}}
    at_faces = {"faces": faces.reshape(-1, 4)[:, 1:], "part": np.array(mesh.cell_data["part"])}
    return at_vertices, at_faces, other


def closed_in_vtk(mesh):
    kinds = {"boundary_edges": True, "non_manifold_edges": True, "feature_edges": False, "manifold_edges": False}
    return mesh.extract_feature_edges(**kinds).n_cells == 0


def as_meshio(vertices, faces):
    return meshio.Mesh(
        vertices,
        [("line", [[0, 1]]), ("triangle", faces)],
        point_data={"label": labels(vertices), "stress": flow(vertices), "word": words(vertices)},
        cell_data={"part": [np.array([9]), np.arange(len(faces))]},
        field_data={"skin": np.array([1, 2])},
        point_sets={"left": np.array([0, 1])},
        cell_sets={"front": [[], [0]]},
    )


def meshio_held(mesh):
    (line, *blocks), (nine, *parts) = mesh.cells, mesh.cell_data["part"]
    assert [block.type for block in (line, *blocks)] == ["line"] + ["triangle"] * len(blocks)
    at_faces = {"faces": np.concatenate([block.data for block in blocks]), "part": np.concatenate(parts)}
    other = {
        "line": mesh.points[line.data].tolist(),
        "line data": nine.tolist(),
        "skin": mesh.field_data["skin"].tolist(),
        "left": mesh.points[mesh.point_sets["left"]].tolist(),
        "front": [face for block in mesh.cell_sets["front"] for face in block],
    }
    return {"vertices": mesh.points, **{k: np.asarray(v) for k, v in mesh.point_data.items()}}, at_faces, other


def as_mesh_set(vertices, faces):
    import pymeshlab

    random = np.random.default_rng(len(vertices))
    mesh = pymeshlab.Mesh(
        vertices,
        faces.astype(np.int32),
        v_color_matrix=colors(vertices) / 255,
        v_scalar_array=labels(vertices).astype(float),
        v_tex_coords_matrix=random.uniform(size=(len(vertices), 2)),
        w_tex_coords_matrix=random.uniform(size=(3 * len(faces), 2)),
        f_color_matrix=colors(faces) / 255,
        f_scalar_array=random.normal(size=len(faces)),
    )
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(mesh, "a mesh")
    return meshes


def meshlab_held(meshes):
    mesh = meshes.current_mesh()
    names = ("color_matrix", "scalar_array", "tex_coord_matrix")
    at_vertices = {"vertices": mesh.vertex_matrix(), **{n: getattr(mesh, f"vertex_{n}")() for n in names}}
    at_faces = {"faces": mesh.face_matrix(), **{n: getattr(mesh, f"face_{n}")() for n in names[:2]}}
    at_faces["corners"] = mesh.wedge_tex_coord_matrix().reshape(-1, 3, 2)
    return at_vertices, at_faces, {"label": mesh.label(), "meshes": meshes.mesh_number()}


def as_open3d(vertices, faces):
    require_peer("open3d")
    from open3d import geometry, utility

    random = np.random.default_rng(len(vertices))
    mesh = geometry.TriangleMesh(utility.Vector3dVector(vertices), utility.Vector3iVector(faces.astype(np.int32)))
    mesh.vertex_colors = utility.Vector3dVector(colors(vertices)[:, :3] / 255)
    mesh.vertex_normals = utility.Vector3dVector(np.tile([0.6, 0, 0.8], (len(vertices), 1)))
    mesh.triangle_normals = utility.Vector3dVector(random.normal(size=(len(faces), 3)))
    mesh.triangle_uvs = utility.Vector2dVector(random.uniform(size=(3 * len(faces), 2)))
    mesh.triangle_material_ids = utility.IntVector(random.integers(0, 3, len(faces)).astype(np.int32))
    mesh.textures = [geometry.Image(np.zeros((2, 2, 3), dtype=np.uint8))]
    return mesh


def open3d_held(mesh):
    at_vertices = {name: np.array(getattr(mesh, name)) for name in ("vertices", "vertex_colors", "vertex_normals")}
    at_faces = {name: np.array(getattr(mesh, name)) for name in ("triangle_normals", "triangle_material_ids")}
    at_faces |= {"faces": np.array(mesh.triangles), "corners": np.array(mesh.triangle_uvs).reshape(-1, 3, 2)}
    return at_vertices, at_faces, {"textures": len(mesh.textures)}


OBJECTS: dict[str, Kind] = {
    "arrays": pair(tuple, np.float64, np.int64),
    "list of arrays": pair(list, np.float32, np.int32),
    "named tuple": pair(Shell._make, np.float64, np.uint32),
    "tensors": tensors(np.float64, np.int64),
    "narrow tensors": tensors(np.float32, np.int32),
    "TriangleMesh": Kind(
        as_triangle_mesh, lambda m: ({"vertices": m.vertices, **m.vertex_attributes}, {"faces": m.faces}, {})
    ),
    "trimesh": trimesh_kind(lambda v, _: ColorVisuals(vertex_colors=colors(v))),
    "trimesh without colours": trimesh_kind(lambda *_: None),
    "trimesh with colours of faces": trimesh_kind(lambda _, f: ColorVisuals(face_colors=colors(f))),
    "trimesh with a texture": trimesh_kind(lambda v, _: TextureVisuals(uv=flow(v)[:, 0])),
    "PolyData": Kind(as_poly_data, vtk_held, closed_in_vtk),
    "UnstructuredGrid": Kind(lambda v, f: as_poly_data(v, f).cast_to_unstructured_grid(), vtk_held, closed_in_vtk),
    "meshio": Kind(as_meshio, meshio_held),
    "pymeshlab": Kind(as_mesh_set, meshlab_held, lambda m: m.get_topological_measures()["boundary_edges"] == 0),
    "open3d": Kind(as_open3d, open3d_held, lambda m: m.is_watertight()),
}
