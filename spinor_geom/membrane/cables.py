"""Edges of a membrane: cables as curves with linear shape functions, fixed edges, and rings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from numbers import Real
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, make_interp_spline

from spinor_geom.errors import OptionError, require_positive
from spinor_geom.mesh.array_checks import freeze_points
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.interpolation import gauss_nodes
from spinor_geom.mesh.open_curve import OpenCurve

DEGREE = 16  # of the polynomials of a cable
_QUADRATURE = 48  # Gauss-Legendre nodes for its length
_HALF_ANGLES = np.linspace(1e-3, np.pi - 1e-3, 3000)  # of arcs, for their lengths per chord


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
        for name in ("tension", "length"):
            if getattr(self, name) is not None:
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


LengthTerms: TypeAlias = tuple[
    float, Float[np.ndarray, "_ 3"], Float[np.ndarray, "_ 3 _ 3"], Float[np.ndarray, "_ 3 _ 3"]
]
Edge: TypeAlias = Cable | Ring | SymmetryPlane | OpenCurve | ArrayLike


@dataclass(frozen=True, eq=False)
class CableEdge:
    """A cable as c(x) = Σ_k B_k(x) C_k, 0 ≤ x ≤ 1: B_0 = 1 − x, B_1 = x, then integrals of Legendre polynomials."""

    cable: Cable

    @property
    def degree(self) -> int:
        """The degree of c."""
        return 1 if isinstance(self.cable, Stay) else DEGREE

    @cached_property
    def _derivatives(self) -> list[Float[np.ndarray, "_ k"]]:
        """Legendre coefficients of B and its derivatives, by columns."""
        own = legendre.legint(np.eye(self.degree + 1), scl=0.5, lbnd=-1)[: self.degree + 1, 1 : self.degree]
        ends = np.zeros((self.degree + 1, 2))
        ends[:2] = [[0.5, 0.5], [-0.5, 0.5]]
        first = np.concatenate([ends, own], axis=1)
        return [first, *(np.atleast_2d(legendre.legder(first, m, scl=2)) for m in (1, 2))]

    def shapes(self, x: Float[np.ndarray, " n"], order: int = 0) -> Float[np.ndarray, "n k"]:
        """B(x), or a derivative."""
        coefficients = self._derivatives[order]
        return np.asarray(legendre.legvander(2 * x - 1, len(coefficients) - 1) @ coefficients)

    @cached_property
    def _at_nodes(self) -> tuple[Float[np.ndarray, " n"], list[Float[np.ndarray, "n k"]]]:
        """Weights of a quadrature, and B with its derivatives at the nodes."""
        nodes, weights = gauss_nodes(_QUADRATURE)
        return weights / 2, [self.shapes((nodes + 1) / 2, order) for order in (0, 1, 2)]

    @property
    def half_angle(self) -> float:
        """Half the angle by which an arc of a circle with this chord, and this length or curvature 1/tension, turns."""
        cable = self.cable
        if cable.tension is None:
            return float(
                np.interp((cable.length or 0.0) / cable.chord, _HALF_ANGLES / np.sin(_HALF_ANGLES), _HALF_ANGLES)
            )
        return float(np.arcsin(min(1.0, cable.chord / (2 * cable.tension))))

    @property
    def first_tension(self) -> float:
        """The tension, or for a given length that of an arc of a circle in a plane film."""
        return self.cable.tension or self.cable.chord / (2 * np.sin(self.half_angle))

    def start(self, inward: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "k 3"]:
        """Own control points of an arc of a circle, twisted towards directions into the film at x = 0, ½ and 1."""
        chord = self.cable.chord
        along = (self.cable.ends[1] - self.cable.ends[0]) / chord
        across = inward - (inward @ along)[:, None] * along
        reach = np.linalg.norm(across, axis=1, keepdims=True)
        # the film is nowhere narrower than a part of the distance to its middle
        half = min(self.half_angle, 2 * np.arctan(0.8 * float(reach[1, 0]) / chord))
        across = np.where(reach > 1e-6 * chord, across / np.maximum(reach, 1e-6 * chord), across[1])
        x = (gauss_nodes(_QUADRATURE)[0] + 1) / 2
        towards = np.stack([(1 - x) * (1 - 2 * x), 4 * x * (1 - x), x * (2 * x - 1)], axis=1) @ across
        towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), np.finfo(float).tiny)
        angle = half * (2 * x - 1)[:, None]
        second = -2 * half * chord / np.sinc(half / np.pi) * (np.cos(angle) * towards + np.sin(angle) * along)
        return np.asarray(legendre.legint(legendre.legfit(2 * x - 1, second, DEGREE - 2), scl=0.5)[1:])

    def length_terms(self, control: Float[np.ndarray, "k 3"]) -> LengthTerms:
        """Length with its first and second derivative, and a form of displacements along the cable.

        The form is ∫ (f′)² ds less its minimum for given ends, f = X·τ. Area and length do not depend on displacements
        along the cable with fixed ends, on which it is positive.
        """
        weights, (values, slopes, bends) = self._at_nodes
        velocity = slopes @ control
        speed = np.linalg.norm(velocity, axis=1)
        tangent = velocity / speed[:, None]
        across = np.eye(3) - tangent[:, :, None] * tangent[:, None]
        second = np.einsum("n,ni,nj,nab->iajb", weights / speed, slopes, slopes, across, optimize=True)
        bend = np.einsum("nab,nb->na", across, bends @ control) / speed[:, None]
        slide = slopes[:, :, None] * tangent[:, None] + values[:, :, None] * bend[:, None]
        length, ends = float(weights @ speed), np.einsum("n,nia->ia", weights, slide)
        along = np.einsum("n,nia,njb->iajb", weights / speed, slide, slide, optimize=True)
        along -= ends[:, :, None, None] * ends / length
        return length, np.einsum("n,ni,na->ia", weights, slopes, tangent), second, along


@dataclass(frozen=True, eq=False)
class FixedEdge:
    """A fixed edge: a straight line, or the spline through the points of an open curve without corners."""

    curve: OpenCurve

    @cached_property
    def knots(self) -> Float[np.ndarray, " m"]:
        """Parameters of the points: normalised chord lengths."""
        steps = np.linalg.norm(np.diff(self.curve.points, axis=0), axis=1)
        return np.asarray(np.append(0.0, np.cumsum(steps)) / steps.sum())

    @cached_property
    def _spline(self) -> BSpline:
        most = len(self.curve.points) - 1
        return make_interp_spline(self.knots, self.curve.points, k=next(k for k in (5, 3, 2, 1) if k <= most))

    def point(self, x: Float[np.ndarray, " n"], order: int = 0) -> Float[np.ndarray, "n 3"]:
        """c(x), or a derivative."""
        return np.asarray(self._spline(x, nu=order))
