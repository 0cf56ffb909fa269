"""Copies of a surface piece under the group that its sides generate, and the lattice of this group."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from spinor_geom.errors import OptionError
from spinor_geom.symmetry.side_symmetries import Isometries

_MOST = 96  # a crystal class has at most 48 elements, with and without a change of orientation
_MOST_COPIES = 1000  # which take seconds: each is compared with all others
_CLOSE = 1e-6  # distances up to this share of the size of the piece count as 0


def within_steps(sides: Isometries, points: Float[np.ndarray, "n 3"], size: float, steps: int) -> Isometries:
    """The copies that are reached from the piece across at most `steps` sides, each once.

    Raises an OptionError if there are more than 1,000.
    """
    found = newest = _identity()
    for _ in range(steps):
        found, before = _distinct(_joined([found, newest.composed(sides)]), points, size), len(found)
        newest = found[before:]
        if len(found) > _MOST_COPIES:
            raise OptionError(
                f"more than {_MOST_COPIES} copies are reached across {steps} sides; give fewer, or repeat a cell"
            )
    return found


def periodic_cell(
    sides: Isometries, points: Float[np.ndarray, "n 3"], size: float
) -> tuple[Isometries, Float[np.ndarray, "rank 3"]]:
    """The copies of a compact cell, connected, and a basis of the translations that continue it with its orientation.

    By Schreier's lemma the compositions of a representative of each direction, a generator, and the inverse of the
    representative of the direction reached generate all translations of the group.

    Raises an OptionError if the group has infinitely many directions or arbitrarily short translations.
    """
    found = newest = _identity()
    while len(newest):
        joined = _joined([found, newest.composed(sides)])
        kept = _first_alike(_directions(joined))
        newest, found = joined[kept[kept >= len(found)]], joined[kept]
        if len(found) > _MOST:
            raise OptionError(
                "the sides generate infinitely many directions, so there is no periodic cell; give copies="
            )
    reached = found.composed(sides)
    known = _directions(found)
    of = np.abs(_directions(reached)[:, None] - known).max(axis=2).argmin(axis=1)
    # g(s(r)) = R r + t and its representative R r + u differ by the translation t − u
    lattice = _basis(reached.shifts - found.shifts[of], _CLOSE * size)
    return _compact(sides, points, size, lattice), lattice


def _identity() -> Isometries:
    return Isometries(rotations=np.eye(3)[None], shifts=np.zeros((1, 3)), odd=np.zeros(1, dtype=bool))


def _joined(parts: Sequence[Isometries]) -> Isometries:
    return Isometries(
        rotations=np.concatenate([part.rotations for part in parts]),
        shifts=np.concatenate([part.shifts for part in parts]),
        odd=np.concatenate([part.odd for part in parts]),
    )


def _directions(g: Isometries) -> Float[np.ndarray, "k 10"]:
    return np.column_stack([g.rotations.reshape(-1, 9), g.odd])


def _first_alike(rows: Float[np.ndarray, "k c"]) -> np.ndarray:
    """Indices of the rows that differ from all before them."""
    alike = np.abs(rows[:, None] - rows).max(axis=2) < _CLOSE
    return np.flatnonzero(alike.argmax(axis=1) == np.arange(len(rows)))


def _distinct(g: Isometries, points: Float[np.ndarray, "n 3"], size: float) -> Isometries:
    """One isometry for each different image of the piece.

    Images are equal if their centres and the sets of their corners are. `points` are the centre of the rims, and the
    corners.
    """
    images = g.points(points)
    first, second = cKDTree(images[:, 0]).query_pairs(_CLOSE * size, output_type="ndarray").T
    gaps = np.linalg.norm(images[first, :, None] - images[second, None], axis=3)
    return g[np.setdiff1d(np.arange(len(g)), second[gaps.min(axis=2).max(axis=1) < _CLOSE * size])]


def _alike(
    image: Float[np.ndarray, "n 3"],
    others: Float[np.ndarray, "k n 3"],
    size: float,
    lattice: Float[np.ndarray, "rank 3"],
) -> np.ndarray:
    """Which other images are equal to one, modulo a lattice."""
    away = image[0] - others[:, 0]
    shift = np.round(away @ np.linalg.pinv(lattice)) @ lattice
    near = np.flatnonzero(np.linalg.norm(away - shift, axis=1) < _CLOSE * size)
    gaps = np.linalg.norm(image[:, None] - (others[near] + shift[near, None])[:, None], axis=3)
    return np.asarray(near[gaps.min(axis=2).max(axis=1) < _CLOSE * size])


def _compact(
    sides: Isometries, points: Float[np.ndarray, "n 3"], size: float, lattice: Float[np.ndarray, "rank 3"]
) -> Isometries:
    """A copy of each class modulo a lattice, each the neighbour nearest to the centroid of those before."""
    cell, border = _identity(), sides
    while True:
        images, outside = cell.points(points), border.points(points)
        free = [k for k, one in enumerate(outside) if not len(_alike(one, images, size, lattice))]
        if not free:
            return cell
        border = border[np.array(free)]
        away = np.linalg.norm(outside[free, 0] - images[:, 0].mean(axis=0), axis=1)
        nearest = border[np.flatnonzero(away < away.min() + _CLOSE * size)[:1]]
        cell, border = _joined([cell, nearest]), _joined([border, nearest.composed(sides)])


def _basis(translations: Float[np.ndarray, "k 3"], close: float) -> Float[np.ndarray, "rank 3"]:
    """A reduced basis of the lattice that translations generate, by Euclid's algorithm."""
    pool, basis = list(translations), np.zeros((0, 3))
    while pool:
        vector = pool.pop()
        share = np.linalg.pinv(basis).T @ vector if len(basis) else np.zeros(0)
        rest = vector - np.round(share) @ basis
        if np.linalg.norm(rest) < close:
            continue
        share -= np.round(share)
        if np.linalg.norm(rest - share @ basis) >= close:
            basis = np.vstack([basis, rest])
        else:
            # the volume of the cell falls by at least a half
            largest = int(np.abs(share).argmax())
            pool.append(basis[largest].copy())
            basis[largest] = rest
            if np.linalg.svd(basis)[1].min() < close:
                raise OptionError("the translations of the continued surface are no lattice; give copies=")
    changed = True
    while changed:
        changed = False
        basis = basis[np.linalg.norm(basis, axis=1).argsort(kind="stable")]
        for k in range(1, len(basis)):
            for j in range(k):
                shorter = basis[k] - np.round(basis[k] @ basis[j] / (basis[j] @ basis[j])) * basis[j]
                # where a ratio is 1/2 up to rounding, both vectors are equally long, and steps between them do not end
                if np.linalg.norm(shorter) < np.linalg.norm(basis[k]) - close:
                    basis[k], changed = shorter, True
    return basis
