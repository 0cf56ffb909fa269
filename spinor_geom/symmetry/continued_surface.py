"""A minimal surface with its continuation across straight sides and planes of symmetry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from spinor_geom.errors import OptionError, SurfaceError, require_count
from spinor_geom.mesh.rational_splines import NurbsPatch, on_side
from spinor_geom.mesh.topology import HalfEdges, boundary_edges, linked
from spinor_geom.mesh.triangle_mesh import TriangleMesh
from spinor_geom.meshing.embed import mesh_patch
from spinor_geom.meshing.solid import Solid, SolidEdge, require_thickness, thickened_mesh, unit_normals
from spinor_geom.nurbs.nurbs_surface import NurbsSurface, Seam, largest_angle
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.symmetry.side_symmetries import Isometries, side_symmetries
from spinor_geom.symmetry.space_group import periodic_cell, within_steps

_CENTRE_SAMPLES = 32  # points of each piece of Γ for the centre of the rims
_SAME = 1e-7  # points up to this share of the size of the piece apart are one
_ALONG = np.linspace(0.05, 0.95, 10)  # parameters on sides where normals are compared
# Copies overlap if images of points deep inside the piece lie on it. Number of these points, edges of a mesh along the
# piece, Newton's steps to the point of the piece nearest to an image, and its distance up to which the image is on it.
_PROBES, _FINE, _NEWTON, _ON_PIECE = 8, 20, 6, 1e-4
_TRANSPOSED = (3, 2, 1, 0)  # the number of each side after u and v are exchanged

Copies = int | Literal["cell"]


@dataclass(frozen=True, kw_only=True, eq=False)
class ContinuedSurface:
    """Copies of a minimal surface that together are a smooth minimal surface.

    Attributes:
        solution: the piece.
        copies: the isometries of its copies. The first is the identity.
        lattice: a basis of the translations that continue a periodic cell, without rows for other numbers of copies.
        sides: the half turns and reflections in the sides of the piece.
    """

    solution: PlateauSolution
    copies: Isometries
    lattice: Float[np.ndarray, "rank 3"]
    sides: Isometries

    def __repr__(self) -> str:
        rank = f", {len(self.lattice)} periods" if len(self.lattice) else ""
        return f"ContinuedSurface({len(self.copies)} copies of {self.solution!r}{rank})"

    @property
    def area(self) -> float:
        """Total area of the copies, in squared mesh units."""
        return len(self.copies) * self.solution.area

    def mesh(self, target_edge_length: float | Literal["auto"] = "auto") -> TriangleMesh:
        """The triangles of all copies with common vertices along their common sides.

        Arguments and errors are those of `mesh_patch`, and a SurfaceError if the surface is one-sided.
        """
        return self._mesh(target_edge_length)[0]

    def solid(
        self, thickness: float, *, target_edge_length: float | Literal["auto"] = "auto", edge: SolidEdge = "rounded"
    ) -> Solid:
        """The surface thickened by half of `thickness` to both sides, as a watertight mesh.

        Arguments and errors are those of `PlateauSolution.solid`, and a SurfaceError if the surface is one-sided.
        """
        require_thickness(thickness, edge)
        mesh, normals = self._mesh(target_edge_length)
        edges = boundary_edges(mesh.faces)
        rim = np.sort(edges[:, 0])
        after = np.searchsorted(rim, edges[edges[:, 0].argsort(), 1])
        return thickened_mesh(mesh.vertices, mesh.faces, normals, (rim, after), thickness, edge)

    def to_nurbs(self, *, tolerance: float = 1e-6, time_limit: float = np.inf) -> NurbsSurface:
        """The patches of all copies, with equal control points along common sides.

        Raises an OptionError for a plane surface, and the errors of `PlateauSolution.to_nurbs`.
        """
        piece = self.solution.to_nurbs(tolerance=tolerance, time_limit=time_limit)
        if piece.trims:
            raise OptionError("the surface is plane: continue its outline instead, and solve over the result")
        nets = [patch.control_points.copy() for patch in piece.patches]
        for patch, side in (one for rim in piece.rims for one in rim):
            nets[patch][on_side(side)] = self._on_sides(nets[patch][on_side(side)])
        images, odd = [self.copies.points(net) for net in nets], self.copies.odd.tolist()
        patches = [
            _transposed(given, image[copy]) if is_odd else replace(given, control_points=image[copy])
            for copy, is_odd in enumerate(odd)
            for given, image in zip(piece.patches, images, strict=True)
        ]
        seams, rims = _joined(patches, _SAME * self.solution.diagonal)
        angle = largest_angle(patches, seams, [(_ALONG, _ALONG)] * len(patches))
        return replace(
            piece,
            deviations=replace(piece.deviations, normals=max(angle, piece.deviations.normals)),
            patches=tuple(patches),
            seams=seams,
            rims=rims,
        )

    def _mesh(self, target_edge_length: float | Literal["auto"]) -> tuple[TriangleMesh, Float[np.ndarray, "v 3"]]:
        """The mesh, and the unit normals of the surface at its vertices."""
        patch = mesh_patch(self.solution, target_edge_length)
        normals = unit_normals(self.solution, patch)
        rim, inside = np.split(patch.vertices, [patch.boundary_size])
        vertices = np.concatenate([self._on_sides(rim), inside])
        count, faces = len(vertices), np.asarray(patch.faces)
        copied = [
            number * count + (faces[:, ::-1] if is_odd else faces)
            for number, is_odd in enumerate(self.copies.odd.tolist())
        ]
        apart = TriangleMesh(self.copies.points(vertices).reshape(-1, 3), np.concatenate(copied))
        edges = HalfEdges.of(apart.merged(_SAME * self.solution.diagonal)[0].faces)
        if (edges.counts > 2).any() or (edges.origin == edges.origin[edges.twin])[edges.twin >= 0].any():
            raise SurfaceError("copies overlap, or the continued surface is one-sided; continue it across fewer sides")
        # where copies touch at a point only, each has a vertex of its own there
        ahead, pairs = np.arange(len(edges.origin)).reshape(-1, 3)[:, [1, 2, 0]].ravel(), edges.pairs
        joined = np.concatenate([np.stack([a, ahead[b]], axis=1) for a, b in (pairs.T, pairs.T[::-1])])
        _, first, corner = np.unique(linked(joined, len(ahead)), return_index=True, return_inverse=True)
        own = apart.faces.ravel()[first]
        mesh = TriangleMesh(apart.vertices[own], corner.reshape(-1, 3))
        return mesh, self.copies.normals(normals).reshape(-1, 3)[own]

    def _on_sides(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Points near the line or the plane of a side are moved onto it, so that they coincide with their images."""
        for k in range(len(self.sides)):
            middle = (points + self.sides[k : k + 1].points(points)[0]) / 2
            near = np.linalg.norm(points - middle, axis=1) < 10 * _SAME * self.solution.diagonal
            points = np.where(near[:, None], middle, points)
        return points


