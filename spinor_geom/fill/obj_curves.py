"""Closed curves of OBJ files as boundary loops."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from spinor_geom.adapters.contents import FileContents
from spinor_geom.adapters.polygon_faces import chained
from spinor_geom.errors import LoopTooShortError, NonFiniteVertexError, OpenCurveError, SpinorGeomError
from spinor_geom.fill.no_holes import require_area
from spinor_geom.mesh.boundary_loop import BoundaryLoop, detect_corners
from spinor_geom.mesh.intersections import require_simple
from spinor_geom.mesh.triangle_mesh import require_extent


@dataclass(frozen=True, kw_only=True, eq=False)
class NamedLoop:
    """A curve of a file as a loop, or the error that prevents a surface over it."""

    name: str  # of its object and group, or "" if the file has none
    points: Float[np.ndarray, "k 3"]  # of the loop, or the finite points of the curve
    loop: BoundaryLoop | None  # None if it cannot be made
    error: SpinorGeomError | None = None
    notes: tuple[str, ...] = ()  # repairs


def curve_loops(contents: FileContents, *, closing: float) -> list[NamedLoop]:
    """The curves of a file as loops, in its order.

    The ends of open curves are joined if they are at most `closing` mean edges apart (of the curve with shorter edges)
    and no third end is as near. A point that is equal to the one before is removed.
    """
    return [
        _curve_loop(contents.vertices, curve, contents.polyline_names[first], gap)
        for first, curve, gap in _joined(contents.vertices, contents.polylines, closing)
    ]


def _joined(
    vertices: Float[np.ndarray, "v 3"], curves: Sequence[Int[np.ndarray, " _"]], closing: float
) -> list[tuple[int, Int[np.ndarray, " _"], float]]:
    """Curves with near ends joined: the number of the first piece, vertex ids, and the largest gap that was closed."""
    is_open = [number for number, curve in enumerate(curves) if curve[0] != curve[-1]]
    whole = [(number, curve, 0.0) for number, curve in enumerate(curves) if curve[0] == curve[-1]]
    if not is_open:
        return whole
    pieces = [curves[number].copy() for number in is_open]
    ends = np.array([piece[[0, -1]] for piece in pieces]).ravel()
    gaps: dict[int, float] = {}
    for one, other in _near_ends(vertices, pieces, closing).tolist():
        gaps[int(ends[one])] = float(np.linalg.norm(vertices[ends[one]] - vertices[ends[other]]))
        pieces[other // 2][-(other % 2)] = ends[one]  # both ends get the vertex of the earlier one
    joined = [
        (is_open[first], curve, max((gaps[v] for v in gaps.keys() & set(curve.tolist())), default=0.0))
        for first, curve in chained(pieces)
    ]
    return sorted([*whole, *joined], key=lambda entry: entry[0])


def _near_ends(
    vertices: Float[np.ndarray, "v 3"], pieces: Sequence[Int[np.ndarray, " _"]], closing: float
) -> Int[np.ndarray, "p 2"]:
    """Pairs of ends to join, the earlier first. Piece k has the ends 2k and 2k + 1."""
    points = np.array([vertices[piece[[0, -1]]] for piece in pieces]).reshape(-1, 3)
    edges = np.repeat([_mean_edge(vertices[piece]) for piece in pieces], 2)
    if not np.isfinite(points).all():
        return np.zeros((0, 2), dtype=np.int64)
    pairs = cKDTree(points).query_pairs(closing * float(edges.max()), output_type="ndarray")
    distances = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    pairs = pairs[distances <= closing * edges[pairs].min(axis=1)]
    has_one_partner = np.bincount(pairs.ravel(), minlength=len(points)) == 1
    return np.asarray(pairs[has_one_partner[pairs].all(axis=1)])


def _mean_edge(points: Float[np.ndarray, "k 3"]) -> float:
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).mean())
    return length if np.isfinite(length) else 0.0


def _curve_loop(vertices: Float[np.ndarray, "v 3"], curve: Int[np.ndarray, " _"], name: str, gap: float) -> NamedLoop:
    points = vertices[curve]
    notes: list[str] = []
    loop: BoundaryLoop | None = None
    error: SpinorGeomError | None = None
    try:
        finite = np.isfinite(points).all(axis=1)
        if not finite.all():
            points = points[finite]
            raise NonFiniteVertexError(vertex=int(curve[np.argmin(finite)]))
        if curve[0] != curve[-1]:
            raise OpenCurveError(gap=float(np.linalg.norm(points[-1] - points[0])), mean_edge=_mean_edge(points))
        points, ids = points[:-1], curve[:-1]
        if gap:
            notes.append(f"closed over a gap of {gap:.6g}")
        kept = (points != np.roll(points, 1, axis=0)).any(axis=1)
        if not kept.all():
            notes.append(f"{(~kept).sum()} repeated {'point was' if (~kept).sum() == 1 else 'points were'} dropped")
            points, ids = points[kept], ids[kept]
        if len(points) < 3:
            raise LoopTooShortError(points=len(points))
        require_extent(points)
        loop = BoundaryLoop(points=points, vertex_ids=ids, corners=detect_corners(points))
        require_area(loop, loop.diagonal / loop.elongation)
        require_simple(loop)
    except SpinorGeomError as raised:
        error = raised
    return NamedLoop(name=name, points=points, loop=loop, error=error, notes=tuple(notes))
