"""An exact minimal surface from two holomorphic functions on a plane domain."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Sequence
from typing import Any, Literal, TypeVar, cast

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.quadrature import RuleName, rule
from spinor_geom.errors import DtypeError, OptionError, PeriodError, require_positive
from spinor_geom.holomorphic.blocks import in_blocks
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.model import HolomorphicModel, IntegrableModel
from spinor_geom.holomorphic.zeros import Zero, find_zeros
from spinor_geom.shown import Shown
from spinor_geom.surface import branch, curvature, formulas, frames, storage
from spinor_geom.surface.interior import ORDER, RimPrimitive, breaks_for, find_anchors, require_finite

PATH_ORDER = 16  # quadrature nodes on each piece of a path in Ω
Points = TypeVar("Points", NDArray[Any], Tensor)  # of Ω, and results of the same kind
Vector = Sequence[float] | NDArray[Any] | Tensor  # three numbers
_CLOSED = 1e-9  # largest period of a surface that closes, as a share of the square root of its area


class SpinorSurface(Shown, torch.nn.Module):
    """The minimal surface r(z) = c + Re ∫ φ dz, φ = (p² − q², −i(p² + q²), 2pq), of two holomorphic functions p, q.

    The integral starts at `root`, where r = c. (p, q) is the output of a model times a constant matrix for rotation,
    scaling and associates. The parameters of the model and c can be trained by any torch optimiser.

    Methods take complex points of any shape (*pts) inside Ω, as an array or as a tensor, and return the same kind.
    Tensors are differentiable by the parameters and by z. x and y are the coordinates of Ω, z = x + iy.

    Attributes:
        model: z ↦ (p, q) before `spinor_map`; see `HolomorphicModel`.
        domain: Ω.
        constant: c, shape (3,), the position of `root`.
        spinor_map: (2, 2) complex; (p, q) = spinor_map · model.value(z).
        quadrature: name of the rule on each straight piece of a path.
        order: number of its nodes ("gauss") or intervals ("trapezoid", "simpson").

    Source: Sun & Chern (2026); the sign conventions are those of `formulas`.
    """

    constant: Tensor
    spinor_map: Tensor

    def __repr__(self) -> str:
        return f"SpinorSurface({type(self.model).__name__} over {self.domain!r})"

    def __init__(
        self,
        model: torch.nn.Module,
        domain: PlaneDomain,
        constant: Vector = (0.0, 0.0, 0.0),
        *,
        spinor_map: Complex[Tensor, "2 2"] | None = None,
        quadrature: RuleName = "gauss",
        order: int = PATH_ORDER,
    ) -> None:
        """Raises OptionError for an unknown rule, an unsupported order, or a constant not of shape (3,)."""
        super().__init__()
        rule(quadrature, order)
        position = torch.as_tensor(constant, dtype=torch.float64).detach().clone()
        if position.shape != (3,):
            raise OptionError(f"constant must be one point, shape (3,), got shape {tuple(position.shape)}")
        self.model = model
        self.domain = domain
        self.constant = torch.nn.Parameter(position)
        identity = torch.eye(2, dtype=torch.complex128, device=position.device)
        self.register_buffer("spinor_map", identity if spinor_map is None else spinor_map.detach().clone())
        self.quadrature: RuleName = quadrature
        self.order = order

    @property
    def root(self) -> complex:
        """The point of Ω where r = constant, a vertex of the triangulation near the middle."""
        return complex(self.domain.triangulation.points[self.domain.root])

    @property
    def has_closed_positions(self) -> bool:
        """Whether positions need no quadrature: the model has closed integrals, and the rule is the default."""
        return self.quadrature == "gauss" and isinstance(self.model, IntegrableModel)

    def spinors(self, z: Points) -> Points:
        """(p, q), shape (*pts, 2)."""
        return self._evaluate(self._spinors, z)

    def spinor_derivatives(self, z: Points) -> Points:
        """(p′, q′), shape (*pts, 2)."""
        return self._evaluate(self._spinor_derivatives, z)

    def weierstrass_data(self, z: Points) -> tuple[Points, Points]:
        """Weierstrass data f = φ₁ − iφ₂ = −2q² and g = −p/q (infinite where q = 0), (*pts) each."""
        data = self._evaluate(lambda w: torch.stack(formulas.weierstrass_data(*self._pair(w)), dim=-1), z)
        return data[..., 0], data[..., 1]

    def gauss_map(self, z: Points) -> Points:
        """The normal projected stereographically from +e₃, g = (n₁ + i n₂)/(1 − n₃) = −p/q, shape (*pts)."""
        return self._evaluate(lambda w: formulas.gauss_map(*self._pair(w)), z)

    def position(self, z: Points) -> Points:
        """Positions r(z), shape (*pts, 3).

        The integral is in closed form if the model has one and the rule is "gauss"; else by quadrature along edges of
        the triangulation to a vertex near z, and along the segment to z. Raises DomainError for NaN or infinite z.
        """
        if not isinstance(z, Tensor):
            z = _complex(z)
            require_finite(z)
        return self._evaluate(self._position, z)

    def positions_inside(self, z: Complex[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """`position` of many points not on ∂Ω, by few evaluations of p and q.

        Without holes and without a closed form it uses Cauchy's formula on ∂Ω, to 1e-10 of the surface's size.
        """
        if self.has_closed_positions or self.domain.holes or len(z) == 0:
            return np.asarray(self.position(z))
        is_inner = self.domain.root >= self.domain.triangulation.boundary_size
        boundary, ends = self.domain.boundary, np.append(z, self.root) if is_inner else z
        moved = RimPrimitive.along(boundary, self._null_curve, ORDER, breaks_for(boundary, ends)).inside(ends).real
        constant = self.constant.detach().cpu().numpy() - moved[-1] if is_inner else self.position(z[0]) - moved[0]
        return np.asarray(moved[: len(z)] + constant)

    def integrate(self, start: Points, end: Points) -> Points:
        """Displacements r(end) − r(start) by quadrature along segments in Ω, shape (*pts, 3)."""
        return self._evaluate(self._integrate, start, end)

    def normal(self, z: Points) -> Points:
        """Unit normals n = (r_x × r_y)/λ², shape (*pts, 3); NaN at branch points."""
        return self._evaluate(lambda w: formulas.normal(*self._pair(w)), z)

    def conformal_factor(self, z: Points) -> Points:
        """λ = |p|² + |q|²: length in space per length in Ω, shape (*pts)."""
        return self._evaluate(lambda w: formulas.conformal_factor(*self._pair(w)), z)

    def first_fundamental_form(self, z: Points) -> Points:
        """λ²·identity in the coordinates x, y, shape (*pts, 2, 2)."""
        return self._evaluate(lambda w: formulas.first_fundamental_form(*self._pair(w)), z)

    def second_fundamental_form(self, z: Points) -> Points:
        """Normal parts of r_xx, r_xy and r_yy from p, q, p′, q′, shape (*pts, 2, 2)."""
        return self._evaluate(
            lambda w: formulas.second_fundamental_form(*self._pair(w), *self._spinor_derivatives(w).unbind(-1)), z
        )

    def gauss_curvature(self, z: Points) -> Points:
        """K = −4|p′q − pq′|²/λ⁴ in 1/length², shape (*pts); NaN at branch points."""
        return self._evaluate(
            lambda w: formulas.gauss_curvature(*self._pair(w), *self._spinor_derivatives(w).unbind(-1)), z
        )

    def mean_curvature(self, z: Points) -> Points:
        """H in 1/length, shape (*pts), measured by automatic differentiation of the position.

        It is 0 up to errors of quadrature and rounding if the model is holomorphic. Positive where the surface bends
        towards n; NaN at branch points.
        """
        return self._evaluate(self._mean_curvature, z)

    def area(self) -> float:
        """Area of the whole surface by an integral over ∂Ω alone, A = ½ ∮ (r − c) · Im(φ dz)."""
        rims = self.rim_primitives(self.order)
        area = sum(rim.area for rim in rims)
        if self.domain.holes:
            # `rim.area` has r = 0 at the start of the rim, and ∮ Im(φ dz) of a rim need not vanish
            start = self.position(np.array([b.point(np.zeros(())) for b in self.domain.boundaries]))
            area += 0.5 * float(((start - start[0]) * [rim.at_breaks[-1].imag for rim in rims]).sum())
        return area

    def rim_primitives(self, order: int) -> tuple[RimPrimitive, ...]:
        """∫ φ dz along every boundary of Ω, by panels of `order` nodes."""
        return tuple(RimPrimitive.along(boundary, self._null_curve, order) for boundary in self.domain.boundaries)

    def periods(self) -> Complex[np.ndarray, "holes 3"]:
        """Periods ∮ φ dz along the boundary of each hole of Ω, clockwise.

        The real part is the gap of the surface around the hole, 0 to rounding for a surface that closes. The imaginary
        part is the flux, up to its sign the force of surface tension across a curve around the hole.
        """
        rims = [RimPrimitive.along(boundary, self._null_curve, self.order) for boundary in self.domain.holes]
        return np.array([rim.at_breaks[-1] for rim in rims], dtype=np.complex128).reshape(-1, 3)

    def largest_period(self) -> float:
        """The largest |Re ∮ φ dz| around a hole, 0 without holes."""
        return float(np.linalg.norm(self.periods().real, axis=1).max(initial=0.0))

    def branch_points(self) -> tuple[branch.BranchPoint, ...]:
        """Common zeros of p and q in Ω, where the surface is not an immersion.

        Raises the errors of `find_zeros`: ZeroOnContourError and UnplacedZerosError.
        """
        return branch.branch_points(self._on_cpu(self._single_valued), self._on_cpu(self._phi), self.domain)

    def spinor_zeros(self) -> tuple[tuple[Zero, ...], tuple[Zero, ...]]:
        """The zeros in Ω of p, where n = −e₃, and of q, where n = e₃ and the Gauss map has poles.

        Raises the errors of `find_zeros`; ZeroOnContourError also if p or q vanishes identically.
        """
        p, q = (lambda z: self._single_valued(z)[:, 0]), (lambda z: self._single_valued(z)[:, 1])
        return find_zeros(self._on_cpu(p), self.domain), find_zeros(self._on_cpu(q), self.domain)

    def _single_valued(self, z: Complex[Tensor, " n"]) -> Complex[Tensor, "n 2"]:
        """(p, q) times the model's factor that changes sign around holes, which has no zeros in Ω."""
        values = self._spinors(z)
        if isinstance(self.model, (CauchyNetwork, LaurentSeries)):
            values = values * self.model.sign_changing(z)[:, None]
        return values

    def loop_invariant(self, z: Complex[np.ndarray, " n"]) -> Literal[0, 1]:
        """The ℤ₂ invariant of a closed curve in Ω: 1 where the surface's frame along it lifts to SU(2), else 0.

        It is 0 for simple curves, since branch points of spinors are removable. The samples are in order, without the
        first at the end. Raises OptionError if the frames of neighbours differ by 90° or more.
        """
        closed = torch.from_numpy(np.array(z, dtype=np.complex128))
        return frames.loop_invariant(self._on_cpu(self._phi)(closed), closed.roll(-1) - closed.roll(1))

    def associate(self, angle: float) -> SpinorSurface:
        """The associate surface with e^{i·angle}φ, the angle in radians, on a copy of the model.

        It is isometric to this one and has the same normals and position of `root`; the angle π/2 gives the conjugate
        surface (a helicoid for the catenoid). Raises PeriodError if it does not close around a hole of Ω, because the
        flux is not 0; see `periods`.
        """
        if self.domain.holes:
            moved = (np.exp(1j * angle) * self.periods()).real
            worst = int(np.linalg.norm(moved, axis=1).argmax())
            if np.linalg.norm(moved[worst]) > _CLOSED * self.area() ** 0.5:
                raise PeriodError(angle=angle, around=f"hole {worst} of the domain", period=moved[worst].tolist())
        half = torch.polar(torch.ones((), dtype=torch.float64), torch.tensor(angle / 2, dtype=torch.float64))
        return self._over(copy.deepcopy(self.model), half.to(self.spinor_map.device) * self.spinor_map, self.constant)

    def transform(
        self, rotation: ArrayLike | Tensor | None = None, scale: float = 1.0, translation: Vector = (0.0, 0.0, 0.0)
    ) -> SpinorSurface:
        """The surface scale·R·r + translation, on a copy of the model.

        Args:
            rotation: R, a (3, 3) rotation matrix; None for the identity.
            scale: a positive factor.
            translation: (3,), in the units of the result.

        Raises:
            OptionError: the matrix is not a rotation, the scale not positive, or the translation not three numbers.
        """
        require_positive("scale", scale)
        matrix = _real("rotation", np.eye(3) if rotation is None else rotation, 3, 3).to(self.constant.device)
        shift = _real("translation", translation, 3).to(self.constant.device)
        # without a rotation p and q are scaled without rounding errors of a matrix product
        turned = self.spinor_map if rotation is None else frames.su2_from_rotation(matrix) @ self.spinor_map
        return self._over(copy.deepcopy(self.model), scale**0.5 * turned, scale * (matrix @ self.constant) + shift)

    def placed(self, scale: float, translation: Vector) -> SpinorSurface:
        """`transform` without a rotation and without a copy of the model, which both surfaces share."""
        shift = torch.as_tensor(translation, dtype=torch.float64, device=self.constant.device)
        return self._over(self.model, scale**0.5 * self.spinor_map, scale * self.constant + shift)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the surface and its domain to a .safetensors file with a JSON description; overwrites the file.

        Raises StorageError for another suffix, a path that cannot be written, or a kind of model that cannot be loaded
        again.
        """
        storage.write(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> SpinorSurface:
        """The surface that `save` wrote, bit for bit. Raises StorageError if the file holds none of this version."""
        return cls(**storage.read(path))

    def _evaluate(self, function: Callable[..., Tensor], *points: Points) -> Points:
        first = points[0]
        if isinstance(first, Tensor):
            if not all(z.is_complex() for z in points):
                raise DtypeError(f"points of Ω must be complex, got {first.dtype}; use torch.complex(x, y)")
            return function(*(z.to(torch.complex128) for z in points))
        device = self.spinor_map.device
        with torch.no_grad():
            arrays = (torch.from_numpy(_complex(z)).to(device) for z in points)
            return function(*arrays).cpu().resolve_conj().numpy()

    def _on_cpu(self, function: Callable[[Tensor], Tensor]) -> Callable[[Tensor], Tensor]:
        """The function, without gradients, from points on the CPU to values there."""
        return lambda z: function(z.to(self.spinor_map.device)).detach().cpu()

    def _spinors(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        return cast(HolomorphicModel, self.model).value(z) @ self.spinor_map.mT

    def _spinor_derivatives(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 2"]:
        return cast(HolomorphicModel, self.model).derivative(z) @ self.spinor_map.mT

    def _pair(self, z: Complex[Tensor, "*pts"]) -> tuple[Complex[Tensor, "*pts"], Complex[Tensor, "*pts"]]:
        p, q = self._spinors(z).unbind(-1)
        return p, q

    def _phi(self, z: Complex[Tensor, "*pts"]) -> Complex[Tensor, "*pts 3"]:
        return formulas.phi(*self._pair(z))

    def _null_curve(self, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n 3"]:
        """φ of an array."""
        return self._evaluate(self._phi, z)

    def _position(self, z: Complex[Tensor, "*pts"]) -> Float[Tensor, "*pts 3"]:
        if self.has_closed_positions:
            integral = self._null_integral(torch.cat([z.reshape(-1), z.new_full((1,), self.root)])).real
            return self.constant + (integral[:-1] - integral[-1:]).reshape(*z.shape, 3)
        end = z.reshape(-1)
        index, start = self._anchors(end)
        moved = (start != end).nonzero()[:, 0]  # a vertex is its own anchor
        displacement = self._integrate(start[moved], end[moved])
        return self._anchor_positions(index)[index].index_add(0, moved, displacement).reshape(*z.shape, 3)

    def _anchors(self, z: Complex[Tensor, " n"]) -> tuple[Int[np.ndarray, " n"], Complex[Tensor, " n"]]:
        """Vertices of the triangulation connected to points by segments in Ω: indices and positions in Ω."""
        index = find_anchors(z.detach().cpu().resolve_conj().numpy(), self.domain)
        return index, torch.tensor(self.domain.triangulation.points[index]).to(z.device)

    def _null_integral(self, z: Complex[Tensor, " n"]) -> Complex[Tensor, "n 3"]:
        """∫ φ dζ from a fixed point to z, in closed form."""
        pp, qq, pq = cast(IntegrableModel, self.model).primitive(z).unbind(-1)
        (a, b), (c, d) = self.spinor_map
        return formulas.null_vector(
            a * a * pp + b * b * qq + 2 * a * b * pq,
            c * c * pp + d * d * qq + 2 * c * d * pq,
            a * c * pp + b * d * qq + (a * d + b * c) * pq,
        )

    def _anchor_positions(self, wanted: Int[np.ndarray, " k"]) -> Float[Tensor, "n 3"]:
        """Positions of the wanted vertices, by sums along the tree of paths; the others are arbitrary."""
        device = self.spinor_map.device
        visited = torch.from_numpy(self.domain.visited(wanted)).to(device)
        vertices = torch.tensor(self.domain.triangulation.points).to(device)
        before = torch.tensor(self.domain.parents, device=device)
        steps = self._integrate(vertices[before[visited]], vertices[visited])
        total = steps.new_zeros(len(vertices), 3).index_copy(0, visited, steps)
        # each pass doubles the number of edges summed; the root is its own parent and adds 0
        while (before != self.domain.root).any():
            total, before = total + total[before], before[before]
        return self.constant + total

    def _integrate(self, start: Complex[Tensor, "*pts"], end: Complex[Tensor, "*pts"]) -> Float[Tensor, "*pts 3"]:
        chosen = rule(self.quadrature, self.order)
        nodes = torch.tensor(chosen.nodes).to(start.device)
        weights = torch.tensor(chosen.weights).to(start.device)

        def segments(a: Complex[Tensor, " n"], b: Complex[Tensor, " n"]) -> Float[Tensor, "n 3"]:
            step = b - a
            phi = self._phi(a[:, None] + nodes * step[:, None])
            return ((phi * weights[:, None]).sum(dim=-2) * step[:, None]).real

        return in_blocks(segments, start, end, width=len(nodes))

    def _mean_curvature(self, z: Complex[Tensor, "*pts"]) -> Float[Tensor, "*pts"]:
        end = z.reshape(-1)
        _, start = self._anchors(end)
        mean = curvature.mean_curvature_of_integrals(self._integrate, start, end, order=self.order)
        return mean.reshape(z.shape)

    def _over(
        self, model: torch.nn.Module, spinor_map: Complex[Tensor, "2 2"], constant: Float[Tensor, "3"]
    ) -> SpinorSurface:
        return SpinorSurface(
            model, self.domain, constant, spinor_map=spinor_map, quadrature=self.quadrature, order=self.order
        )


def _real(name: str, value: Any, *shape: int) -> Float[Tensor, "..."]:
    """A tensor of finite numbers of a given shape, or an OptionError."""
    try:
        tensor = torch.as_tensor(value, dtype=torch.float64)
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name} must be numbers of shape {shape}: {error}") from None
    if tensor.shape != shape or not tensor.isfinite().all():
        raise OptionError(f"{name} must be finite numbers of shape {shape}, got {value!s:.60}")
    return tensor


def _complex(z: Any) -> np.ndarray:
    """A complex copy of points, or a DtypeError."""
    try:
        return np.array(z, dtype=np.complex128)
    except (TypeError, ValueError):
        raise DtypeError(f"points of Ω must be complex numbers, got {type(z).__name__} {z!r:.60}") from None
