"""The triangle primitives of a binary glTF scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import malformed, unit_vectors
from spinor_geom.adapters.extending import cast_values
from spinor_geom.adapters.glb_container import GlbContainer, Json

TRIANGLES, STRIP, FAN = 4, 5, 6  # a primitive's mode
WIDTHS = {"POSITION": 3, "NORMAL": 3, "TEXCOORD_0": 2}
# A mesh that many nodes show, or an array that many primitives name, is read once for each: what a scene may hold in
# rows of arrays, beyond as many as the file has bytes; 35 bytes of memory or so each.
MOST_ROWS = 10_000_000
ROWS_OF_A_PRIMITIVE = 100  # what its Python objects take
NAMES = {"COLOR_0": "color", "NORMAL": "normal", "TEXCOORD_0": "uv"}
# None of these means anything when averaged: a new vertex takes them from one old vertex beside it.
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

    @property
    def size(self) -> int:
        """How many rows its arrays have, faces included."""
        return len(self.faces) + sum(map(len, self.rows.values()))

    def decoded(self, semantic: str) -> Float[np.ndarray, "n k"]:
        """An attribute as float64 in the scene's coordinates; colours in the file's own scale."""
        rows = self.rows[semantic]
        values = rows.astype(np.float64)
        if semantic in self.normalized and semantic != "COLOR_0":
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


def scene_pieces(container: GlbContainer, path: Path | None) -> list[Piece]:
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
    pieces: list[Piece] = []
    seen: set[int] = set()
    most = max(MOST_ROWS, container.size)
    rows = 0
    stack = [(root, np.eye(4)) for root in reversed(roots)]
    while stack:
        number, parent = stack.pop()
        if number in seen:
            raise malformed(path, f"node {number}", "has two parents", "check the file")
        seen.add(number)
        node = container.item("nodes", number)
        with np.errstate(over="ignore", invalid="ignore"):  # a position that is not finite is reported later
            transform = parent @ _local_transform(node)
            is_flat = np.linalg.det(transform[:3, :3]) == 0
        stack += [(child, transform) for child in reversed(node.get("children", []))]
        if "mesh" in node:
            placed = np.eye(4) if "skin" in node else transform
            if is_flat and "skin" not in node:
                raise malformed(path, f"node {number}", "its transform flattens the mesh", "correct the transform")
            for index in range(len(tree["meshes"][node["mesh"]]["primitives"])):
                start = pieces[-1].stop if pieces else 0
                piece = _piece(container, number, index, start, placed, path)
                pieces += [piece] if piece is not None else []
                rows += ROWS_OF_A_PRIMITIVE + (piece.size if piece is not None else 0)
                if rows > most:
                    problem = f"with it the scene has more than {most:,} rows of arrays, as it shows meshes repeatedly"
                    raise malformed(path, f"node {number}", problem, "give each mesh as a file of its own")
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
    count = len(rows["POSITION"])
    if any(
        len(values) != count or values.shape[1] != WIDTHS.get(name, values.shape[1]) for name, values in rows.items()
    ):
        raise malformed(
            path, place, "its attributes do not have one row a vertex, of their own width", "check the file"
        )
    indices = np.arange(count)
    if "indices" in primitive:
        stored = container.values(primitive["indices"])
        if stored.dtype.kind != "u":
            raise malformed(path, place, "its indices are no unsigned integers", "correct the indices")
        indices = stored[:, 0].astype(np.int64)
    faces = _triangles(indices, mode)
    if faces is None or (len(faces) and (faces.max() >= count or faces.min() < 0)):
        problem = f"its indices are no triangles over its {count} vertices"
        raise malformed(path, place, problem, "correct the indices")
    if len(faces) == 0:
        return None
    # only writing needs them, but what is wrong with them is told now
    moved = [container.values(accessor) for target in primitive.get("targets", []) for accessor in target.values()]
    if any(len(values) != count for values in moved):
        raise malformed(path, place, "its morph targets do not have one row a vertex", "check the file")
    normalized = frozenset(
        semantic
        for semantic, accessor in primitive["attributes"].items()
        if tree["accessors"][accessor].get("normalized", False) and rows[semantic].dtype.kind != "f"
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


def shared_semantics(pieces: list[Piece]) -> list[str]:
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
