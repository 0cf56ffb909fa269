"""Edges of a membrane: cables, stays, rings and planes of symmetry."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from numbers import Real
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from spinor_geom.errors import OptionError, require_positive
from spinor_geom.mesh.array_checks import freeze_points
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.open_curve import OpenCurve


@dataclass(frozen=True, kw_only=True)
class Cable:
    """A flexible cable between two points, of given tension or of given length.

    Attributes:
        start: position of its start, three numbers, in mesh units.
        end: position of its end.
        tension: force, in units of the surface tension of the film times mesh units.
        length: in mesh units. The tension follows from it.

    Raises:
        OptionError: not exactly one of tension and length is given, it is not positive, both ends are equal, or the
            cable is shorter than the distance of its ends.
        MeshShapeError, NonFiniteVertexError: the ends are no points in space.
    """

    start: ArrayLike
    end: ArrayLike
    tension: float | None = None
    length: float | None = None

    def __post_init__(self) -> None:
        if (self.tension is None) == (self.length is None):
            raise OptionError("a cable has a tension or a length; give exactly one of them")
        name = "tension" if self.length is None else "length"
        require_positive(name, getattr(self, name))
        freeze_points([self.start, self.end], name="both ends of a cable")  # type: ignore[arg-type]
        if self.chord == 0:
            raise OptionError(f"both ends of a cable are {self.ends[0].tolist()}; give two points")
        if self.length is not None and self.length <= self.chord and not isinstance(self, Stay):
            raise OptionError(
                f"a cable of length {self.length:g} is too short for ends {self.chord:g} apart; lengthen it"
            )

    @property
    def ends(self) -> Float[np.ndarray, "2 3"]:
        """Both ends."""
        return np.asarray([self.start, self.end], dtype=np.float64)

    @property
    def chord(self) -> float:
        """The distance of the ends."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))


class Stay(Cable):
    """A straight cable outside the film, which holds its start.

    The position of the start follows from the forces there. The given one is where its search starts. It is a corner
    between cables of the film, or the start of other stays. The end is fixed unless another stay starts there.
    """


@dataclass(frozen=True, kw_only=True)
class Ring:
    """A closed rigid rim of the film, such as the head of a mast.

    Attributes:
        points: (m, 3) points in order, in mesh units. Corners need three or more on each side.
        force: that pulls the ring along the z axis. Its height follows, and the given one is where the search starts.
            None for a fixed ring.

    Raises:
        OptionError: the force is not finite.
        SpinorGeomError: the errors of `BoundaryLoop.from_points`.
    """

    points: ArrayLike
    force: float | None = None

    def __post_init__(self) -> None:
        BoundaryLoop.from_points(self.points)  # raises the errors
        if self.force is not None and not (isinstance(self.force, Real) and isfinite(self.force)):
            raise OptionError(f"the force of a ring must be a finite number, got {self.force!r}")

    def __repr__(self) -> str:
        return f"Ring({len(np.asarray(self.points))} points, force={self.force})"


@dataclass(frozen=True, kw_only=True)
class SymmetryPlane:
    """A plane in which all edges are reflected. The film meets it at right angles.

    Attributes:
        point: a point of the plane.
        normal: its normal, of any length.
    """

    point: ArrayLike
    normal: ArrayLike


Edge: TypeAlias = Cable | Ring | SymmetryPlane | OpenCurve | ArrayLike
