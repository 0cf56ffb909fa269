"""Appending to a binary glTF file: patches grow the primitives they belong to."""

from __future__ import annotations

from collections import Counter
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from spinor_geom.adapters.contents import Addition
from spinor_geom.adapters.glb_container import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, GlbContainer, Json
from spinor_geom.adapters.glb_pieces import COPIED, NAMES, TRIANGLES, Piece


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
        primitive; those that no new face uses are not written. Rim vertices of other primitives are copied, bit by bit
        where both lie in one node.
        """
        if len(addition.faces) == 0 and len(addition.vertices) == 0:
            return self.data
        container = GlbContainer.read(self.data, self.path)
        labels = _connected(addition.faces, addition.first + len(addition.vertices))
        owners = _owners(addition, labels, self.pieces)
        for number in np.unique(owners).tolist():
            _grow(container, self.pieces, self.pieces[number], addition, addition.faces[owners == number], labels)
        return container.encoded()


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
