"""The boundary loops of any mesh, and the choice of those to be filled."""

import operator
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np

from spinor_geom.adapters import to_mesh
from spinor_geom.errors import ForeignLoopError, LoopIndexError, OptionError
from spinor_geom.fill.fill_options import Choice
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.mesh.triangle_mesh import require_faces
from spinor_geom.plateau.plane_route import lie_in_plane
from spinor_geom.plateau.roughness import has_stray_corners

LoopChoice: TypeAlias = Literal["all"] | int | BoundaryLoop | Sequence[int]


def boundary_loops(mesh: Any) -> list[BoundaryLoop]:
    """The boundary loops of a mesh of any supported type, longest perimeter first.

    A loop passes each vertex once: a boundary that passes a vertex twice is split there. It is oriented as the boundary
    of a patch on it, opposite to the half-edges of the adjacent faces.

    Args:
        mesh: a path, a (vertices, faces) pair of arrays or tensors, or any mesh type that has an adapter.

    Returns:
        The loops, none for a closed mesh.

    Raises:
        UnknownMeshTypeError: no adapter supports the type.
        MeshFileError: the file is missing or malformed.
        NoFacesError: the mesh has vertices and no faces.
        MeshError: the mesh has an index out of range, a coordinate that is not finite, or arrays of the wrong shape.
        DuplicateVertexError: the faces do not share their vertices.
    """
    triangles = to_mesh(mesh)
    require_faces(triangles)
    return find_boundary_loops(triangles)


def free_rim(loop: BoundaryLoop, *, tolerance: float) -> BoundaryLoop:
    """The loop without stray corners (see `has_stray_corners`), so that Γ is free there.

    A loop that is plane within the tolerance, in mean edges, keeps them.
    """
    allowed = tolerance * loop.mean_edge_length / loop.diagonal
    if not has_stray_corners(loop) or lie_in_plane([loop], allowed=allowed):
        return loop
    return replace(loop, corners=np.zeros(len(loop), dtype=bool))


def chosen_indices(choice: LoopChoice, loops: Sequence[BoundaryLoop]) -> list[int]:
    """The indices of the chosen loops of a mesh, ascending.

    A `BoundaryLoop` chooses the loop with the same vertices, in the same cyclic order, at the same positions.

    Raises:
        LoopIndexError: an index is out of range.
        ForeignLoopError: the loop given is not one of the mesh's, or is reversed.
        OptionError: the choice is none of these.
    """
    if isinstance(choice, BoundaryLoop):
        for index, candidate in enumerate(loops):
            for start in np.flatnonzero(candidate.vertex_ids == choice.vertex_ids[0]).tolist():
                same_vertices = np.array_equal(np.roll(candidate.vertex_ids, -start), choice.vertex_ids)
                if same_vertices and np.array_equal(np.roll(candidate.points, -start, axis=0), choice.points):
                    return [index]
        raise ForeignLoopError(vertices=len(choice))
    if isinstance(choice, str) and choice == "all":
        return list(range(len(loops)))
    try:
        several = choice if isinstance(choice, Iterable) and not isinstance(choice, str) else [choice]
        indices = sorted({operator.index(index) for index in several})
    except TypeError:
        raise OptionError(f"loop must be 'all', an index, several indices or a BoundaryLoop, not {choice!r}") from None
    for index in indices:
        if not 0 <= index < len(loops):
            raise LoopIndexError(index=index, loops=len(loops))
    return indices


def reasons_to_leave_open(loops: Sequence[BoundaryLoop], indices: Sequence[int], choice: Choice) -> dict[int, str]:
    """The reasons why options exclude loops, by index. `indices` are the loops that they name."""
    reasons: dict[int, str] = {}
    chosen = set(indices)
    for index, loop in enumerate(loops):
        if index not in chosen:
            reasons[index] = "not requested"
        elif choice.keep_largest and index == 0:
            reasons[index] = "not requested: keep_largest leaves the longest loop open"
        elif choice.max_perimeter is not None and loop.perimeter > choice.max_perimeter:
            over = f"its perimeter {loop.perimeter:.6g} is over max_perimeter {choice.max_perimeter:.6g}"
            reasons[index] = f"not requested: {over}"
    return reasons
