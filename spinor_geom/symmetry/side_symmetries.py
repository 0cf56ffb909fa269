"""Symmetries of a minimal surface in its sides, by Schwarz's reflection principle.

A minimal surface with a straight side continues as its image under the half turn about this line. A surface that meets
a plane at right angles along a side continues as its mirror image in the plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from spinor_geom.errors import OptionError
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.rim_match import RimMatch
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.surface.array_surface import ArraySurface

_SAMPLES = 65  # of a side
# Largest deviations: the distance of a side from its line or plane, in diagonals. The angle between the normal of the
# surface and the plane of a side. π over the angle of a corner from an integer, relative to this integer.
_AWAY, _ASKEW, _INTEGER = 1e-7, 1e-3, 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Isometries:
    """Isometries r ↦ rotation·r + shift of space, and whether each reverses the order of the corners of faces.

    Attributes:
        rotations: orthogonal matrices.
        shifts: in mesh units.
        odd: whether an odd number of half turns and reflections are composed.
    """

    rotations: Float[np.ndarray, "k 3 3"]
    shifts: Float[np.ndarray, "k 3"]
    odd: Bool[np.ndarray, " k"]

    def __len__(self) -> int:
        return len(self.shifts)

    def __getitem__(self, index: slice | Int[np.ndarray, " n"]) -> Isometries:
        return Isometries(**{name: values[index] for name, values in vars(self).items()})

    def __add__(self, others: Isometries) -> Isometries:
        return Isometries(**{name: np.concatenate([own, vars(others)[name]]) for name, own in vars(self).items()})

    def points(self, r: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "k *n 3"]:
        """The images of points."""
        turned = np.einsum("kij,...j->k...i", self.rotations, r)
        return np.asarray(turned + self.shifts.reshape(-1, *(1,) * (np.ndim(r) - 1), 3))

    def normals(self, n: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "k *n 3"]:
        """The images of normals of a surface, on the same side of all its copies."""
        signs = np.sign(np.linalg.det(self.rotations)) * np.where(self.odd, -1, 1)
        return np.asarray(np.einsum("k,kij,...j->k...i", signs, self.rotations, n))

    def composed(self, second: Isometries) -> Isometries:
        """All compositions r ↦ g(s(r)), those of the first g first."""
        rotations = self.rotations[:, None] @ second.rotations
        shifts = np.einsum("kij,mj->kmi", self.rotations, second.shifts) + self.shifts[:, None]
        odd = self.odd[:, None] != second.odd
        return Isometries(rotations=rotations.reshape(-1, 3, 3), shifts=shifts.reshape(-1, 3), odd=odd.ravel())


def side_symmetries(solution: PlateauSolution) -> Isometries:
    """A half turn for each straight side, a reflection for each side that meets its plane at right angles.

    Raises an OptionError if there is none, or a corner between two such sides has an angle that does not divide π:
    the continuation is then branched there.
    """
    found: list[tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]] = []
    size = solution.diagonal
    for rim in solution.rims:
        ends = rim.curve.breaks[:-1][rim.curve.corners]
        starts = ends if len(ends) else np.zeros(1)
        sides = [
            _of_side(rim, solution.array_surface, start, end, size)
            for start, end in zip(starts, np.append(starts[1:], starts[0] + 1), strict=True)
        ]
        for k in range(len(ends)):
            if sides[k] is not None and sides[k - 1] is not None:
                _require_dividing_angle(rim.curve, float(ends[k]))
        found += [side for side in sides if side is not None]
    if not found:
        raise OptionError("no side of the surface is straight or meets a plane at right angles; it cannot be continued")
    rotations, shifts = map(np.array, zip(*found, strict=True))
    return Isometries(rotations=rotations, shifts=shifts, odd=np.ones(len(found), dtype=bool))


def _of_side(
    rim: RimMatch, surface: ArraySurface, start: float, end: float, size: float
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]] | None:
    """The rotation and the shift of the symmetry in the side between two parameters of Γ, or None without one."""
    s = start + (end - start) * np.arange(_SAMPLES) / (_SAMPLES - 1)
    s[-1] = np.nextafter(end, start)
    points = rim.curve.point(s)
    middle = points.mean(axis=0)
    along, _, across = np.linalg.svd(points - middle, full_matrices=False)[2]
    reach = points - middle
    if np.linalg.norm(reach - np.outer(reach @ along, along), axis=1).max() <= _AWAY * size:
        chord = points[-1] - points[0]
        turn = 2 * np.outer(chord, chord) / (chord @ chord) - np.eye(3)
        return turn, points[0] - turn @ points[0]
    inner = s[_SAMPLES // 8 : -_SAMPLES // 8]
    normals = surface.normal(rim.boundary.point(rim.parameters(inner)))
    if np.abs(reach @ across).max() > _AWAY * size or np.abs(normals @ across).max() > _ASKEW:
        return None
    return np.eye(3) - 2 * np.outer(across, across), 2 * (middle @ across) * across


def _require_dividing_angle(curve: BoundaryCurve, at: float) -> None:
    """Raises an OptionError if the angle at a corner does not divide π."""
    ahead, back = curve.derivative(np.array([at, np.nextafter(at + 1, 0)]))
    angle = np.arctan2(np.linalg.norm(np.cross(ahead, back)), -(ahead @ back))
    parts = np.pi / angle
    if abs(parts - round(parts)) > _INTEGER * parts:
        place = [float(f"{x:.6g}") for x in curve.point(np.array([at]))[0]]
        raise OptionError(
            f"the corner at {place} has an angle of {np.degrees(angle):.6g}°, which does not divide 180°, so that the "
            "continued surface is branched there; continue a surface without this corner"
        )
