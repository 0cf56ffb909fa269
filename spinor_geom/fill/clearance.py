"""Keeps the mesh of a patch clear of the mesh around it, where it crosses that beside a ragged or steep rim."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array, csr_array

from spinor_geom.domain.delaunay import rim_successors
from spinor_geom.fill.surroundings import Crossings, Surroundings, patch_chords, split_chords
from spinor_geom.mesh.operators import face_normals
from spinor_geom.meshing.embed import Patch
from spinor_geom.surface.spinor_surface import SpinorSurface

CLEARANCE = 0.05
ROUNDS = 12
WIDTH = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class Cleared:
    patch: Patch
    crossings: Crossings
    edges_split: int


def cleared(surroundings, rim, patch, crossings, surface=None):
    best = Cleared(patch=patch, crossings=crossings, edges_split=0)
    split = 0
    n0 = len(surroundings.mesh.faces)
    wall = None
    for _ in range(ROUNDS):
        pairs = crossings.mesh
        if not len(pairs):
            break
        start = surroundings.count
        new, old = pairs[:, 0] - start, pairs[:, 1]
        faces = np.asarray(patch.faces)
        chords = patch_chords(patch)
        inface = np.isin(chords[:, 0] * len(patch.vertices) + chords[:, 1], _edges(faces[np.unique(new)], len(patch.vertices)))
        if inface.any():
            patch = split_chords(patch, chords[inface], surface)
            split += int(inface.sum())
        else:
            if wall is None: wall = _Wall.of(surroundings, rim, patch, np.unique(old))
            patch = _pushed(patch, new, old, surroundings, wall)
        crossings = surroundings.crossings(patch)
        if len(crossings) < len(best.crossings):
            best = Cleared(patch=patch, crossings=crossings, edges_split=split)
    return best


def _edges(faces, n):
    a, b = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).T
    return np.minimum(a, b) * n + np.maximum(a, b)


def _adjacency(faces, n):
    a, b = faces[:, [0, 1, 2, 1, 2, 0]].ravel(), faces[:, [1, 2, 0, 0, 1, 2]].ravel()
    m = coo_array((np.ones(len(a)), (a, b)), shape=(n, n)).tocsr()
    m.data[:] = 1
    return m


def _averaging(m):
    n = m.shape[0]
    d = m.sum(axis=1) + 1
    from scipy.sparse import diags_array, eye_array
    return csr_array(diags_array(1 / d) @ (m + eye_array(n)))


class _Wall:
    @classmethod
    def of(cls, s, rim, patch, crossed):
        self = cls()
        mesh = s.mesh
        self.mesh = mesh
        self.normals_cache = {}
        self.rim_points = patch.vertices[: patch.boundary_size]
        ids = np.unique(np.concatenate([rim, mesh.faces[crossed].ravel()]))
        for _ in range(3):
            near = s.faces_at(ids)
            ids = np.unique(mesh.faces[near])
        self.ids = ids
        local = np.searchsorted(ids, mesh.faces[near])
        v = mesh.vertices[ids]
        a, b, c = (v[local[:, k]] for k in range(3))
        area = np.cross(b - a, c - a)
        n = np.zeros((len(ids), 3))
        for k in range(3):
            np.add.at(n, local[:, k], area)
        A = _averaging(_adjacency(local, len(ids)))
        for _ in range(3):
            n = A @ n
        n /= np.maximum(np.linalg.norm(n, axis=1), 1e-300)[:, None]
        self.normals = n
        # side
        P = _averaging(_adjacency(np.asarray(patch.faces), len(patch.vertices)))
        y = patch.vertices
        succ = rim_successors(patch.rims)
        m = len(succ)
        R = _averaging(coo_array((np.ones(2 * m), (np.r_[np.arange(m), succ], np.r_[succ, np.arange(m)])), shape=(m, m)).tocsr())
        r = patch.vertices[:m]
        for _ in range(WIDTH):
            y, r = P @ y, R @ r
        bulk = y[:m] - r
        side = np.einsum("ij,ij->i", n[np.searchsorted(ids, rim)], bulk)
        for _ in range(WIDTH):
            side = R @ side
        self.sign = np.where(side > 0, 1.0, -1.0)
        from scipy.spatial import cKDTree
        self.tree = cKDTree(self.rim_points)
        return self

    def directions(self, faces):
        """smoothed free direction and raw free normal for wall faces"""
        mesh = self.mesh
        tri = mesh.faces[faces]
        pos = np.minimum(np.searchsorted(self.ids, tri), len(self.ids) - 1)
        ok = (self.ids[pos] == tri)
        raw = face_normals(mesh.vertices, tri)
        smooth = (self.normals[pos] * ok[..., None]).sum(axis=1)
        lacking = ~ok.any(axis=1)
        smooth[lacking] = raw[lacking]
        smooth /= np.maximum(np.linalg.norm(smooth, axis=1), 1e-300)[:, None]
        sign = self.sign[self.tree.query(mesh.vertices[tri].mean(axis=1))[1]][:, None]
        return sign * smooth, sign * raw


def _pushed(patch, new, old, s, wall):
    faces, m = np.asarray(patch.faces), patch.boundary_size
    d, n = wall.directions(old)
    centre = s.mesh.vertices[s.mesh.faces[old, 0]]
    length = _scale(patch)
    v = faces[new]
    x = patch.vertices[v]
    h = np.einsum("kij,kj->ki", x - centre[:, None], n)
    slope = np.maximum(np.einsum("kj,kj->k", d, n), 0.3)[:, None]
    delta = CLEARANCE * length[v]
    need = np.clip((delta - h) / slope, 0, 0.5 * length[v])
    need = np.where(need == 0, delta, need)
    need = np.where(v < m, 0, need)
    flat, amount = v.ravel(), need.ravel()
    order = np.argsort(amount, kind="stable")
    step = np.zeros((len(patch.vertices), 3))
    step[flat[order]] = (amount[:, None] * np.repeat(d, 3, axis=0))[order]
    step[:m] = 0
    return replace(patch, vertices=patch.vertices + step)


def _scale(patch):
    f = np.asarray(patch.faces)
    x = patch.vertices
    n = len(x)
    tot, cnt = np.zeros(n), np.zeros(n)
    for k in range(3):
        a, b = f[:, k], f[:, (k + 1) % 3]
        l = np.linalg.norm(x[a] - x[b], axis=1)
        tot += np.bincount(a, l, n) + np.bincount(b, l, n)
        cnt += np.bincount(a, minlength=n) + np.bincount(b, minlength=n)
    return tot / np.maximum(cnt, 1)
