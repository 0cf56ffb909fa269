"""The paper's route to a minimal disk: a complex-valued network, trained."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np
import torch

from spinor_geom.errors import OptionError
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.solution import Iteration, PlateauSolution
from spinor_geom.plateau.training import (
    LevenbergMarquardt,
    RMSprop,
    Trained,
    TrainingStep,
    train_by_levenberg_marquardt,
    train_by_rmsprop,
)
from spinor_geom.surface.spinor_surface import SpinorSurface

Optimizer: TypeAlias = Literal["levenberg-marquardt", "rmsprop"] | LevenbergMarquardt | RMSprop

# RMSprop's rates suit curves of the paper's size: it sees Γ with the diagonal of the unit circle's bounding box
_DIAGONAL = 2 * math.sqrt(2)
_METHODS: dict[str, Literal["distillation", "polishing", "RMSprop"]] = {
    "distillation": "distillation",
    "polishing": "polishing",
    "rmsprop": "RMSprop",
}


def optimizer_options(optimizer: Optimizer) -> LevenbergMarquardt | RMSprop:
    """The options of an optimiser, which may be given by name.

    Raises:
        OptionError: it is unknown, or trains another representation than p and q.
    """
    if isinstance(optimizer, RMSprop) and optimizer.representation != "spinor":
        raise OptionError(
            f"a Plateau solution has p and q, not the representation {optimizer.representation!r}; train that with "
            "spinor_geom.plateau.training.train_by_rmsprop"
        )
    if isinstance(optimizer, (LevenbergMarquardt, RMSprop)):
        return optimizer
    if optimizer == "levenberg-marquardt":
        return LevenbergMarquardt()
    if optimizer == "rmsprop":
        return RMSprop()
    raise OptionError(
        f"unknown optimizer {optimizer!r}; choose 'levenberg-marquardt', 'rmsprop', LevenbergMarquardt(...) or "
        "RMSprop(...)"
    )


def trained_disk(
    curve: BoundaryCurve,
    options: LevenbergMarquardt | RMSprop,
    *,
    start: PlateauSolution | None,
    device: torch.device,
    on_iteration: Callable[[Iteration], None] | None,
) -> Found:
    """A minimal disk whose p and q are networks.

    Args:
        curve: Γ, at unit size.
        options: of the network and its training.
        start: a solution over the curve at any size and place, whose p and q the network takes over first; none starts
            from random parameters on the unit disk, as RMSprop always does.
        device: where it runs.
        on_iteration: is called after each step.
    """
    history = [] if start is None else list(start.history)

    def hear(step: TrainingStep) -> None:
        iteration = Iteration(index=len(history) + 1, method=_METHODS[step.method], residual=step.loss)
        history.append(iteration)
        if on_iteration is not None:
            on_iteration(iteration)

    if isinstance(options, RMSprop):
        trained = _by_rmsprop(curve, options, device, hear)
        size = 1 / _DIAGONAL
    else:
        trained = _by_levenberg_marquardt(curve, options, start, device, hear)
        size = 1.0
    surface = trained.surface
    assert isinstance(surface, SpinorSurface)  # the other representation was refused with the options
    surface = surface.transform(scale=size)
    return Found(
        curve=curve,
        surface=surface,
        matching=trained.matching,
        misfit=trained.misfit.enlarged(size),
        area=float(surface.area()),
        route="trained",
        history=tuple(history),
        limit=trained.reason,
    )


def _by_rmsprop(
    curve: BoundaryCurve, options: RMSprop, device: torch.device, hear: Callable[[TrainingStep], None]
) -> Trained:
    larger = curve.placed(_DIAGONAL * curve.coefficients[-1], _DIAGONAL)
    return train_by_rmsprop(larger, options=options, device=device, on_epoch=hear)


def _by_levenberg_marquardt(
    curve: BoundaryCurve,
    options: LevenbergMarquardt,
    start: PlateauSolution | None,
    device: torch.device,
    hear: Callable[[TrainingStep], None],
) -> Trained:
    if start is None:
        return train_by_levenberg_marquardt(curve, options=options, device=device, on_step=hear)
    loop = start.loop
    unit = start.surface.transform(scale=1 / loop.diagonal, translation=-np.asarray(loop.centroid) / loop.diagonal)
    return train_by_levenberg_marquardt(
        curve, start=unit, matching=start.matching, options=options, device=device, on_step=hear
    )
