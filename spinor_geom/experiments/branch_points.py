"""Branch points of both forms: which of them a small change of the surface removes, and which are there at random."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Complex
from numpy.polynomial import polynomial

from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.experiments.drawing import Drawn, surfaces
from spinor_geom.experiments.experiment import Experiment, Outcome
from spinor_geom.experiments.forms import branch_points, positions
from spinor_geom.holomorphic.series import PowerSeries
from spinor_geom.surface import SpinorSurface
from spinor_geom.surface.weierstrass import WeierstrassSurface

SPINOR, ENNEPER = "spinor", "Weierstrass-Enneper"
FORMS = (SPINOR, ENNEPER)
# where the zeros of prescribed order lie, and what they are multiplied by
_PLACE = 0.2 + 0.1j
_FACTORS = ([1.0, 0.3j], [0.4, 0.5 - 0.2j])
# what p is moved by, to show that a removable branch point goes
_PERTURBATION = 0.15
_DEGREE, _SEED = 5, 0


def lasting(*, orders: Sequence[int], random: int) -> Outcome:
    """Finds the branch points of pairs with zeros of prescribed orders and of so many random ones, in both forms."""
    rows = [prescribed_row(form, order) for form in FORMS for order in orders]
    as_said = all(row["removable"] == (row["order of φ"] % 2 == 0) for row in rows)
    generator = np.random.default_rng(_SEED)
    shape = (random, 2, _DEGREE + 1)
    pairs = generator.normal(size=shape) + 1j * generator.normal(size=shape)
    shares = {}
    for form in FORMS:
        found = [branch_points(surface_of(form, *pair)) or () for pair in pairs]
        counts = [sum(not point.removable for point in points) for points in found]
        shares[form] = sum(count > 0 for count in counts)
        rows.append(
            {
                "form": form,
                "pairs": f"{random} random, degree {_DEGREE}",
                "with branch points that last": shares[form],
                "such points": sum(counts),
            }
        )
    return Outcome(
        rows=rows,
        holds=as_said and shares[SPINOR] == 0 and shares[ENNEPER] > 0,
        verdict=f"Branch points are removable {'exactly' if as_said else 'not'} where the order of φ is even, by the "
        f"lift of a frame around each. Of {random} random pairs {shares[ENNEPER]} have others in the "
        f"Weierstrass-Enneper form, {shares[SPINOR]} as spinors.",
        pictures={"branch-points": surfaces(drawn())},
    )


def pair_with_zero(order: int) -> tuple[Complex[np.ndarray, " k"], Complex[np.ndarray, " k"]]:
    """(z − z₀)^order times each of two polynomials without zeros in the unit disk."""
    power = polynomial.polyfromroots([_PLACE] * order)
    p, q = (polynomial.polymul(power, factor) for factor in _FACTORS)
    return p, q


def surface_of(
    form: str, first: Complex[np.ndarray, " n"], second: Complex[np.ndarray, " m"]
) -> SpinorSurface | WeierstrassSurface:
    """The surface over the unit disk of p and q, or of f and g, by their coefficients."""
    coefficients = torch.zeros(max(len(first), len(second)), 2, dtype=torch.complex128)
    coefficients[: len(first), 0], coefficients[: len(second), 1] = (torch.tensor(c) for c in (first, second))
    model, domain = PowerSeries(coefficients), PlaneDomain.disk()
    if form == SPINOR:
        return SpinorSurface(model, domain)
    return WeierstrassSurface(model, domain, torch.zeros(3, dtype=torch.float64))


def prescribed_row(form: str, order: int) -> dict[str, Any]:
    """The branch point of a pair with a common zero, or of an f with one."""
    p, q = pair_with_zero(order)
    second = q if form == SPINOR else np.array(_FACTORS[1])
    (point,) = surface_of(form, p, second).branch_points()
    return {
        "form": form,
        "pairs": f"zero of order {order}",
        "order of φ": point.order,
        "found off by": abs(point.z - _PLACE),
        "frame lifts to SU(2)": "yes" if point.invariant else "no",
        "removable": point.removable,
    }


def drawn() -> dict[str, Drawn]:
    """Surfaces with the zero of order 1, and the spinors' after a small change of p."""
    p, q = pair_with_zero(1)
    moved = p + np.array([_PERTURBATION, *[0.0] * (len(p) - 1)])
    shown = {
        "Weierstrass-Enneper, f has a simple zero": surface_of(ENNEPER, p, np.array(_FACTORS[1])),
        "spinors, p and q have a common zero": surface_of(SPINOR, p, q),
        "the same after a small change of p": surface_of(SPINOR, moved, q),
    }
    return {
        title: replace(Drawn.of(surface), marks=positions(surface, surface.branch_points()))
        for title, surface in shown.items()
    }


EXPERIMENTS = {
    "branch-points": Experiment(
        title="branch points, and which of them last",
        paper="A zero of φ of order m is a branch point that a small change of the surface removes if and only if m is "
        "even; p and q make even orders only, and a generic f has simple zeros.",
        here="Zeros by the argument principle, and the lift to SU(2) of the surface's frame along a circle around "
        "each: on polynomials with a zero of known order, and on polynomials with normal random coefficients. Crosses "
        "mark branch points. Seen means that the lift agrees with the order everywhere, and that random f and g have "
        "branch points that last where random p and q have none.",
        measure=lasting,
        full={"orders": (1, 2, 3, 4, 5), "random": 500},
        quick={"orders": (1, 2, 3, 4), "random": 50},
    )
}