def continued(solution: PlateauSolution, copies: Copies) -> ContinuedSurface:
    """See `PlateauSolution.continued`."""
    if copies != "cell":
        require_count(0, copies=copies)
    sides = side_symmetries(solution)
    size = solution.diagonal
    points, lengths = [], []
    for rim in solution.rims:
        steps = np.diff(rim.curve.breaks)[:, None]
        s = (rim.curve.breaks[:-1, None] + steps * ((np.arange(_CENTRE_SAMPLES) + 0.5) / _CENTRE_SAMPLES)).ravel()
        points.append(rim.curve.point(s))
        lengths.append(np.linalg.norm(rim.curve.derivative(s), axis=1) * np.repeat(steps, _CENTRE_SAMPLES))
    weights = np.concatenate(lengths)
    centre = weights @ np.concatenate(points) / weights.sum()
    corners = [rim.curve.coefficients[-1][rim.curve.corners] for rim in solution.rims]
    marks = np.concatenate([centre[None], *corners])
    lattice = np.zeros((0, 3))
    if copies == "cell":
        found, lattice = periodic_cell(sides, marks, size)
    else:
        found = within_steps(sides, marks, size, copies)
    _require_apart(solution, found, lattice, size)
    return ContinuedSurface(solution=solution, copies=found, lattice=lattice, sides=sides)


