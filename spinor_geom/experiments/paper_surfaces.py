"""The paper's four surfaces: twisted circle, tennis seam, random networks, perturbed series."""

import math

import numpy as np

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.gallery import KnownCurve, tennis_seam, twisted_circle
from spinor_geom.gallery.curves import trigonometric
from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.plateau import solve_plateau
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.torch_extra import torch
from spinor_geom.training import LevenbergMarquardt, RMSprop, Trained, train_by_levenberg_marquardt

_ORDER, _PERTURBATION = 10, 0.1  # of Taylor expansions, and of their coefficients, relative to the largest
_SEED = 5
_UNEVEN, _SHIFT = 0.4, 0.1  # β and b of the parameter of a prescribed boundary
_TAYLOR_POINTS, _BOUNDARY_POINTS = 256, 512  # points of the circle for Taylor coefficients, and of a boundary


def random_networks(depth: int) -> SpinorSurface:
    """The surface of two networks with the random parameters that the paper's training starts from."""
    network = ComplexMLP(depth=depth, gain=RMSprop().gain, generator=torch.Generator().manual_seed(_SEED))
    return SpinorSurface(network, PlaneDomain.disk())


def perturbed_series(depth: int) -> SpinorSurface:
    """The Taylor polynomials of order 10 of the random networks' p and q, their coefficients perturbed at random."""
    z = np.exp(2j * np.pi * np.arange(_TAYLOR_POINTS) / _TAYLOR_POINTS)
    coefficients = np.fft.fft(random_networks(depth).spinors(z), axis=0)[: _ORDER + 1] / _TAYLOR_POINTS
    random = np.random.default_rng(_SEED)
    noise = random.normal(size=coefficients.shape) + 1j * random.normal(size=coefficients.shape)
    size = np.abs(coefficients).max() * _PERTURBATION / math.sqrt(_ORDER + 1)
    # the perturbation decreases with the order, so that the boundary stays smooth
    fading = 1 / (1 + np.arange(_ORDER + 1))[:, None]
    return SpinorSurface(PowerSeries(coefficients + size * fading * noise), PlaneDomain.disk())


def boundary_of(surface: SpinorSurface, name: str) -> KnownCurve:
    """The boundary of a surface over the unit disk as a closed curve: r(e^{2πiw}), w = t + β sin(2πt)/2π + b.

    Its parameter t is not the angle on the circle. A solver has to find the relation.
    """
    t = np.arange(_BOUNDARY_POINTS) / _BOUNDARY_POINTS
    place = t + _UNEVEN * np.sin(2 * np.pi * t) / (2 * np.pi) + _SHIFT
    curve = trigonometric(surface.position(np.exp(2j * np.pi * place)))
    return KnownCurve(**vars(curve), name=name, source="prescribed p and q")


def solved_by_network(curve: KnownCurve, options: LevenbergMarquardt) -> Trained:
    """A network over the unit disk by Levenberg-Marquardt, from the solution by power series."""
    start = solve_plateau(curve, model="series")
    # the solution's polynomials equal the curve to rounding error, and are faster than a formula by quadrature
    return train_by_levenberg_marquardt(start.curve, start=start.surface, matching=start.matching, options=options)


def reconstructed(options: LevenbergMarquardt) -> dict[str, SpinorSurface]:
    """Networks fitted to the boundaries of the four surfaces. The last two boundaries are of prescribed surfaces."""
    curves = {
        "twisted circle": twisted_circle(),
        "tennis seam": tennis_seam(0.8),
        "random networks": boundary_of(random_networks(options.depth), "random networks"),
        "perturbed series": boundary_of(perturbed_series(options.depth), "perturbed series"),
    }
    found = {name: solved_by_network(curve, options).surface for name, curve in curves.items()}
    return {name: surface for name, surface in found.items() if isinstance(surface, SpinorSurface)}
