"""Minimal surfaces in exact formulas, as `ArraySurface`s with exact areas."""

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Complex, Float
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.errors import OptionError, require_count, require_positive
from spinor_geom.gallery.chart import SurfaceFunction
from spinor_geom.gallery.known import KnownSurface
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.surface.array_surface import ArraySurface

_NEGLIGIBLE = 1e-19  # relative size of terms of power series that are left out
_SIDE_VERTICES = 32  # vertices on the longer side of a rectangle in Ω


def enneper(radius: float = 0.8) -> KnownSurface:
    """Enneper's surface p = 1, q = z over |z| < R, of area πR²(1 + R² + R⁴/3).

    It is stable for R < 1. At R = 1 the second variation is degenerate. Its boundary crosses itself for R ≥ √3.
    """
    require_positive("radius", radius)
    area = math.pi * radius**2 * (1 + radius**2 + radius**4 / 3)
    source = "Enneper (1864); area by integrating (1 + |z|²)²"
    return replace(polynomial([1], [0, 1], radius=radius), name=f"Enneper R={radius:g}", area=area, source=source)


def plane_disk(radius: float = 1.0) -> KnownSurface:
    """The plane disk |r| < R, with p = 1 and q = 0."""
    disk = polynomial([1], [0], radius=radius)
    return replace(disk, name=f"plane disk R={radius:g}", area=math.pi * radius**2, source="area πR²")


