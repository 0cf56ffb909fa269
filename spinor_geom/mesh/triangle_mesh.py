"""Triangle meshes, and the vertices and faces that a fill adds to one, immutable and checked."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from spinor_geom.errors import MeshExtentError, NoFacesError, NonFiniteVertexError, VertexIndexError
from spinor_geom.mesh.array_checks import freeze_attributes, freeze_points, frozen, nonfinite_rows
from spinor_geom.mesh.topology import SHARE_OF_EDGE, longest_sides, near_vertices
from spinor_geom.shown import Shown, shortened

Within: TypeAlias = float | Literal["rounding"]  # a distance in mesh units, or `rounding_reach`
# the positions of a patch's new vertices where the mesh is stored, from their own and the vertices of the patch's rim
Stored: TypeAlias = Callable[[Float[np.ndarray, "n 3"], Int[np.ndarray, " m"]], Float[np.ndarray, "n 3"]]
COLOR = "color"
SMALLEST_EXTENT, LARGEST_EXTENT = 1e-70, 1e70  # fourth powers of lengths must neither overflow nor underflow


@dataclass(frozen=True, eq=False, init=False)
class TriangleMesh(Shown):
    """A triangle mesh in space with vertex attributes. Arrays become read-only copies.

    Faces are counter-clockwise seen from the side of their normals. The arrays are checked. Inconsistent faces beside a
    loop are reported by `find_boundary_loops`. Unused vertices are allowed, and may be NaN or infinite.

    Attributes:
        vertices: (V, 3) float64 positions, in mesh units.
        faces: (F, 3) int64 vertex indices.
        vertex_attributes: (V, k) float64 values by name ("color", "normal", ...), in the source's own scale.
        labels: names of the attributes that are class labels, which must not be averaged, by default all integer
            attributes except colours.
        stored: the positions that new vertices get in the object or file that the mesh is from, so that a patch is
            tested as it is stored. By default they are rounded to the dtype of the given vertices, if it is a float.

    Raises:
        MeshShapeError: an array has the wrong shape or dtype.
        NonFiniteVertexError: a coordinate of a vertex that a face uses is NaN or infinite.
        VertexIndexError: a vertex index of a face is out of range.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    vertex_attributes: Mapping[str, Float[np.ndarray, "v _"]]
    labels: frozenset[str]
    stored: Stored

    def __repr__(self) -> str:
        attributes = f", attributes {', '.join(self.vertex_attributes)}" if self.vertex_attributes else ""
        return shortened(f"TriangleMesh({len(self.vertices)} vertices, {len(self.faces)} faces{attributes})")

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        vertex_attributes: Mapping[str, ArrayLike] | None = None,
        labels: Collection[str] | None = None,
        stored: Stored | None = None,
    ) -> None:
        points = frozen(vertices, "real numbers", None, 3, name="vertices")
        corners = frozen(faces, "integers", None, 3, name="faces (triangles)")
        require_existing_vertices(corners, vertices=len(points))
        require_finite(points, corners.ravel(), np.arange(0, corners.size + 1, 3))
        given = vertex_attributes or {}
        if labels is None:
            labels = [name for name, values in given.items() if name != COLOR and np.asarray(values).dtype.kind in "iu"]
        attributes = freeze_attributes(given, vertices=len(points))
        self.__dict__.update(vertices=points, faces=corners, vertex_attributes=attributes, labels=frozenset(labels))
        self.__dict__["stored"] = stored or stored_as(getattr(vertices, "dtype", points.dtype))

    def merged(self, within: Within = 0.0) -> tuple[TriangleMesh, Int[np.ndarray, " v"]]:
        """The same surface with vertices of equal position merged.

        Of each group the vertex of lowest index is kept, with its attributes, and the order is unchanged. Faces are
        neither dropped nor reordered. A face with two corners at one position then uses a vertex twice. Corners of a
        face at different positions stay different.

        Args:
            within: the distance, in mesh units, up to which vertices are merged, or "rounding" for `rounding_reach`.

        Returns:
            The merged mesh, and for every old vertex its index in the merged mesh, (V,) int64.

        Raises:
            MeshExtentError: distances of the vertices are too large or too small for floating-point numbers.
        """
        kept, new_index = self.merge_map(within)
        attributes = {name: values[kept] for name, values in self.vertex_attributes.items()}
        corners, labels, stored = new_index[self.faces], self.labels, self.stored
        merged = TriangleMesh(self.vertices[kept], corners, vertex_attributes=attributes, labels=labels, stored=stored)
        return merged, new_index

    def merge_map(self, within: Within = 0.0) -> tuple[Bool[np.ndarray, " v"], Int[np.ndarray, " v"]]:
        """Which vertices `merged` keeps, and the index of each old vertex among them."""
        points = self.vertices
        require_extent(points)
        reach = rounding_reach(points, self.faces) if within == "rounding" else np.full(len(points), float(within))
        representative = near_vertices(points, reach, self.faces)
        kept = representative == np.arange(len(representative))
        return kept, (np.cumsum(kept) - 1)[representative]


