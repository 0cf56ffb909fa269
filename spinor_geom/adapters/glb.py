"""Binary glTF (GLB): all triangle meshes of a scene as one mesh, and patches as primitives of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from operator import attrgetter
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import METRES, FileContents, is_held_in_single_precision, malformed, single_precision
from spinor_geom.adapters.glb_container import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, GlbContainer, Json
from spinor_geom.adapters.polygon_faces import Polygons, seam_representatives
from spinor_geom.adapters.textures import EMBEDDED, Appearance, Texture
from spinor_geom.adapters.vertex_data import as_float64, cast_values, parts_of_faces, unit_vectors
from spinor_geom.errors import MeshFileError, PrecisionError
from spinor_geom.mesh.triangle_mesh import MeshExtension, Stored, stored_as

TRIANGLES, STRIPS_AND_FANS = 4, (5, 6)  # a primitive's mode
MOVES = {"matrix", "rotation", "scale", "translation"}  # of a node
WIDTHS = {"POSITION": 3, "NORMAL": 3, "TEXCOORD_0": 2}
# The largest number of rows of arrays in a scene, of about 35 bytes each, unless the file itself has more bytes: a
# mesh that many nodes use, or an array that many primitives use, is read once for each of them.
MOST_ROWS = 10_000_000
ROWS_OF_A_PRIMITIVE = 100  # the memory of its Python objects, in rows
COPIED = ("JOINTS_", "WEIGHTS_", "TANGENT")  # from the nearest old vertex: they cannot be averaged
NAMES = {"COLOR_0": "color", "NORMAL": "normal", "TEXCOORD_0": "uv"}
# properties of a material with a texture that other formats have as well, or that its colour does not depend on
_CONVERTED = ("name", "doubleSided", "pbrMetallicRoughness", "baseColorTexture", "metallicFactor", "roughnessFactor")


def read_glb(data: bytes) -> FileContents:
    """All triangles of a GLB file's scene, in the scene's coordinates.

    Primitives are in the order of the nodes. A mesh that several nodes use is read once for each node, up to
    `MOST_ROWS` rows in total. Skinned meshes are in their rest pose. Edges along which any attribute differs, and those
    between the primitives of one node (which differ in material), are seams and are closed. Nodes are not joined.
    Draco, meshopt, sparse arrays, strips, morph targets and data outside the file are not supported.
    """
    try:
        container = GlbContainer.read(data)
        pieces = scene_pieces(container)
    except MeshFileError:
        raise
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError) as error:
        raise malformed("JSON", f"does not follow glTF ({type(error).__name__}: {error})") from error
    if not pieces:
        raise malformed("scene", "has no triangles", "give a file with a surface in it")
    vertices = np.concatenate([piece.decoded("POSITION") for piece in pieces])
    attributes = {
        NAMES.get(semantic, semantic): np.concatenate([piece.decoded(semantic) for piece in pieces])
        for semantic in shared_semantics(pieces)
    }
    color_dtype: np.dtype[Any] = pieces[0].rows["COLOR_0"].dtype if "color" in attributes else np.dtype(np.float32)
    return FileContents(
        vertices=vertices,
        polygons=Polygons.of_triangles(np.concatenate([piece.faces + piece.start for piece in pieces])),
        attributes=attributes,
        color_scale=1.0 if color_dtype.kind == "f" else float(np.iinfo(color_dtype).max),
        has_linear_colors=True,
        tint=_tint(container, pieces),
        representatives=_representatives(vertices, pieces),
        appearance=_appearance(container, pieces),
        unit="meter",
        suffix=".glb",
        stored=partial(_stored, pieces),
        appended=partial(_appended, data, pieces),
    )


def _tint(container: GlbContainer, pieces: Sequence[PlacedPrimitive]) -> Float[np.ndarray, "n 3"] | None:
    """The base colours of the materials at all vertices, or None if they are all white."""
    tints = np.ones((len(pieces), 3))
    for tint, primitive in zip(tints, _primitives(container, pieces), strict=True):
        material = container.item("materials", primitive["material"]) if "material" in primitive else {}
        factor = material.get("pbrMetallicRoughness", {}).get("baseColorFactor", (1.0, 1.0, 1.0))
        tint[:] = np.clip(np.array(factor[:3], dtype=np.float64), 0, 1)
    return None if (tints == 1).all() else tints.repeat([piece.stop - piece.start for piece in pieces], axis=0)


def _primitives(container: GlbContainer, pieces: Sequence[PlacedPrimitive]) -> list[Json]:
    meshes = [container.tree["meshes"][container.tree["nodes"][piece.node]["mesh"]] for piece in pieces]
    return [mesh["primitives"][piece.primitive] for mesh, piece in zip(meshes, pieces, strict=True)]


def _appearance(container: GlbContainer, pieces: Sequence[PlacedPrimitive]) -> Appearance | None:
    """The images outside the file, and the texture if all primitives have the same one, or None without materials."""
    tree = container.tree
    if not tree.get("materials"):
        return None
    listed = tree.get("images")
    images = [image for image in listed if isinstance(image, dict)] if isinstance(listed, list) else []
    outside = [image["uri"] for image in images if isinstance(image.get("uri"), str)]
    names = tuple(unquote(uri) for uri in outside if not uri.startswith("data:"))
    try:
        (material,) = {primitive.get("material") for primitive in _primitives(container, pieces)}
        own = tree["materials"][material]
        described = own["pbrMetallicRoughness"]["baseColorTexture"]
        others = [
            name
            for name, value in {**own, **own["pbrMetallicRoughness"]}.items()
            if name not in _CONVERTED and (name, value) != ("baseColorFactor", [1, 1, 1, 1])
        ]
        image = tree["images"][tree["textures"][described["index"]]["source"]]
        data = container.views[image["bufferView"]]
        suffix = next(key for key, kind in EMBEDDED.items() if kind == image["mimeType"])
        is_plain = not described.get("texCoord") and not described.get("extensions")
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, StopIteration):  # of another form
        return Appearance(names=names, has_several="textures" in tree)
    texture = Texture(data=data, name=f"texture{suffix}") if data and is_plain else None
    return Appearance(names=names, texture=texture, others=tuple(others))


def _appended(data: bytes, pieces: Sequence[PlacedPrimitive], extension: MeshExtension) -> bytes:
    """The file with every new patch as a primitive, with the node and the material of most vertices of its rim.

    The elements of the file are unchanged. The patch has copies of the rim's vertices, equal bit for bit to those of
    the same node. New vertices that no new face uses are not written.
    """
    if len(extension.faces) == 0:
        return data
    from scipy.spatial import KDTree  # slow to import

    container = GlbContainer.read(data)
    nodes, meshes = container.tree["nodes"], container.tree["meshes"]
    vertices = np.concatenate([*(piece.decoded("POSITION") for piece in pieces), extension.vertices])
    first_new = pieces[-1].stop
    owners = parts_of_faces(extension, [piece.start for piece in pieces], first_new).argmax(axis=1)
    for number in np.unique(owners).tolist():
        piece = pieces[number]
        node = nodes[piece.node]
        used, faces = np.unique(extension.faces[owners == number], return_inverse=True)
        own = piece.decoded("POSITION")
        finite = np.flatnonzero(np.isfinite(own).all(axis=1))
        nearest = finite[KDTree(own[finite]).query(vertices[used])[1]]
        attributes = {}
        like = meshes[node["mesh"]]["primitives"][piece.primitive]
        for semantic, rows in piece.rows.items():
            new_rows, name = rows[nearest], NAMES.get(semantic, semantic)
            if semantic == "POSITION":
                new_rows = piece.encoded(semantic, vertices[used])
            elif name in extension.vertex_attributes and not semantic.startswith(COPIED):
                values = extension.vertex_attributes[name][used[used >= first_new] - first_new]
                new_rows[used >= first_new] = piece.encoded(semantic, values)
            for other in pieces:
                if other.node == piece.node and other.layout(semantic) == piece.layout(semantic):
                    taken = (used >= other.start) & (used < other.stop)
                    new_rows[taken] = other.rows[semantic][used[taken] - other.start]
            attributes[semantic] = container.store(new_rows, target=ARRAY_BUFFER, like=like["attributes"][semantic])
        # the largest index of each type means "restart" to graphics hardware
        indices = faces.reshape(-1, 1).astype(np.uint16 if len(used) <= np.iinfo(np.uint16).max else np.uint32)
        patch = {**like, "attributes": attributes, "indices": container.store(indices, target=ELEMENT_ARRAY_BUFFER)}
        if sum(other.get("mesh") == node["mesh"] for other in nodes) > 1:  # other nodes keep the old mesh
            meshes.append(dict(meshes[node["mesh"]]))
            node["mesh"] = len(meshes) - 1
        mesh = meshes[node["mesh"]]
        mesh["primitives"] = [*mesh["primitives"], patch]
    return container.encoded()


def _stored(
    pieces: Sequence[PlacedPrimitive], points: Float[np.ndarray, "n 3"], rim: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "n 3"]:
    """The positions of the new vertices of a patch, which has the node of most vertices of its rim, in the file."""
    owners = np.searchsorted([piece.start for piece in pieces], rim, side="right") - 1
    piece = pieces[int(np.bincount(owners).argmax())]
    return replace(piece, rows={"POSITION": piece.encoded("POSITION", points)}).decoded("POSITION")


def names_in_glb(contents: FileContents) -> dict[str, str]:
    """The name of each attribute in a new GLB file, without attributes that are too wide or whose names clash."""
    found: dict[str, str] = {}
    for name, values in contents.attributes.items():
        semantic = next((key for key, own in NAMES.items() if own == name), name)
        if not semantic.startswith(("COLOR_", "NORMAL", "TEXCOORD_")):
            semantic = f"_{name.upper().lstrip('_')}"
        fits = values.shape[1] <= 4 and (name != "normal" or values.shape[1] == 3)
        if fits and semantic not in found.values():
            found[name] = semantic
    return found


def encode_glb(contents: FileContents) -> bytes:
    """A new GLB file with one mesh: positions as float32, in metres if the unit is known, and supported attributes.

    If single precision does not hold the positions, they are relative to `glb_offset`, the translation of the node.
    """
    offset = glb_offset(contents)
    rows = {"POSITION": single_precision(_positions(contents) - offset)}
    for name, semantic in names_in_glb(contents).items():
        values = contents.attributes[name]
        if name == "uv":
            values = values[:, :2] * [1.0, -1.0] + [0.0, 1.0]
        rows[semantic] = single_precision(values / contents.color_scale if name == "color" else values)
    faces, _ = contents.polygons.triangulated(contents.vertices)
    container = GlbContainer(tree={}, views=[])
    primitive: Json = {
        "attributes": {name: container.store(values, target=ARRAY_BUFFER) for name, values in rows.items()},
        "indices": container.store(faces.reshape(-1, 1).astype("<u4"), target=ELEMENT_ARRAY_BUFFER),
    }
    if (texture := contents.appearance and contents.appearance.texture) and "TEXCOORD_0" in rows:
        primitive["material"] = 0
        container.tree |= {
            "images": [{"bufferView": container.store_bytes(texture.data), "mimeType": texture.media_type}],
            "textures": [{"source": 0}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0}}],
        }
    container.tree |= {
        "asset": {"version": "2.0", "generator": "spinor_geom"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": offset.tolist()} if offset.any() else {"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
    }
    return container.encoded()


def stored_in_glb(contents: FileContents) -> Stored:
    """The positions in a new GLB file. Raises as `glb_offset`."""
    return partial(_stored_about, glb_offset(contents), METRES.get(contents.unit, 1.0))


def _stored_about(
    offset: Float[np.ndarray, "3"], unit: float, points: Float[np.ndarray, "n 3"], rim: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "n 3"]:
    rounded = stored_as(np.dtype(np.float32))(points * unit - offset, rim)
    return np.asarray((rounded + offset) / unit)


def glb_offset(contents: FileContents) -> Float[np.ndarray, "3"]:
    """The point that positions in a new GLB file are relative to: the origin, or near the middle of the mesh.

    Raises a PrecisionError if single precision does not hold the mesh in either case.
    """
    positions, none = _positions(contents), np.zeros(3)
    if is_held_in_single_precision(contents, positions):
        return none
    used = positions[contents.polygons.corners]
    # a multiple of a power of two near the size, which has few digits
    step = 2.0 ** np.floor(np.log2(np.ptp(used, axis=0).max(initial=0.0) or 1.0))
    middle = used.min(axis=0, initial=np.inf) / 2 + used.max(axis=0, initial=-np.inf) / 2
    offset = np.rint(middle / step) * step + 0.0  # not −0
    if not is_held_in_single_precision(contents, positions - offset):
        raise PrecisionError(suffix=".glb")
    return np.asarray(offset)


def _positions(contents: FileContents) -> Float[np.ndarray, "v 3"]:
    return contents.vertices * METRES.get(contents.unit, 1.0)


def _representatives(vertices: Float[np.ndarray, "v 3"], pieces: list[PlacedPrimitive]) -> Int[np.ndarray, " v"]:
    """For every vertex the one that represents its position in its node."""
    representatives = np.empty(len(vertices), dtype=np.int64)
    for _, group in groupby(pieces, key=attrgetter("node")):
        own = list(group)
        start, stop = own[0].start, own[-1].stop
        primitive = np.concatenate([np.full((piece.stop - piece.start, 1), piece.primitive) for piece in own])
        appearance = [np.concatenate([piece.rows[name] for piece in own]) for name in shared_semantics(own)]
        faces = Polygons.of_triangles(np.concatenate([piece.faces + (piece.start - start) for piece in own]))
        representatives[start:stop] = start + seam_representatives(
            vertices[start:stop], faces, [primitive, *appearance]
        )
    return representatives


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedPrimitive:
    """A primitive of triangles in one node. Its vertices follow each other in the scene."""

    node: int  # index of the node
    primitive: int  # index in the node's mesh
    start: int  # index of its first vertex in the scene
    faces: Int[np.ndarray, "f 3"]  # over its own vertices
    rows: Mapping[str, np.ndarray]  # its attributes in the file's dtypes, by their glTF names
    normalized: frozenset[str]  # attributes, except colours, whose integers are fractions of the largest one
    transform: Float[np.ndarray, "4 4"]  # from its own coordinates to the scene's

    @property
    def stop(self) -> int:
        """One more than the index of its last vertex in the scene."""
        return self.start + len(self.rows["POSITION"])

    def layout(self, semantic: str) -> tuple[int, np.dtype[Any]] | None:
        """The width and the dtype of an attribute, or None if it is missing."""
        return (self.rows[semantic].shape[1], self.rows[semantic].dtype) if semantic in self.rows else None

    def decoded(self, semantic: str) -> Float[np.ndarray, "n k"]:
        """An attribute as float64 in the scene's coordinates, colours in the file's own scale."""
        rows = self.rows[semantic]
        values = as_float64(rows)
        if semantic in self.normalized:
            values = np.maximum(values / np.iinfo(rows.dtype).max, -1.0)
        if semantic == "TEXCOORD_0":
            return values * [1.0, -1.0] + [0.0, 1.0]
        if np.array_equal(self.transform, np.eye(4)) or semantic not in ("POSITION", "NORMAL"):
            return values
        with np.errstate(over="ignore", invalid="ignore"):  # a position that is not finite is reported later
            if semantic == "POSITION":
                return np.asarray(values @ self.transform[:3, :3].T + self.transform[:3, 3])
            return unit_vectors(values @ np.linalg.inv(self.transform[:3, :3]))

    def encoded(self, semantic: str, values: Float[np.ndarray, "n k"]) -> np.ndarray:
        """The inverse of `decoded`, rounded to the file's dtype."""
        dtype = self.rows[semantic].dtype
        if semantic == "TEXCOORD_0":
            values = values * [1.0, -1.0] + [0.0, 1.0]
        if not np.array_equal(self.transform, np.eye(4)):
            if semantic == "POSITION":
                values = (values - self.transform[:3, 3]) @ np.linalg.inv(self.transform[:3, :3]).T
            elif semantic == "NORMAL":
                values = unit_vectors(values @ self.transform[:3, :3])
        if semantic in self.normalized:
            values = values * np.iinfo(dtype).max
        return cast_values(values, dtype)


