"""Curves and domains for tests of Douglas's slide and of the surfaces computed from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinor_geom.arrays import NUMPY
from spinor_geom.domain import FourierBoundary
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.curve_tensors import CurveTensors
from spinor_geom.plateau.harmonic.dirichlet import DirichletForm
from spinor_geom.plateau.harmonic.douglas import HarmonicDisk, Slides, minimise_dirichlet_energies
from spinor_geom.plateau.threads import one_thread

DISK = DirichletForm.of_disk(64)
# r = 1 + 0.8 cos 2θ + 0.05 sin θ: a waist of a fifth of the width
PEANUT = FourierBoundary(np.array([0, 0, 0, 0.4, 0.025j, 1, -0.025j, 0.4, 0]), 64)


def ellipse(ratio: float, count: int = 64) -> FourierBoundary:
    """The ellipse with half-axes `ratio` and 1 by its own angle."""
    return FourierBoundary(np.array([(ratio - 1) / 2, 0, (ratio + 1) / 2]), count)


def form_of(boundary: FourierBoundary, n: int) -> DirichletForm:
    """Λ of any domain."""
    return DirichletForm.of(boundary, n, NUMPY)


def even(n: int) -> Float[np.ndarray, " n"]:
    """n equal steps."""
    return np.arange(n, dtype=np.float64) / n


def tensors(loop: BoundaryLoop) -> CurveTensors:
    """Γ of a loop."""
    return CurveTensors.of(BoundaryCurve.from_loop(loop), NUMPY)


def increments(slide: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Steps of a slide around the circle."""
    return np.diff(slide, append=slide[:1] + 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Solved(HarmonicDisk):
    """A disk, its energy, the size of the gradient, and the steps to it."""

    energy: float
    gradient: float
    steps: int

    @classmethod
    def of(cls, disk: HarmonicDisk, curve: CurveTensors, form: DirichletForm, steps: int) -> Solved:
        here = Slides.of(CurveTensors.batch([curve]), form, disk.slide[None])
        energy = 2 * np.pi / len(disk.slide) * float(here.energy[0])
        return cls(**vars(disk), energy=energy, gradient=float(here.size[0]), steps=steps)


def solved(
    curve, form, slide, *, tolerance=1e-12, max_steps=60, near=False, negligible=0.0, on_step=lambda size: None
) -> Solved:
    """The slide of one curve."""
    sizes = []
    with one_thread():
        (disk,) = minimise_dirichlet_energies(
            CurveTensors.batch([curve]),
            form,
            slide[None],
            tolerances=[tolerance],
            max_steps=[max_steps],
            near=near,
            negligible=[negligible],
            on_step=[lambda size: (sizes.append(size), on_step(size))],
        )
    return Solved.of(disk, curve, form, len(sizes))
