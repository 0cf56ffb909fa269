"""Harmonic surfaces between several rims of which some have corners, and the derivatives of their energy.

Ω is the unit disk less round holes. Harmonic functions are real parts of Laurent series, logarithms, and poles that are
clustered exponentially towards the image of each corner. The energy of boundary values is the maximum over these
functions (Galerkin), so that its errors are of second order. The unknowns are coefficients of the slides, the arguments
of the corners' images, and the circles. The Hessian is exact.

Source: Gopal & Trefethen, "Solving Laplace problems with corner singularities via rational functions", SIAM J. Numer.
Anal. 57 (2019), for the poles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpstrf

from spinor_geom.arrays import TINY, cis, unit
from spinor_geom.plateau.rims.circles import Circles
from spinor_geom.plateau.rims.sides import CorneredRims, Resolution, Side, slices

# Share of a side beside a corner where ∂X/∂n shows the angle of the surface, and slides for a wrong angle are not used.
_NEAR = 0.05
_BLOCK = 256  # columns of a symmetric matrix of which only the lower triangle is computed


@dataclass(frozen=True, kw_only=True, eq=False)
class Moves:
    """Velocities v of points of ∂Ω by the moduli: arguments of corners, then x, y and log radius of each hole."""

    velocities: Complex[np.ndarray, "n p"]
    along: Complex[np.ndarray, "n p"]  # dv between nodes, times the weights
    turns: Complex[np.ndarray, "n p"]  # v/(z − c) of the velocities that turn or enlarge a circle, 0 for the others
    around: Complex[np.ndarray, " n"]  # z − c


class _Galerkin(NamedTuple):
    """The harmonic functions that are kept, of energy ½ each, and the Cholesky factor of their energies."""

    normals: Float[np.ndarray, "n r"]  # normal derivatives at the nodes, times the weights
    factor: Float[np.ndarray, "r r"]  # lower triangle
    kept: Int[np.ndarray, " r"]  # numbers among the real and imaginary parts, in turn, of all functions
    size: Float[np.ndarray, " k2"]  # roots of twice the energies of all functions


@dataclass(frozen=True, kw_only=True, eq=False)
class CornerForm:
    """Dirichlet's form Λ for values at the nodes of rims with corners, and the functions that it is made of."""

    rims: CorneredRims
    circles: Circles

    @cached_property
    def nodes(self) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]:
        """The nodes z on ∂Ω, and dz times the weights."""
        parts = [self._on(side) for side in self.rims.sides]
        z = [self.circles.centres[side.rim] + e for side, (e, _) in zip(self.rims.sides, parts, strict=True)]
        return np.concatenate(z), np.concatenate([step for _, step in parts])

    def _on(self, side: Side) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, " n"]]:
        """The nodes of a side relative to the centre of its circle, and dz times the weights."""
        sign, (u, rest) = self.circles.signs[side.rim], side.shares
        first, arc = self.circles.arc(side)
        # from the nearer end, because nodes at corners are less than rounding errors of the argument apart
        argument = np.where(u < 0.5, first + arc * u, first + arc - arc * rest)
        e = self.circles.radii[side.rim] * cis(sign * argument)
        return e, 1j * sign * arc * side.weights * e

    @cached_property
    def _poles(self) -> tuple[Complex[np.ndarray, " k"], Float[np.ndarray, " k"], Int[np.ndarray, " j"]]:
        return self.circles.poles(self.rims)

    def functions(
        self, z: Complex[np.ndarray, " n"], from_poles: Complex[np.ndarray, "n j"] | None = None
    ) -> Complex[np.ndarray, "3 n k"]:
        """The functions whose real parts span harmonic functions, and their first two derivatives.

        The last ones, one for each hole, are log|z − c|, with the derivatives of log(z − c). `from_poles` has the
        differences of points and poles, where they are known better than those of rounded positions.
        """
        poles, distances, _ = self._poles
        powers, radii = self.rims.powers, self.circles.radii
        columns = slices([*powers, len(poles), len(powers) - 1])
        found = np.empty((3, len(z), columns[-1].stop), dtype=np.complex128)
        inverses = 1 / (z[:, None] - self.circles.centres[1:])
        bases = [z, *(radii[1:] * inverses).T]
        for rim, (base, count, own) in enumerate(zip(bases, powers, columns, strict=False)):
            value, slope, bend = found[:, :, own]
            k = np.arange(1, count + 1)
            value[:] = base[:, None]
            np.multiply.accumulate(value, axis=1, out=value)
            if rim:
                inverse = inverses[:, rim - 1, None]
                np.multiply(-k, value * inverse, out=slope)
                np.multiply(-(k + 1), slope * inverse, out=bend)
            else:
                slope[:, :1], bend[:, :1] = 1.0, 0.0
                np.multiply(k[1:], value[:, :-1], out=slope[:, 1:])
                np.multiply(k[1:], slope[:, :-1], out=bend[:, 1:])
        inverse = 1 / (z[:, None] - poles if from_poles is None else from_poles)
        value, slope, bend = found[:, :, columns[-2]]
        np.multiply(distances, inverse, out=value)
        np.multiply(-value, inverse, out=slope)
        np.multiply(-2 * slope, inverse, out=bend)
        found[:, :, columns[-1]] = -np.log(np.abs(inverses)), inverses, -(inverses**2)
        return found

    def on_side(self, number: int) -> Complex[np.ndarray, "3 n k"]:
        """`functions` at the nodes of a side, with poles near its corners from their distances to these."""
        side, (poles, distances, corner_of_pole) = self.rims.sides[number], self._poles
        z = self.nodes[0][self.rims.rows[number]]
        from_poles = z[:, None] - poles
        sign, (_, arc) = self.circles.signs[side.rim], self.circles.arc(side)
        for corner, share, ahead in zip(side.corners or (), side.shares, (sign, -sign), strict=False):
            near, own = np.flatnonzero(share < 0.5), np.flatnonzero(corner_of_pole == corner)
            turn, outwards = ahead * arc * share[near], cis(sign * self.circles.arguments[corner])
            away = 2j * self.circles.radii[side.rim] * np.sin(turn / 2) * cis(turn / 2)
            from_poles[np.ix_(near, own)] = outwards * (away[:, None] - sign * distances[own])
        return self.functions(z, from_poles)

    @cached_property
    def _galerkin(self) -> _Galerkin:
        whole, logarithms = list[Float[np.ndarray, "n k2"]](), 1 - 2 * len(self.circles.centres[1:])
        gram: Float[np.ndarray, "k2 k2"] = np.zeros(())
        for number, rows in enumerate(self.rims.rows):
            value, slope, _ = self.on_side(number)
            # the normal derivatives of real and imaginary parts alternate, as the parts themselves
            values, normals = (part.view(np.float64) for part in (value, slope * (-1j * self.nodes[1][rows])[:, None]))
            normals[:, logarithms::2] = 0.0  # logarithms are real
            whole.append(normals)
            if not gram.ndim:
                gram = np.zeros((normals.shape[1], normals.shape[1]))
            for first in range(0, len(gram), _BLOCK):  # the lower triangle
                own = slice(first, first + _BLOCK)
                gram[own, : own.stop] += values[:, own].T @ normals[:, : own.stop]
        size = np.sqrt(np.maximum(np.abs(np.diag(gram)), TINY))
        gram /= size * size[:, None]
        factor, order, rank, _ = dpstrf(gram, tol=self.rims.resolution.dependent, lower=1)
        kept = order[:rank] - 1
        return _Galerkin(
            normals=np.concatenate([normals[:, kept] for normals in whole]) / size[kept],
            factor=factor[:rank, :rank],
            kept=kept,
            size=size,
        )

    def projected(self, values: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "r c"]:
        """Products with Yᵀ, where Λ = Y Yᵀ."""
        return self.reduced(self.products(slice(None), values))

    def reduced(self, products: Float[np.ndarray, "r c"]) -> Float[np.ndarray, "r c"]:
        """Products with Yᵀ of values with given products with the normal derivatives."""
        return np.asarray(solve_triangular(self._galerkin.factor, products, lower=True))

    def normal(self, projected: Float[np.ndarray, "r c"]) -> Float[np.ndarray, "n c"]:
        """Y projected: integrals of ∂X/∂n between nodes for `projected` values X."""
        own = self._galerkin
        return np.asarray(own.normals @ solve_triangular(own.factor, projected, lower=True, trans="T"))

    def products(self, rows: slice, values: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "r c"]:
        """Products of the normal derivatives with values at some nodes, 0 at the others."""
        return np.asarray(self._galerkin.normals[rows].T @ values)

    def coefficients(self, values: Float[np.ndarray, "n c"]) -> Complex[np.ndarray, "k c"]:
        """Coefficients of the functions whose real part has given values at the nodes."""
        own = self._galerkin
        found = solve_triangular(own.factor, self.projected(values), lower=True, trans="T")
        both = np.zeros((len(own.size), values.shape[1]))
        both[own.kept] = found / own.size[own.kept, None]
        return np.asarray(both[::2] - 1j * both[1::2])

    @cached_property
    def moves(self) -> Moves:
        """The velocities of the nodes."""
        count = self.rims.corners + 3 * (len(self.circles.centres) - 1)
        velocities, along, turns = np.zeros((3, len(self.nodes[0]), count), dtype=np.complex128)
        around = np.empty_like(self.nodes[0])
        for side, rows in zip(self.rims.sides, self.rims.rows, strict=True):
            e, step = self._on(side)
            around[rows], sign = e, 1j * self.circles.signs[side.rim]
            for corner, share, slope in zip(side.corners or (), side.shares[::-1], (-1.0, 1.0), strict=False):
                turns[rows, corner] += sign * share
                along[rows, corner] += sign * (step * share + e * slope * side.weights)
            if side.rim:
                first = self.rims.corners + 3 * (side.rim - 1)
                velocities[rows, first : first + 2] = 1.0, 1j
                turns[rows, first + 2], along[rows, first + 2] = 1.0, step
        return Moves(velocities=velocities + around[:, None] * turns, along=along, turns=turns, around=around)

    @cached_property
    def moves_of_corners(self) -> Moves:
        """The velocities of the images of corners."""
        rims, circles = self.rims.rim_of_corner, self.circles
        own, count = np.arange(len(rims)), len(rims) + 3 * (len(circles.centres) - 1)
        velocities, turns = np.zeros((2, len(rims), count), dtype=np.complex128)
        turns[own, own] = 1j * circles.signs[rims]
        on_hole = own[rims > 0]
        first = len(rims) + 3 * (rims[on_hole] - 1)
        velocities[on_hole, first], velocities[on_hole, first + 1], turns[on_hole, first + 2] = 1.0, 1j, 1.0
        around = circles.images(rims) - circles.centres[rims]
        return Moves(velocities=velocities + around[:, None] * turns, along=0 * velocities, turns=turns, around=around)