def _require_apart(
    solution: PlateauSolution, copies: Isometries, lattice: Float[np.ndarray, "rank 3"], size: float
) -> None:
    """Raises an OptionError if copies overlap: points inside one, moved into the piece by another, are on it."""
    surface, mesh = solution.array_surface, mesh_patch(solution, size / _FINE)
    m = mesh.boundary_size
    depth = np.abs(mesh.points[m:, None] - mesh.points[:m]).min(axis=1)
    inner = mesh.vertices[m:][depth.argsort()[-_PROBES:]]
    # points g(r) moved by h⁻¹. The copies of a cell are a group modulo its lattice, so that one h suffices
    moved, others = copies.points(inner), copies[:1] if len(lattice) else copies
    turns = np.array(list(product((-1.0, 0.0, 1.0), repeat=len(lattice)))).reshape(3 ** len(lattice), -1)
    apart = moved[:, None] - others.shifts[:, None]
    near = np.round(apart.mean(axis=2, keepdims=True) @ np.linalg.pinv(lattice))
    shifted = apart[:, :, None] - (near[:, :, None] + turns[:, None]) @ lattice
    places = np.einsum("ghtnk,hkj->ghtnj", shifted, others.rotations)
    points = places[~np.eye(len(copies), len(others), dtype=bool)].reshape(-1, 3)
    away, vertex = cKDTree(mesh.vertices).query(points, distance_upper_bound=size / _FINE)
    points, z = points[np.isfinite(away)], mesh.points[np.asarray(vertex)[np.isfinite(away)]]
    for _ in range(_NEWTON):
        phi, gap = surface.null_curve(z), points - surface.position(z)
        # r_x = Re φ and r_y = −Im φ are orthogonal and as long as each other
        z = z + (phi.conj() * gap).sum(axis=1) * 2 / (np.abs(phi) ** 2).sum(axis=1)
        z = np.where(solution.domain.contains(z), z, np.nan)
        points, z = points[np.isfinite(z)], z[np.isfinite(z)]
    if len(z) and (np.linalg.norm(surface.position(z) - points, axis=1) < _ON_PIECE * size).any():
        raise OptionError(
            "copies overlap, because a symmetry of the continued surface maps the piece partly onto itself; continue a "
            "smaller piece, bounded by the lines or planes of this symmetry, or fewer copies"
        )


def _transposed(patch: NurbsPatch, net: Float[np.ndarray, "n m 3"]) -> NurbsPatch:
    """A patch of other control points with u and v exchanged, which turns its normal."""
    return NurbsPatch(control_points=net.transpose(1, 0, 2).copy(), weights=patch.weights.T, knots=patch.knots[::-1])


def _joined(
    patches: Sequence[NurbsPatch], within: float
) -> tuple[tuple[Seam, ...], tuple[tuple[tuple[int, int], ...], ...]]:
    """The seams between sides whose control points nearly coincide, and the other sides in closed chains.

    The control points are made equal, bit for bit.
    """
    sides = list(product(range(len(patches)), range(4)))
    rows = [patches[patch].control_points[on_side(side)] for patch, side in sides]
    points = np.concatenate(rows)
    pairs = cKDTree(points).query_pairs(within, output_type="ndarray")
    _, first, group = np.unique(linked(pairs, len(points)), return_index=True, return_inverse=True)
    known: dict[tuple[int, ...], tuple[int, int]] = {}
    seams = []
    for (patch, side), row in zip(sides, np.split(group, np.cumsum([len(row) for row in rows])[:-1]), strict=True):
        patches[patch].control_points[on_side(side)] = points[first[row]]
        ahead, back = tuple(row.tolist()), tuple(row[::-1].tolist())
        if ahead in known or back in known:
            is_reversed = ahead not in known
            other = known.pop(back if is_reversed else ahead)
            seams.append(Seam(first=other, second=(patch, side), reversed=is_reversed))
        elif len(set(ahead)) > 1:  # sides of triangles may be points
            known[ahead] = (patch, side)
    left: dict[int, list[tuple[tuple[int, int], int]]] = {}
    for ids, own in known.items():
        start, end = (ids[0], ids[-1]) if own[1] < 2 else (ids[-1], ids[0])
        left.setdefault(start, []).append((own, end))
    chains = []
    while left:
        at, chain = next(iter(left)), []
        while at in left:
            ahead_of, at_start = left[at], at
            own, at = ahead_of.pop()
            chain.append(own)
            if not ahead_of:
                del left[at_start]
        chains.append(tuple(chain))
    return tuple(seams), tuple(chains)
