"""What a minimal surface is asked for with."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import torch

from spinor_geom.errors import OptionError
from spinor_geom.plateau.network_route import Cauchy
from spinor_geom.plateau.trained_route import Optimizer, Trainer, optimizer_options


@dataclass(frozen=True, kw_only=True)
class Laurent:
    """p and q between two loops as Laurent series on a round annulus, or between more on a disk with round holes.

    Attributes:
        modulus: a start: of all surfaces that are found, or of the stable ones unless those that are not are to be
            kept, the one is taken whose modulus (see `Annulus`) is nearest to this by ratio; none for the stable
            surface of least area.

    Raises:
        OptionError: the modulus is not positive.
    """

    modulus: float | None = None

    def __post_init__(self) -> None:
        if self.modulus is not None and not 0 < self.modulus < math.inf:
            raise OptionError(f"modulus must be positive and finite, got {self.modulus}")


Model: TypeAlias = Literal["auto", "cauchy", "series", "mlp"] | Cauchy | Laurent


def require_model(model: Model) -> None:
    """Checks the option `model`.

    Raises:
        OptionError: it is none of those that `solve_plateau` takes.
    """
    if not isinstance(model, (Cauchy, Laurent)) and model not in ("auto", "cauchy", "series", "mlp"):
        raise OptionError(
            f"unknown model {model!r}; choose 'auto', 'cauchy', 'series', 'mlp', Cauchy(...) or Laurent(...)"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Options:
    """What every loop of a call is solved with.

    Attributes:
        cauchy: of the Cauchy network.
        laurent: of the Laurent series between two loops, where they were asked for.
        is_free: whether the model is chosen by the loop.
        is_series: whether it is a power series.
        optimizer: of a network that is trained; none for the others.
        warm_start: whether that takes over a solution.
        is_free_between: whether Γ need not be smooth between the points of a rough loop.
        tolerance: RMS distance from Γ, in mean loop edges.
        max_iterations: limit on steps.
        leaves_unstable: whether an unstable disk is left for a better one.
        device: of the linear algebra.
    """

    cauchy: Cauchy
    laurent: Laurent | None
    is_free: bool
    is_series: bool
    optimizer: Trainer | None
    warm_start: bool
    is_free_between: bool
    tolerance: float
    max_iterations: int
    leaves_unstable: bool
    device: torch.device

    @classmethod
    def checked(
        cls,
        model: Model,
        tolerance: float,
        max_iterations: int,
        unstable: str,
        device: str | torch.device,
        *,
        optimizer: Optimizer | None = None,
        warm_start: bool = True,
        between: str = "smooth",
    ) -> Options:
        """The options of `solve_plateau`.

        Raises:
            OptionError: an unknown model or optimizer, a value out of range, or options that exclude each other.
        """
        require_model(model)
        if model != "mlp" and (optimizer is not None or not warm_start):
            raise OptionError(f"optimizer and warm_start are options of model='mlp', got model={model!r}")
        if not tolerance > 0 or max_iterations < 1:
            raise OptionError(f"tolerance and max_iterations must be positive, got {tolerance} and {max_iterations}")
        if unstable not in ("leave", "keep"):
            raise OptionError(f"unknown choice for unstable {unstable!r}; choose 'leave' or 'keep'")
        if between not in ("smooth", "free"):
            raise OptionError(f"unknown choice for between {between!r}; choose 'smooth' or 'free'")
        return cls(
            cauchy=model if isinstance(model, Cauchy) else Cauchy(),
            laurent=model if isinstance(model, Laurent) else None,
            is_free=model == "auto" or isinstance(model, Laurent),
            is_series=model == "series",
            optimizer=optimizer_options(optimizer or "levenberg-marquardt") if model == "mlp" else None,
            warm_start=warm_start,
            is_free_between=between == "free",
            tolerance=tolerance,
            max_iterations=max_iterations,
            leaves_unstable=unstable == "leave",
            device=torch.device(device),
        )
