"""Area descent of a discrete disk with fixed boundary: Pinkall-Polthier iteration, then Newton's method."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array, csc_array

from spinor_geom.arrays import shifted
from spinor_geom.domain.delaunay import plane_coordinates
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import OutOfTimeError, SingularMatrixError
from spinor_geom.mesh.operators import face_areas, factor_symmetric, mollified_laplacian, vertex_normals

Vertices = Float[np.ndarray, "n 3"]
Faces = Int[np.ndarray, "f 3"]

# Relative change of the area below which Newton steps, which need a good start, replace harmonic ones. A disk is then
# accurate enough to be flattened, and an annulus for its conformal structure.
FIRST_CHANGE = 1e-3
_SHORTEST_STEP = 1e-3  # smallest share of a step that is tried
_NO_AREA = 1e-300  # faces below this have no normal


@dataclass(frozen=True, kw_only=True, eq=False)
class Disk:
    """A triangulated disk or annulus, boundary points first, and the areas after each step of its descent."""

    vertices: Vertices
    faces: Faces
    areas: tuple[float, ...]
    converged: bool
    reason: str = ""


def harmonic_extension(laplacian: csc_array, boundary: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "n k"]:
    """Values at all vertices, given at the first m and harmonic at the others. Raises as `factor_symmetric`."""
    m = len(boundary)
    if laplacian.shape[0] == m:
        return np.array(boundary)
    values = np.concatenate([boundary, np.zeros((laplacian.shape[0] - m, boundary.shape[1]))])
    values[m:] = factor_symmetric(laplacian[m:, m:]).solve(-(laplacian @ values)[m:])
    return values


def descend_from_plane(plane: PlaneTriangulation, boundary: Vertices, *, relative_change: float) -> Disk:
    """`descend_area` from the harmonic map of a plane mesh to points in space. Raises as `factor_symmetric`."""
    mapped = harmonic_extension(mollified_laplacian(plane_coordinates(plane.points), plane.faces), boundary)
    return descend_area(mapped, plane.faces, len(boundary), relative_change=relative_change)


def descend_area(
    vertices: Vertices, faces: Faces, boundary_size: int, *, relative_change: float, max_iterations: int = 100
) -> Disk:
    """Moves the inner vertices until the area is stationary for motions along the vertex normals, or time is out.

    First by harmonic maps of the current surface: ∇area = L(x)x with L the positive cotangent Laplacian, so the step
    −L⁻¹∇area to the harmonic map descends. Then by Newton's method for displacements along the vertex normals.
    Tangential motions are excluded: they would lower the area only by about the discretisation error, and degenerate
    the triangles.

    The area is stationary when a full Newton step lowers it, or its slope predicts a decrease, by less than
    `relative_change`. For a relative change of 1e-3 or more no Newton steps are taken.

    Source: Pinkall & Polthier, "Computing discrete minimal surfaces and their conjugates", Experim. Math. 2 (1993).
    """
    x, m = vertices, boundary_size
    areas = [float(face_areas(x, faces).sum())]
    if len(x) == m or areas[0] == 0:
        return Disk(vertices=x, faces=faces, areas=tuple(areas), converged=True)
    newton = converged = False
    for _ in range(max_iterations):
        try:
            step, slope = (_newton_step if newton else _harmonic_step)(x, faces, m)
        except OutOfTimeError:
            break
        allowed = (relative_change if newton else max(FIRST_CHANGE, relative_change)) * areas[-1]
        length = 1.0
        while length > _SHORTEST_STEP:
            moved = x.copy()
            moved[m:] += length * step
            area = float(face_areas(moved, faces).sum())
            if area < areas[-1]:
                break
            length /= 2
        change = areas[-1] - area
        if change > 0:
            x = moved
            areas.append(area)
        # the stage ends after a small decrease by a full step, or if no step along the direction decreases the area
        small = length == 1.0 and 0 < change <= allowed
        if small or change <= 0:
            if newton or (small and relative_change >= FIRST_CHANGE):
                # a large slope without a decrease: a face is about to flip
                converged = small or slope <= allowed
                break
            newton = True
    reason = "" if converged else "the area did not become stationary"
    return Disk(vertices=x, faces=faces, areas=tuple(areas), converged=converged, reason=reason)


def _harmonic_step(x: Vertices, faces: Faces, m: int) -> tuple[Float[np.ndarray, "i 3"], float]:
    """The step of the inner vertices to the harmonic map, and the decrease of the area to first order."""
    laplacian = mollified_laplacian(x, faces)
    step = harmonic_extension(laplacian, x[:m])[m:] - x[m:]
    # the Laplacian of the harmonic map is 0 at the inner vertices
    return step, float(-(step * (laplacian @ x)[m:]).sum())


def _newton_step(x: Vertices, faces: Faces, m: int) -> tuple[Float[np.ndarray, "i 3"], float]:
    """The Newton step for displacements of the inner vertices along their normals, and the decrease to first order."""
    n = len(x)
    corner = x[faces]
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    vertex_normal = vertex_normals(x, faces)
    # bounded, because the second derivatives of slivers would dominate those of their neighbours
    longest = np.max(np.sum((corner - shifted(corner, 1, axis=1)) ** 2, axis=2), axis=1)
    twice_area = np.maximum(np.linalg.norm(cross, axis=1), np.maximum(1e-4 * longest, _NO_AREA))
    normal = cross / twice_area[:, None]
    nu = vertex_normal[faces]
    # first derivatives of the face's cross product with respect to the displacements of its corners
    slope = np.cross(nu, shifted(corner, -1, axis=1) - shifted(corner, -2, axis=1))
    along = np.einsum("fik,fk->fi", slope, normal)
    gradient = np.bincount(faces.ravel(), 0.5 * along.ravel(), minlength=n)[m:]
    hessian = slope @ slope.transpose(0, 2, 1) - along[:, :, None] * along[:, None, :]
    hessian /= 2 * twice_area[:, None, None]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        mixed = 0.5 * np.einsum("fk,fk->f", normal, np.cross(nu[:, i], nu[:, j]))
        hessian[:, i, j] += mixed
        hessian[:, j, i] += mixed
    rows, columns = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, (1, 3)).ravel()
    matrix = csc_array(coo_array((hessian.ravel(), (rows, columns)), shape=(n, n)).tocsc()[m:, m:])
    metric, shift = mollified_laplacian(x, faces)[m:, m:], 0.0
    while True:
        try:
            factor = factor_symmetric(matrix + shift * metric)
            if (factor.U.diagonal() > 0).all():  # positive definite: a direction of descent
                break
        except SingularMatrixError:
            pass
        shift = max(4 * shift, 1e-2)
    along_normals = -factor.solve(gradient)
    return along_normals[:, None] * vertex_normal[m:], -float(gradient @ along_normals)
