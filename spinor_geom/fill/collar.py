"""The rings of faces around a patch: the mean curvature there, and the bend between mesh and patch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.arrays import TINY, distinct
from spinor_geom.domain.delaunay import rim_successors, unique_edges
from spinor_geom.fill.patched_mesh import PatchedMesh
from spinor_geom.mesh.operators import Bending, crossing_angles
from spinor_geom.mesh.topology import HalfEdges
from spinor_geom.meshing.embed import Patch

# Curvature is not continued across a crease: an edge where the angle between the faces is more than 40°, and more than
# twice the mean over the rim's vertices of the largest angle at an edge there. A prism, with equal angles, has none.
CREASE, _SHARPER = np.radians(40), 2.0
_LONG = 2.0  # longer edges of the first ring, in rim edges, are shortened: see `_shortened`
# Largest trace of S in the metric 1 + S across ridges. On 120 disks cut out of four scans the distances are 0.89 times
# those with 0 (geometric mean). 20 and 80 change that by 0.02 or less. Without the square of `variation` 20 gives 0.87,
# but windows in tori are up to three times as far off as with 0.
_STRETCH = 40.0
_RINGS = 3  # rings of faces from which the correlation of H is estimated


@dataclass(frozen=True, kw_only=True, eq=False)
class Bend:
    """The angle between the normals of neighbouring faces along some edges, in degrees: the RMS, weighted by length."""

    largest: float
    rms: float
    edge: float  # mean length of the edges, in mesh units

    def to_dict(self) -> dict[str, float]:
        """The figures in JSON's types."""
        return {"largest_degrees": self.largest, "rms_degrees": self.rms}


@dataclass(frozen=True, kw_only=True, eq=False)
class Collar:
    """The first ring of faces around a patch.

    The vertices are the patch's boundary, in its order, then those of the ring beyond it.
    """

    vertices: Float[np.ndarray, "v 3"]  # (m + r, 3) positions
    faces: Int[np.ndarray, "f 3"]  # mesh faces at the boundary
    boundary_size: int  # m
    bends: Bool[np.ndarray, " v"]  # whether H is defined: each edge at the vertex has two faces and is no crease
    curvature: Float[np.ndarray, " r"]  # H at the vertices beyond the boundary, or 0 where it is not defined
    length: float  # correlation length ℓ of H, in mesh units, or 0 for noise, and where H is constant
    roughness: float  # variance of H between neighbours / total variance: 0 on a smooth mesh, 1 and more in noise
    variation: float  # covariance of H between neighbours / mean of H²: 1 at most, or 0 if `length` is 0
    third_form: Float[
        np.ndarray, "w 3 3"
    ]  # of the vertices of the ring: dN·dN for the unit normals N of the mesh: squared curvatures
    creased: int  # number of boundary vertices at creases
    crease_ends: Int[np.ndarray, " k"]  # boundary vertices at which the creases beyond the boundary end
    crease_directions: Float[np.ndarray, "k 3"]  # unit vectors along these creases, into the hole
    crease_angles: Float[np.ndarray, " k"]  # between the faces there, in radians
    bend: Bend  # between neighbouring faces of the three rings

    @property
    def rim_edges(self) -> Int[np.ndarray, "e 2"]:
        """The edges of the mesh between vertices of the boundary."""
        edges = unique_edges(self.faces, len(self.vertices))
        return edges[edges[:, 1] < self.boundary_size]


