"""Two prescribed surfaces, recovered from their boundaries: p, q, f, g compared up to Möbius maps of the disk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Complex
from matplotlib.figure import Figure
from numpy.typing import NDArray

from spinor_geom.experiments.drawing import Drawn, HolomorphicFunction, phases, surfaces
from spinor_geom.experiments.experiment import Experiment, Outcome, kept_as
from spinor_geom.experiments.moebius import MoebiusFit, fit_moebius
from spinor_geom.experiments.paper_surfaces import boundary_of, perturbed_series, random_networks, solved_by_network
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau import solve_plateau
from spinor_geom.surface import SpinorSurface
from spinor_geom.training import LevenbergMarquardt, RMSprop, Trained, train_by_rmsprop

# what counts as recovered: positions in diagonals, and p and q relative to their size
_NEAR, _ALIKE = 1e-6, 1e-5
PAPER, OURS, SERIES = "RMSprop", "Levenberg-Marquardt", "Douglas-Newton"


@dataclass(frozen=True, kw_only=True)
class PrescribedSettings:
    """How they are recovered.

    Attributes:
        depth: hidden layers of the prescribed networks.
        network: ours.
        random: the paper's training for random networks.
        perturbed: the paper's training for perturbed series.
    """

    depth: int
    network: LevenbergMarquardt
    random: RMSprop
    perturbed: RMSprop


def measure(settings: PrescribedSettings) -> Outcome:
    """Recovers both."""
    cases = {
        "random networks": (random_networks(settings.depth), settings.random),
        "perturbed series": (perturbed_series(settings.depth), settings.perturbed),
    }
    rows: list[dict[str, Any]] = []
    arrays: dict[str, NDArray[Any]] = {}
    pictures: dict[str, Figure] = {}
    for name, (truth, paper) in cases.items():
        curve = boundary_of(truth, name)
        trained = {
            PAPER: train_by_rmsprop(BoundaryCurve.from_formula(curve), options=kept_as(name, paper)),
            OURS: solved_by_network(curve, settings.network),
        }
        found = {method: t.surface for method, t in trained.items() if isinstance(t.surface, SpinorSurface)}
        found[SERIES] = solve_plateau(curve, model="series").surface
        fits = {method: fit_moebius(surface, truth) for method, surface in found.items()}
        for method, fit in fits.items():
            rows.append(
                {
                    "surface": name,
                    "method": method,
                    **(_trained_row(trained[method]) if method in trained else {}),
                    "p, q": fit.spinor_residual,
                    "f": fit.weierstrass_residual,
                    "g": fit.gauss_residual,
                    "position/diagonal": fit.position_residual,
                    "Möbius a": f"{fit.center:.2g}",
                    "Möbius turn": fit.turn,
                    "sign": fit.sign,
                }
            )
        z = np.exp(2j * np.pi * np.arange(256) / 256)
        arrays |= {f"{name}/{method}": surface.spinors(z) for method, surface in {"truth": truth, **found}.items()}
        drawn = {method: Drawn.of(surface) for method, surface in {"prescribed": truth, **found}.items()}
        file = f"prescribed-{name.replace(' ', '-')}"
        pictures[file] = surfaces(drawn, curves=dict.fromkeys(drawn, curve.point))
        pictures[f"{file}-functions"] = phases(
            {
                "prescribed": functions(truth),
                "found": functions(found[OURS]),
                "prescribed, after the Möbius map": functions(truth, fits[OURS]),
            }
        )
    ours = [row for row in rows if row["method"] != PAPER]
    return Outcome(
        rows=rows,
        holds=all(row["position/diagonal"] <= _NEAR and row["p, q"] <= _ALIKE for row in ours),
        verdict=" ".join(
            f"{row['surface']}, {row['method']}: positions to {row['position/diagonal']:.1e} of the diagonal, p and q "
            f"to {row['p, q']:.1e}, f to {row['f']:.1e}, g on the sphere to {row['g']:.1e}."
            for row in rows
        ),
        arrays=arrays,
        pictures=pictures,
    )


def _trained_row(one: Trained) -> dict[str, Any]:
    return {"steps": len(one.history), "seconds": one.seconds, "distance/diagonal": one.max_per_diagonal}


def functions(surface: SpinorSurface, fit: MoebiusFit | None = None) -> dict[str, HolomorphicFunction]:
    """p, q, and f = −2q² and g = −p/q of the Weierstrass-Enneper form, after a Möbius map if one is given."""

    def spinors(z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "2 n"]:
        w, root = (z, np.ones_like(z)) if fit is None else fit.reparametrised(z)
        return np.asarray(surface.spinors(w).T * root)

    return {
        "p": lambda z: spinors(z)[0],
        "q": lambda z: spinors(z)[1],
        "f": lambda z: -2 * spinors(z)[1] ** 2,
        "g": lambda z: -spinors(z)[0] / spinors(z)[1],
    }


EXPERIMENT = Experiment(
    title="prescribed surfaces are recovered from their boundaries",
    paper="The boundary of the surface of random networks, 2,000 epochs; of their Taylor polynomials of order 10 with "
    "perturbed coefficients, 4,000 epochs; p, q, f, g are recovered up to a Möbius map, nearly a rotation.",
    here="Surfaces of the same kinds, their boundaries unevenly parametrised; the paper's training, and a network of "
    "ours by Levenberg-Marquardt from a solution by power series, both from the curve alone. The Möbius map and the "
    "common sign of p and q are fitted; the table has what remains, and the last row of the functions' pictures the "
    f"prescribed ones moved by it. Seen means that both of ours recover positions to {_NEAR:g} and p and q to "
    f"{_ALIKE:g}.",
    measure=measure,
    full=PrescribedSettings(
        depth=10,
        network=LevenbergMarquardt(tolerance=1e-8, nodes=256),
        random=RMSprop(epochs=2000),
        perturbed=RMSprop(epochs=4000),
    ),
    quick=PrescribedSettings(
        depth=3,
        network=LevenbergMarquardt(tolerance=1e-8, nodes=256),
        random=RMSprop(epochs=10, order=25),
        perturbed=RMSprop(epochs=10, order=25),
    ),
)
