"""The first epochs of the paper's training without and with its tangent term, from the same start."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spinor_geom.experiments.drawing import Drawn, surfaces
from spinor_geom.experiments.experiment import Experiment, Outcome
from spinor_geom.gallery import KnownCurve, twisted_circle
from spinor_geom.render.plots import log_log
from spinor_geom.training import RMSprop, Trained, train_by_rmsprop


@dataclass(frozen=True, kw_only=True)
class TangentSettings:
    """What is trained.

    Attributes:
        weights: λ of each training.
        epochs: after which the surface is looked at.
        rmsprop: the paper's training.
    """

    weights: tuple[float, ...]
    epochs: tuple[int, ...]
    rmsprop: RMSprop


def measure(settings: TangentSettings) -> Outcome:
    """Trains with each weight."""
    curve = twisted_circle()
    rows: list[dict[str, Any]] = []
    drawn, lines, arrays = {}, {}, {}
    for weight in settings.weights:
        states = at_epochs(curve, replace(settings.rmsprop, tangent_weight=weight), settings.epochs)
        errors = [trained.max_per_diagonal for trained in states]
        lines[f"λ = {weight:g}"] = (settings.epochs, errors)
        arrays[f"λ = {weight:g}"] = np.array([settings.epochs, errors])
        for epoch, trained in zip(settings.epochs, states, strict=True):
            rows.append(
                {
                    "λ": weight,
                    "epoch": epoch,
                    "distance/diagonal": trained.max_per_diagonal,
                    "rms/diagonal": trained.rms_per_diagonal,
                }
            )
            drawn[f"λ = {weight:g}, epoch {epoch}"] = Drawn.of(trained.surface)
    last = {weight: row for weight in settings.weights for row in rows if row["λ"] == weight}
    without, with_tangents = last[settings.weights[0]], last[settings.weights[-1]]
    told = "; ".join(
        f"λ = {weight:g} {row['distance/diagonal']:.3g} at most, {row['rms/diagonal']:.3g} RMS"
        for weight, row in last.items()
    )
    return Outcome(
        rows=rows,
        holds=with_tangents["distance/diagonal"] < without["distance/diagonal"],
        verdict=f"Distance from the curve in diagonals after {settings.epochs[-1]} epochs: {told}.",
        arrays=arrays,
        pictures={
            "tangents-surfaces": surfaces(drawn, curves=dict.fromkeys(drawn, curve.point), across=len(settings.epochs)),
            "tangents-errors": log_log(lines, x="epoch", y="largest distance from Γ / diagonal", linear_x=True),
        },
    )


def at_epochs(curve: KnownCurve, options: RMSprop, epochs: tuple[int, ...]) -> list[Trained]:
    """One training, looked at after some of its epochs; 0 is its start."""
    with tempfile.TemporaryDirectory() as folder:
        kept = replace(options, checkpoint=Path(folder) / "training.pt")
        return [train_by_rmsprop(curve, options=replace(kept, epochs=epoch)) for epoch in epochs]


EXPERIMENT = Experiment(
    title="training without and with the tangents' term",
    paper="λ = 0 and λ = 0.5 from the same initialisation, epochs 0 to 10; the curve with tangents is nearer.",
    here="The twisted circle, from the same random numbers, looked at after the same epochs. Seen means that λ = 0.5 "
    "has the smaller largest distance after the last one.",
    measure=measure,
    full=TangentSettings(weights=(0.0, 0.5), epochs=(0, 2, 4, 6, 8, 10), rmsprop=RMSprop()),
    quick=TangentSettings(weights=(0.0, 0.5), epochs=(0, 2, 4, 6, 8, 10), rmsprop=RMSprop(order=25)),
)
