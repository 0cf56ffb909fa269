"""Derivatives of surfaces over disks with round holes: the adjoint of Newton's equations for Douglas's energy E.

When Γ moves by δΓ, slides and moduli change by δy = −E″⁻¹ (∂E′/∂Γ) δΓ, and the surface by the harmonic function δr with
boundary values δΓ + Γ′δs. The adjoint maps weights of its normal part u = n·δr at points of Ω to weights of δΓ, by one
solve with the Hessian E″ of the last Newton step. Without errors of discretisation these weights are normal to Γ.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float
from scipy.sparse.linalg import LinearOperator, cg

from spinor_geom.arrays import NUMPY, norm
from spinor_geom.errors import NotDifferentiableError
from spinor_geom.gradients.rim_nodes import RimNodes
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.series import power_moments
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.dirichlet import CirclesForm, DirichletForm, derivative
from spinor_geom.plateau.harmonic.douglas import Slides
from spinor_geom.plateau.newton import Rows
from spinor_geom.plateau.rims.energy import HarmonicSurface
from spinor_geom.plateau.solution import PlateauSolution

# relative residual of the adjoint equations, and size below which powers on other circles are dropped
_RESIDUAL = 1e-10

OnCircles = Float[np.ndarray, "m n 3"]  # vectors at equal steps of every circle


@dataclass(frozen=True, kw_only=True, eq=False)
class SlideAdjoint:
    """Normal displacements u = n·δr of a surface over a disk with or without round holes."""

    solution: PlateauSolution
    z: Complex[np.ndarray, " v"]  # inside Ω
    rims: list[RimNodes]  # the nodes on ∂Ω

    def by_boundary(self, by_u: Float[np.ndarray, " v"]) -> list[Float[np.ndarray, "_ 3"]]:
        """Weights of δΓ at the nodes of each rim, from weights of u at the points inside.

        Raises a NotDifferentiableError if the equations are singular or nearly so.
        """
        surface, newton = self.solution.array_surface, self._newton
        by_values = self._by_values(by_u[:, None] * np.asarray(surface.normal(self.z)))
        along, by_moduli = newton.solved(by_values)
        change = newton.form(newton.unit * along[..., None]) + np.tensordot(by_moduli, newton.changes, axes=1)
        # E′ depends on Γ′ too. The term with δΓ′ is integrated by parts
        turned = newton.by_normal * (along / norm(derivative(newton.points)))[..., None]
        # the result is band-limited. It is resampled at the nodes by Fourier series
        spectra = np.fft.rfft(by_values - change + derivative(turned), axis=1)
        return [np.fft.irfft(own, n=len(nodes.z), axis=0) for own, nodes in zip(spectra, self.rims, strict=True)]

    @cached_property
    def _newton(self) -> _Newton:
        rims = self.solution.rims
        curves = CurveTensors.batch([CurveTensors.of(rim.curve, NUMPY) for rim in rims])
        slides = np.stack([rim.matching[:, 1] for rim in rims])
        if self._circles is None:
            disk = Slides.of(curves, DirichletForm.of_disk(slides.shape[1]), slides)
            points, unit, by_normal = (
                np.moveaxis(part, 0, -1) for part in (disk.points, disk.tangent / disk.speed, disk.normal)
            )
            return _Newton(
                points=points,
                unit=unit,
                by_normal=by_normal,
                form=disk.form,
                displacements=np.zeros((0, *points.shape)),
                changes=np.zeros((0, *points.shape)),
                hessian=disk.hessian(None),
                precondition=disk.precondition,
                without_gauge=disk.without_gauge,
            )
        between = HarmonicSurface.of(curves, slides, self._circles, _RESIDUAL)
        return _Newton(
            points=between.points,
            unit=between.unit,
            by_normal=between.normal,
            form=between.form,
            displacements=between.moduli.displacements,
            changes=between.moduli.changes,
            hessian=between.hessian(None),
            precondition=between.precondition,
            without_gauge=lambda rows: rows,  # the Hessian has a stiffness for conformal maps
        )

    @property
    def _circles(self) -> CircularDomain | None:
        """Ω, or None for the unit disk."""
        model = self.solution.array_surface.at(NUMPY).model
        return model.circles if isinstance(model, LaurentSeries) else None

    def _by_values(self, weights: Float[np.ndarray, "v 3"]) -> OnCircles:
        """Weights of boundary values X of harmonic functions r, from weights of r at the points inside.

        With φ dz = ∂X + iΛX = Σ v_k e^{ikτ} dτ on each circle, r is the mean of X on the unit circle, plus the real
        part of Σ v_k ζ^k/ik over the powers of the coordinates ζ of all circles, plus Re iv_0 log|z − c| for each hole.
        """
        form, n = self._newton.form, self._newton.points.shape[1]
        coordinates, holes = self.z[None], 0
        if self._circles is not None:
            coordinates, holes = self._circles.coordinates(self.z), len(self._circles.centres)
        spectrum = np.zeros((holes + 1, n, 3), dtype=np.complex128)
        k = np.arange(1, n // 2)
        for own, zeta in zip(spectrum, coordinates, strict=True):
            own[1 : n // 2] = power_moments(zeta, weights, n // 2)[:, 1:].T / (1j * k[:, None])
        if self._circles is not None:
            distance = np.abs(self.z[:, None] - self._circles.centres)
            spectrum[1:, 0] = 1j * np.log(distance).T @ weights
        both = np.fft.fft(spectrum, axis=1) / n
        by_values = -derivative(np.ascontiguousarray(both.real)) - form(np.ascontiguousarray(both.imag))
        by_values[0] += weights.sum(axis=0) / n
        return np.asarray(by_values)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Newton:
    """Newton's equations at a stationary surface, see `Slides` and `HarmonicSurface`."""

    points: OnCircles  # X
    unit: OnCircles  # unit tangents of Γ
    by_normal: OnCircles  # ΛX
    form: DirichletForm | CirclesForm  # Λ
    displacements: Float[np.ndarray, "p m n 3"]  # of the surface along itself on ∂Ω, by each modulus
    changes: Float[np.ndarray, "p m n 3"]  # derivative of ΛX by each modulus
    hessian: Rows
    precondition: Rows
    without_gauge: Rows  # removes displacements by conformal maps of Ω, for which E″ is singular

    def solved(self, by_values: OnCircles) -> tuple[Float[np.ndarray, "m n"], Float[np.ndarray, " p"]]:
        """Multipliers of the equations for slides, in arc length, and moduli, from weights of the boundary values."""
        along = (by_values * self.unit).sum(axis=-1)
        by_moduli = -(self.displacements * by_values).sum(axis=(1, 2, 3))
        (right,) = self.without_gauge(np.append(along, by_moduli)[None])
        hessian, inverse = (_operator(rows, len(right)) for rows in (self.hessian, self.precondition))
        steps, missed = cg(hessian, right, rtol=_RESIDUAL, M=inverse)
        if missed:
            raise NotDifferentiableError(
                "the surface is nearly degenerate: the equations for its change have no accurate solution; move the "
                "rims towards each other, or points away from this place"
            )
        return steps[: along.size].reshape(along.shape), steps[along.size :]


def _operator(rows: Rows, size: int) -> LinearOperator:
    return LinearOperator((size, size), matvec=lambda x: rows(x[None])[0], dtype=np.float64)