def stored_as(dtype: np.dtype[Any]) -> Stored:
    """Positions rounded to a floating type. Other types hold no positions: they are replaced by float64."""
    return partial(_rounded, dtype if dtype.kind == "f" else np.dtype(np.float64))


def _rounded(
    dtype: np.dtype[Any], points: Float[np.ndarray, "n 3"], _: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "n 3"]:
    with np.errstate(over="ignore", under="ignore"):
        return points.astype(dtype).astype(np.float64)


def rounding_reach(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " v"]:
    """Largest distance between two single-precision roundings of one position, in mesh units, (V,) float64.

    Two roundings of a position differ by one unit in the last place along each axis, less than twice the precision
    times the largest coordinate. The distance is at most 1 % of the longest edge at a vertex.
    """
    # text files are often written from single precision, or with 6 to 9 digits
    precision = 2 * float(np.finfo(np.float32).eps) * float(np.abs(vertices[np.isfinite(vertices)]).max(initial=0.0))
    return np.minimum(precision, SHARE_OF_EDGE * longest_sides(vertices, faces))


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshExtension:
    """New vertices and faces to be appended to a mesh of V vertices, which itself is unchanged.

    Raises:
        MeshShapeError: an array has the wrong shape or dtype.
        NonFiniteVertexError: a new vertex is NaN or infinite.
    """

    vertices: Float[np.ndarray, "k 3"]  # positions of the new vertices, in mesh units. Vertex k gets the index V + k
    faces: Int[np.ndarray, "t 3"]  # indices into [the V original vertices | the K new ones]
    face_loops: Int[np.ndarray, " t"]  # which boundary loop each new face fills
    # at the new vertices, under the names of the mesh's own `TriangleMesh.vertex_attributes`
    vertex_attributes: Mapping[str, Float[np.ndarray, "k _"]] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"MeshExtension({len(self.vertices)} vertices, {len(self.faces)} faces)"

    def __post_init__(self) -> None:
        points = freeze_points(self.vertices, name="vertices")
        corners = frozen(self.faces, "integers", None, 3, name="faces (triangles)")
        self.__dict__.update(
            vertices=points,
            faces=corners,
            face_loops=frozen(self.face_loops, "integers", len(corners), name="face_loops"),
            vertex_attributes=freeze_attributes(self.vertex_attributes, vertices=len(points)),
        )


def require_faces(mesh: TriangleMesh) -> None:
    """Raises a NoFacesError for vertices without faces, or a MeshExtentError if areas cannot be computed."""
    if not len(mesh.vertices):
        return
    if not len(mesh.faces):
        raise NoFacesError(vertices=len(mesh.vertices))
    require_extent(mesh.vertices)


def box_sides(points: Float[np.ndarray, "n 3"]) -> tuple[float, ...]:
    """The lengths of the sides of the bounding box of the finite points, or 0 without any."""
    if len(wrong := nonfinite_rows(points)):
        points = np.delete(points, wrong, axis=0)
    with np.errstate(over="ignore"):  # the difference of two finite numbers may be infinite
        # column by column: a fiftieth of the time of ptp(axis=0)
        return tuple(float(np.ptp(column)) if len(column) else 0.0 for column in points.T)


def require_extent(points: Float[np.ndarray, "n 3"]) -> None:
    """Raises a MeshExtentError for points so far apart, or so close, that areas cannot be computed."""
    extent = max(box_sides(points))
    if extent and not SMALLEST_EXTENT < extent < LARGEST_EXTENT:
        raise MeshExtentError(extent=extent)


def require_finite(
    points: Float[np.ndarray, "n 3"],
    corners: Int[np.ndarray, " c"],
    starts: Int[np.ndarray, " p"],
    places: Mapping[int, str] = MappingProxyType({}),
) -> None:
    """Raises a NonFiniteVertexError for the first face with a vertex that is NaN or infinite.

    Face i has the corners corners[starts[i]:starts[i + 1]]. `places` are those of such vertices in a file.
    """
    if not len(wrong := nonfinite_rows(points)):
        return
    is_wrong = np.zeros(len(points), dtype=bool)
    is_wrong[wrong] = True
    for corner in np.flatnonzero(is_wrong[corners])[:1]:
        vertex, face = int(corners[corner]), int(np.searchsorted(starts, corner, side="right")) - 1
        raise NonFiniteVertexError(vertex=vertex, face=face, place=places.get(vertex, ""))


def require_existing_vertices(faces: Int[np.ndarray, "f 3"], *, vertices: int) -> None:
    """Raises a VertexIndexError for the first face with an index outside 0 … vertices − 1."""
    outside = (faces < 0) | (faces >= vertices)
    if outside.any():
        face, corner = divmod(int(np.flatnonzero(outside)[0]), 3)
        raise VertexIndexError(face=face, index=int(faces[face, corner]), vertices=vertices)
