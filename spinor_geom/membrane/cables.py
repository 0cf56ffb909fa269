"""Cables and fixed edges of a membrane, as curves with linear shape functions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy.polynomial.legendre import Legendre
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, make_interp_spline

from spinor_geom.errors import OptionError, require_positive
from spinor_geom.mesh.interpolation import gauss_nodes
from spinor_geom.mesh.open_curve import OpenCurve

DEGREE = 16  # of the polynomials of a cable
_TURN_SAMPLES = 1000  # of a fixed edge for its total curvature
_QUADRATURE = 48  # Gauss-Legendre nodes for its length


@dataclass(frozen=True, kw_only=True)
class Cable:
    """A flexible cable between two points, of given tension or of given length.

    Attributes:
        start: position of its start, three numbers, in mesh units.
        end: position of its end.
        tension: force, in units of the surface tension of the film times mesh units.
        length: in mesh units; the tension follows from it.

    Raises:
        OptionError: not exactly one of tension and length is given, it is not positive, both ends are equal, or the
            cable is shorter than the distance of its ends.
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
        ends = np.asarray([self.start, self.end], dtype=np.float64)
        if ends.shape != (2, 3) or not np.isfinite(ends).all():
            raise OptionError(f"the ends of a cable are two points in space, got {self.start!r} and {self.end!r}")
        chord = float(np.linalg.norm(ends[1] - ends[0]))
        if chord == 0:
            raise OptionError(f"both ends of a cable are {ends[0].tolist()}; give two points")
        if self.length is not None and self.length <= chord:
            raise OptionError(f"a cable of length {self.length:g} is too short for ends {chord:g} apart; lengthen it")


@dataclass(frozen=True, eq=False)
class CableEdge:
    """A cable as c(x) = Σ_k B_k(x) C_k, 0 ≤ x ≤ 1: B_0 = 1 − x, B_1 = x, then integrals of Legendre polynomials."""

    cable: Cable

    @cached_property
    def _functions(self) -> list[Legendre]:
        ends = [Legendre([0.5, -0.5], domain=[0, 1]), Legendre([0.5, 0.5], domain=[0, 1])]
        return [*ends, *(Legendre.basis(k, domain=[0, 1]).integ(lbnd=0) for k in range(1, DEGREE))]

    def shapes(self, x: Float[np.ndarray, " n"], order: int = 0) -> Float[np.ndarray, "n k"]:
        """B(x), or a derivative."""
        return np.stack([(f.deriv(order) if order else f)(x) for f in self._functions], axis=-1)

    @cached_property
    def _at_nodes(self) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, " n"]]:
        nodes, weights = gauss_nodes(_QUADRATURE)
        return self.shapes((nodes + 1) / 2, 1), weights / 2

    def start(self, towards: Float[np.ndarray, "3"], size: float) -> Float[np.ndarray, "k 3"]:
        """Control points of a parabola that is bent towards a point."""
        ends = np.asarray([self.cable.start, self.cable.end], dtype=np.float64)
        chord = float(np.linalg.norm(ends[1] - ends[0]))
        across = towards - ends.mean(axis=0)
        across -= (across @ (ends[1] - ends[0])) * (ends[1] - ends[0]) / chord**2
        reach = np.linalg.norm(across)
        if self.cable.tension is None:
            sag = np.sqrt(3 / 8 * ((self.cable.length or chord) - chord) * chord)
        else:
            sag = chord**2 / (8 * self.cable.tension)
        control = np.zeros((DEGREE + 1, 3))
        control[:2] = ends
        if reach > size * 1e-9:
            # 4 x (1 − x) is −4 times the first integral, ∫ (2x − 1)
            control[2] = -4 * min(sag, 0.4 * reach) * across / reach
        return control

    def length_terms(
        self, control: Float[np.ndarray, "k 3"]
    ) -> tuple[float, Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3 k 3"], Float[np.ndarray, "k 3 k 3"]]:
        """Length with its first and second derivative, and the form ∫ ((X·τ)′)² ds of displacements along it."""
        slopes, weights = self._at_nodes
        velocity = slopes @ control
        speed = np.linalg.norm(velocity, axis=1)
        tangent = velocity / speed[:, None]
        across = np.eye(3) - tangent[:, :, None] * tangent[:, None]
        second = np.einsum("n,ni,nj,nab->iajb", weights / speed, slopes, slopes, across, optimize=True)
        x = (gauss_nodes(_QUADRATURE)[0] + 1) / 2
        bend = np.einsum("nab,nb->na", across, self.shapes(x, 2) @ control) / speed[:, None]
        slide = slopes[:, :, None] * tangent[:, None] + self.shapes(x)[:, :, None] * bend[:, None]
        along = np.einsum("n,nia,njb->iajb", weights / speed, slide, slide, optimize=True)
        length = float(weights @ speed)
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

    @property
    def total_curvature(self) -> float:
        """The angle by which its direction turns in all."""
        along = self.point(np.linspace(0, 1, _TURN_SAMPLES), 1)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        return float(np.linalg.norm(np.diff(along, axis=0), axis=1).sum())
