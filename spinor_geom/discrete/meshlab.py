"""Other triangles for the discrete baseline: MeshLab's isotropic remeshing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.errors import FirstFillError
from spinor_geom.mesh.topology import face_components, is_watertight

if TYPE_CHECKING:
    import pymeshlab

_STEPS = 5


def remeshed(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], boundary_size: int, size: float
) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "t 3"]]:
    """A disk whose inner edges MeshLab has made about equally long; the boundary and its edges stay as they are.

    It splits, collapses and flips edges away from the boundary's triangles, then only flips, everywhere. A disk that
    has no other triangles is left alone. The boundary's vertices come first, in order.

    Raises:
        FirstFillError: MeshLab fails, moves the boundary or tears the disk.
    """
    import pymeshlab

    m, meshes = boundary_size, _mesh_set(vertices, faces)
    meshes.compute_selection_from_mesh_border()
    meshes.apply_selection_inverse(invfaces=True)
    if not meshes.current_mesh().selected_face_number():
        return vertices, faces
    ours = {"iterations": _STEPS, "targetlen": pymeshlab.PureValue(size), "featuredeg": 180.0}
    ours |= {"checksurfdist": False, "reprojectflag": False}
    try:
        _remesh(meshes, **ours, selectedonly=True)
        _remesh(meshes, **ours, splitflag=False, collapseflag=False)
        mesh = meshes.current_mesh()
        new, new_faces = mesh.vertex_matrix(), mesh.face_matrix().astype(np.int64)
    except pymeshlab.PyMeshLabException as error:
        raise FirstFillError(f"MeshLab did not fill a loop of {m} points: {error}") from error
    finally:
        # it would use our options in the caller's next calls
        _remesh(_mesh_set(np.eye(3), np.array([[0, 1, 2]])))
    if not np.array_equal(new[:m], vertices[:m]) or not _is_disk(new_faces, vertices=len(new), boundary_size=m):
        raise FirstFillError(f"MeshLab's remeshing tore the fill of a loop of {m} points")
    return new, new_faces


def _remesh(meshes: pymeshlab.MeshSet, **options: Any) -> None:
    """MeshLab's remeshing with its own defaults: it remembers options from call to call, so each is given."""
    import pymeshlab

    defaults = {"iterations": 10, "adaptive": False, "selectedonly": False, "targetlen": pymeshlab.PercentageValue(100)}
    defaults |= {"featuredeg": 30.0, "checksurfdist": True, "splitflag": True, "collapseflag": True, "swapflag": True}
    defaults |= {"smoothflag": True, "reprojectflag": True}
    meshes.meshing_isotropic_explicit_remeshing(**defaults | options)


def _mesh_set(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> pymeshlab.MeshSet:
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32)))
    return meshes


def _is_disk(faces: Int[np.ndarray, "f 3"], *, vertices: int, boundary_size: int) -> bool:
    """Whether faces are one disk on all vertices whose boundary runs 0, 1, … boundary_size − 1."""
    here = np.arange(boundary_size)
    # a cone over the boundary closes a disk, and nothing else, to a sphere
    cone = np.stack([np.roll(here, -1), here, np.full(boundary_size, vertices)], axis=1)
    closed = np.concatenate([faces, cone])
    return bool(
        len(np.unique(closed)) == vertices + 1
        and 2 * (vertices + 1) - len(closed) == 4  # Euler's formula for triangles without a boundary
        and is_watertight(closed)
        and face_components(closed).max() == 0
    )
