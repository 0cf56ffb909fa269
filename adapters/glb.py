"""Binary glTF (GLB): all triangle meshes of a scene as one mesh."""

from __future__ import annotations

from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import FileContents, malformed, single_precision
from spinor_geom.adapters.glb_container import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, GlbContainer
from spinor_geom.adapters.glb_pieces import NAMES, TRIANGLES, Piece, scene_pieces, shared_semantics
from spinor_geom.adapters.glb_source import GlbSource
from spinor_geom.adapters.polygons import Polygons
from spinor_geom.adapters.seams import seam_representatives
from spinor_geom.errors import MeshFileError


def read_glb(data: bytes, path: Path | None) -> FileContents:
    """All triangles of a GLB file's scene, in the scene's coordinates.

    Primitives follow one another in the order of the nodes. A mesh that several nodes show is read once for each. Skins
    and morph targets are at rest. Edges along which any attribute differs, and those between the primitives of one node
    (which differ in material), are seams and are closed; nodes are not joined.

    A mesh or an array that is shown again and again is read again and again: up to `MOST_ROWS` rows in all, or as many
    as the file has bytes.

    Raises:
        MeshFileError: malformed, truncated, compressed (Draco, meshopt), with data outside of the file, of more rows
            than that, or without triangles; names the place.
    """
    try:
        return _contents(data, path)
    except MeshFileError:
        raise
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError) as error:
        problem = f"does not follow glTF ({type(error).__name__}: {error})"
        raise malformed(path, "JSON", problem, "check the file") from error


def _contents(data: bytes, path: Path | None) -> FileContents:
    pieces = scene_pieces(GlbContainer.read(data, path), path)
    if not pieces:
        raise malformed(path, "scene", "has no triangles", "give a file with a surface in it")
    vertices = np.concatenate([piece.decoded("POSITION") for piece in pieces])
    shared = shared_semantics(pieces)
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
        semantic = next((key for key, own in NAMES.items() if own == name), name)
        if not semantic.startswith(("COLOR_", "NORMAL", "TEXCOORD_")):
            semantic = f"_{name.upper().lstrip('_')}"
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
