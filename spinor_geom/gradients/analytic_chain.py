"""The chain rule of analytic curves: trigonometric polynomials, and sums of Poisson kernels (`mesh.interpolation`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg.lapack import dpotrf, dpotrs

from spinor_geom.mesh.interpolation import ARC_NODES, RIDGE, gauss_nodes, poisson_kernels


def by_trigonometric_points(
    m: int, s: Float[np.ndarray, " k"], by_values: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, "m 3"]:
    """The gradient in the points of a trigonometric polynomial, from that in its values."""
    turn = np.exp(-2j * np.pi * s)
    # with k = 8a + b, in a third of the time of cumulative products
    low, high = turn ** np.arange(8)[:, None], turn ** (8 * np.arange(m // 16 + 1))[:, None]
    powers = (high[:, None] * low).reshape(-1, len(s))[: m // 2 + 1]
    return np.asarray(np.fft.irfft(powers @ by_values, n=m, axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class PoissonCurve:
    """The interpolating sum of Poisson kernels at given parameters: Γ(s) = mean + Σ_j c_j K(s − k_j)."""

    points: Float[np.ndarray, "m 3"]
    breaks: Float[np.ndarray, " m_plus_1"]

    @property
    def places(self) -> Float[np.ndarray, " m"]:
        """The parameters k_j of the points."""
        return self.breaks[:-1]

    @cached_property
    def _own(self) -> tuple[Float[np.ndarray, "m m"], Float[np.ndarray, "m m"]]:
        """Kernels and their slopes at the points."""
        kernel, slope = poisson_kernels(self.places, self.places, len(self.points), 1)
        kernel.flat[:: len(kernel) + 1] *= 1 + RIDGE
        return kernel, slope

    @cached_property
    def _factor(self) -> Float[np.ndarray, "m m"]:
        # LAPACK directly, because the checks of scipy.linalg take as long as the computation
        factor, is_singular = dpotrf(self._own[0])
        if is_singular:
            raise np.linalg.LinAlgError("the equations of an analytic curve are singular")
        return np.asarray(factor)

    @cached_property
    def weights(self) -> Float[np.ndarray, "m 3"]:
        """The weights c."""
        return np.asarray(dpotrs(self._factor, self.points - self.points.mean(axis=0))[0])

    def by_values(
        self, s: Float[np.ndarray, " k"], by_values: Float[np.ndarray, "k 3"]
    ) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, " m"]]:
        """The gradients in the points and in the k_j, from that in Γ(s) at fixed s."""
        kernel, slope = poisson_kernels(s, self.places, len(self.points), 1)
        by_points, by_places = self._by_weights(kernel.T @ by_values)
        by_places -= (slope.T @ by_values * self.weights).sum(axis=1)
        return by_points + by_values.sum(axis=0) / len(by_points), by_places

    def by_lengths(self, by_logs: Float[np.ndarray, " m"]) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, " m"]]:
        """The gradients in the points and in the k_j, from that in the logarithms of the lengths of the pieces."""
        m, widths = len(self.points), np.diff(self.breaks)
        nodes, shares = gauss_nodes(ARC_NODES)
        s = (self.breaks[:-1, None] + widths[:, None] * (nodes + 1) / 2).ravel()
        _, slope, bend = poisson_kernels(np.append(s, self.places), self.places, m, 2)
        velocity = slope @ self.weights
        speed = np.linalg.norm(velocity, axis=1)
        inner, ends = np.split(speed, [len(s)])
        steps = np.outer(widths, shares) / 2
        by_arcs = by_logs / (inner.reshape(steps.shape) * steps).sum(axis=1)
        by_velocity = (by_arcs[:, None] * steps).reshape(-1, 1) * velocity[: len(s)] / inner[:, None]
        by_points, by_places = self._by_weights(slope[: len(s)].T @ by_velocity)
        by_places -= (bend[: len(s)].T @ by_velocity * self.weights).sum(axis=1)
        return by_points, by_places + ends * (np.roll(by_arcs, 1) - by_arcs)

    def _by_weights(
        self, by_weights: Float[np.ndarray, "m 3"]
    ) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, " m"]]:
        """The gradients in the points and in the k_j, from that in the weights c."""
        by_points = dpotrs(self._factor, by_weights)[0]
        turned = self._own[1] * (by_points @ self.weights.T)
        return by_points - by_points.mean(axis=0), turned.sum(axis=0) - turned.sum(axis=1)


def by_steps(by_breaks: Float[np.ndarray, " m"], breaks: Float[np.ndarray, " m_plus_1"]) -> Float[np.ndarray, " m"]:
    """The gradient in the logarithms of lengths, from that in their cumulative sums, normalised to end at 1."""
    after = np.append(np.cumsum(by_breaks[:0:-1])[::-1], 0.0)
    return np.asarray(np.diff(breaks) * (after - by_breaks @ breaks[:-1]))