def collar_of(patched: PatchedMesh, rim: Int[np.ndarray, " m"], patch: Patch) -> Collar:
    """The collar of a patch. `rim` are the mesh vertices of its boundary. No inner edge of the patch is a mesh edge."""
    mesh, m = patched.mesh, len(rim)
    rings = [patched.faces_at(rim)]
    for _ in range(1, _RINGS):
        rings.append(
            np.setdiff1d(patched.faces_at(distinct(mesh.faces[rings[-1]])), np.concatenate(rings), assume_unique=True)
        )
    first = np.setdiff1d(distinct(mesh.faces[rings[0]]), rim, assume_unique=True)
    inner = np.concatenate([rim, first])
    beyond = np.setdiff1d(distinct(mesh.faces[np.concatenate(rings)]), inner, assume_unique=True)
    ids, size = np.concatenate([inner, beyond]), m + len(first)
    order = np.argsort(ids, kind="stable")
    faces = order[np.searchsorted(ids[order], mesh.faces[np.concatenate(rings)])]
    vertices = mesh.vertices[ids]
    closed = HalfEdges.of(np.concatenate([faces, _numbered_after(patch, len(ids))]))
    bends = ~closed.unclosed(len(ids) + len(patch.vertices) - m)[: len(ids)]
    half_edges = HalfEdges.of(faces)
    angles = crossing_angles(half_edges, vertices)
    creased = np.zeros(len(ids), dtype=bool)
    leaves = np.flatnonzero((half_edges.origin < m) & (half_edges.target >= m))
    inside = (half_edges.origin < m) & (half_edges.target < m)
    lengths = np.linalg.norm(vertices[half_edges.origin] - vertices[half_edges.target], axis=1)
    largest = np.zeros(m)
    np.maximum.at(largest, half_edges.origin[leaves], angles[leaves])
    crease = max(CREASE, _SHARPER * float(largest.mean()))
    creased[half_edges.origin[angles > crease]] = True
    reaching = leaves[angles[leaves] > crease]
    along = vertices[half_edges.origin[reaching]] - vertices[half_edges.target[reaching]]
    bends &= ~creased
    bending = Bending.of(vertices, faces)
    third_form = _third_form(vertices, faces, bending.normals)
    length, roughness, variation = _correlation(bending, half_edges, bends & (np.arange(len(ids)) >= m), vertices)
    bend = _bend(half_edges, vertices, angles, np.flatnonzero(half_edges.twin >= 0))
    if variation:
        bending = Bending.of(vertices, faces, stretch_across_creases(third_form, faces, variation))
    curvature = np.where(bends, bending.curvature, 0.0)
    vertices, faces = vertices[:size], faces[: len(rings[0])]
    bends, curvature, third_form = bends[:size], curvature[:size], third_form[:size]
    # no curvature is continued, or the mesh is too coarse to tell how it changes: the faces at the rim are enough
    if not length or np.median(lengths[leaves]) > _LONG * np.median(lengths[inside]):
        faces, ends, shares = _shortened(vertices, faces, patch)
        vertices = vertices[ends[:, 0]] + shares[:, None] * (vertices[ends[:, 1]] - vertices[ends[:, 0]])
        bends, curvature, third_form = bends[ends[:, 1]], curvature[ends[:, 1]], third_form[ends[:, 1]]
    return Collar(
        vertices=vertices,
        faces=faces,
        boundary_size=m,
        bends=bends,
        curvature=curvature[m:],
        length=length,
        roughness=roughness,
        variation=variation,
        third_form=third_form,
        creased=int(creased[:m].sum()),
        crease_ends=half_edges.origin[reaching],
        crease_directions=along / lengths[reaching, None],
        crease_angles=angles[reaching],
        bend=bend,
    )


def bend_across(collar: Collar, patch: Patch, crease: Int[np.ndarray, " k"] | None = None) -> Bend:
    """The bend between a patch and the mesh, but not along a crease that boundary vertices `crease` lie on."""
    vertices = np.concatenate([collar.vertices, patch.vertices[collar.boundary_size :]])
    half_edges = HalfEdges.of(np.concatenate([_numbered_after(patch, len(collar.vertices)), collar.faces]))
    here = np.arange(3 * len(patch.faces))
    across = here[half_edges.twin[here] >= len(here)]
    if crease is not None:
        on = np.isin([half_edges.origin[across], half_edges.target[across]], crease).all(axis=0)
        across = across[~on]
    return _bend(half_edges, vertices, crossing_angles(half_edges, vertices), across)


def bend_inside(patch: Patch) -> Bend:
    """The bend between faces of a patch at edges that do not touch its boundary."""
    angles = patch.angles
    return Bend(largest=angles.largest_bend, rms=angles.rms_bend, edge=angles.edge)


def _shortened(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], patch: Patch
) -> tuple[Int[np.ndarray, "g 3"], Int[np.ndarray, "w 2"], Float[np.ndarray, " w"]]:
    """The first ring of faces, cut off about one rim edge away from the rim where its edges are much longer.

    Otherwise a vertex of the rim would have a large part of a long face for its area, and a kink there a small H.

    Returns:
        The faces. For each of their vertices, the rim's first, the ends of the edge that it lies on. The places of the
        vertices on these edges, from 0 to 1.
    """
    m = patch.boundary_size
    after = rim_successors(patch.rims)
    ahead = np.linalg.norm(vertices[after] - vertices[:m], axis=1)
    step = (ahead + ahead[np.argsort(after)]) / 2
    # the rim's vertices come first in each face
    turn = np.argmax((faces < m) & (np.roll(faces, 1, axis=1) >= m), axis=1)
    faces = np.take_along_axis(faces, (turn[:, None] + np.arange(3)) % 3, axis=1)
    count = (faces < m).sum(axis=1)
    fans, strips = faces[count == 1], faces[count == 2]
    edges = np.concatenate([fans[:, [0, 1]], fans[:, [0, 2]], strips[:, [1, 2]], strips[:, [0, 2]]])
    length = np.linalg.norm(vertices[edges[:, 1]] - vertices[edges[:, 0]], axis=1)
    is_long = length > _LONG * step[edges[:, 0]]
    edges = np.where(is_long[:, None], edges, edges[:, [1, 1]])
    ends, place = np.unique(edges, axis=0, return_inverse=True)
    place = m + place.reshape(-1)
    a, b, c, d = np.split(place, np.cumsum([len(fans), len(fans), len(strips)]))
    ring = np.concatenate(
        [
            faces[count == 3],
            np.column_stack([fans[:, 0], a, b]),
            np.column_stack([strips[:, 0], strips[:, 1], c]),
            np.column_stack([strips[:, 0], c, d])[c != d],
        ]
    )
    rim = np.arange(m)
    ends = np.concatenate([np.column_stack([rim, rim]), ends])
    length = np.linalg.norm(vertices[ends[:, 1]] - vertices[ends[:, 0]], axis=1)
    shares = np.divide(
        step[np.minimum(ends[:, 0], m - 1)], length, out=np.ones(len(ends)), where=ends[:, 0] < ends[:, 1]
    )
    return ring, ends, shares