def scene_pieces(container: GlbContainer) -> list[PlacedPrimitive]:
    """The triangle primitives of the scene, node by node, parents first."""
    tree = container.tree
    nodes = tree.get("nodes", [])
    for node in nodes:
        if "mesh" in node:
            container.item("meshes", node["mesh"])
    if "scenes" in tree:
        roots = container.item("scenes", tree.get("scene", 0)).get("nodes", [])
    else:
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [number for number in range(len(nodes)) if number not in children]
    pieces: list[PlacedPrimitive] = []
    seen: set[int] = set()
    rows_left = max(MOST_ROWS, sum(len(view or b"") for view in container.views))
    unmoved = np.eye(4)
    stack = [(root, unmoved) for root in reversed(roots)]
    while stack:
        number, parent = stack.pop()
        if number in seen:
            raise malformed(f"node {number}", "has two parents")
        seen.add(number)
        node = container.item("nodes", number)
        with np.errstate(over="ignore", invalid="ignore"):  # a position that is not finite is reported later
            transform = parent if MOVES.isdisjoint(node) else parent @ _local_transform(node)
        stack += [(child, transform) for child in reversed(node.get("children", []))]
        if "mesh" not in node:
            continue
        if "skin" in node:
            transform = np.eye(4)
        else:
            with np.errstate(over="ignore", invalid="ignore"):
                is_flat = np.linalg.det(transform[:3, :3]) == 0
            if is_flat:
                raise malformed(f"node {number}", "its transform is singular", "correct the transform")
        for index in range(len(tree["meshes"][node["mesh"]]["primitives"])):
            piece = _piece(container, number, index, pieces[-1].stop if pieces else 0, transform)
            rows_left -= ROWS_OF_A_PRIMITIVE
            if piece is not None:
                pieces.append(piece)
                rows_left -= len(piece.faces) + sum(map(len, piece.rows.values()))
            if rows_left < 0:
                problem = f"with it the scene has over {MOST_ROWS:,} rows of arrays, because nodes share meshes"
                raise malformed(f"node {number}", problem, "write each mesh to its own file")
    return pieces


