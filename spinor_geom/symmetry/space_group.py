"""Copies of a surface piece under the group that its sides generate, and the lattice of this group."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from spinor_geom.errors import OptionError
from spinor_geom.symmetry.side_symmetries import Isometries

_MOST = 96  # a crystal class has at most 48 elements, with and without a change of orientation
_MOST_COPIES = 1000  # which take seconds: each is compared with all others
_NO_LATTICE = np.zeros((0, 3))
_CLOSE = 1e-6  # distances up to this share of the size of the piece count as 0


def within_steps(sides: Isometries, points: Float[np.ndarray, "n 3"], size: float, steps: int) -> Isometries:
    """The copies that are reached from the piece across at most `steps` sides, each once.

    Raises an OptionError if there are more than 1,000.
    """
    found = newest = _identity()
    for _ in range(steps):
        newest = _new(newest.composed(sides), found, points, size)
        found = found + newest
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
        joined = found + newest.composed(sides)
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


def _directions(g: Isometries) -> Float[np.ndarray, "k 10"]:
    return np.column_stack([g.rotations.reshape(-1, 9), g.odd])


def _first_alike(rows: Float[np.ndarray, "k c"]) -> np.ndarray:
    """Indices of the rows that differ from all before them."""
    alike = np.abs(rows[:, None] - rows).max(axis=2) < _CLOSE
    return np.flatnonzero(alike.argmax(axis=1) == np.arange(len(rows)))


def _new(
    g: Isometries,
    known: Isometries,
    points: Float[np.ndarray, "n 3"],
    size: float,
    lattice: Float[np.ndarray, "rank 3"] = _NO_LATTICE,
) -> Isometries:
    """The isometries whose images of the piece differ from each other, and from those of known ones modulo a lattice.

    Images are equal if their centres and the sets of their corners are. `points` are the centre of the rims, and the
    corners.
    """
    images, kept = (known + g).points(points), np.arange(len(known))
    for k in range(len(known), len(images)):
        away = images[k, 0] - images[kept, 0]
        shift = np.round(away @ np.linalg.pinv(lattice)) @ lattice
        shift[len(known) :] = 0
        near = np.linalg.norm(away - shift, axis=1) < _CLOSE * size
        others = images[kept[near]] + shift[near, None]
        gaps = np.linalg.norm(images[k, :, None] - others[:, None], axis=3).min(axis=1).max(axis=1)
        kept = kept if (gaps < _CLOSE * size).any() else np.append(kept, k)
    return (known + g)[kept[len(known) :]]


def _compact(
    sides: Isometries, points: Float[np.ndarray, "n 3"], size: float, lattice: Float[np.ndarray, "rank 3"]
) -> Isometries:
    """A copy of each class modulo a lattice, each the neighbour nearest to the centroid of those before."""
    cell, border = _identity(), sides
    while len(border := _new(border, cell, points, size, lattice)):
        away = np.linalg.norm(border.points(points)[:, 0] - cell.points(points)[:, 0].mean(axis=0), axis=1)
        nearest = border[np.flatnonzero(away < away.min() + _CLOSE * size)[:1]]
        cell, border = cell + nearest, border + nearest.composed(sides)
    return cell


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
