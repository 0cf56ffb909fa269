"""Holes that are hard or impossible to close, and boundary loops that are not holes."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import trimesh
from jaxtyping import Float

from spinor_geom import gallery
from spinor_geom.bench.holes import Hole, all_rims, collar, cut_hole, lattice, plane_square

LEFT_OPEN = "nothing is missing: left open, with a reason"
_OFFSETS = (1e-16, 1e-12, 1e-8)  # distance between coincident corners, per size of the mesh
# names of the cases that are correctly left open
NOTHING_MISSING = (*(f"near-seam-{offset:.0e}" for offset in _OFFSETS), "t-junctions", "ribbon")
_GRID = 12  # cells along each side of the plane squares


@cache
def odd_holes() -> Mapping[str, Hole]:
    """Unusual rims, and holes from the test suites of other projects."""
    return {hole.name: hole for hole in (*_unusual(), *_tests_of_others())}


def _unusual() -> Iterator[Hole]:
    t = 2 * np.pi * (np.arange(64) + 0.5) / 64  # its crossing lies inside two edges
    eight = np.stack([np.sin(t), np.sin(2 * t) / 2, 0 * t], axis=1)
    yield _widening("figure-eight", eight, "bounds no embedded disk")
    t = 2 * np.pi * np.arange(48) / 48
    r = 2 + np.cos(3 * t)
    trefoil = np.stack([r * np.cos(2 * t), r * np.sin(2 * t), np.sin(3 * t)], axis=1)
    yield _widening("knot", trefoil, "every disk over it crosses itself")
    cells = [(x, y) for x, y in _square(3, 9) if not (x in (5, 6) and y in (5, 6))]
    yield _pierced("island", cells, "one patch with a hole for the island")
    yield _slit()
    for height in (0.5, 0.6, 0.7):
        yield facing_rims(height)


def _slit() -> Hole:
    """A plane square cut open along a line."""
    vertices, faces = plane_square(_GRID)
    line = [_GRID // 2 * (_GRID + 1) + x for x in range(3, 10)]
    copies = np.arange(len(vertices))
    copies[line[1:-1]] = len(vertices) + np.arange(len(line) - 2)
    above = vertices[faces].mean(axis=1)[:, 1] > _GRID // 2
    faces[above] = copies[faces[above]]
    points, rim = np.concatenate([vertices, vertices[line[1:-1]]]), np.array([*line, *copies[line[1:-1]]])
    expected = "merge its sides: there is nothing to fill"
    return Hole(name="slit", vertices=points, faces=faces, rim=rim, expected=expected)


def _tests_of_others() -> Iterator[Hole]:
    """Holes from the tests of PMP, MeshLib, trimesh and CGAL."""
    # PMP: a cone of radius 1 and height 1.5 without its base
    t, i = 2 * np.pi * np.arange(8) / 8, np.arange(8)
    cone = np.concatenate([np.stack([np.cos(t), np.sin(t), 0 * t], axis=1), [[0, 0, 1.5]]])
    yield all_rims("open-cone", cone, np.stack([i, (i + 1) % 8, np.full(8, 8)], axis=1), "one flat patch")
    # MeshLib: a coarse torus without one triangle
    ring = trimesh.creation.torus(2.0, 1.0, major_sections=10, minor_sections=10)
    yield all_rims("torus-window", ring.vertices, ring.faces[1:], "one triangle")
    # MeshLib: a prism without three triangles: rims of three and four edges with two common vertices
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]]
    ends, sides = [[0, 2, 1], [3, 4, 5]], [[0, 1, 3], [2, 5, 4], [2, 3, 5]]
    yield all_rims("prism", corners, ends + sides, "two patches of one and two triangles")
    # MeshLib: two triangles at distance 1, to be joined by a prism's sides
    yield replace(all_rims("facing-triangles", corners, ends, "the three sides of a prism, or refused"), facing=True)
    # trimesh: a cube without its first and last triangle
    box = trimesh.creation.box()
    yield all_rims("holey-cube", box.vertices, box.faces[1:-1], "one triangle in each of two sides")
    # CGAL: a closed mesh without two neighbouring triangles
    ball = trimesh.creation.icosphere(2)
    neighbour = (np.isin(ball.faces, ball.faces[0]).sum(axis=1) == 2).nonzero()[0][0]
    yield all_rims("quad-hole", ball.vertices, np.delete(ball.faces, [0, neighbour], axis=0), "two triangles")
    # CGAL and trimesh: a plane hole in the shape of an S
    rows = [(x, y) for y in (4, 8, 12) for x in range(6, 18)]
    turns = [(x, y) for x, low in ((17, 5), (6, 9)) for y in range(low, low + 3)]
    yield _pierced("squiggle", rows + turns, "one flat patch", 2 * _GRID)
    # CGAL: a third triangle at an edge that ends in the rim makes the mesh non-manifold there
    hole = _pierced("fin", _square(3, 9), "closed, or refused with the edge's name")
    inner = hole.faces[np.isin(hole.faces, hole.rim).sum(axis=1) == 1][0]
    base = inner[np.isin(inner, hole.rim)][0], inner[~np.isin(inner, hole.rim)][0]
    top = hole.vertices[list(base)].mean(axis=0) + np.array([0, 0, 1])
    faces = np.concatenate([hole.faces, [[*base, len(hole.vertices)]]])
    yield replace(hole, vertices=np.vstack([hole.vertices, top]), faces=faces)
    # CGAL: two square holes that touch in a vertex
    yield _pierced("bow-tie", _square(3, 6) + _square(6, 9), "two patches that share a vertex")


def _widening(name: str, points: Float[np.ndarray, "n 3"], expected: str) -> Hole:
    """A collar that widens downwards."""
    return collar(name, points, points * [1.15, 1.15, 1.0] - [0, 0, 0.25], expected=expected)


def facing_rims(height: float, n: int = 48) -> Hole:
    """Two unit circles at z = ±h, with collars on the sides away from each other."""
    t = 2 * np.pi * np.arange(n) / n
    circle = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    lift = np.array([0, 0, height])
    upper = collar("", circle + lift, 1.1 * circle + np.array([0, 0, 0.1]) + lift)
    lower = upper.vertices * [1, 1, -1]
    expected = "no minimal annulus between them: two disks"
    if joined := height < 0.66274:
        expected = "a catenoid between them is a local minimum, two disks have less area"
    if height < 0.5277:
        expected = "the catenoid between them has less area than two disks"
    return Hole(
        name=f"facing-{height:g}",
        vertices=np.concatenate([upper.vertices, lower]),
        faces=np.concatenate([upper.faces, upper.faces[:, ::-1] + len(lower)]),
        rim=np.concatenate([upper.rim, upper.rim + len(lower)]),
        expected=expected,
        facing=True,
        area=gallery.catenoid(height).area if joined else None,
    )


def _square(low: int, high: int) -> list[tuple[int, int]]:
    return [(x, y) for x in range(low, high) for y in range(low, high)]


def _pierced(name: str, cells: list[tuple[int, int]], expected: str, side: int = _GRID) -> Hole:
    """A plane square without some of its cells."""
    removed = np.zeros((side, side, 2), dtype=bool)
    removed[tuple(np.array(cells).T[::-1])] = True
    return cut_hole(name, *plane_square(side), removed.ravel(), expected=expected)


def nothing_missing() -> Iterator[Hole]:
    """Meshes whose boundary loops are not holes."""
    # a closed box whose lid has vertices of its own, displaced by rounding errors
    box = trimesh.creation.box((2.5, 1.2, 0.5))
    vertices, lid = np.array(box.vertices), (np.array(box.vertices)[box.faces][:, :, 0] > 0).all(axis=1)
    corners, renumbered = np.unique(np.array(box.faces)[lid], return_inverse=True)
    for offset in _OFFSETS:
        faces = np.array(box.faces)
        faces[lid] = len(vertices) + renumbered.reshape(-1, 3)
        moved = vertices[corners] + 2.5 * offset * np.random.default_rng(0).uniform(-1, 1, (len(corners), 3))
        yield all_rims(f"near-seam-{offset:.0e}", np.vstack([vertices, moved]), faces, LEFT_OPEN)
    # a box with one coarse side: edges of the other sides end inside its edges
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    side = (np.array(box.vertices)[box.faces][:, :, 0] > 0).all(axis=1)
    fine = trimesh.Trimesh(box.vertices, box.faces[~side]).subdivide().subdivide()
    corners, renumbered = np.unique(np.array(box.faces[side]), return_inverse=True)
    faces = np.vstack([fine.faces, len(fine.vertices) + renumbered.reshape(-1, 3)])
    yield all_rims("t-junctions", np.vstack([fine.vertices, np.array(box.vertices)[corners]]), faces, LEFT_OPEN)
    # an open strip rolled up to a spiral
    (x, y), faces = lattice(199, 1)
    ribbon = np.stack([np.cos(x / 12) * (x / 12 + 3), np.sin(x / 12) * (x / 12 + 3), y], axis=1)
    yield all_rims("ribbon", ribbon, faces, LEFT_OPEN)
    torus = trimesh.creation.torus(1.0, 0.3, major_sections=24, minor_sections=12)
    yield all_rims("tunnel", torus.vertices, torus.faces, "closed, of genus 1: a tunnel has no rim")


def moebius_and_lips() -> Iterator[Hole]:
    """A Möbius band with a window, and a strip around a rim of almost no width."""
    (x, y), faces = lattice(60, 6)
    turn = np.pi * x / 60
    radius = 2 + (y - 3) / 4 * np.cos(turn)
    band = np.stack([radius * np.cos(2 * turn), radius * np.sin(2 * turn), (y - 3) / 4 * np.sin(turn)], axis=1)
    joined = np.arange(len(x))
    joined[x == 60] = np.flatnonzero(x == 0)[::-1]  # the ends of the strip meet upside down
    faces = joined[faces]
    window = np.linalg.norm(band[faces].mean(axis=1) - band[(x == 30) & (y == 3)][0], axis=1) < 0.35
    yield all_rims("moebius", band, faces[~window], "not orientable: refused")
    t = 2 * np.pi * np.arange(28) / 28
    lips = np.column_stack([np.cos(t), 0.02 * np.sin(t) + 0.15 * np.cos(t) ** 2, 0.1 * np.cos(t) ** 2])
    around = np.column_stack([1.5 * np.cos(t), 0.6 * np.sin(t), np.full(28, -0.3)])
    ring, after = np.arange(28), (np.arange(28) + 1) % 28
    inner, outer = np.stack([ring, ring + 28, after], axis=1), np.stack([after, ring + 28, after + 28], axis=1)
    yield all_rims("lips", np.vstack([lips, around]), np.concatenate([inner, outer]))
