"""The table of adapters: types are compared by name, so that no optional library is imported."""

from typing import Any, Protocol

from spinor_geom.adapters.textures import Textured
from spinor_geom.errors import OptionError, UnknownMeshTypeError
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, Within


class Adapter(Protocol):
    """Converts one kind of mesh object to a `TriangleMesh`, and appends to it.

    An adapter may have a third method, `merged(obj, within)`: a new object of the type of `obj` with the vertices
    merged that `TriangleMesh.merge_map` returns. Of each group the vertex of lowest index stays, with its attributes,
    and all faces stay, in their order. A fourth one is `textured(obj, largest)`: the texture that pictures show, with
    at most `largest` pixels on its longer side, and its coordinates at the corners of the triangles of `to_mesh`.
    """

    @property
    def name(self) -> str:
        """The name of the supported objects in error messages."""

    @property
    def types(self) -> tuple[str, ...]:
        """The supported types, each as "package.Class": the top-level package and the class's own name.

        "pair of package.Class" is a tuple or list (vertices, faces) of two such objects. Subclasses are supported too.
        """

    def to_mesh(self, obj: Any) -> TriangleMesh:
        """The triangles of `obj`, with all its vertices in their order. Raises a MeshError for invalid arrays."""

    def extend(self, obj: Any, extension: MeshExtension) -> Any:
        """A new object of the type of `obj`: the contents of `obj`, unchanged, followed by the extension.

        Raises:
            VertexIndexError: a new face has the index of a vertex that neither of them has.
            MeshShapeError: an attribute of the mesh is missing in the extension or has another width.
        """


_adapters: dict[str, Adapter] = {}
# what to do with types that have no adapter, by a part of their description
_CURES = {
    ".PointCloud": "points have no holes: reconstruct faces first, or pass points of a closed curve to solve_plateau",
    "pyvista.MultiBlock": "give its surface, mesh.combine().extract_surface(), or one of its blocks",
    "pyvista.": "give its surface, mesh.extract_surface()",
    ".vtk": "give pyvista.wrap(mesh), with .extract_surface() if it is no vtkPolyData",
    "of 2 (list, list)": "give arrays: (numpy.asarray(vertices), numpy.asarray(faces))",
    "of 2 (tuple, tuple)": "give arrays: (numpy.asarray(vertices), numpy.asarray(faces))",
}


def register(adapter: Adapter) -> None:
    """Register an adapter for its types. It replaces earlier ones."""
    for name in adapter.types:
        _adapters[name] = adapter


def to_mesh(obj: Any) -> TriangleMesh:
    """The triangles of any supported mesh object or mesh file.

    The result has all vertices of `obj` in their order, so that indices of loops and extensions are those of `obj`.
    Quads and larger polygons are split into triangles. If the format has several vertices at one position along texture
    or normal seams, faces use the one of lowest index, so that a seam is not a boundary. Nothing else is merged,
    cleaned or reordered.

    Args:
        obj: a `TriangleMesh`, a pair (vertices, faces) of numpy arrays or torch tensors, a `trimesh.Trimesh` or
            `Scene`, a `pyvista.PolyData` or `UnstructuredGrid`, an `open3d.geometry.TriangleMesh`, a `meshio.Mesh`,
            the current mesh of a `pymeshlab.MeshSet`, a `compas.datastructures.Mesh`, a `bpy.types.Object` or `Mesh`, a
            `MeshFile`, the path of a mesh file, or any type an adapter was registered for.

    Raises:
        UnknownMeshTypeError: no adapter supports the type.
        MeshError: an index is out of range, a vertex of a face is not finite, or an array has the wrong shape.
        MeshFileError: the file is missing or malformed.
    """
    return _adapter_of(obj).to_mesh(obj)


def extend(obj: Any, extension: MeshExtension) -> Any:
    """A new object of the type of `obj`, with new vertices and faces appended.

    Vertices (bit for bit), faces (quads and polygons too), attributes and metadata of `obj` come first in the result,
    unchanged. `obj` itself is not changed. For a path, the result is a `MeshFile`, which is not written.

    Args:
        obj: as for `to_mesh`.
        extension: what to append. Its attributes are those of `to_mesh(obj)`.

    Raises:
        UnknownMeshTypeError, MeshFileError: as for `to_mesh`.
        VertexIndexError, MeshShapeError: as for `Adapter.extend`.
    """
    return _adapter_of(obj).extend(obj, extension)


def merged(obj: Any, within: Within) -> Any:
    """A new object of the type of `obj` with vertices at most `within` apart merged, in mesh units.

    Of each group the vertex of lowest index is kept, with its attributes, even if texture coordinates or normals
    differ. Two corners of a face at different positions are never merged. For a path, the result is a `MeshFile`.

    Raises:
        UnknownMeshTypeError, MeshError, MeshFileError: as for `to_mesh`.
        OptionError: the adapter of the type cannot merge vertices.
    """
    adapter = _adapter_of(obj)
    merge = getattr(adapter, "merged", None)
    if merge is None:
        raise OptionError(
            f"the adapter of {adapter.name} cannot merge vertices; merge with its library, or give (vertices, faces)"
        )
    return merge(obj, within)


def textured(obj: Any, largest: int) -> Textured | None:
    """The only texture of a mesh, or None if it has none, or the adapter of its type does not know.

    Raises:
        UnknownMeshTypeError: as for `to_mesh`.
        MeshFileError: there are several textures, or an image cannot be read.
        MissingPackageError: Pillow is not installed.
    """
    own = getattr(_adapter_of(obj), "textured", None)
    found: Textured | None = None if own is None else own(obj, largest)
    return found


def known_types() -> tuple[str, ...]:
    """The names of all adapters, in the order of their registration."""
    return tuple(dict.fromkeys(adapter.name for adapter in _adapters.values()))


def _adapter_of(obj: Any) -> Adapter:
    """The adapter of the nearest class of an object, or of the nearest class of both members of a pair."""
    names = [_class_name(cls) for cls in type(obj).__mro__]
    if isinstance(obj, (tuple, list)) and len(obj) == 2:
        second = type(obj[1]).__mro__
        names += [f"pair of {_class_name(cls)}" for cls in type(obj[0]).__mro__ if cls in second]
    for name in names:
        if name in _adapters:
            return _adapters[name]
    found, known = _description(obj), known_types()
    advice = next((cure for name, cure in _CURES.items() if name in found), f"give one of: {', '.join(known)}")
    raise UnknownMeshTypeError(found=found, known=known, advice=advice)


def _class_name(cls: type) -> str:
    return f"{cls.__module__.partition('.')[0]}.{cls.__qualname__}"


def _description(obj: Any) -> str:
    own = _class_name(type(obj)).removeprefix("builtins.")
    if not isinstance(obj, (tuple, list)):
        return own
    members = ", ".join(_class_name(type(member)).removeprefix("builtins.") for member in obj[:3])
    return f"{own} of {len(obj)} ({members}{', ...' if len(obj) > 3 else ''})"
