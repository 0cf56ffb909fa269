"""Pointwise formulas of a minimal surface from its spinors p, q, with all sign conventions.

    φ = (p² − q², −i(p² + q²), 2pq),    r_x = Re φ,  r_y = −Im φ,  n = (r_x × r_y)/|r_x × r_y|

So p = 1, q = 0 is the plane r = (x, y, 0) with n = +e₃, and p = 0 gives n = −e₃. Mean curvature is positive where the
surface bends towards n (a sphere with its inner normal).

The functions take arrays of any shape and are differentiable. At a branch point (p = q = 0) quotients are NaN. dp and
dq are the derivatives p′ and q′. They raise a `DtypeError` for arrays that are not complex.

Source: Sun & Chern (2026), minimal surfaces from a pair of holomorphic functions.
"""

from jaxtyping import Complex, Float

from spinor_geom.arrays import Array, namespace, square
from spinor_geom.holomorphic.blocks import require_complex

Values = Complex[Array, "*pts"]


def phi(p: Values, q: Values) -> Complex[Array, "*pts 3"]:
    """The null curve's derivative φ = (p² − q², −i(p² + q²), 2pq), with φ·φ = 0 for any p, q."""
    require_complex(p=p, q=q)
    return null_vector(p * p, q * q, p * q)


def phi_derivative(p: Values, q: Values, dp: Values, dq: Values) -> Complex[Array, "*pts 3"]:
    """φ′ = 2(pp′ − qq′, −i(pp′ + qq′), p′q + pq′)."""
    require_complex(p=p, q=q, dp=dp, dq=dq)
    return 2 * null_vector(p * dp, q * dq, (dp * q + p * dq) / 2)


def null_vector(pp: Values, qq: Values, pq: Values) -> Complex[Array, "*pts 3"]:
    """(pp − qq, −i(pp + qq), 2pq): φ from p², q² and pq, or its integral from theirs."""
    return namespace(pp).stack([pp - qq, -1j * (pp + qq), 2 * pq], axis=-1)


def conformal_factor(p: Values, q: Values) -> Float[Array, "*pts"]:
    """Conformal factor λ = |p|² + |q|²: length in space per length in Ω.

    The first fundamental form is λ²(dx² + dy²). λ = 0 exactly at branch points.

    Source: Sun & Chern (2026), r_x·r_x = r_y·r_y = ½|φ|².
    """
    require_complex(p=p, q=q)
    return square(p) + square(q)


def normal(p: Values, q: Values) -> Float[Array, "*pts 3"]:
    """Unit normal n = (r_x × r_y)/λ² = (−2 Re(p q̄), −2 Im(p q̄), |p|² − |q|²)/λ."""
    require_complex(p=p, q=q)
    pq = p * q.conj()
    n = namespace(p).stack([-2 * pq.real, -2 * pq.imag, square(p) - square(q)], axis=-1)
    return n / conformal_factor(p, q)[..., None]


def gauss_map(p: Values, q: Values) -> Values:
    """Gauss map g = φ₃/(φ₁ − iφ₂) = −p/q = (n₁ + i n₂)/(1 − n₃), the normal projected stereographically from e₃.

    It is meromorphic. At its poles, where q = 0 and n = e₃, it is infinite. With f = −2q² it is the Weierstrass data:
    φ = (f(1 − g²)/2, i f(1 + g²)/2, f g).
    """
    require_complex(p=p, q=q)
    return -p / q


def hopf_differential(p: Values, q: Values, dp: Values, dq: Values) -> Values:
    """Q = φ′·n = 2(p q′ − p′ q), the coefficient of II = Re(Q dz²)."""
    require_complex(p=p, q=q, dp=dp, dq=dq)
    return 2 * (p * dq - dp * q)


def gauss_curvature(p: Values, q: Values, dp: Values, dq: Values) -> Float[Array, "*pts"]:
    """Gauss curvature K = −4|p′q − pq′|²/(|p|² + |q|²)⁴ ≤ 0, in 1/length²."""
    return -square(hopf_differential(p, q, dp, dq)) / conformal_factor(p, q) ** 4


def mean_curvature(tangents: Complex[Array, "*pts 3"], hopf: Values) -> Float[Array, "*pts"]:
    """H = ½ tr(I⁻¹ II) in 1/length, I from tangents T = r_x − i r_y and II = Re(Q dz²).

    It is 0 where T·T = 0, as for T = φ: H = −2 Re(Q·conj(T·T))/(|T|⁴ − |T·T|²).
    """
    length, null = square(tangents).sum(-1), (tangents * tangents).sum(-1)
    return -2 * (hopf * null.conj()).real / (square(length) - square(null))


def second_fundamental_form(p: Values, q: Values, dp: Values, dq: Values) -> Float[Array, "*pts 2 2"]:
    """Second fundamental form ((r_xx·n, r_xy·n), (r_xy·n, r_yy·n)) = ((Re Q, −Im Q), (−Im Q, −Re Q)).

    Q is the Hopf differential. The trace is 0 because the surface is minimal.
    """
    hopf = hopf_differential(p, q, dp, dq)
    rows = [hopf.real, -hopf.imag, -hopf.imag, -hopf.real]
    return namespace(hopf).stack(rows, axis=-1).reshape(*hopf.shape, 2, 2)
