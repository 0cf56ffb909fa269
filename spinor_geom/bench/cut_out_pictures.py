"""Pictures of cut-outs: the removed piece and what each filler put in its place, side by side."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure
from matplotlib.image import imread

from spinor_geom.bench.fillers import FILLERS
from spinor_geom.bench.measure import DISTANCE
from spinor_geom.render.layers import Scale
from spinor_geom.render.portrait import plain_portrait

REMOVED = "removed"
_GAP = 1.15  # from piece to piece, per width
_SIDE = 220  # of a piece, in pixels
_EYE = (0.0, -2.0, 1.3)


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


def pictures(folders: Sequence[Path]) -> Figure:
    """Pictures of cut-outs below each other: what was removed and what the fillers put there, coloured by distance.

    Args:
        folders: in each the pieces that a run left of a cut-out.

    Raises:
        MissingPackageError: pyvista is not installed.
        RenderError: the drawing failed.
    """
    figure = Figure(figsize=(16, 2.3 * len(folders)), layout="constrained")
    rows = figure.subplots(len(folders), 1, squeeze=False)[:, 0]
    for axes, folder in zip(rows, folders, strict=True):
        pieces = pieces_of(folder)
        with tempfile.TemporaryDirectory() as place:
            _draw(pieces, Path(place) / "strip.png")
            axes.imshow(imread(Path(place) / "strip.png"))
        axes.set_xticks(
            _SIDE * (np.arange(len(pieces)) + 0.5), [piece.name.replace("-", "-\n", 1) for piece in pieces], fontsize=9
        )
        axes.set_yticks([])
        axes.set_frame_on(False)
        axes.set_title(f"{folder.name}: yellow is {scale_of(pieces).high:.1%} of the hole's diameter away", fontsize=10)
    return figure


def _draw(pieces: Sequence[Piece], path: Path) -> None:
    scale = scale_of(pieces)
    portraits = [
        plain_portrait(piece.vertices, piece.faces, np.clip(piece.values, scale.low, scale.high)) for piece in pieces
    ]
    portraits[0].beside(*portraits[1:]).write(path, eye=_EYE, size=(_SIDE * len(pieces), _SIDE))


def _axes(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "3 3"]:
    """Rows: along the longest extent across the hole's normal, across, and the normal."""
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    normal /= np.linalg.norm(normal)
    flat = vertices - vertices.mean(axis=0)
    flat = flat - np.outer(flat @ normal, normal)
    first = np.linalg.svd(flat, full_matrices=False)[2][0]
    return np.stack([np.cross(normal, first), first, normal])
