"""Cut-outs to be drawn: the removed piece and what each filler put in its place, side by side."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.bench.fillers import FILLERS
from spinor_geom.bench.measure import DISTANCE
from spinor_geom.render.layers import Faces, Scale

REMOVED = "removed"
_GAP = 1.15  # from piece to piece, per width


def pieces_of(folder: Path) -> dict[str, Faces]:
    """The pieces that a run left in a folder, by name: what was removed, then the fillers' in their order.

    They lie side by side, the hole's normal along the third axis, each with its distance from what was removed, per
    diameter of the hole, at every vertex.
    """
    made: dict[str, Faces] = {}
    for name in (name for name in (REMOVED, *FILLERS) if (folder / f"{name}.npz").exists()):
        with np.load(folder / f"{name}.npz") as arrays:
            vertices, faces = arrays["vertices"].astype(np.float64), arrays["faces"].astype(np.int64)
            values = arrays["values"].astype(np.float64)
        if not made:
            middle = vertices.mean(axis=0)
            axes = _axes(vertices, faces)
            width = _GAP * np.ptp((vertices - middle) @ axes.T, axis=0)[0]
        moved = (vertices - middle) @ axes.T + [len(made) * width, 0, 0]
        made[name] = Faces(vertices=moved, faces=faces, fields={DISTANCE: values}, edges=True)
    return made


def scale_of(pieces: Mapping[str, Faces]) -> Scale:
    """One scale for all: from zero to what all but one vertex in twenty of a typical piece stay below."""
    tops = [float(np.quantile(piece.fields[DISTANCE], 0.95)) for name, piece in pieces.items() if name != REMOVED]
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
