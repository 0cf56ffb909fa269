"""Cut-outs to be drawn: the removed piece and what each filler put in its place, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.bench.fillers import FILLERS
from spinor_geom.bench.measure import DISTANCE
from spinor_geom.render.layers import Scale

REMOVED = "removed"
_GAP = 1.15  # from piece to piece, per width


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """One of several patches side by side.

    Attributes:
        name: of the filler, or "removed".
        vertices: moved to the piece's place, the hole's normal along the third axis.
        faces: triangles.
        values: distance at each vertex from what was removed, per diameter of the hole.
    """

    name: str
    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    values: Float[np.ndarray, " n"]


def pieces_of(folder: Path) -> list[Piece]:
    """The pieces that a run left in a folder: what was removed, then the fillers' in their order."""
    names = [name for name in (REMOVED, *FILLERS) if (folder / f"{name}.npz").exists()]
    made: list[Piece] = []
    for place, name in enumerate(names):
        with np.load(folder / f"{name}.npz") as arrays:
            vertices, faces = arrays["vertices"].astype(np.float64), arrays["faces"].astype(np.int64)
            values = arrays[f"field/{DISTANCE}"].astype(np.float64)
        if not made:
            middle = vertices.mean(axis=0)
            axes = _axes(vertices, faces)
            width = _GAP * np.ptp((vertices - middle) @ axes.T, axis=0)[0]
        moved = (vertices - middle) @ axes.T + [place * width, 0, 0]
        made.append(Piece(name=name, vertices=moved, faces=faces, values=values))
    return made


def scale_of(pieces: Sequence[Piece]) -> Scale:
    """One scale for all: from zero to what all but one vertex in twenty of a typical piece stay below."""
    tops = [float(np.quantile(piece.values, 0.95)) for piece in pieces if piece.name != REMOVED]
    return Scale(low=0.0, high=float(np.median(tops)))


def _axes(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "3 3"]:
    """Rows: along the longest extent across the hole's normal, across, and the normal."""
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    normal /= np.linalg.norm(normal)
    flat = vertices - vertices.mean(axis=0)
    flat = flat - np.outer(flat @ normal, normal)
    first = np.linalg.svd(flat, full_matrices=False)[2][0]
    return np.stack([np.cross(normal, first), first, normal])
