"""Schwarz's minimal surfaces: p² and q² have square roots of polynomials as factors.

In a parameter s with Gauss map g = s^k
φ ds = e^{iα}(s^{2k} − 1, −i(s^{2k} + 1), 2s^k)·Π(1 − s/s_j)^{−1/2} ds.
"""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Float, Real
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.spatial import geometric_slerp
from scipy.spatial.transform import Rotation
from scipy.special import ellipk, ellipkm1

from spinor_geom.domain.quadrature import rule
from spinor_geom.errors import OptionError
from spinor_geom.gallery.chart import Chart, null_tangents
from spinor_geom.gallery.curves import polygon
from spinor_geom.gallery.known import KnownCurve, KnownDisk, KnownPatch

# Gauss-Legendre nodes on [0, 1/4], [1/4, 1/2] and [1/2, 1], for integrals to round-off
_ENDS = np.array([0.0, 0.25, 0.5, 1.0])
_NODES = (_ENDS[:-1, None] + np.diff(_ENDS)[:, None] * rule("gauss", 24).nodes).ravel()
_WEIGHTS = (np.diff(_ENDS)[:, None] * rule("gauss", 24).weights).ravel()
_SIDE_POINTS = 48  # of an outline on every great circle
# complete elliptic integrals of modulus 1/2 and √3/2 (scipy's argument is the modulus squared)
_K, _K_PRIME = float(ellipk(0.25)), float(ellipk(0.75))
_SOURCE = "Schwarz (1865); areas by complete elliptic integrals of modulus 1/2 and √3/2"
# normals at the flat points of Schwarz's D and P surfaces
_CUBE = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) / math.sqrt(3)


