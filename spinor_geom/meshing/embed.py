"""From a solved surface to a triangle mesh whose boundary is the loop or both loops, bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.spatial import cKDTree

from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface, relaxed_surface
from spinor_geom.domain.delaunay import Rims, plane_coordinates
from spinor_geom.domain.quadrature import rule
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import DomainError, OptionError
from spinor_geom.meshing.triangulate import triangulate_patch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.shown import Shown
from spinor_geom.surface.spinor_surface import SpinorSurface

# Gauss–Legendre nodes on an edge of the patch: enough for this error, in edges, if a pole were on the boundary
QUADRATURE_ERROR = 1e-8
NODE_COUNTS = np.array([2, 3, 4, 6, 8])
# bounds the memory of p and q at the nodes
EDGES_AT_ONCE = 1 << 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Patch(Shown):
    """A triangulated piece of a minimal surface over a loop, or between two.

    Attributes:
        vertices: Positions in mesh units; the loops' points come first, in order and bit-equal.
        faces: Counter-clockwise in Ω and so about the surface's normal; the boundary runs along the loops.
        boundary_size: Number M of loop points, of all loops together.
        points: Where the vertices lie in Ω.
        hole_sizes: Numbers of points of the loops after the first.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    boundary_size: int
    points: Complex[np.ndarray, " n"]
    hole_sizes: tuple[int, ...] = ()

    @property
    def rims(self) -> Rims:
        """Numbers of points of the loops."""
        return (self.boundary_size - sum(self.hole_sizes), *self.hole_sizes)

    @cached_property
    def area(self) -> float:
        """Total area of the faces, in squared mesh units."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    def relaxed(self) -> DiscreteMinimalSurface:
        """The discrete minimal surface nearest to this mesh: the same triangles, without discrete mean curvature.

        A mesh with its inner vertices on the exact surface has some at them, about 4 % of the principal curvatures,
        however small its triangles: at a single vertex the cotangent formula is right only where the triangles around
        it are even. To lose it the vertices leave the exact surface, by some 0.5 % of an edge, and by some 10 % beside
        a loss of stability.

        Source: Xu (2004), "Discrete Laplace–Beltrami operators and their convergence", CAGD 21, for the formula's
        pointwise error.
        """
        return relaxed_surface(self.vertices, self.faces, self.boundary_size)


def mesh_patch(solution: PlateauSolution, target_edge_length: float | Literal["auto"] = "auto") -> Patch:
    """Meshes a solved minimal surface; the points of its loop or loops are its boundary vertices, bit-equal.

    The surface's domain is triangulated with edges of about target/λ, beside the boundary as long as the loop's own
    edges; the inner vertices are on the exact surface. The boundary's vertices are the loop's points and not the
    surface's, so the boundary residual of the solution stays visible in the triangles beside the boundary.

    Args:
        solution: A solved Plateau problem.
        target_edge_length: In mesh units; "auto" is the mean edge length of its loops.

    Raises:
        OptionError: The edge length is neither "auto" nor positive and finite.
        DomainError: The loop's points in Ω do not form a simple polygon, or the surface is not finite inside it.
    """
    surface, loops = solution.surface, [rim.loop for rim in solution.rims]
    mean_edge = sum(loop.perimeter for loop in loops) / sum(map(len, loops))
    target = mean_edge if target_edge_length == "auto" else target_edge_length
    if isinstance(target, str) or not 0 < target < np.inf:
        raise OptionError(f"target_edge_length must be 'auto' or a positive number, not {target_edge_length!r}")
    plane = triangulate_patch(surface, [rim.points_in_domain() for rim in solution.rims], target, solution.area)
    inner = inner_positions(surface, plane)
    if not np.isfinite(inner).all():
        raise DomainError("the surface is not finite inside its domain: p or q has a pole there")
    return Patch(
        vertices=np.concatenate([*(loop.points for loop in loops), inner]),
        faces=plane.faces,
        boundary_size=plane.boundary_size,
        points=plane.points,
        hole_sizes=plane.hole_sizes,
    )


def inner_positions(surface: SpinorSurface, plane: PlaneTriangulation) -> Float[np.ndarray, "k 3"]:
    """Positions of a triangulation's inner points: in closed form, or by integration of φ along its own edges.

    Where it takes quadrature: in each connected part of the inner edges the point farthest from the boundary is placed
    by `SpinorSurface.position`; a breadth-first tree of inner edges leads from it to the others, with two to eight
    Gauss–Legendre nodes an edge: p and q are holomorphic in Ω, so few are enough far from its boundary.

    Returns:
        (n − m, 3), in the surface's units of length.
    """
    m = plane.boundary_size
    points, count = plane.points[m:], len(plane.points) - m
    if surface.has_closed_positions or count == 0:
        return np.asarray(surface.position(points)).reshape(-1, 3)
    rim = cKDTree(plane_coordinates(plane.points[:m]))
    depth, _ = rim.query(plane_coordinates(points))
    roots, parent = _forest(plane.edges[plane.edges[:, 0] >= m] - m, np.asarray(depth))
    displacement = _edge_displacements(surface, points[parent], points, rim)
    displacement[roots] = np.asarray(surface.position(points[roots])).reshape(-1, 3)
    # pointer jumping: each round adds the sum over twice as long a way to the root
    while (parent != parent[parent]).any():
        jump = parent != parent[parent]
        displacement[jump] = (displacement + displacement[parent])[jump]
        parent = parent[parent]
    inner = parent != np.arange(count)
    displacement[inner] += displacement[parent[inner]]
    return displacement


def _forest(
    edges: Int[np.ndarray, "e 2"], depth: Float[np.ndarray, " k"]
) -> tuple[Int[np.ndarray, " r"], Int[np.ndarray, " k"]]:
    """The deepest point of each connected part as its root, and each point's predecessor on its way from there.

    A root is its own predecessor.
    """
    count = len(depth)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    _, part = connected_components(graph, directed=False)
    by_depth = np.lexsort((-depth, part))
    roots = by_depth[np.unique(part[by_depth], return_index=True)[1]]
    # one more vertex joined to all roots makes the forest one tree
    source = np.full(len(roots), count)
    joined = coo_array(
        (
            np.ones(len(edges) + len(roots)),
            (np.append(edges[:, 0], source), np.append(edges[:, 1], roots)),
        ),
        shape=(count + 1, count + 1),
    )
    _, parent = breadth_first_order(joined.tocsr(), count, directed=False)
    parent = parent[:count].astype(np.int64)
    parent[roots] = roots
    return roots, parent


def _edge_displacements(
    surface: SpinorSurface, start: Complex[np.ndarray, " k"], end: Complex[np.ndarray, " k"], rim: cKDTree
) -> Float[np.ndarray, "k 3"]:
    """Re ∫ φ dz along straight edges; `rim` holds the boundary vertices."""
    level = np.searchsorted(NODE_COUNTS[:-1], _nodes_needed(start, end, rim))
    parts = [
        _integrals(surface, start[some], end[some], level[some])
        for some in np.split(np.arange(len(start)), np.arange(EDGES_AT_ONCE, len(start), EDGES_AT_ONCE))
    ]
    return np.concatenate(parts)


def _nodes_needed(
    start: Complex[np.ndarray, " k"], end: Complex[np.ndarray, " k"], rim: cKDTree
) -> Float[np.ndarray, " k"]:
    """Gauss–Legendre nodes for QUADRATURE_ERROR: the error falls like ρ^(−2n).

    ρ belongs to the largest ellipse about the edge's ends, as foci, that holds no pole.

    Source: Trefethen, Approximation Theory and Approximation Practice (2013), theorem 19.3.
    """
    middle, half = 0.5 * (start + end), 0.5 * np.abs(end - start)
    distance, _ = rim.query(plane_coordinates(middle))
    # an edge as long as its distance from the boundary takes the most nodes there are; one of length 0 the fewest
    ratio = np.maximum(distance / np.maximum(half, np.finfo(np.float64).tiny), 1.1)
    return np.asarray(-np.log(QUADRATURE_ERROR) / (2 * np.arccosh(ratio)))


def _integrals(
    surface: SpinorSurface,
    start: Complex[np.ndarray, " k"],
    end: Complex[np.ndarray, " k"],
    level: Int[np.ndarray, " k"],
) -> Float[np.ndarray, "k 3"]:
    """Re ∫ φ dz along edges, each by the rule of its level; p and q are asked for at all nodes at once."""
    rules = [rule("gauss", count) for count in NODE_COUNTS.tolist()]
    nodes, weights = (np.concatenate(parts) for parts in zip(*rules, strict=True))
    count, step = NODE_COUNTS[level], end - start
    first = np.cumsum(count) - count
    edge = np.repeat(np.arange(len(start)), count)
    # the rules' nodes stand one rule after the other
    node = np.arange(len(edge)) - first[edge] + (np.cumsum(NODE_COUNTS) - NODE_COUNTS)[level][edge]
    p, q = np.moveaxis(np.asarray(surface.spinors(start[edge] + step[edge] * nodes[node])), -1, 0)
    weighted = np.stack([p * p, q * q, p * q], axis=1) * weights[node][:, None]
    pp, qq, pq = np.add.reduceat(weighted, first, axis=0).T * step
    return np.stack([pp - qq, -1j * (pp + qq), 2 * pq], axis=1).real
