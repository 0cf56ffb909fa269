"""The boundary loops of any mesh, and the choice of those to be filled."""

from __future__ import annotations

import operator
import os
from collections.abc import Iterable, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np

from spinor_geom.adapters import MeshFile, read_mesh, to_mesh
from spinor_geom.errors import ForeignLoopError, LoopIndexError, MeshError, OptionError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.loops import find_boundary_loops
from spinor_geom.mesh.triangle_mesh import TriangleMesh

LoopChoice: TypeAlias = Literal["all"] | int | BoundaryLoop | Sequence[int]


def boundary_loops(mesh: Any) -> list[BoundaryLoop]:
    """The boundary loops of a mesh of any known type, longest perimeter first.

    Each loop visits a vertex once (a boundary that passes a vertex twice is split there) and runs the way the boundary
    of a patch on it runs: against the half-edges of the faces beside the hole.

    Args:
        mesh: a path, a (vertices, faces) pair of arrays or tensors, or any mesh type that has an adapter.

    Returns:
        The loops; none for a closed mesh.

    Raises:
        UnknownMeshTypeError: no adapter knows the type.
        MeshFileError: the file is missing or malformed.
        MeshError: the mesh has no unambiguous boundary (see `spinor_geom.mesh.validate`).
        DuplicateVertexError: the faces do not share their vertices.
    """
    source = read_mesh(mesh) if isinstance(mesh, (str, os.PathLike)) else mesh
    return loops_of(source, to_mesh(source))


def loops_of(source: Any, triangles: TriangleMesh) -> list[BoundaryLoop]:
    """The boundary loops of a mesh's triangles; what is wrong with faces of a file is told by its own face numbers.

    Raises:
        MeshError: as `boundary_loops`.
    """
    try:
        return find_boundary_loops(triangles)
    except MeshError as error:
        raise (source.with_own_face_numbers(error) if isinstance(source, MeshFile) else error) from None


def place_of_loop(loop: BoundaryLoop, loops: Sequence[BoundaryLoop]) -> int:
    """The place of a loop among those of a mesh: same vertices in the same cyclic order, at the same positions.

    Raises:
        ForeignLoopError: it is none of them, or runs the other way.
    """
    ids = np.asarray(loop.vertex_ids)
    for place, candidate in enumerate(loops):
        if len(candidate) != len(loop):
            continue
        start = np.flatnonzero(np.asarray(candidate.vertex_ids) == ids[0])
        if start.size != 1:
            continue
        shift = -int(start[0])
        same_vertices = np.array_equal(np.roll(candidate.vertex_ids, shift), ids)
        if same_vertices and np.array_equal(np.roll(candidate.points, shift, axis=0), loop.points):
            return place
    raise ForeignLoopError(vertices=len(loop))


def chosen_places(choice: LoopChoice, loops: Sequence[BoundaryLoop]) -> list[int]:
    """The places of the loops that a choice names, ascending.

    Args:
        choice: "all", a place, several places, or one of the mesh's loops.
        loops: all loops of the mesh.

    Raises:
        LoopIndexError: a place does not exist.
        ForeignLoopError: the loop given is not one of the mesh's.
        OptionError: the choice is none of these.
    """
    if isinstance(choice, BoundaryLoop):
        return [place_of_loop(choice, loops)]
    if isinstance(choice, str):
        if choice != "all":
            raise OptionError(f"loop must be 'all', a place, several places or a BoundaryLoop, not {choice!r}")
        return list(range(len(loops)))
    try:
        several = choice if isinstance(choice, Iterable) else [choice]
        places = {operator.index(place) for place in several}
    except TypeError:
        raise OptionError(f"loop must be 'all', a place, several places or a BoundaryLoop, not {choice!r}") from None
    for place in sorted(places):
        if not 0 <= place < len(loops):
            raise LoopIndexError(index=place, loops=len(loops))
    return sorted(places)


def reasons_to_leave_open(
    loops: Sequence[BoundaryLoop], places: Sequence[int], *, keep_largest: bool, max_perimeter: float | None
) -> list[str | None]:
    """For every loop why the caller wants it left open, or None where it is to be filled.

    Args:
        loops: all loops of the mesh, longest perimeter first.
        places: those that were chosen.
        keep_largest: leaves the longest loop open.
        max_perimeter: leaves longer loops open, in mesh units.
    """
    reasons: list[str | None] = []
    chosen = set(places)
    for place, loop in enumerate(loops):
        if place not in chosen:
            reasons.append("not requested")
        elif keep_largest and place == 0:
            reasons.append("not requested: keep_largest leaves the longest loop open")
        elif max_perimeter is not None and loop.perimeter > max_perimeter:
            reasons.append(
                f"not requested: its perimeter {loop.perimeter:.6g} is over max_perimeter {max_perimeter:.6g}"
            )
        else:
            reasons.append(None)
    return reasons
