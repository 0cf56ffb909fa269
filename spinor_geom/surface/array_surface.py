"""An exact minimal surface from two holomorphic functions on a plane domain, on arrays."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np
from jaxtyping import Complex, Float, Int
from numpy.typing import ArrayLike, NDArray

from spinor_geom.arrays import Array, Place, cis, indices, is_numpy, namespace, place_of, to_numpy, zeros
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.quadrature import RuleName, rule
from spinor_geom.errors import DtypeError, OptionError, PeriodError, require_positive
from spinor_geom.holomorphic.array_model import ArrayModel
from spinor_geom.holomorphic.blocks import in_blocks
from spinor_geom.holomorphic.model import HolomorphicModel, IntegrableModel, conjugated
from spinor_geom.holomorphic.zeros import Zero, find_zeros
from spinor_geom.mesh.loop_frame import LoopFrame
from spinor_geom.shown import Shown
from spinor_geom.surface import branch, formulas, frames, storage
from spinor_geom.surface.interior import ORDER, RimPrimitive, breaks_for, find_anchors, require_finite

if TYPE_CHECKING:
    import torch

PATH_ORDER = 16  # quadrature nodes on each piece of a path in Ω
Points = TypeVar("Points", NDArray[Any], "torch.Tensor")  # of Ω, and results of the same kind
Vector = Sequence[float] | NDArray[Any] | Array  # three numbers
S = TypeVar("S", bound="ArraySurface")
_CLOSED = 1e-9  # largest period of a surface that closes, as a share of the square root of its area


class ArraySurface(Shown):
    """The minimal surface r(z) = c + Re ∫ φ dz, φ = (p² − q², −i(p² + q²), 2pq), of two holomorphic functions p, q.

    The integral starts at `root`, where r = c. (p, q) is the output of a model times a constant matrix for rotation,
    scaling and associates. Arrays are numpy's, or tensors if the model and c are. `SpinorSurface` is the same surface
    as a torch module.

    Methods take complex points of any shape (*pts) inside Ω, as an array or as a tensor, and return the same kind.
    x and y are the coordinates of Ω, z = x + iy.

    Attributes:
        model: z ↦ (p, q) before `spinor_map`, a `HolomorphicModel`.
        domain: Ω.
        constant: c, shape (3,), the position of `root`.
        spinor_map: (2, 2) complex, with (p, q) = spinor_map · model.value(z).
        quadrature: name of the rule on each straight piece of a path.
        order: number of its nodes ("gauss") or intervals ("trapezoid", "simpson").
        rim: ∫ φ dz along ∂Ω, for `positions_inside`, where it is known already and Ω has no holes.

    Source: Sun & Chern (2026); the sign conventions are those of `formulas`.
    """

    model: Any
    constant: Float[Array, "3"]
    spinor_map: Complex[Array, "2 2"]
    rim: RimPrimitive | None = None

    def __repr__(self) -> str:
        model = getattr(self.model, "tracked", self.model)
        return f"{type(self).__name__}({type(model).__name__} over {self.domain!r})"

    def __init__(
        self,
        model: HolomorphicModel,
        domain: PlaneDomain,
        constant: Vector = (0.0, 0.0, 0.0),
        *,
        spinor_map: Complex[Array, "2 2"] | None = None,
        quadrature: RuleName = "gauss",
        order: int = PATH_ORDER,
    ) -> None:
        """Raises OptionError for an unknown rule, an unsupported order, or a constant not of shape (3,)."""
        rule(quadrature, order)
        self.domain, self.quadrature, self.order = domain, quadrature, order
        position, matrix = np.array(to_numpy(constant), dtype=np.float64), np.eye(2, dtype=np.complex128)
        if position.shape != (3,):
            raise OptionError(f"constant must be one point, shape (3,), got shape {tuple(position.shape)}")
        place = _place_of_model(model)
        self._set(model, place.put(position), place.put(matrix if spinor_map is None else spinor_map))

    def _set(self, model: Any, constant: Float[Array, "3"], spinor_map: Complex[Array, "2 2"]) -> None:
        self.model, self.constant, self.spinor_map = model, constant, spinor_map

    @property
    def root(self) -> complex:
        """The point of Ω where r = constant, a vertex of the triangulation near the middle."""
        return complex(self.domain.triangulation.points[self.domain.root])

    @property
    def has_closed_positions(self) -> bool:
        """Whether positions need no quadrature: the model has closed integrals, and the rule is the default."""
        return self.quadrature == "gauss" and hasattr(self.model, "primitive")

    def spinors(self, z: Points) -> Points:
        """(p, q), shape (*pts, 2)."""
        return self._evaluate(_spinors, z)

    def spinor_derivatives(self, z: Points) -> Points:
        """(p′, q′), shape (*pts, 2)."""
        return self._evaluate(_spinor_derivatives, z)

    def gauss_map(self, z: Points) -> Points:
        """The normal projected stereographically from +e₃, g = (n₁ + i n₂)/(1 − n₃) = −p/q, shape (*pts)."""
        return self._evaluate(lambda on, w: formulas.gauss_map(*_pair(on, w)), z)

    def position(self, z: Points) -> Points:
        """Positions r(z), shape (*pts, 3).

        The integral is in closed form if the model has one and the rule is "gauss", else by quadrature along edges of
        the triangulation to a vertex near z, and along the segment to z. Raises DomainError for NaN or infinite z.
        """
        if not _is_tensor(z):
            require_finite(_complex(z))
        return self._evaluate(_position, z)

    def positions_inside(self, z: Complex[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 3"], bool]:
        """`position` of many points not on ∂Ω by few evaluations of p and q, and whether they are accurate.

        Without holes and without a closed form it uses Cauchy's formula on ∂Ω, to 1e-10 of the surface's size. Near ∂Ω
        positions are less accurate if the time limit leaves too little time.
        """
        if self.has_closed_positions or self.domain.holes or len(z) == 0:
            return np.asarray(self.position(z)), True
        is_inner = self.domain.root >= self.domain.triangulation.boundary_size
        boundary, ends, rim = self.domain.boundary, np.append(z, self.root) if is_inner else z, self.rim
        is_accurate = True
        if rim is None or not rim.resolves(boundary, ends):
            breaks, is_accurate = breaks_for(boundary, ends)
            rim = RimPrimitive.along(boundary, self.null_curve, ORDER, breaks)
        moved = rim.inside(ends).real
        constant = to_numpy(self.constant) - moved[-1] if is_inner else self.position(z[0]) - moved[0]
        return np.asarray(moved[: len(z)] + constant), is_accurate

    def integrate(self, start: Points, end: Points) -> Points:
        """Displacements r(end) − r(start) by quadrature along segments in Ω, shape (*pts, 3)."""
        return self._evaluate(integrate, start, end)

    def null_curve(self, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n 3"]:
        """φ of an array."""
        return self._evaluate(_phi, z)

    def normal(self, z: Points) -> Points:
        """Unit normals n = (r_x × r_y)/λ², shape (*pts, 3), NaN at branch points."""
        return self._evaluate(lambda on, w: formulas.normal(*_pair(on, w)), z)

    def conformal_factor(self, z: Points) -> Points:
        """λ = |p|² + |q|²: length in space per length in Ω, shape (*pts). The first form is λ²(dx² + dy²)."""
        return self._evaluate(lambda on, w: formulas.conformal_factor(*_pair(on, w)), z)

    def second_fundamental_form(self, z: Points) -> Points:
        """Normal parts of r_xx, r_xy and r_yy from p, q, p′, q′, shape (*pts, 2, 2)."""
        return self._evaluate(lambda on, w: formulas.second_fundamental_form(*_pair(on, w), *_slopes(on, w)), z)

    def gauss_curvature(self, z: Points) -> Points:
        """K = −4|p′q − pq′|²/λ⁴ in 1/length², shape (*pts), NaN at branch points."""
        return self._evaluate(lambda on, w: formulas.gauss_curvature(*_pair(on, w), *_slopes(on, w)), z)

    def mean_curvature(self, z: Points) -> Points:
        """H in 1/length, shape (*pts), of the positions that `integrate` gives along segments to the points.

        It is 0 up to errors of quadrature and rounding if the model's derivative is that of its values. Positive where
        the surface bends towards n, NaN at branch points.
        """
        return self._evaluate(_mean_curvature, z)

    def area(self) -> float:
        """Area of the whole surface by an integral over ∂Ω alone, A = ½ ∮ (r − c) · Im(φ dz)."""
        rims = self.rim_primitives(self.order)
        area = sum(rim.area for rim in rims)
        if self.domain.holes:
            # `rim.area` has r = 0 at the start of the rim, and ∮ Im(φ dz) of a rim need not vanish
            start = np.concatenate([self._start_of(rim) for rim in rims])
            area += 0.5 * float(((start - start[0]) * [rim.at_breaks[-1].imag for rim in rims]).sum())
        return area

    def _start_of(self, rim: RimPrimitive) -> Float[np.ndarray, "1 3"]:
        """The position at the start of a rim, from that on its longest panel: the start may be a corner near poles."""
        order = rim.panels.order
        middle = int(np.diff(rim.panels.breaks).argmax()) * order + order // 2
        return np.asarray(self.position(rim.panels.z[[middle]]) - rim.primitive[[middle]].real)

    def rim_primitives(self, order: int) -> tuple[RimPrimitive, ...]:
        """∫ φ dz along every boundary of Ω, the outer one first, by panels of `order` nodes."""
        return tuple(RimPrimitive.along(boundary, self.null_curve, order) for boundary in self.domain.boundaries)

    def periods(self) -> Complex[np.ndarray, "holes 3"]:
        """Periods ∮ φ dz along the boundary of each hole of Ω, clockwise.

        The real part is the change of r along a curve around the hole: 0 up to rounding if the surface closes. The
        imaginary part is the flux: up to its sign the force of surface tension across a curve around the hole.
        """
        around = [rim.at_breaks[-1] for rim in self.rim_primitives(self.order)[1:]] if self.domain.holes else []
        return np.array(around, dtype=np.complex128).reshape(-1, 3)

    def largest_period(self) -> float:
        """The largest |Re ∮ φ dz| around a hole, 0 without holes."""
        return float(np.linalg.norm(self.periods().real, axis=1).max(initial=0.0))

    def branch_points(self) -> tuple[branch.BranchPoint, ...]:
        """Common zeros of p and q in Ω, where the surface is not an immersion. Raises as `find_zeros`."""
        return branch.branch_points(self._single_valued, self.null_curve, self.domain)

    def spinor_zeros(self) -> tuple[tuple[Zero, ...], tuple[Zero, ...]]:
        """The zeros in Ω of p, where n = −e₃, and of q, where n = e₃ and the Gauss map has poles.

        Raises the errors of `find_zeros`, and ZeroOnContourError if p or q vanishes identically.
        """
        p, q = (lambda z: self._single_valued(z)[:, 0]), (lambda z: self._single_valued(z)[:, 1])
        return find_zeros(p, self.domain), find_zeros(q, self.domain)

    def _single_valued(self, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n 2"]:
        """(p, q) times the model's factor that changes sign around holes, which has no zeros in Ω."""
        values = self.spinors(z)
        if hasattr(self.model, "sign_changing"):
            values = values * self._evaluate(lambda on, w: on.model.sign_changing(w), z)[:, None]
        return values

    def associate(self: S, angle: float) -> S:
        """The associate surface with e^{i·angle}φ, the angle in radians, on a copy of the model.

        It is isometric to this one and has the same normals and position of `root`. The angle π/2 gives the conjugate
        surface (a helicoid for the catenoid). Raises PeriodError if it does not close around a hole of Ω, because the
        flux is not 0: see `periods`.
        """
        if self.domain.holes:
            moved = (np.exp(1j * angle) * self.periods()).real
            worst = int(np.linalg.norm(moved, axis=1).argmax())
            if np.linalg.norm(moved[worst]) > _CLOSED * self.area() ** 0.5:
                raise PeriodError(angle=angle, around=f"hole {worst} of the domain", period=moved[worst].tolist())
        half = complex(cis(np.array(angle / 2))) * self.spinor_map
        return self._over(copy.deepcopy(self.model), half, self.constant)

    def transform(
        self: S, rotation: ArrayLike | Array | None = None, scale: float = 1.0, translation: Vector = (0.0, 0.0, 0.0)
    ) -> S:
        """The surface scale·R·r + translation, on a copy of the model.

        Args:
            rotation: R, a (3, 3) rotation matrix, or None for the identity.
            scale: a positive factor.
            translation: (3,), in the units of the result.

        Raises:
            OptionError: the matrix is not a rotation, the scale not positive, or the translation not three numbers.
        """
        require_positive("scale", scale)
        place = place_of(self.constant)
        matrix = place.put(_real("rotation", np.eye(3) if rotation is None else rotation, 3, 3))
        shift = place.put(_real("translation", translation, 3))
        # without a rotation p and q are scaled without rounding errors of a matrix product
        turned = self.spinor_map if rotation is None else frames.su2_from_rotation(matrix) @ self.spinor_map
        return self._over(copy.deepcopy(self.model), scale**0.5 * turned, scale * (matrix @ self.constant) + shift)

    def placed(self: S, scale: float, translation: Vector) -> S:
        """`transform` without a rotation and without a copy of the model, which both surfaces share."""
        shift = place_of(self.constant).put(np.asarray(translation, dtype=np.float64))
        other = self._over(self.model, scale**0.5 * self.spinor_map, scale * self.constant + shift)
        other.rim = self.rim and self.rim.scaled(scale)
        return other

    def placed_by(self: S, frame: LoopFrame) -> S:
        """The surface in the coordinates outside a frame, r(z̄) over the mirror image of Ω if the frame is backward."""
        model, domain, turned = self.model, self.domain, self.spinor_map
        place = place_of(self.constant)
        if frame.is_backward:
            # φ of r(z̄) is conj(φ(z̄)), that of (i conj q, −i conj p)
            model, domain = conjugated(model), domain.mirrored
            turned = place.put(np.array([[0, 1j], [-1j, 0]])) @ turned.conj()
        sign = complex(np.sign(np.linalg.det(frame.axes)))
        rotation = place.put(sign.real * frame.axes.T)
        turned = sign**0.5 * (frames.su2_from_rotation(rotation) @ turned)
        constant = place.put(frame.outside(to_numpy(self.constant)[None])[0])
        return type(self)(model, domain, constant, spinor_map=frame.size**0.5 * turned, **self._rule)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the surface and its domain to a .safetensors file with a JSON description, and overwrites the file.

        Raises StorageError for another suffix, a path that cannot be written, or a kind of model that cannot be loaded
        again.
        """
        storage.write(self, path)

    @classmethod
    def load(cls: type[S], path: str | os.PathLike[str]) -> S:
        """Reads a surface that `save` wrote, bit for bit. Raises StorageError for other files and other versions."""
        return cls(**storage.read(path))

    def _evaluate(self, function: Callable[..., Array], *points: Points) -> Points:
        """Evaluates a function of this surface and points. Arrays give an array, tensors a tensor."""
        with np.errstate(all="ignore"):  # quotients are NaN or infinite at branch points and poles
            if _is_tensor(points[0]):
                require_complex_points(points)
                place = place_of(points[0])
                value: Points = function(self if place_of(self.constant) == place else self.at(place), *points)
                return value
            found: Any = to_numpy(function(self, *(place_of(self.constant).put(_complex(z)) for z in points)))
            return cast(Points, found)

    def at(self, place: Place) -> ArraySurface:
        """The surface with its arrays converted to a `Place`."""
        return ArraySurface(self.model.at(place), self.domain, self.constant, spinor_map=self.spinor_map, **self._rule)

    @property
    def _rule(self) -> dict[str, Any]:
        return {"quadrature": self.quadrature, "order": self.order}

    def _over(self: S, model: Any, spinor_map: Complex[Array, "2 2"], constant: Float[Array, "3"]) -> S:
        return type(self)(model, self.domain, constant, spinor_map=spinor_map, **self._rule)


def _spinors(on: ArraySurface, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
    return on.model.value(z) @ on.spinor_map.mT


def _spinor_derivatives(on: ArraySurface, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 2"]:
    return on.model.derivative(z) @ on.spinor_map.mT


def _pair(on: ArraySurface, z: Complex[Array, "*pts"]) -> tuple[Complex[Array, "*pts"], Complex[Array, "*pts"]]:
    values = _spinors(on, z)
    return values[..., 0], values[..., 1]


def _slopes(on: ArraySurface, z: Complex[Array, "*pts"]) -> tuple[Complex[Array, "*pts"], Complex[Array, "*pts"]]:
    values = _spinor_derivatives(on, z)
    return values[..., 0], values[..., 1]


def _phi(on: ArraySurface, z: Complex[Array, "*pts"]) -> Complex[Array, "*pts 3"]:
    return formulas.phi(*_pair(on, z))


def _position(on: ArraySurface, z: Complex[Array, "*pts"]) -> Float[Array, "*pts 3"]:
    xp, end = namespace(z), z.reshape(-1)
    if on.has_closed_positions:
        integral = _null_integral(on, xp.concat([end, xp.full_like(end[:1], on.root) if len(end) else end])).real
        return on.constant + (integral[: len(end)] - integral[-1:]).reshape(*z.shape, 3)
    index, start = anchors(on, end)
    moved = indices(start != end)  # a vertex is its own anchor
    places = _anchor_positions(on, index)[place_of(z).put(index)]
    displacement = zeros((len(end), 3), places)
    displacement[moved] = integrate(on, start[moved], end[moved])
    return (places + displacement).reshape(*z.shape, 3)


def anchors(on: ArraySurface, z: Complex[Array, " n"]) -> tuple[Int[np.ndarray, " n"], Complex[Array, " n"]]:
    """Vertices of the triangulation connected to points by segments in Ω: indices and positions in Ω."""
    index = find_anchors(to_numpy(z), on.domain)
    return index, place_of(z).put(on.domain.triangulation.points[index])


def _null_integral(on: ArraySurface, z: Complex[Array, " n"]) -> Complex[Array, "n 3"]:
    """∫ φ dζ from a fixed point to z, in closed form."""
    integrals = cast(IntegrableModel, on.model).primitive(z)
    pp, qq, pq = integrals[..., 0], integrals[..., 1], integrals[..., 2]
    (a, b), (c, d) = on.spinor_map
    return formulas.null_vector(
        a * a * pp + b * b * qq + 2 * a * b * pq,
        c * c * pp + d * d * qq + 2 * c * d * pq,
        a * c * pp + b * d * qq + (a * d + b * c) * pq,
    )


def _anchor_positions(on: ArraySurface, wanted: Int[np.ndarray, " k"]) -> Float[Array, "n 3"]:
    """Positions of the wanted vertices, by sums along the tree of paths. The others are arbitrary."""
    place, before = place_of(on.constant), on.domain.parents
    visited, vertices = on.domain.visited(wanted), on.domain.triangulation.points
    steps = integrate(on, place.put(vertices[before[visited]]), place.put(vertices[visited]))
    total = zeros((len(vertices), 3), steps)
    total[place.put(visited)] = steps
    # each pass doubles the number of summed edges. The root is its own parent and adds 0
    while (before != on.domain.root).any():
        total, before = total + total[place.put(before)], before[before]
    return on.constant + total


def integrate(on: ArraySurface, start: Complex[Array, "*pts"], end: Complex[Array, "*pts"]) -> Float[Array, "*pts 3"]:
    """Displacements by quadrature along segments."""
    nodes, weights = map(place_of(start).put, rule(on.quadrature, on.order))

    def segments(a: Complex[Array, " n"], b: Complex[Array, " n"]) -> Float[Array, "n 3"]:
        step = b - a
        phi = _phi(on, a[:, None] + nodes * step[:, None])
        return ((phi * weights[:, None]).sum(-2) * step[:, None]).real

    return in_blocks(segments, start, end, width=len(nodes))


def _mean_curvature(on: ArraySurface, z: Complex[Array, "*pts"]) -> Float[Array, "*pts"]:
    """H of the surface whose tangents are the derivatives of the quadrature with respect to its end."""
    end = z.reshape(-1)
    _, start = anchors(on, end)
    nodes, weights = map(place_of(z).put, rule(on.quadrature, on.order))

    def mean(a: Complex[Array, " n"], b: Complex[Array, " n"]) -> Float[Array, " n"]:
        step = (b - a)[:, None]
        at_nodes = a[:, None] + nodes * step
        p, q, dp, dq = *_pair(on, at_nodes), *_slopes(on, at_nodes)
        # the derivative of (b − a) Σ w φ(a + t(b − a)) with respect to b
        terms = formulas.phi(p, q) + (nodes * step)[..., None] * formulas.phi_derivative(p, q, dp, dq)
        hopf = formulas.hopf_differential(*_pair(on, b), *_slopes(on, b))
        return formulas.mean_curvature((terms * weights[:, None]).sum(-2), hopf)

    return in_blocks(mean, start, end, width=4 * len(nodes)).reshape(z.shape)


def _place_of_model(model: HolomorphicModel) -> Place:
    if isinstance(model, ArrayModel):
        return place_of(next(iter(model.arrays.values())))
    import torch

    return Place(next(model.parameters(), torch.empty(0)).device)  # type: ignore[attr-defined]


def _is_tensor(z: object) -> bool:
    return not is_numpy(z) and hasattr(z, "detach")


def require_complex_points(points: Sequence[Array]) -> None:
    """Raises a DtypeError for tensors that are not complex."""
    if not all(z.is_complex() for z in points):
        raise DtypeError(f"points of Ω must be complex, got {points[0].dtype}; use torch.complex(x, y)")


def _real(name: str, value: Any, *shape: int) -> Float[np.ndarray, "..."]:
    """An array of finite numbers of a given shape, or an OptionError."""
    try:
        array = np.asarray(to_numpy(value), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name} must be numbers of shape {shape}: {error}") from None
    if array.shape != shape or not np.isfinite(array).all():
        raise OptionError(f"{name} must be finite numbers of shape {shape}, got {value!s:.60}")
    return array


def _complex(z: Any) -> np.ndarray:
    """A complex copy of points, or a DtypeError."""
    try:
        return np.array(z, dtype=np.complex128)
    except (TypeError, ValueError):
        raise DtypeError(f"points of Ω must be complex numbers, got {type(z).__name__} {z!r:.60}") from None