@dataclass(frozen=True, kw_only=True, eq=False)
class CorneredSurface:
    """A harmonic surface between rims with corners, and derivatives of its energy."""

    form: CornerForm
    slides: Float[np.ndarray, " k"]  # coefficients of the modes

    @cached_property
    def _points(self) -> Float[np.ndarray, "3 n 3"]:
        return self.form.rims.points(self.slides)

    @cached_property
    def _projected(self) -> Float[np.ndarray, "r 3"]:
        return self.form.projected(self._points[0])

    @property
    def energy(self) -> float:
        """The Dirichlet energy: the area of a conformal surface."""
        return float((self._projected**2).sum() / 2)

    @property
    def points(self) -> Float[np.ndarray, "n 3"]:
        """Γ at the nodes."""
        return np.asarray(self._points[0])

    @cached_property
    def coefficients(self) -> Complex[np.ndarray, "k 3"]:
        """Coefficients of `CornerForm.functions`."""
        return self.form.coefficients(self._points[0])

    def null_curve(self, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n 3"]:
        """φ = 2∂X/∂z in Ω."""
        return np.asarray(self.form.functions(z)[1] @ self.coefficients)

    @property
    def _angles(self) -> Float[np.ndarray, " c"]:
        """Angles of the surface at the corners, over π: of those of Γ and the rest of a full turn the more probable.

        The sum of ∂X/∂n beside a corner points out of the surface.
        """
        rims, normals = self.form.rims, self.form.normal(self._projected)
        outwards, between = np.zeros((2, rims.corners, 3))
        for side, rows in zip(rims.sides, rims.rows, strict=True):
            tangents = unit(self._points[1, [rows.start, rows.stop - 1]])
            ends = zip(side.corners or (), side.shares, (tangents[0], -tangents[1]), strict=False)
            for corner, share, tangent in ends:
                outwards[corner] += normals[rows][share < _NEAR].sum(axis=0)
                between[corner] += tangent
        given, is_reflex = rims.exponents, (outwards * between).sum(axis=1) > 0
        return np.where(is_reflex == (given > 1), given, 2 - given)

    def refitted(self, resolution: Resolution) -> CorneredSurface:
        """The surface with probable angles at corners, another resolution, and modes for gaps between circles."""
        form, old = self.form, self.form.rims
        rims = old.adapted(self._angles, resolution, partial(form.circles.places, old.rim_of_corner))
        slides = np.empty(rims.columns[-1].stop)
        sides = zip(old.sides, rims.sides, old.columns, rims.columns, strict=True)
        for before, after, given, columns in sides:
            if after.corners is None:
                slides[columns] = self.slides[given]
                continue
            # beyond the range of another angle, the sum of the modes is continued as a constant
            least = [_NEAR if a != b else 0.0 for a, b in zip(before.exponents, after.exponents, strict=True)]
            u = np.clip(after.shares[0], least[0], 1 - least[1])
            shares = np.stack([u, np.maximum(after.shares[1], least[1])])
            sums = before.base(shares) + before.modes(shares) @ self.slides[given] - after.base(shares)
            slides[columns] = np.linalg.lstsq(after.modes(after.shares), sums, rcond=None)[0]
        return CorneredSurface(form=replace(form, rims=rims), slides=slides)

    def derivatives(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k k"]]:
        """Gradient and Hessian of the energy in the coefficients of slides, then the moduli.

        Where the domain moves with velocity v, dE = −½ Im ∮ φ·φ v dz. Fields that are holomorphic in Ω change nothing.
        One is subtracted from each v, so that v = 0 at corners: φ v has finite energy then.
        """
        form = self.form
        (_, tangent, bend), modes, rims = self._points, form.rims.modes, form.rims
        normal = form.normal(self._projected)
        pull = (tangent * normal).sum(1)
        turned = []
        for axis in range(3):
            moved = (
                modes[rows, own] * tangent[rows, axis, None] for rows, own in zip(rims.rows, rims.columns, strict=True)
            )
            turned.append(form.reduced(np.concatenate(list(map(form.products, rims.rows, moved)), axis=1)))
        own = rims.by_modes((bend * normal).sum(1)[:, None] * modes)
        own = own + np.sum([one.T @ one for one in turned], axis=0)
        _, steps = form.nodes
        parts = [form.on_side(number)[1:] @ self.coefficients for number in range(len(rims.sides))]
        phi, phi_slope = np.concatenate(parts, axis=1)
        moves, second = self._vanishing_moves()
        velocities, along = moves.velocities, moves.along
        squares = (phi * phi).sum(1)
        n, count = velocities.shape
        carried = phi[:, :, None] * velocities[:, None]
        changes = phi_slope[:, :, None] * (velocities * steps[:, None])[:, None] + phi[:, :, None] * along[:, None]
        fields = form.projected(carried.real.reshape(n, -1))
        mixed = rims.by_modes((tangent[:, :, None] * changes.imag).sum(1))
        mixed = mixed - np.sum(
            [one.T @ fields[:, axis * count :][:, :count] for axis, one in enumerate(turned)], axis=0
        )
        displaced = fields.reshape(-1, count)
        by_moduli = displaced.T @ displaced - carried.real.reshape(-1, count).T @ changes.imag.reshape(-1, count)
        by_moduli += 0.5 * ((squares[:, None] * velocities).T @ along - second(squares * steps)).imag
        gradient = np.concatenate([modes.T @ pull, -0.5 * ((squares * steps) @ velocities).imag])
        return gradient, np.block([[own, mixed], [mixed.T, (by_moduli + by_moduli.T) / 2]])

    def _vanishing_moves(self) -> tuple[Moves, Callable[[Complex[np.ndarray, " n"]], Complex[np.ndarray, "p p"]]]:
        """Velocities less holomorphic fields w with the same values at the corners, and integrals of their changes.

        The change of field j by a move along field i is ∂_i v_j − w_i′ v_j − (v_i − w_i) w_j′, again less a holomorphic
        field. The function takes weights of the nodes.
        """
        moves, at_corners = self.form.moves, self.form.moves_of_corners
        (z, steps), rim_of_corner = self.form.nodes, self.form.rims.rim_of_corner
        value, slope = self._smooth_functions(z)
        corner_value, corner_slope = self._smooth_functions(self.form.circles.images(rim_of_corner))
        through = np.linalg.inv(corner_value)
        fields = through @ at_corners.velocities
        slopes, corner_slopes = slope @ fields, corner_slope @ fields
        less = moves.velocities - value @ fields
        at_corner = (at_corners.around[:, None] * at_corners.turns)[:, :, None] * at_corners.turns[:, None]
        at_corner = at_corner - corner_slopes[:, :, None] * at_corners.velocities[:, None]

        def second(weights: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "p p"]:
            at = weights[:, None]
            whole = (at * moves.around[:, None] * moves.turns).T @ moves.turns
            whole = whole - (at * slopes).T @ moves.velocities - (at * less).T @ slopes
            return np.asarray(whole - np.tensordot(weights @ value @ through, at_corner, 1))

        return replace(moves, velocities=less, along=moves.along - slopes * steps[:, None]), second

    def _smooth_functions(self, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "2 n k"]:
        """Squares of poles beside each corner, which decay over the shorter arc beside it, and their derivatives."""
        circles, rim = self.form.circles, self.form.rims.rim_of_corner
        # in holes poles stay between circle and centre
        depths = 0.5 * circles.radii[rim] * np.minimum(circles.arcs(rim), 1.0)
        outwards = circles.signs[rim] * cis(circles.signs[rim] * circles.arguments)
        inverse = depths / (z[:, None] - circles.images(rim) - depths * outwards)
        return np.stack([inverse**2, -2 * inverse**3 / depths])

    def stepped(self, step: Float[np.ndarray, " k"]) -> CorneredSurface | None:
        """The surface after a step, or None if circles would meet."""
        count, form = len(self.slides), self.form
        circles = form.circles.moved(step[count:])
        if not circles.is_domain(form.rims.rim_of_corner):
            return None
        return CorneredSurface(form=replace(form, circles=circles), slides=self.slides + step[:count])