def _bend(
    half_edges: HalfEdges,
    vertices: Float[np.ndarray, "n 3"],
    angles: Float[np.ndarray, " h"],
    at: Int[np.ndarray, " k"],
) -> Bend:
    """The bend at the half-edges `at`, from the angles between the faces at each half-edge, or 0 if there are none."""
    if not len(at):
        return Bend(largest=0.0, rms=0.0, edge=0.0)
    length = np.linalg.norm(vertices[half_edges.origin[at]] - vertices[half_edges.target[at]], axis=1)
    angle = np.degrees(angles[at])
    rms = float(np.sqrt(length @ angle**2 / length.sum()))
    return Bend(largest=float(angle.max()), rms=rms, edge=float(length.mean()))


def _numbered_after(patch: Patch, count: int) -> Int[np.ndarray, "f 3"]:
    """The patch's faces, with its inner vertices numbered from `count` on."""
    numbers = np.arange(len(patch.vertices))
    numbers[patch.boundary_size :] += count - patch.boundary_size
    return np.asarray(numbers[patch.faces])


def _correlation(
    bending: Bending, half_edges: HalfEdges, bends: Bool[np.ndarray, " n"], vertices: Float[np.ndarray, "n 3"]
) -> tuple[float, float, float]:
    """The correlation length of H, its roughness and its variation, as in `Collar`."""
    edges = np.stack([half_edges.origin, half_edges.target], axis=1)
    edges = edges[bends[edges].all(axis=1) & (edges[:, 0] < edges[:, 1])]
    edge = float(np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1).mean()) if len(edges) else 0.0
    if not edge:
        return 0.0, 0.0, 0.0
    curvature = bending.curvature
    weight = np.where(bends, bending.areas, 0.0)
    mean = weight @ curvature / weight.sum()
    variance = float(weight @ (curvature - mean) ** 2 / weight.sum())
    # the change of H by rounding of vertices to single precision
    rounding = float(np.finfo(np.float32).eps) * float(np.ptp(vertices, axis=0).max()) / edge**2
    if variance <= rounding**2:
        return 0.0, 0.0, 0.0
    between = float(np.mean((curvature[edges[:, 0]] - curvature[edges[:, 1]]) ** 2) / 2)
    correlation = 1 - between / variance
    if correlation <= 0:
        return 0.0, between / variance, 0.0
    # n edges cannot distinguish correlations nearer to 1 than about 1 − 1/n
    length = edge / max(-float(np.log(correlation)), 1 / len(edges))
    return length, between / variance, (variance - between) / float(variance + mean**2)


def stretch_across_creases(
    third_form: Float[np.ndarray, "n 3 3"], faces: Int[np.ndarray, "f 3"], variation: float
) -> Float[np.ndarray, "f 3 3"]:
    """The symmetric matrices S of a metric 1 + S of faces: longer in the directions in which a mesh bends most.

    S is the third fundamental form divided by its trace, which has no direction on spheres, times a factor that is 0
    where H is constant or noise.
    """
    of_faces = third_form[faces].mean(axis=1)
    trace = np.maximum(np.trace(of_faces, axis1=1, axis2=2), TINY)
    return np.asarray(_STRETCH * variation**2 * of_faces / trace[:, None, None])


def _third_form(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], normals: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3 3"]:
    """dN·dN at the vertices for the unit normals N, linear on the faces: means over the faces there by area."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    across = np.cross(b - a, c - a)
    double = np.maximum(np.linalg.norm(across, axis=1), TINY)[:, None]
    gradients = np.cross((across / double)[:, None], np.stack([c - b, a - c, b - a], axis=1)) / double[:, None]
    change = np.einsum("fki,fkj->fij", normals[faces], gradients)
    form = double[:, :, None] * np.einsum("fij,fik->fjk", change, change)
    total, weight = np.zeros((len(vertices), 3, 3)), np.zeros(len(vertices))
    for corner in faces.T:
        np.add.at(total, corner, form)
        np.add.at(weight, corner, double[:, 0])
    return np.asarray(total / np.maximum(weight, TINY)[:, None, None])  # points of a crease have no faces