def polynomial(p: ArrayLike, q: ArrayLike, *, radius: float = 1.0) -> KnownSurface:
    """The surface of polynomials p and q, coefficients in ascending powers, over |z| < R with r(0) = 0.

    Its area is π Σ_k R^{2k+2}(|[p²]_k|² + |[q²]_k|² + 2|[pq]_k|²)/(k + 1), because powers are orthogonal on the disk.
    """
    require_positive("radius", radius)
    a, b = np.atleast_1d(np.asarray(p, dtype=np.complex128)), np.atleast_1d(np.asarray(q, dtype=np.complex128))
    p2, q2, pq = poly.polymul(a, a), poly.polymul(b, b), poly.polymul(a, b)
    null = (poly.polysub(p2, q2), -1j * poly.polyadd(p2, q2), 2 * pq)
    integrals = [poly.polyint(c) for c in null]

    def position(z: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        return np.stack([poly.polyval(z, c).real for c in integrals], axis=-1)

    def mass(c: Complex[np.ndarray, " k"]) -> float:
        k = np.arange(1, len(c) + 1)
        return float((np.abs(c) ** 2 * radius ** (2 * k) / k).sum())

    terms = np.zeros((max(len(a), len(b)), 2), dtype=np.complex128)
    terms[: len(a), 0], terms[: len(b), 1] = a, b
    surface = _surface(PowerSeries(terms), PlaneDomain.disk(radius), position)
    return KnownSurface(
        name=f"polynomial of degree {len(terms) - 1}",
        surface=surface,
        position=position,
        area=math.pi * (mass(p2) + mass(q2) + 2 * mass(pq)),
        source="orthogonality of the powers on the disk",
    )


def random_polynomial(seed: int, *, degree: int = 4) -> KnownSurface:
    """The surface of random polynomials p and q of one degree on the unit disk, which is stable.

    p = 1 + Σ a_k z^k with Σ |a_k| = 1/2 has no zero. q has normal coefficients of deviation 1/(k + 1), scaled so that
    |q/p| ≤ 0.8: normals stay in a hemisphere.
    """
    require_count(degree=degree)
    random = np.random.default_rng(seed)
    coefficients = random.normal(size=(2, degree + 1, 2)) @ np.array([1, 1j]) / np.arange(1, degree + 2)
    p, q = coefficients
    p = np.append(1.0, 0.5 * p[1:] / np.abs(p[1:]).sum())
    circle = np.exp(2j * np.pi * np.arange(720) / 720)
    q *= 0.8 / np.abs(poly.polyval(circle, q) / poly.polyval(circle, p)).max()
    known = polynomial(p, q)
    return replace(known, name=f"random polynomials {seed} of degree {degree}")


def henneberg(centre: complex = 2.0, radius: float = 0.6) -> KnownSurface:
    """A disk |z − centre| < R of Henneberg's surface, φ = ½(1 − z⁻⁴)(z² − 1, −i(z² + 1), 2z), outside |z| = 1.

    There it has no branch point (z⁴ = 1), and is stable because its normals stay in a hemisphere. p and q are power
    series in z − centre.
    """
    if not 0 < radius < abs(centre) - 1:
        raise OptionError(f"a disk of Henneberg's surface outside |z| = 1 needs 0 < R < |centre| − 1, got {radius}")
    reach = abs(centre) - 1  # a lower bound of the radius of convergence
    count = max(64, 2 * math.ceil(math.log(_NEGLIGIBLE) / math.log(radius / reach)))
    # coefficients from values on a circle between the disk's and that of the singularities
    circle = math.sqrt(radius * reach)
    z = centre + circle * np.exp(2j * np.pi * np.arange(count) / count)
    q = np.sqrt((1 - z**-4) / 2)
    scale = (radius / circle) ** np.arange(count // 2)
    terms = np.stack([np.fft.fft(f)[: count // 2] / count * scale for f in (z * q, q)], axis=1)
    known = polynomial(terms[:, 0], terms[:, 1])

    def position(w: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        z = centre + np.asarray(w)
        # ∫ z^k (1 − z⁻⁴)/2 for k = 2, 0, 1
        square, one, first = z**3 / 6 + 1 / (2 * z), z / 2 + z**-3 / 6, z**2 / 4 + z**-2 / 4
        return np.stack([square - one, -1j * (square + one), 2 * first], axis=-1).real

    model = PowerSeries(terms, radius=radius)
    return KnownSurface(
        name=f"Henneberg |z − {centre:g}| < {radius:g}",
        surface=_surface(model, PlaneDomain.disk(radius), position),
        position=position,
        area=known.area * radius**2,
        source="Henneberg (1875); area by orthogonality of the powers on the disk",
    )


def associate(angle: float = math.pi / 4, *, reach: float = 1.0, turn: float = math.pi) -> KnownSurface:
    """A member Re e^{iα}(cosh z, −i sinh z, z) of the family of the catenoid (α = 0) and the helicoid (α = π/2).

    It lies over |x| < U, 0 < y < turn, with U the reach. Its area is turn·(U + sinh U cosh U) for every angle α.
    """
    require_positive("reach", reach)
    require_positive("turn", turn)
    name = f"associate of the catenoid, {math.degrees(angle):.0f}°"
    return _catenoid_associate(angle, 1.0, (-reach, reach), turn, name=name, source="Bonnet (1853)")


def catenoid(height: float = 0.5, *, turn: float = 2 * math.pi) -> KnownSurface:
    """The stable catenoid between the unit circles at z = ±h, cut open: the part within an angle `turn` about the axis.

    The neck c solves c·cosh(h/c) = 1. The area is turn·c²(U + sinh U cosh U) with U = h/c. Raises OptionError
    for an h above 0.66274…, for which there is no catenoid.
    """
    # for c = h/x*, x* tanh x* = 1, the stable and the unstable catenoid coincide
    critical = brentq(lambda x: x * math.tanh(x) - 1, 1.0, 2.0, xtol=1e-15)
    highest = 1 / math.sinh(critical)
    if not 0 < height <= highest:
        raise OptionError(f"a catenoid between unit circles at ±h needs 0 < h <= {highest:.6f}, got {height}")
    require_positive("turn", turn)
    reach = brentq(lambda u: height * math.cosh(u) - u, 0.0, critical, xtol=1e-15)
    name = f"catenoid h={height:g}"
    return _catenoid_associate(0.0, height / reach, (-reach, reach), turn, name=name, source="Euler (1744)")


def helicoid(
    radius: float = 1.0, pitch: float = 1.0, *, turn: float = 2 * math.pi, both_sides: bool = False
) -> KnownSurface:
    """The helicoid (ρ cos θ, ρ sin θ, −cθ), 0 < θ < turn, 0 < ρ < R or, with `both_sides`, −R < ρ < R.

    The pitch c is the rise per radian. The area is turn·½(R√(R² + c²) + c² asinh(R/c)), with `both_sides` twice that.
    """
    for name, value in (("radius", radius), ("pitch", pitch), ("turn", turn)):
        require_positive(name, value)
    reach = math.asinh(radius / pitch)
    ends, name = (-reach if both_sides else 0.0, reach), f"helicoid R={radius:g} c={pitch:g}"
    return _catenoid_associate(math.pi / 2, pitch, ends, turn, name=name, source="Meusnier (1776)")


def _catenoid_associate(
    angle: float, scale: float, ends: tuple[float, float], turn: float, *, name: str, source: str
) -> KnownSurface:
    """The associate c·Re e^{iα}(cosh z, −i sinh z, z) of the catenoid over x₀ < x < x₁, 0 < y < turn."""

    def position(z: Complex[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
        null = np.stack([np.cosh(z), -1j * np.sinh(z), z], axis=-1)
        return np.asarray(scale * (np.exp(1j * angle) * null).real)

    # p² = e^z/2 and q² = e^{−z}/2 give φ = (sinh z, −i cosh z, 1)
    factor = math.sqrt(scale / 2) * np.exp(0.5j * angle)
    centre, radius = complex(sum(ends), turn) / 2, math.hypot(ends[1] - ends[0], turn) / 2
    terms = factor * np.stack([_exponential(0.5, centre, radius), _exponential(-0.5, centre, radius)], axis=1)
    model = PowerSeries(terms, center=centre, radius=radius)
    low, high = ((x + math.sinh(x) * math.cosh(x)) / 2 for x in ends)
    surface, area = _surface(model, _rectangle(*ends, turn), position), turn * scale**2 * (high - low)
    return KnownSurface(name=name, surface=surface, position=position, area=area, source=source)


def _exponential(rate: float, centre: complex, radius: float) -> Complex[np.ndarray, " k"]:
    """Coefficients of e^{rate·z} in powers of (z − centre)/radius, to round-off on the disk."""
    step = abs(rate) * radius
    count = 1 + next(k for k in range(int(step), 1000) if step**k < _NEGLIGIBLE * math.factorial(k))
    k = np.arange(1, count)
    return np.asarray(np.exp(rate * centre) * np.append(1.0, np.cumprod(rate * radius / k)))


def _rectangle(x0: float, x1: float, height: float) -> PlaneDomain:
    corners = np.array([x0, x1, x1 + 1j * height, x0 + 1j * height])
    length = np.abs(np.roll(corners, -1) - corners)
    count = np.maximum(np.ceil(_SIDE_VERTICES * length / length.max()), 2).astype(int)
    sides = zip(corners, np.roll(corners, -1), count, strict=True)
    vertices = np.concatenate([np.linspace(start, end, n, endpoint=False) for start, end, n in sides])
    return PlaneDomain.from_boundary(vertices, np.isin(vertices, corners))


def _surface(model: PowerSeries, domain: PlaneDomain, position: SurfaceFunction) -> ArraySurface:
    """The surface of a model, translated to the position of the closed formula."""
    root = domain.triangulation.points[domain.root]
    return ArraySurface(model, domain, position(np.asarray(root)))