@dataclass(frozen=True, kw_only=True, eq=False)
class RootSurface:
    """A minimal surface with φ as in the module's docstring and position 0 at s = 0."""

    degree: int  # k
    roots: Complex[np.ndarray, " r"]  # s_j
    angle: float = 0.0  # α
    cuts: Float[np.ndarray, " r"] | float = 0.0  # angles between the branch cuts of the roots and the rays from 0

    def null(self, s: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts 3"]:
        """φ(s)."""
        return np.asarray(self._vector(s) / self._roots(s).prod(axis=-1)[..., None])

    def complex_position(self, s: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts 3"]:
        """∫ φ ds from 0: the position and, as imaginary part, that of the conjugate surface.

        The variable v = (1 − s/s_j)^{1/2}, s_j the nearest root, removes the singularity of the integrand at s_j.
        """
        s = np.asarray(s, dtype=np.complex128)
        nearest = np.abs(s[..., None] - self.roots).argmin(axis=-1)
        root = self.roots[nearest]
        end = np.take_along_axis(self._roots(s), nearest[..., None], axis=-1)[..., 0]
        v = 1 + (end - 1)[..., None] * _NODES
        here = root[..., None] * (1 - v**2)
        others = self._roots(here)
        # the factor of the root itself is exactly v
        own = root[..., None, None] == self.roots
        density = np.where(own, 1.0, others).prod(axis=-1)
        # ds = −2 v s_j dv, and v cancels
        values = self._vector(here) * (-2 * root[..., None] / density)[..., None]
        return np.asarray(((end - 1)[..., None, None] * values * _WEIGHTS[:, None]).sum(axis=-2))

    def _vector(self, s: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts 3"]:
        g = s**self.degree
        turn = np.exp(1j * self.angle)
        return np.asarray(turn * np.stack([g**2 - 1, -1j * (g**2 + 1), 2 * g], axis=-1))

    def _roots(self, s: Complex[np.ndarray, "*pts"]) -> Complex[np.ndarray, "*pts r"]:
        turn = np.exp(1j * np.asarray(self.cuts))
        return np.asarray(np.sqrt(turn) * np.sqrt((self.roots - s[..., None]) / self.roots / turn))


def _polygon_chart(corners: Float[np.ndarray, "c 3"], up: Float[np.ndarray, "3"], degree: int) -> Chart:
    """The minimal disk of a skew polygon, whose Gauss image is the spherical polygon of the normals at the corners.

    The normals along a straight edge are on a great circle. Scale, α and translation are fitted to the corners. `up` is
    the unit normal at the centre, s = 0. The degree of the Gauss map is 2 for a flat point there (a monkey saddle).
    """
    to_axis, _ = Rotation.align_vectors([[0.0, 0.0, -1.0]], [up])
    normals = np.cross(np.roll(corners, -1, axis=0) - corners, np.roll(corners, 1, axis=0) - corners)
    normals *= np.sign(normals @ up)[:, None] / np.linalg.norm(normals, axis=1)[:, None]
    others = _CUBE[np.abs(np.abs(_CUBE @ up) - 1) > 1e-9]
    g = _stereographic(to_axis.apply(others))
    roots = (g ** (1 / degree))[:, None] * np.exp(2j * np.pi * np.arange(degree) / degree)
    parameters = _continuous_root(_stereographic(to_axis.apply(normals)), degree)
    # near a root the position varies like the square root of the distance: errors of 1e-16 would become 1e-8
    nearest = roots.ravel()[np.abs(parameters[:, None] - roots.ravel()).argmin(axis=1)]
    parameters = np.where(np.abs(parameters - nearest) < 1e-12, nearest, parameters)
    surface = RootSurface(degree=degree, roots=roots.ravel())
    found = surface.complex_position(parameters)
    found, wanted = found - found[0], to_axis.apply(corners - corners[0])
    real, imaginary = np.linalg.lstsq(np.column_stack([found.real.ravel(), -found.imag.ravel()]), wanted.ravel())[0]
    surface = replace(surface, angle=math.atan2(imaginary, real))
    matrix = math.hypot(real, imaginary) * to_axis.inv().as_matrix()
    shift = corners[0] - matrix @ surface.complex_position(parameters[:1])[0].real
    return _chart(surface, great_circles(parameters, degree), matrix, shift)


def schwarz_d_quadrilateral() -> KnownCurve:
    """Four edges of the regular tetrahedron with edge 1 (corners of 60°): they bound a piece of Schwarz's D surface."""
    vertices = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(8)
    return _polygon("Schwarz D quadrilateral", vertices, _K_PRIME / (2 * _K), axis=(0, 1, 0), degree=1)


def schwarz_d_hexagon() -> KnownCurve:
    """The Petrie hexagon of the unit cube (corners of 90°)."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1], [0, 0, 1]])
    return _polygon("Schwarz D hexagon", vertices, 3 * _K_PRIME / (2 * _K))


def schwarz_p_hexagon() -> KnownCurve:
    """The Petrie hexagon of the octahedron with vertices ±e_i (edges √2, corners of 60°)."""
    return _polygon("Schwarz P hexagon", np.concatenate([np.eye(3), -np.eye(3)]), 3 * _K / _K_PRIME)


def schwarz_p_quadrilateral() -> KnownCurve:
    """A sixth of the P hexagon: its centre, a mid-edge, a vertex, a mid-edge (corners of 60°, 90°, 60°, 90°)."""
    vertices = np.array([[0, 0, 0], [0.5, 0.5, 0], [0, 1, 0], [0, 0.5, 0.5]])
    return _polygon("Schwarz P quadrilateral", vertices, _K / (2 * _K_PRIME))


def _polygon(
    name: str, vertices: Real[np.ndarray, "c 3"], area: float, *, axis: ArrayLike = (1, -1, 1), degree: int = 2
) -> KnownCurve:
    return replace(
        polygon(vertices, name=name, source=_SOURCE),
        disks=(KnownDisk(area=area, stable=True),),
        chart=_polygon_chart(np.asarray(vertices, dtype=np.float64), np.asarray(axis) / np.linalg.norm(axis), degree),
    )


def schwarz_prism(stretch: float = 1.0) -> KnownCurve:
    """The minimal disk of eight edges of a square prism: two opposite sides of each base, and the four upright edges.

    It is a piece of a tetragonal relative of the D surface, Schwarz's solution of Gergonne's problem: φ =
    (z² − 1, −i(z² + 1), 2z)(1 − 2 cosh 2τ z⁴ + z⁸)^{−1/2} over the unit disk, cut from its circle to the four roots.
    Half the side is L = K(k)/(2√cosh τ) with k² = (cosh τ − 1)/(2 cosh τ), half the height c = e^{−τ}K(κ) with
    κ = e^{−2τ}, the area K(k)K(k′)/cosh τ + 2e^{−2τ}K(κ)K(κ′). The curve is scaled to L = 1. The stretch is c/L.
    """
    if not 0.05 < stretch < 20:
        raise OptionError(f"the prism needs a stretch in (0.05, 20), got {stretch}")

    def sizes(tau: float) -> tuple[float, float, float]:
        cosh, kappa = math.cosh(tau), math.exp(-2 * tau)
        # ellipkm1 takes the complementary parameter
        k, k_prime = float(ellipkm1((cosh + 1) / (2 * cosh))), float(ellipkm1((cosh - 1) / (2 * cosh)))
        upright, upright_prime = float(ellipkm1(-math.expm1(-4 * tau))), float(ellipkm1(kappa**2))
        area = k * k_prime / cosh + 2 * kappa * upright * upright_prime
        return k / (2 * math.sqrt(cosh)), math.exp(-tau) * upright, area

    tau = brentq(lambda tau: sizes(tau)[1] / sizes(tau)[0] - stretch, 1e-14, 100.0, xtol=1e-15)
    side, height, area = sizes(tau)
    h = height / side
    corners = [(-1, -1, h), (-1, 1, h), (-1, 1, -h), (1, 1, -h), (1, 1, h), (1, -1, h), (1, -1, -h), (-1, -1, -h)]
    quarters, root = np.array([1, 1j, -1, -1j]), math.exp(-tau / 2)
    surface = RootSurface(
        degree=1,
        roots=np.concatenate([quarters * root, quarters / root]),
        cuts=np.array([-0.5, 0.5, 0, 0, 0, 0, 0, 0]) * np.pi,  # away from the quarter disk between the first two roots
    )
    outline = great_circles(np.array([0, root, 1, 1j, 1j * root]), 1)
    # a quarter turn around the z axis with a reflection in the plane z = 0
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    chart = _chart(surface, outline, np.eye(3) / side)
    source = "Schwarz (1872), tetragonal relatives of D; area by complete elliptic integrals"
    return replace(
        polygon(corners, name=f"Schwarz prism 1:{stretch:g}", source=source),
        disks=(KnownDisk(area=area / side**2, stable=True, relative_error=1e-14),),
        chart=replace(chart, symmetries=tuple(np.linalg.matrix_power(turn, k) for k in range(4))),
    )


def schwarz_h(a: float = 0.3) -> KnownPatch:
    """A twelfth of the cell of Schwarz's H surface: a straight side and three sides in planes of mirror symmetry.

    φ = (s⁴ − 1, −i(s⁴ + 1), 2s²)((1 − s⁶/a³)(1 − a³s⁶))^{−1/2} over the sector 0 < arg s < π/6 of the unit disk, with
    corners at 0, √a, 1 and e^{iπ/6}. Here a is the size of the triangles relative to the height between them. The flux
    ∫ Im φ ds is orthogonal to a straight side, and parallel to the normal of the plane of a side in a mirror plane, so
    the area is ½ Σ r_j · Im(W_{j+1} − W_j) over the corners, W = ∫ φ ds. Raises OptionError for an a outside [0.2, 1):
    for smaller ones the paths of integration pass the roots.
    """
    if not 0.2 <= a < 1:
        raise OptionError(f"Schwarz's H surface needs a in [0.2, 1), got {a}")
    sixth = np.exp(1j * np.pi * np.arange(6) / 3)
    roots = np.concatenate([math.sqrt(a) * sixth, sixth / math.sqrt(a)])
    # the first root is on the sector's side: its cut leads away from the sector
    surface = RootSurface(degree=2, roots=roots, cuts=np.where(np.arange(12) == 0, -0.5 * np.pi, 0.0))
    corners = np.array([0, math.sqrt(a), 1, np.exp(1j * np.pi / 6)])
    w = surface.complex_position(corners)
    area = 0.5 * float((w.real * (np.roll(w, -1, axis=0) - w).imag).sum())
    edge, arc = math.sqrt(a), np.pi / 6
    return KnownPatch(
        name=f"Schwarz H a={a:g}",
        chart=_chart(surface, great_circles(corners, 2), np.eye(3)),
        sides=(
            lambda t: edge * t + 0j,
            lambda t: edge + (1 - edge) * t + 0j,
            lambda t: np.exp(1j * arc * t),
            lambda t: np.exp(1j * arc) * (1 - t),
        ),
        area=area,
        source="Schwarz (1865); area by elliptic integrals, the fluxes of its four sides",
    )


def great_circles(corners: Complex[np.ndarray, " c"], degree: int) -> Complex[np.ndarray, " m"]:
    """The closed curve in s whose Gauss image follows great circles from corner to corner."""
    g, size = corners**degree, np.abs(corners) ** (2 * degree)
    normals = np.stack([-2 * g.real, -2 * g.imag, size - 1], axis=1) / (size + 1)[:, None]
    fraction = np.arange(_SIDE_POINTS) / _SIDE_POINTS
    sides = []
    for start, end, a, b in zip(normals, np.roll(normals, -1, axis=0), corners, np.roll(corners, -1), strict=True):
        image = _stereographic(geometric_slerp(start, end, fraction))
        size, turn = np.abs(image) ** (1 / degree), np.angle(image) / degree
        # the branch of the root that is between the ends
        straight = np.angle(a + (b - a) * (fraction + 0.5 / _SIDE_POINTS))
        step = 2 * np.pi / degree
        side = size * np.exp(1j * (turn + step * np.round((straight - turn) / step)))
        side[0] = a
        sides.append(side)
    return np.concatenate(sides)


def _chart(
    surface: RootSurface, outline: Complex[np.ndarray, " m"], matrix: ArrayLike, shift: ArrayLike = (0, 0, 0)
) -> Chart:
    by = np.transpose(matrix)
    # counter-clockwise
    area = float(np.imag(np.conj(outline) * np.roll(outline, -1)).sum())
    return Chart(
        position=lambda s: surface.complex_position(s).real @ by + shift,
        tangents=lambda s: null_tangents(surface.null(s)) @ by,
        outline=outline if area > 0 else outline[::-1],
    )


def _continuous_root(g: Complex[np.ndarray, " c"], degree: int) -> Complex[np.ndarray, " c"]:
    """Roots of a sequence of numbers, continuous if the angle between neighbours is less than π."""
    turns = np.angle(g)
    known = np.abs(g) > 1e-9
    turns[known] = np.unwrap(turns[known])
    return np.asarray(np.where(known, np.abs(g), 0) ** (1 / degree) * np.exp(1j * turns / degree))


def _stereographic(normals: Float[np.ndarray, "k 3"]) -> Complex[np.ndarray, " k"]:
    """The Gauss map g of unit normals, 0 at −e₃, for φ = (g² − 1, −i(g² + 1), 2g)."""
    return np.asarray((normals[:, 0] + 1j * normals[:, 1]) / (normals[:, 2] - 1))
