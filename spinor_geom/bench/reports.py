"""The suite of holes as people report them: steep ragged rims, and loops where nothing is missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache

import numpy as np
import trimesh

from spinor_geom.bench.cases import Hole, all_rims, lattice
from spinor_geom.bench.reported import reported_bowls, reported_tubes

OFFSETS = (1e-16, 1e-12, 1e-8)  # of equal corners, per size of the mesh
LEFT_OPEN = "nothing is missing: left open, and said so"
# names of the cases where that is right
NOTHING_MISSING = (*(f"near-seam-{offset:.0e}" for offset in OFFSETS), "t-junctions", "ribbon")
_RIBBON = 199  # quads of an open strip


@cache
def reported_holes() -> Mapping[str, Hole]:
    """All cases by name."""
    return {hole.name: hole for hole in (*reported_bowls(), *reported_tubes(), *_nothing_missing(), *_others())}


def _nothing_missing() -> Iterator[Hole]:
    for offset in OFFSETS:
        yield near_seam(offset)
    yield t_junctions()
    (x, y), faces = lattice(_RIBBON, 1)
    ribbon = np.stack([np.cos(x / 12) * (x / 12 + 3), np.sin(x / 12) * (x / 12 + 3), y], axis=1)
    yield all_rims("ribbon", ribbon, faces, LEFT_OPEN)
    torus = trimesh.creation.torus(1.0, 0.3, major_sections=24, minor_sections=12)
    yield all_rims("tunnel", torus.vertices, torus.faces, "closed, of genus 1: a tunnel has no rim")


def _others() -> Iterator[Hole]:
    (x, y), faces = lattice(60, 6)
    turn = np.pi * x / 60  # half a turn around itself on the way around
    radius = 2 + (y - 3) / 4 * np.cos(turn)
    band = np.stack([radius * np.cos(2 * turn), radius * np.sin(2 * turn), (y - 3) / 4 * np.sin(turn)], axis=1)
    # the ends of the strip meet upside down
    last, first = np.flatnonzero(x == 60), np.flatnonzero(x == 0)[::-1]
    joined = np.arange(len(x))
    joined[last] = first
    faces = joined[faces]
    middle = band[faces].mean(axis=1)
    window = np.linalg.norm(middle - band[(x == 30) & (y == 3)][0], axis=1) < 0.35
    yield all_rims("moebius", band, faces[~window], "not orientable: said so")
    t = 2 * np.pi * np.arange(28) / 28
    lips = np.column_stack([np.cos(t), 0.02 * np.sin(t) + 0.15 * np.cos(t) ** 2, 0.1 * np.cos(t) ** 2])
    around = np.column_stack([1.5 * np.cos(t), 0.6 * np.sin(t), np.full(28, -0.3)])
    ring = np.arange(28)
    after = np.roll(ring, -1)
    strip = np.concatenate(
        [np.stack([ring, ring + 28, after], axis=1), np.stack([after, ring + 28, after + 28], axis=1)]
    )
    yield all_rims("lips", np.vstack([lips, around]), strip)


def near_seam(offset: float) -> Hole:
    """A closed box whose lid has corners of its own, off by rounding of a share of the size."""
    box = trimesh.creation.box((2.5, 1.2, 0.5))
    vertices, faces = np.array(box.vertices), np.array(box.faces)
    lid = (vertices[faces][:, :, 0] > 0).all(axis=1)
    corners, renumbered = np.unique(faces[lid], return_inverse=True)
    faces[lid] = len(vertices) + renumbered.reshape(-1, 3)
    moved = vertices[corners] + 2.5 * offset * np.random.default_rng(0).uniform(-1, 1, (len(corners), 3))
    return all_rims(f"near-seam-{offset:.0e}", np.vstack([vertices, moved]), faces, LEFT_OPEN)


def t_junctions(pieces: int = 4) -> Hole:
    """A box one of whose sides is a coarse piece: the edges of the rest end in the middle of its edges."""
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    side = (np.array(box.vertices)[box.faces][:, :, 0] > 0).all(axis=1)
    fine = trimesh.Trimesh(box.vertices, box.faces[~side])
    for _ in range(int(np.log2(pieces))):
        fine = fine.subdivide()
    coarse = np.array(box.faces[side])
    used, renumbered = np.unique(coarse, return_inverse=True)
    vertices = np.vstack([fine.vertices, np.array(box.vertices)[used]])
    faces = np.vstack([fine.faces, len(fine.vertices) + renumbered.reshape(-1, 3)])
    return all_rims("t-junctions", vertices, faces, LEFT_OPEN)
