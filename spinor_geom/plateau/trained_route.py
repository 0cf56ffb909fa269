"""What the solver knows of networks that are trained: how one is asked for its disk, and the names of the ways."""

from __future__ import annotations

from typing import Literal, Protocol, TypeAlias

import torch

from spinor_geom.errors import OptionError
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.steps import Steps


class Trainer(Protocol):
    """The options of a network and its training: `LevenbergMarquardt` or `RMSprop` of `spinor_geom.training`."""

    @property
    def takes_start(self) -> bool:
        """Whether the network can take over the p and q of a solution."""
        ...

    def disk(
        self,
        curve: BoundaryCurve,
        *,
        start: PlateauSolution | None,
        device: torch.device,
        steps: Steps,
    ) -> Found:
        """A minimal disk whose p and q are networks.

        Args:
            curve: Γ, at unit size.
            start: a solution over the curve at any size and place; none starts from random parameters on the unit disk.
            device: where it runs.
            steps: get those of the training.
        """
        ...


Optimizer: TypeAlias = Literal["levenberg-marquardt", "rmsprop"] | Trainer


def optimizer_options(optimizer: Optimizer) -> Trainer:
    """The options of an optimiser, which may be given by name.

    Raises:
        OptionError: it is unknown, or trains another representation than p and q.
    """
    from spinor_geom.training import LevenbergMarquardt, RMSprop

    if isinstance(optimizer, RMSprop) and optimizer.representation != "spinor":
        raise OptionError(
            f"a Plateau solution has p and q, not the representation {optimizer.representation!r}; train that with "
            "spinor_geom.training.train_by_rmsprop"
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