def _piece(
    container: GlbContainer, node: int, index: int, start: int, transform: Float[np.ndarray, "4 4"]
) -> PlacedPrimitive | None:
    """One primitive, or None if it has no triangles."""
    tree = container.tree
    mesh = tree["nodes"][node]["mesh"]
    primitive = tree["meshes"][mesh]["primitives"][index]
    place = f"mesh {mesh}, primitive {index}"
    mode = primitive.get("mode", TRIANGLES)
    if mode in STRIPS_AND_FANS:
        raise malformed(place, "is a triangle strip or fan", "convert it to a list of triangles")
    if mode != TRIANGLES or "POSITION" not in primitive["attributes"]:
        return None
    if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
        raise malformed(place, "is compressed with Draco", "decompress the file first")
    if primitive.get("targets"):
        raise malformed(place, "has morph targets, which a patch cannot follow", "apply them first")
    rows = {semantic: container.values(accessor) for semantic, accessor in primitive["attributes"].items()}
    count = len(rows["POSITION"])
    if any(len(own) != count or own.shape[1] != WIDTHS.get(name, own.shape[1]) for name, own in rows.items()):
        raise malformed(place, "its attributes do not have one row per vertex, of the width that glTF requires")
    indices = np.arange(count)
    if "indices" in primitive:
        stored = container.values(primitive["indices"])
        if stored.dtype.kind != "u":
            raise malformed(place, "its indices are not unsigned integers", "correct the indices")
        indices = stored[:, 0].astype(np.int64)
    if len(indices) % 3 or indices.max(initial=-1) >= count:
        raise malformed(place, f"its indices do not form triangles of its {count} vertices", "correct the indices")
    if not len(indices):
        return None
    accessors = {name: tree["accessors"][item] for name, item in primitive["attributes"].items() if name != "COLOR_0"}
    normalized = (name for name, accessor in accessors.items() if accessor.get("normalized"))
    return PlacedPrimitive(
        node=node,
        primitive=index,
        start=start,
        faces=indices.reshape(-1, 3),
        rows=rows,
        normalized=frozenset(name for name in normalized if rows[name].dtype.kind != "f"),
        transform=transform,
    )


def _local_transform(node: Json) -> Float[np.ndarray, "4 4"]:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape((4, 4), order="F")
    from scipy.spatial.transform import Rotation  # slow to import

    transform = np.eye(4)
    rotation = Rotation.from_quat(node.get("rotation", (0.0, 0.0, 0.0, 1.0))).as_matrix()
    transform[:3, :3] = rotation * np.array(node.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
    transform[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return transform


def shared_semantics(pieces: list[PlacedPrimitive]) -> list[str]:
    """The attributes that all pieces have, in one width and type, and that may be interpolated."""
    return [
        semantic
        for semantic in pieces[0].rows
        if semantic != "POSITION"
        and not semantic.startswith(COPIED)
        and all(piece.layout(semantic) == pieces[0].layout(semantic) for piece in pieces)
    ]
