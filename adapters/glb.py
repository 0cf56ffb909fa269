"""Binary glTF (GLB): reading all triangle meshes of a scene, and growing them where they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from spinor_geom.adapters.contents import Addition, FileContents, malformed, single_precision, unit_vectors
from spinor_geom.adapters.extending import cast_values
from spinor_geom.adapters.glb_container import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, GlbContainer, Json
from spinor_geom.adapters.polygons import Polygons
from spinor_geom.adapters.seams import seam_representatives
from spinor_geom.errors import MeshFileError

TRIANGLES, STRIP, FAN = 4, 5, 6  # a primitive's mode
NAMES = {"COLOR_0": "color", "NORMAL": "normal", "TEXCOORD_0": "uv"}
# Neither means anything when averaged: a new vertex takes them from one old vertex beside it.
COPIED = ("JOINTS_", "WEIGHTS_", "TANGENT")


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """One triangle primitive of one node: a run of the vertices of the whole scene.

    Attributes:
        node: the node's number.
        primitive: the number of the primitive in the node's mesh.
        start: the number of its first vertex in the scene.
        faces: (F, 3) triangles over its own vertices.
        rows: (n, k) its attributes as the file stores them, by their glTF names.
        normalized: those of them whose integers stand for fractions of the largest one.
        transform: (4, 4) from its own coordinates to the scene's.
    """

    node: int
    primitive: int
    start: int
    faces: Int[np.ndarray, "f 3"]
    rows: Mapping[str, np.ndarray]
    normalized: frozenset[str]
    transform: Float[np.ndarray, "4 4"]

    @property
    def stop(self) -> int:
        """One more than the number of its last vertex in the scene."""
        return self.start + len(self.rows["POSITION"])

    def decoded(self, semantic: str) -> Float[np.ndarray, "n k"]:
        """An attribute as float64 in the scene's coordinates; colours in the file's own scale."""
        rows = self.rows[semantic]
        values = rows.astype(np.float64)
        if semantic in self.normalized and semantic != "COLOR_0":
            values = values / np.iinfo(rows.dtype).max
        if semantic == "TEXCOORD_0":
            return values * [1.0, -1.0] + [0.0, 1.0]
        if np.array_equal(self.transform, np.eye(4)) or semantic not in ("POSITION", "NORMAL"):
            return values
        with np.errstate(over="ignore", invalid="ignore"):  # a position that is not finite is reported later
            if semantic == "POSITION":
                return np.asarray(values @ self.transform[:3, :3].T + self.transform[:3, 3])
            return unit_vectors(values @ np.linalg.inv(self.transform[:3, :3]))

    def encoded(self, semantic: str, values: Float[np.ndarray, "n k"]) -> np.ndarray:
        """The inverse of `decoded`, rounded to what the file stores."""
        dtype = self.rows[semantic].dtype
        if semantic == "TEXCOORD_0":
            values = values * [1.0, -1.0] + [0.0, 1.0]
        if not np.array_equal(self.transform, np.eye(4)):
            if semantic == "POSITION":
                values = (values - self.transform[:3, 3]) @ np.linalg.inv(self.transform[:3, :3]).T
            elif semantic == "NORMAL":
                values = unit_vectors(values @ self.transform[:3, :3])
        if semantic in self.normalized and semantic != "COLOR_0":
            values = values * np.iinfo(dtype).max
        return cast_values(values, dtype)


@dataclass(frozen=True, kw_only=True, eq=False)
class GlbSource:
    """A GLB file as it was read.

    Attributes:
        data: the file's bytes.
        pieces: its triangle primitives, in the order of the scene's vertices.
        path: its name, for errors.
    """

    data: bytes
    pieces: tuple[Piece, ...]
    path: Path | None
    suffix: str = ".glb"

    def appended(self, addition: Addition) -> bytes:
        """The file with every new patch in the primitive that most of its rim belongs to.

        Materials, textures, animations and all other content stay as they are. New vertices stand after those of their
        primitive. Rim vertices of other primitives are copied, bit by bit where both lie in one node.
        """
        if len(addition.faces) == 0 and len(addition.vertices) == 0:
            return self.data
        container = GlbContainer.read(self.data, self.path)
        labels = _connected(addition.faces, addition.first + len(addition.vertices))
        owners = _owners(addition, labels, self.pieces)
        for number in np.unique(owners).tolist():
            _grow(container, self.pieces, self.pieces[number], addition, addition.faces[owners == number], labels)
        return container.encoded()


def read_glb(data: bytes, path: Path | None) -> FileContents:
    """All triangles of a GLB file's scene, in the scene's coordinates.

    Primitives follow one another in the order of the nodes. A mesh that several nodes show is read once for each. Skins
    and morph targets are at rest. Edges along which any attribute differs, and those between the primitives of one node
    (which differ in material), are seams and are closed; nodes are not joined.

    Raises:
        MeshFileError: malformed, truncated, compressed (Draco, meshopt), with data outside of the file, or without
            triangles; names the place.
    """
    try:
        pieces = _pieces(GlbContainer.read(data, path), path)
    except MeshFileError:
        raise
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError) as error:
        problem = f"does not follow glTF ({type(error).__name__}: {error})"
        raise malformed(path, "JSON", problem, "check the file") from error
    if not pieces:
        raise malformed(path, "scene", "has no triangles", "give a file with a surface in it")
    vertices = np.concatenate([piece.decoded("POSITION") for piece in pieces])
    shared = _shared_semantics(pieces)
    attributes = {
        NAMES.get(semantic, semantic): np.concatenate([piece.decoded(semantic) for piece in pieces])
        for semantic in shared
    }
    color_dtype: np.dtype[Any] = pieces[0].rows["COLOR_0"].dtype if "color" in attributes else np.dtype(np.float32)
    return FileContents(
        vertices=vertices,
        polygons=Polygons.of_triangles(np.concatenate([piece.faces + piece.start for piece in pieces])),
        attributes=attributes,
        color_scale=1.0 if color_dtype.kind == "f" else float(np.iinfo(color_dtype).max),
        representatives=_representatives(vertices, pieces),
        source=GlbSource(data=data, pieces=tuple(pieces), path=path),
    )


def encode_glb(contents: FileContents) -> bytes:
    """A new GLB file with one mesh: positions as float32, and those attributes that glTF has a place for.

    Raises:
        MeshFileError: a number is too large for float32.
    """
    container = GlbContainer(
        tree={
            "asset": {"version": "2.0", "generator": "spinor_geom"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
        },
        views=[],
        path=None,
    )
    rows = {"POSITION": single_precision(contents.vertices)}
    for name, values in contents.attributes.items():
        semantic = next((key for key, own in NAMES.items() if own == name), f"_{name.upper().lstrip('_')}")
        if values.shape[1] > 4 or (name == "normal" and values.shape[1] != 3):
            continue
        if name == "uv":
            values = values[:, :2] * [1.0, -1.0] + [0.0, 1.0]
        rows[semantic] = single_precision(values / contents.color_scale if name == "color" else values)
    faces, _ = contents.polygons.triangulated(contents.vertices)
    attributes = {
        semantic: container.store(values, instead_of=None, target=ARRAY_BUFFER, bounds=semantic == "POSITION")
        for semantic, values in rows.items()
    }
    indices = container.store(faces.reshape(-1, 1).astype("<u4"), instead_of=None, target=ELEMENT_ARRAY_BUFFER)
    container.tree["meshes"] = [{"primitives": [{"attributes": attributes, "indices": indices, "mode": TRIANGLES}]}]
    return container.encoded()


def _pieces(container: GlbContainer, path: Path | None) -> list[Piece]:
    """The triangle primitives of the scene, node by node, parents first."""
    tree = container.tree
    nodes = tree.get("nodes", [])
    if "scenes" in tree:
        roots = tree["scenes"][tree.get("scene", 0)].get("nodes", [])
    else:
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [number for number in range(len(nodes)) if number not in children]
    pieces: list[Piece] = []
    seen: set[int] = set()
    stack = [(root, np.eye(4)) for root in reversed(roots)]
    while stack:
        number, parent = stack.pop()
        if number in seen:
            raise malformed(path, f"node {number}", "has two parents", "check the file")
        seen.add(number)
        node = nodes[number]
        transform = parent @ _local_transform(node)
        stack += [(child, transform) for child in reversed(node.get("children", []))]
        if "mesh" in node:
            placed = np.eye(4) if "skin" in node else transform
            if np.linalg.det(placed[:3, :3]) == 0:
                raise malformed(path, f"node {number}", "its transform flattens the mesh", "correct the transform")
            for index in range(len(tree["meshes"][node["mesh"]]["primitives"])):
                start = pieces[-1].stop if pieces else 0
                piece = _piece(container, number, index, start, placed, path)
                pieces += [piece] if piece is not None else []
    return pieces


def _piece(
    container: GlbContainer,
    node: int,
    index: int,
    start: int,
    transform: Float[np.ndarray, "4 4"],
    path: Path | None,
) -> Piece | None:
    """One primitive, or None if it has no triangles."""
    tree = container.tree
    mesh = tree["nodes"][node]["mesh"]
    primitive = tree["meshes"][mesh]["primitives"][index]
    place = f"mesh {mesh}, primitive {index}"
    mode = primitive.get("mode", TRIANGLES)
    if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in primitive["attributes"]:
        return None
    if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
        raise malformed(path, place, "is compressed with Draco", "decompress the file first")
    rows = {semantic: container.values(accessor) for semantic, accessor in primitive["attributes"].items()}
    count, width = rows["POSITION"].shape
    if width != 3 or any(len(values) != count for values in rows.values()):
        raise malformed(path, place, "its attributes do not have one row a vertex", "check the file")
    indices = np.arange(count)
    if "indices" in primitive:
        indices = container.values(primitive["indices"])[:, 0].astype(np.int64)
    faces = _triangles(indices, mode)
    if faces is None or (len(faces) and (faces.max() >= count or faces.min() < 0)):
        problem = f"its indices are no triangles over its {count} vertices"
        raise malformed(path, place, problem, "correct the indices")
    if len(faces) == 0:
        return None
    normalized = frozenset(
        semantic
        for semantic, accessor in primitive["attributes"].items()
        if tree["accessors"][accessor].get("normalized", False)
    )
    return Piece(
        node=node, primitive=index, start=start, faces=faces, rows=rows, normalized=normalized, transform=transform
    )


def _triangles(indices: Int[np.ndarray, " n"], mode: int) -> Int[np.ndarray, "f 3"] | None:
    """The triangles of a list, strip or fan of indices; None if a list is no multiple of three."""
    if mode == TRIANGLES:
        return indices.reshape(-1, 3) if len(indices) % 3 == 0 else None
    if len(indices) < 3:
        return np.zeros((0, 3), dtype=np.int64)
    if mode == FAN:
        apex = np.broadcast_to(indices[:1], len(indices) - 2)
        return np.stack([apex, indices[1:-1], indices[2:]], axis=1)
    faces = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    faces[1::2] = faces[1::2, [1, 0, 2]]
    # strips name a vertex twice to jump to another place
    return np.asarray(faces[(faces != np.roll(faces, -1, axis=1)).all(axis=1)])


def _local_transform(node: Json) -> Float[np.ndarray, "4 4"]:
    """A node's transform to its parent's coordinates."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape((4, 4), order="F")
    transform = np.eye(4)
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    transform[:3, :3] = rotation * np.array(node.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
    transform[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return transform


def _shared_semantics(pieces: list[Piece]) -> list[str]:
    """The attributes that all pieces have, in one width and type, and that may be interpolated."""
    first = pieces[0].rows
    return [
        semantic
        for semantic, rows in first.items()
        if semantic != "POSITION"
        and not semantic.startswith(COPIED)
        and all(
            semantic in piece.rows
            and piece.rows[semantic].shape[1] == rows.shape[1]
            and piece.rows[semantic].dtype == rows.dtype
            for piece in pieces
        )
    ]


def _representatives(vertices: Float[np.ndarray, "v 3"], pieces: list[Piece]) -> Int[np.ndarray, " v"]:
    """For every vertex the one that stands for its place, found for each node by itself."""
    representatives = np.empty(len(vertices), dtype=np.int64)
    for node in dict.fromkeys(piece.node for piece in pieces):
        own = [piece for piece in pieces if piece.node == node]
        start, stop = own[0].start, own[-1].stop
        primitive = np.concatenate([np.full((piece.stop - piece.start, 1), piece.primitive) for piece in own])
        appearance = [np.concatenate([piece.rows[name] for piece in own]) for name in _shared_semantics(own)]
        faces = Polygons.of_triangles(np.concatenate([piece.faces + (piece.start - start) for piece in own]))
        representatives[start:stop] = start + seam_representatives(
            vertices[start:stop], faces, [primitive, *appearance]
        )
    return representatives


def _connected(faces: Int[np.ndarray, "t 3"], vertices: int) -> Int[np.ndarray, " {vertices}"]:
    """A label for every vertex, the same for those that the faces connect."""
    links = coo_array(
        (np.ones(2 * len(faces), dtype=bool), (np.tile(faces[:, 0], 2), faces[:, 1:].T.reshape(-1))),
        shape=(vertices, vertices),
    )
    _, labels = connected_components(links, directed=False)
    return np.asarray(labels, dtype=np.int64)


def _owners(addition: Addition, labels: Int[np.ndarray, " v"], pieces: tuple[Piece, ...]) -> Int[np.ndarray, " t"]:
    """For every new face the piece that most of the old vertices of its patch belong to."""
    old = np.unique(addition.faces)
    old = old[old < addition.first]
    piece_of = np.searchsorted([piece.start for piece in pieces], old, side="right") - 1
    patches, patch_of = np.unique(labels[addition.faces[:, 0]], return_inverse=True)
    votes = np.zeros((len(patches), len(pieces)), dtype=np.int64)
    np.add.at(votes, (np.searchsorted(patches, labels[old]), piece_of), 1)
    return np.asarray(votes.argmax(axis=1)[patch_of], dtype=np.int64)


def _grow(
    container: GlbContainer,
    pieces: tuple[Piece, ...],
    piece: Piece,
    addition: Addition,
    faces: Int[np.ndarray, "t 3"],
    labels: Int[np.ndarray, " v"],
) -> None:
    """Append faces and the vertices they need to one piece in the file."""
    primitive = _own_primitive(container.tree, piece)
    count = piece.stop - piece.start
    used = np.unique(faces)
    inside = (used >= piece.start) & (used < piece.stop)
    others = used[~inside]
    own = (faces >= piece.start) & (faces < piece.stop)
    local_faces = np.where(own, faces - piece.start, count + np.searchsorted(others, faces))
    donors = _donors(used[inside], others, labels, default=piece.start) - piece.start
    for semantic, rows in piece.rows.items():
        new_rows = _new_rows(pieces, piece, semantic, addition, others, rows[donors])
        primitive["attributes"][semantic] = container.store(
            np.concatenate([rows, new_rows]),
            instead_of=primitive["attributes"][semantic],
            target=ARRAY_BUFFER,
            bounds=semantic == "POSITION",
        )
    for target in primitive.get("targets", []):
        for semantic, accessor in target.items():
            rows = container.values(accessor)
            still = np.zeros((len(others), rows.shape[1]), dtype=rows.dtype)
            target[semantic] = container.store(
                np.concatenate([rows, still]), instead_of=accessor, target=ARRAY_BUFFER, bounds=semantic == "POSITION"
            )
    all_faces = np.concatenate([piece.faces, local_faces])
    # the largest index of each type means "restart" to graphics hardware
    dtype = np.uint16 if all_faces.max() < np.iinfo(np.uint16).max else np.uint32
    primitive["indices"] = container.store(
        all_faces.reshape(-1, 1).astype(dtype), instead_of=primitive.get("indices"), target=ELEMENT_ARRAY_BUFFER
    )
    primitive["mode"] = TRIANGLES


def _own_primitive(tree: Json, piece: Piece) -> Json:
    """The piece's entry in the JSON, after giving its node a mesh of its own if other nodes show the same."""
    node = tree["nodes"][piece.node]
    shown = Counter(other["mesh"] for other in tree["nodes"] if "mesh" in other)
    if shown[node["mesh"]] > 1:
        tree["meshes"].append(deepcopy(tree["meshes"][node["mesh"]]))
        node["mesh"] = len(tree["meshes"]) - 1
    entry: Json = tree["meshes"][node["mesh"]]["primitives"][piece.primitive]
    return entry


def _donors(
    own: Int[np.ndarray, " n"], others: Int[np.ndarray, " m"], labels: Int[np.ndarray, " v"], *, default: int
) -> Int[np.ndarray, " m"]:
    """For every other vertex one of the piece's own vertices in the same patch."""
    if len(own) == 0:
        return np.full(len(others), default)
    patches, first = np.unique(labels[own], return_index=True)
    place = np.minimum(np.searchsorted(patches, labels[others]), len(patches) - 1)
    return np.where(patches[place] == labels[others], own[first[place]], default)


def _new_rows(
    pieces: tuple[Piece, ...],
    piece: Piece,
    semantic: str,
    addition: Addition,
    others: Int[np.ndarray, " m"],
    rows: np.ndarray,
) -> np.ndarray:
    """An attribute of new vertices and of those taken over from other pieces; `rows` where nothing is known."""
    rows = rows.copy()
    is_new = others >= addition.first
    new = others[is_new] - addition.first
    name = NAMES.get(semantic, semantic)
    if semantic == "POSITION":
        rows[is_new] = piece.encoded(semantic, addition.vertices[new])
    elif name in addition.attributes and not semantic.startswith(COPIED):
        rows[is_new] = piece.encoded(semantic, addition.attributes[name][new])
    for other in pieces:
        taken = (others >= other.start) & (others < other.stop)
        if not taken.any() or semantic not in other.rows:
            continue
        within = others[taken] - other.start
        same = other.node == piece.node and other.rows[semantic].dtype == rows.dtype
        if same and other.rows[semantic].shape[1] == rows.shape[1]:
            rows[taken] = other.rows[semantic][within]
        elif semantic == "POSITION":
            rows[taken] = piece.encoded(semantic, other.decoded(semantic)[within])
    return rows
