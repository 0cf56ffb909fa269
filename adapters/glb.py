"""Binary glTF (GLB): all triangle meshes of a scene as one mesh, and patches in the primitives that they belong to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from copy import deepcopy
from functools import partial
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import FileContents, malformed, single_precision
from spinor_geom.adapters.extending import parts_of_faces
from spinor_geom.adapters.glb_container import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, GlbContainer
from spinor_geom.adapters.glb_pieces import COPIED, Piece, have_one_layout, scene_pieces, shared_semantics
from spinor_geom.adapters.polygons import Polygons
from spinor_geom.adapters.seams import seam_representatives
from spinor_geom.errors import MeshFileError
from spinor_geom.mesh.triangle_mesh import MeshExtension

NAMES = {"COLOR_0": "color", "NORMAL": "normal", "TEXCOORD_0": "uv"}


def read_glb(data: bytes, path: Path | None) -> FileContents:
    """All triangles of a GLB file's scene, in the scene's coordinates.

    Primitives follow one another in the order of the nodes. A mesh that several nodes show is read once for each. Skins
    are at rest. Edges along which any attribute differs, and those between the primitives of one node (which differ in
    material), are seams and are closed; nodes are not joined.

    A mesh or an array that is shown again and again is read again and again: up to `MOST_ROWS` rows in all, or as many
    as the file has bytes.

    Raises:
        MeshFileError: malformed, truncated, compressed (Draco, meshopt), with sparse arrays, strips, morph targets
            or data outside of the file, of more rows than that, or without triangles; names the place.
    """
    try:
        pieces = scene_pieces(GlbContainer.read(data, path))
    except MeshFileError:
        raise
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError) as error:
        problem = f"does not follow glTF ({type(error).__name__}: {error})"
        raise malformed(path, "JSON", problem, "check the file") from error
    if not pieces:
        raise malformed(path, "scene", "has no triangles", "give a file with a surface in it")
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
        representatives=_representatives(vertices, pieces),
        suffix=".glb",
        appended=partial(_appended, data, pieces, path),
    )


def _appended(data: bytes, pieces: Sequence[Piece], path: Path | None, extension: MeshExtension) -> bytes:
    """The file with every new patch in the primitive that most of its rim belongs to.

    Materials, textures, animations and all other content stay as they are. New vertices stand after those of their
    primitive; those that no new face uses are not written. Rim vertices of other primitives are copied, bit by bit
    where both lie in one node.
    """
    if len(extension.faces) == 0 and len(extension.vertices) == 0:
        return data
    container = GlbContainer.read(data, path)
    vertices = np.concatenate([*(piece.decoded("POSITION") for piece in pieces), extension.vertices])
    votes = parts_of_faces(extension, [piece.start for piece in pieces], pieces[-1].stop)
    owners = votes.argmax(axis=1)
    for number in np.unique(owners).tolist():
        _grow(container, pieces, pieces[number], extension, extension.faces[owners == number], vertices)
    return container.encoded()


def _grow(
    container: GlbContainer,
    pieces: Sequence[Piece],
    piece: Piece,
    extension: MeshExtension,
    faces: Int[np.ndarray, "t 3"],
    vertices: Float[np.ndarray, "v 3"],
) -> None:
    """Append faces and the vertices they need to one piece in the file."""
    from scipy.spatial import KDTree  # takes long to import

    nodes, meshes = container.tree["nodes"], container.tree["meshes"]
    node = nodes[piece.node]
    if Counter(other.get("mesh") for other in nodes)[node["mesh"]] > 1:
        # what other nodes show stays as it is
        meshes.append(deepcopy(meshes[node["mesh"]]))
        node["mesh"] = len(meshes) - 1
    primitive = meshes[node["mesh"]]["primitives"][piece.primitive]
    own = (faces >= piece.start) & (faces < piece.stop)
    others = np.unique(faces[~own])
    is_new = others >= pieces[-1].stop
    new = others[is_new] - pieces[-1].stop
    _, nearest = KDTree(piece.decoded("POSITION")).query(vertices[others])
    for semantic, rows in piece.rows.items():
        new_rows = rows[nearest]
        name = NAMES.get(semantic, semantic)
        if semantic == "POSITION":
            new_rows = piece.encoded(semantic, vertices[others])
        elif name in extension.vertex_attributes and not semantic.startswith(COPIED):
            new_rows[is_new] = piece.encoded(semantic, extension.vertex_attributes[name][new])
        for other in pieces:
            if other.node == piece.node and have_one_layout(piece, other, semantic):
                taken = (others >= other.start) & (others < other.stop)
                new_rows[taken] = other.rows[semantic][others[taken] - other.start]
        primitive["attributes"][semantic] = container.store(
            np.concatenate([rows, new_rows]), target=ARRAY_BUFFER, instead_of=primitive["attributes"][semantic]
        )
    local = np.where(own, faces - piece.start, piece.stop - piece.start + np.searchsorted(others, faces))
    all_faces = np.concatenate([piece.faces, local])
    # the largest index of each type means "restart" to graphics hardware
    dtype = np.uint16 if all_faces.max() < np.iinfo(np.uint16).max else np.uint32
    primitive["indices"] = container.store(
        all_faces.reshape(-1, 1).astype(dtype), target=ELEMENT_ARRAY_BUFFER, instead_of=primitive.get("indices")
    )


def encode_glb(contents: FileContents) -> bytes:
    """A new GLB file with one mesh: positions as float32, and those attributes that glTF has a place for.

    Raises:
        MeshFileError: a number is too large for float32.
    """
    rows = {"POSITION": single_precision(contents.vertices)}
    for name, values in contents.attributes.items():
        semantic = next((key for key, own in NAMES.items() if own == name), name)
        if not semantic.startswith(("COLOR_", "NORMAL", "TEXCOORD_")):
            semantic = f"_{name.upper().lstrip('_')}"
        if values.shape[1] > 4 or (name == "normal" and values.shape[1] != 3):
            continue
        if name == "uv":
            values = values[:, :2] * [1.0, -1.0] + [0.0, 1.0]
        rows[semantic] = single_precision(values / contents.color_scale if name == "color" else values)
    faces, _ = contents.polygons.triangulated(contents.vertices)
    container = GlbContainer(tree={}, views=[], path=None)
    primitive = {
        "attributes": {name: container.store(values, target=ARRAY_BUFFER) for name, values in rows.items()},
        "indices": container.store(faces.reshape(-1, 1).astype("<u4"), target=ELEMENT_ARRAY_BUFFER),
    }
    container.tree |= {
        "asset": {"version": "2.0", "generator": "spinor_geom"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
    }
    return container.encoded()


def _representatives(vertices: Float[np.ndarray, "v 3"], pieces: list[Piece]) -> Int[np.ndarray, " v"]:
    """For every vertex the one that stands for its place, found for each node by itself."""
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
